"""proximity_stop says that it cannot judge, but not while the robot's nodes are still starting."""

import pytest

pytest.importorskip("rospy")

from husky_highlevel_controller.ros.safety.proximity_stop import Blindness


def test_a_second_without_odometry_is_the_start_and_more_is_a_warning():
    blindness = Blindness()
    assert not any(blindness.lasts(stamp) for stamp in (10.0, 10.5, 10.95))
    assert blindness.lasts(11.05)
    blindness.end()
    assert not blindness.lasts(12.0)


def test_a_simulation_that_begins_again_may_start_again():
    blindness = Blindness()
    assert not any(blindness.lasts(stamp) for stamp in (100.0, 0.0, 0.9))
    assert blindness.lasts(1.1)
