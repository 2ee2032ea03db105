"""lockstep:=true: a whole ROS run repeats itself to the last bit, and nobody can stop the clock for good."""

import contextlib
import sys
from pathlib import Path

import pytest
from network import Ros, wait_until

RECORDER = str(Path(__file__).with_name("record_truth.py"))
END = 24.0  # [s] of simulated time: the robot has arrived


@pytest.fixture
def network(tmp_path):
    """Makes ROS networks and ends them."""
    with contextlib.ExitStack() as stack:

        def make(name):
            folder = tmp_path / name
            folder.mkdir()
            ros = Ros(folder)
            stack.callback(ros.end)
            return ros

        yield make


def drive(ros, *arguments):
    """The true poses of a run of controller.launch, by stamp."""
    recorder = ros.start(sys.executable, RECORDER, str(ros.folder / "poses"), str(END))
    launched = ros.roslaunch("controller.launch", "lockstep:=true", "real_time_factor:=0", *arguments)
    assert recorder.wait() == 0, recorder.output
    assert "arrived" in launched.output, launched.output
    assert "running free" not in launched.output, launched.output
    ros.end()
    rows = [line.split(maxsplit=1) for line in (ros.folder / "poses").read_text().splitlines()]
    return {int(stamp): pose for stamp, pose in rows}


def start_controller(ros, answer):
    """A node whose answer to every scan is an expression."""
    script = (
        "import rospy; from sensor_msgs.msg import LaserScan; from geometry_msgs.msg import Twist;"
        "rospy.init_node('it'); seen = []; velocity = rospy.Publisher('cmd_vel', Twist, queue_size=1);"
        f"rospy.Subscriber('front/scan', LaserScan, lambda scan: {answer}); rospy.spin()"
    )
    ros.start(sys.executable, "-c", script)


def test_two_runs_are_the_same_to_the_last_bit_on_a_busy_machine_too(network):
    first = drive(network("first"))
    busy = network("busy")
    busy.start(sys.executable, "-c", "while True: pass")
    busy.start(sys.executable, "-c", "while True: pass")
    second = drive(busy)
    common = first.keys() & second.keys()
    assert len(common) > 1000
    assert [stamp for stamp in common if first[stamp] != second[stamp]] == []


def test_another_seed_is_another_run(network):
    first, second = (drive(network(seed), f"seed:={seed}") for seed in ("1", "2"))
    common = first.keys() & second.keys()
    assert [stamp for stamp in common if first[stamp] != second[stamp]]


def test_a_controller_that_never_answers_holds_the_clock_only_until_a_deadline(network):
    ros = network("silent")
    launched = ros.roslaunch("simulator.launch", "lockstep:=true", "real_time_factor:=0")
    start_controller(ros, "None")
    launched.says("no command answers the scan; running free from now on")
    echo = ros.start("rostopic", "echo", "-n", "300", "/clock")
    assert echo.wait() == 0
    wait_until(lambda: launched.output.count("running free") == 1, "it says so once")


def test_a_first_answer_that_is_lost_is_asked_for_again(network):
    ros = network("late")
    launched = ros.roslaunch("simulator.launch", "lockstep:=true", "real_time_factor:=0")
    start_controller(ros, "seen.append(scan) or len(seen) == 1 or velocity.publish(Twist())")
    launched.says("simulating")
    echo = ros.start("rostopic", "echo", "-n", "300", "/clock")
    assert echo.wait() == 0
    assert "running free" not in launched.output, launched.output
