"""The satellite receiver: where on Earth, how fast, how wrong."""

from dataclasses import replace

import numpy as np
import pytest

from husky_highlevel_controller.datatypes import Pose, RobotState
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_highlevel_controller.simulator.sensors.gps import Gps
from husky_highlevel_controller.simulator.simulator_config import simulator_config

EXACT = replace(simulator_config().gps, drift=0.0)


def make_gps(config=EXACT, period=0.025):
    gps = Gps(config, period)
    gps.reset(np.random.default_rng(4))
    return gps


def locate(position=(0.0, 0.0, 0.0), yaw=0.0, velocity=(0.0, 0.0, 0.0)):
    state = RobotState(Pose(position, quat_from_rpy(0.0, 0.0, yaw)), velocity, (0.0, 0.0, 0.0))
    return make_gps().sample(state, 0.025)


def test_the_world_s_origin_is_where_the_husky_s_is():
    fix = locate(position=(0.0, 0.0, 0.3))
    assert (fix.latitude, fix.longitude, fix.altitude, fix.stamp) == (49.9, 8.9, 0.3, 0.025)


def test_x_is_east_and_y_is_north():
    """One degree is 111.2 km north at 49.9 degrees, and 71.8 km east (published)."""
    east, north = locate(position=(1000.0, 0.0, 0.0)), locate(position=(0.0, 1000.0, 0.0))
    assert (east.latitude, north.longitude) == (49.9, 8.9)
    assert east.longitude - 8.9 == pytest.approx(1000.0 / 71.8e3, rel=2e-3)
    assert north.latitude - 49.9 == pytest.approx(1000.0 / 111.2e3, rel=2e-3)


@pytest.mark.parametrize(
    ("yaw", "velocity"), [(0.0, (0.0, -1.0, 0.0)), (np.pi / 2, (1.0, 0.0, 0.0)), (np.pi, (0.0, 1.0, 0.0))]
)
def test_velocity_is_towards_north_west_and_up(yaw, velocity):
    assert locate(yaw=yaw, velocity=(1.0, 0.0, 0.0)).velocity == pytest.approx(velocity, abs=1e-12)


def test_the_error_wanders_slowly_by_as_much_as_asked_for():
    gps = make_gps(replace(EXACT, drift=2.0), 60.0)
    state = RobotState(Pose(), (0.0,) * 3, (0.0,) * 3)
    heights = np.array([gps.sample(state, 60.0 * i).altitude for i in range(20000)])
    assert np.std(heights) == pytest.approx(2.0, rel=0.2)
    assert np.std(np.diff(heights)) < 0.5
