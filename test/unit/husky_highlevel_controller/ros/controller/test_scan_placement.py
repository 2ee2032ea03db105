"""Every scan becomes one observation, with the pose of its own stamp, whichever of the two arrives last."""

import numpy as np
import pytest

rospy = pytest.importorskip("rospy")
tf2_ros = pytest.importorskip("tf2_ros")

from geometry_msgs.msg import TransformStamped  # noqa: E402

from husky_highlevel_controller.datatypes import Scan  # noqa: E402
from husky_highlevel_controller.robot import load_robot  # noqa: E402
from husky_highlevel_controller.ros.controller.scan_placement import (  # noqa: E402
    MAX_UNPLACED_SCANS,
    START_TIMEOUT,
    TRANSFORM_TIMEOUT,
    ScanPlacement,
)


class Fixture:
    """A placement with its TF buffer, the observations it made, and a wall clock that is set by hand."""

    def __init__(self):
        self.now, self.observations = 0.0, []
        self.transforms = tf2_ros.Buffer(debug=False)
        outline = load_robot().footprint
        self.placement = ScanPlacement(self.transforms, self.observations.append, outline, lambda: self.now)

    def mount(self, x=0.3):
        """As a message on /tf_static."""
        self.transforms.set_transform_static(transform("base_link", "laser", 0.0, x), "test")
        self.placement.forget_mount()

    def pose(self, stamp, x):
        self.transforms.set_transform(transform("odom", "base_link", stamp, x), "test")
        self.placement.update()

    def scan(self, stamp):
        self.placement.add(scan(stamp), rospy.Time.from_sec(stamp))

    def answers(self):
        """Stamp and x of base_link in odom of each observation; None for no pose."""
        return [(seen.scan.stamp, seen.base_in_odom and seen.base_in_odom.x) for seen in self.observations]


def transform(parent, child, stamp, x):
    msg = TransformStamped(child_frame_id=child)
    msg.header.frame_id, msg.header.stamp = parent, rospy.Time.from_sec(stamp)
    msg.transform.translation.x, msg.transform.rotation.w = x, 1.0
    return msg


def scan(stamp):
    return Scan(stamp, "laser", -1.0, 1.0, 0.1, 30.0, np.full(3, 2.0))


@pytest.fixture
def placed():
    """A placement that knows the lidar's mount and has answered the scan of 1 s."""
    fixture = Fixture()
    fixture.mount()
    fixture.pose(1.0, 10.0)
    fixture.scan(1.0)
    assert fixture.answers() == [(1.0, 10.0)]
    fixture.observations.clear()
    return fixture


@pytest.mark.parametrize(
    ("story", "answers"),
    [
        # scans and poses by their stamps
        ("pose 2", ""),
        ("pose 2, scan 2", "2"),
        ("scan 2, pose 1.5", ""),
        ("scan 2, pose 1.5, pose 2, pose 3", "2"),
        ("scan 1.5, pose 2", "1.5"),  # interpolated
        # of those that arrive while one is pending the newest is next
        ("scan 2, scan 3, scan 4, pose 2, pose 3", "2"),
        ("scan 2, scan 3, scan 4, pose 2, pose 3, pose 4", "2 4"),
        ("scan 2, scan 2, pose 2, pose 3", "2"),  # one that is sent again
        # poses that are always later than the next scan starve none
        (", ".join(f"scan {n}, pose {n - 1}" for n in range(2, 20)), " ".join(map(str, range(2, 19)))),
        ("scan 2, scan 3, clock starts, pose 0.05, scan 0.1, pose 0.1, pose 3", "0.1"),
        ("clock starts, pose 0, scan 0.1, pose 0.1", "0.1"),  # a stamp of 0 does not mean a fixed pose
        ("scan 2, scan 3, discard all, pose 3", ""),
    ],
)
def test_each_scan_is_answered_once_with_the_pose_of_its_own_stamp(placed, story, answers):
    for event in story.split(", "):
        what, stamp = event.split()
        if what == "pose":
            placed.pose(float(stamp), 10.0 * float(stamp))
        elif what == "scan":
            placed.scan(float(stamp))
        else:
            {"clock": placed.transforms.clear, "discard": placed.placement.discard}[what]()
    expected = [(float(stamp), pytest.approx(10.0 * float(stamp))) for stamp in answers.split()]
    assert placed.answers() == expected


def test_odometry_that_stops_is_waited_for_once_and_then_its_last_pose_has_to_do(placed):
    placed.scan(2.0)
    placed.now = 0.9 * TRANSFORM_TIMEOUT
    placed.placement.update()
    assert placed.answers() == []
    placed.now = 1.1 * TRANSFORM_TIMEOUT
    placed.placement.update()
    placed.scan(3.0)
    assert placed.answers() == [(2.0, 10.0), (3.0, 10.0)]
    placed.scan(3.1)
    assert placed.answers()[2:] == [(3.1, None)], "a robot does not drive on by a pose that is 2 s old"
    placed.pose(3.5, 35.0)
    placed.scan(4.0)
    assert len(placed.answers()) == 3, "odometry is back: its pose is waited for again"


def test_the_first_scan_waits_until_lidar_and_odometry_have_a_place():
    fixture = Fixture()
    fixture.scan(1.0)
    fixture.pose(1.0, 10.0)
    assert fixture.answers() == []
    fixture.mount()
    fixture.placement.update()
    assert fixture.answers() == [(1.0, 10.0)]
    assert fixture.observations[0].laser_in_base.position[0] == pytest.approx(0.3)


def test_without_any_transform_the_first_scan_is_answered_at_a_deadline_and_the_others_at_once():
    fixture = Fixture()
    fixture.scan(1.0)
    fixture.now = 0.9 * START_TIMEOUT
    fixture.placement.update()
    assert fixture.answers() == []
    fixture.now = 1.1 * START_TIMEOUT
    fixture.placement.update()
    fixture.scan(2.0)
    assert fixture.answers() == [(1.0, None), (2.0, None)]
    assert fixture.observations[0].laser_in_base is None


def test_a_lidar_without_a_place_is_told_and_gets_the_one_where_it_is_put_later(monkeypatch):
    warnings = []
    monkeypatch.setattr(rospy, "logwarn_throttle", lambda _, text: warnings.append(text))
    fixture = Fixture()
    fixture.scan(1.0)
    fixture.now = 1.1 * START_TIMEOUT
    for number in range(2, MAX_UNPLACED_SCANS + 1):
        fixture.scan(float(number))
    assert warnings == [], "TF may take a moment, which is not a reason for a warning"
    fixture.scan(MAX_UNPLACED_SCANS + 1.0)
    (warning,) = warnings
    assert "'laser' to 'base_link'" in warning
    assert "robot_state_publisher" in warning, "it says what would help"
    for x in (0.3, 0.5):
        fixture.mount(x)
        fixture.scan(fixture.answers()[-1][0] + 1.0)
        assert fixture.observations[-1].laser_in_base.position[0] == x


@pytest.mark.parametrize("ahead", [0.1, 0.3, 0.5, 2.0, 3600.0])
def test_scans_stamped_by_a_clock_that_is_ahead_are_answered_at_ten_hertz(ahead):
    """Scans at 20 Hz, odometry at 50 Hz, as on a robot whose lidar has a clock of its own."""
    fixture = Fixture()
    fixture.mount()
    answered = {}  # wall time by stamp
    for step in range(600):
        fixture.now = 1000.0 + 0.01 * step
        if step % 2 == 0:
            fixture.pose(fixture.now, fixture.now)
        if step % 5 == 0:
            fixture.scan(fixture.now + ahead)
        fixture.placement.update()
        answered.update((stamp, fixture.now) for stamp, _ in fixture.answers() if stamp not in answered)
    assert len([at for at in answered.values() if 1002.0 <= at < 1006.0]) >= 40
    assert fixture.placement.ahead_of_odometry == pytest.approx(ahead, abs=0.021)
    last = fixture.observations[-1]
    assert last.ahead_of_odometry == fixture.placement.ahead_of_odometry
    assert last.base_in_odom.x == pytest.approx(last.scan.stamp - ahead, abs=0.05), "where the robot was then"


def test_clocks_alike_are_waited_for_to_the_last_even_where_every_pose_is_late():
    fixture = Fixture()
    fixture.mount()
    for step in range(300):
        fixture.now = 1000.0 + 0.02 * step
        fixture.scan(fixture.now)
        fixture.now += 0.01
        fixture.pose(1000.0 + 0.02 * step, float(step))
    assert fixture.answers() == [(pytest.approx(1000.0 + 0.02 * step), step) for step in range(300)]
    assert fixture.placement.ahead_of_odometry == 0.0
