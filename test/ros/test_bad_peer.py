"""What a sensor that is alone sends wrongly: the robot stands, and a line of the log says why."""

import re
import sys
from pathlib import Path

import pytest
from network import wait_until

HERE = Path(__file__).parent


@pytest.mark.parametrize(
    ("fault", "why"),
    [
        ("scans of NaN", "turning to look around: no pillar in the scan (it has no valid range)"),
        ("scans of inf", "turning to look around: no pillar in the scan (it has no valid range)"),
        ("scans of 0", "turning to look around: no pillar in the scan (it has no valid range)"),
        ("no rotation", "standing still: no transform from odom to base_link any more"),
        ("an infinite place", "standing still: no transform from odom to base_link any more"),
        ("velocities of NaN", "odometry reports nan m/s, nan rad/s: stopped the controller"),
        ("an infinite lidar", "the robot stands still: no transform from 'front_laser' to 'base_link'"),
    ],
)
def test_a_robot_whose_only_sensor_is_wrong_stands_and_says_why(ros, fault, why):
    ros.core()
    ros.start(sys.executable, str(HERE / "bad_peer.py"))
    launched = ros.start("roslaunch", "-p", str(ros.port), str(HERE / "bad_peer.launch"))
    speed = ros.start("rostopic", "echo", "/ground_truth/odom/twist/twist/linear/x")
    launched.says("driving to the pillar")

    def speeds():
        return [float(line) for line in speed.output.splitlines() if re.fullmatch(r"-?\d[\d.e-]*", line)]

    wait_until(lambda: speeds() and speeds()[-1] > 0.7, "it drives")
    said = len(launched.output)
    ros.start("rostopic", "pub", "-1", "/fault", "std_msgs/String", f"data: '{fault}'")
    wait_until(lambda: why in launched.output[said:], f"it says {why}")
    wait_until(lambda: abs(speeds()[-1]) < 0.02, "it stands")
    count = len(speeds())
    wait_until(lambda: len(speeds()) > count + 250, "five seconds pass")
    assert max(map(abs, speeds()[count:])) < 0.05


def test_a_clock_that_is_set_back_is_told(ros):
    """Scans and odometry agree with each other, so the robot goes on."""
    ros.core()
    ros.start(sys.executable, str(HERE / "bad_peer.py"))
    launched = ros.start("roslaunch", "-p", str(ros.port), str(HERE / "bad_peer.launch"))
    lights = ros.start("rostopic", "echo", "/diagnostics")
    launched.says("driving to the pillar")
    ros.start("rostopic", "pub", "-1", "/fault", "std_msgs/String", "data: 'a clock that is set back'")
    lights.says("s ahead of this computer's clock; set the clocks")
