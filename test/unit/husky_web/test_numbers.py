"""Numbers of the page: what has no news is not shown as present."""

from types import SimpleNamespace

import pytest
from geometry_msgs.msg import PointStamped, Vector3Stamped
from nav_msgs.msg import Odometry

from husky_highlevel_controller.datatypes import Pose
from husky_web.numbers import EXPIRY, RATE_WINDOW, Numbers
from husky_web.plots import Curve

SCENE = SimpleNamespace(
    scan_stamp=0.0, fixed_frame="odom", frames=SimpleNamespace(pose=lambda *_: Pose((1.0, 0.0, 0.0)))
)


class Network:
    """Topics on which 50 scans a second and a controller are heard up to a time [s]."""

    def __init__(self):
        series = {"distance": 1, "bearing": 1, "speed": 2, "turning": 2}
        self.numbers = Numbers({name: Curve(count) for name, count in series.items()})
        self.scan_count, self.step, self.messages = 0, 0, {}

    def take(self, use):
        return self.messages.pop(use, None)

    def go_on(self, seconds, heard):
        for _ in range(round(seconds * 10)):
            self.step += 1
            odometry = Odometry()
            odometry.header.stamp.secs, tenths = divmod(self.step, 10)
            odometry.header.stamp.nsecs = tenths * 100_000_000
            self.messages = {"odometry": odometry}
            if heard:
                self.scan_count += 5
                error = Vector3Stamped()
                error.vector.x, error.vector.y, error.header.stamp = 2.0, 0.1, odometry.header.stamp
                self.messages.update(error=error, pillar=PointStamped())
            self.numbers.take(self, SCENE, now=self.step / 10.0)
        return self.numbers


def test_a_lidar_and_a_controller_that_have_ended_leave_no_numbers():
    network = Network()
    numbers = network.go_on(5.0, heard=True)
    assert (numbers.distance, numbers.bearing, numbers.pillar) == (2.0, 0.1, (1.0, 0.0, 0.0))
    assert numbers.scans.rate == pytest.approx(50.0)
    numbers = network.go_on(max(EXPIRY, RATE_WINDOW) + 0.2, heard=False)
    assert (numbers.distance, numbers.bearing, numbers.pillar) == (None, None, None)
    assert numbers.scans.rate == 0.0
    numbers.forget()
    assert (numbers.time, numbers.speed, numbers.scans.rate) == (None, None, None)
