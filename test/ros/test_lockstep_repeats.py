"""lockstep:=true: a ROS run repeats itself to the last bit, also where the controller sleeps."""

import contextlib
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from network import Ros

RECORDER = str(Path(__file__).with_name("record_truth.py"))
END = 24.0  # [s] of simulated time: the robot has arrived
SLEEPING_END = 7.0  # [s] of simulated time: it has slept for 2 s and driven for 5 s
SLEEPING_DEADLINE = 240.0  # [s] for that: at each scan all processes must be asleep for a moment


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


def drive(ros, *arguments, end=END):
    """The true poses of a run of controller.launch, by stamp."""
    recorder = ros.start(sys.executable, RECORDER, str(ros.folder / "poses"), str(end))
    launched = ros.roslaunch("controller.launch", "lockstep:=true", "real_time_factor:=0", *arguments)
    assert recorder.wait() == 0, recorder.output
    assert end < END or "arrived" in launched.output, launched.output
    assert "continuing without lockstep" not in launched.output, launched.output
    ros.end()
    return recorded(ros)


def recorded(ros):
    """The true poses that the recorder wrote, by stamp."""
    rows = [line.split(maxsplit=1) for line in (ros.folder / "poses").read_text().splitlines()]
    return {int(stamp): pose for stamp, pose in rows}


@pytest.fixture(scope="module")
def of_seed_1(tmp_path_factory):
    """A drive with seed 1."""
    ros = Ros(tmp_path_factory.mktemp("of_seed_1"))
    try:
        return drive(ros, "seed:=1")
    finally:
        ros.end()


@pytest.mark.parametrize("busy", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_two_runs_are_the_same_to_the_last_bit_on_a_busy_machine_too(busy, of_seed_1, network):
    ros = network("busy")
    for _ in range(busy):
        ros.start(sys.executable, "-c", "while True: pass")
    second = drive(ros, "seed:=1")
    common = of_seed_1.keys() & second.keys()
    assert len(common) > 1000
    assert [stamp for stamp in common if of_seed_1[stamp] != second[stamp]] == []


def test_another_seed_is_another_run(of_seed_1, network):
    second = drive(network("of_seed_2"), "seed:=2", end=3.0)
    common = of_seed_1.keys() & second.keys()
    assert [stamp for stamp in common if of_seed_1[stamp] != second[stamp]]


HEAD = """
import rospy
from geometry_msgs.msg import Twist, Vector3
from sensor_msgs.msg import LaserScan


def steer(scan):
    distance, beam = min((r, i) for i, r in enumerate(scan.ranges) if r > 0.1)
    angle = scan.angle_min + beam * scan.angle_increment
    velocity.publish(Twist(Vector3(0.5, 0.0, 0.0), Vector3(0.0, 0.0, -angle)))


scans = []
rospy.init_node("it")
velocity = rospy.Publisher("cmd_vel", Twist, queue_size=1)
"""
LOOP = """
rospy.Subscriber("front/scan", LaserScan, scans.append, queue_size=1)
rospy.sleep(2.0)
rate = rospy.Rate({rate})
while not rospy.is_shutdown():
    if scans:
        steer(scans[-1])
        del scans[:-1]
    rate.sleep()
"""
CALLBACK = """
def on_scan(scan):
    steer(scan)
    rospy.Rate(1000).sleep()


rospy.Subscriber("front/scan", LaserScan, on_scan)
rospy.spin()
"""
SLEEPERS = {  # what students write
    "after each command": HEAD + LOOP.format(rate=10),
    "to each tick of the clock": HEAD + LOOP.format(rate=100),
    "in the callback": HEAD + CALLBACK,
}


def sleeping_drive(ros, script):
    """True poses of a drive of a controller that sleeps by simulated time."""
    recorder = ros.start(sys.executable, RECORDER, str(ros.folder / "poses"), str(SLEEPING_END))
    launched = ros.roslaunch("simulator.launch", "lockstep:=true", "real_time_factor:=0")
    # a node that starts before /use_sim_time is set sleeps by wall time
    launched.says("lockstep: waiting for")
    ros.start(sys.executable, "-c", script)
    assert recorder.wait(SLEEPING_DEADLINE) == 0, recorder.output
    assert "continuing without lockstep" not in launched.output, launched.output
    ros.end()
    return recorded(ros)


@pytest.mark.parametrize(
    "sleeps",
    [
        "after each command",
        pytest.param("to each tick of the clock", marks=pytest.mark.slow),
        "in the callback",
    ],
)
def test_a_controller_that_sleeps_by_simulated_time_repeats_itself_too(network, sleeps):
    networks = network("first"), network("second")
    with ThreadPoolExecutor() as side_by_side:
        first, second = side_by_side.map(sleeping_drive, networks, [SLEEPERS[sleeps]] * 2)
    common = sorted(first.keys() & second.keys())
    assert len(common) > 250
    assert first[common[0]] != first[common[-1]], "it drives"
    assert [stamp for stamp in common if first[stamp] != second[stamp]] == []


TELEPORT = """
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import SetModelState

rospy.wait_for_service("/gazebo/set_model_state")
put = rospy.ServiceProxy("/gazebo/set_model_state", SetModelState)


def on_scan(scan):
    scans.append(scan)
    if len(scans) % 100 == 0:  # a new episode
        state = ModelState(model_name="husky")
        state.pose.position.x, state.twist.linear.x = -len(scans) / 100.0, 0.3
        put(state)
    steer(scan)


rospy.Subscriber("front/scan", LaserScan, on_scan)
rospy.spin()
"""


def test_episodes_that_begin_with_gazebo_s_set_model_state_repeat_themselves(network):
    networks = network("first"), network("second")
    with ThreadPoolExecutor() as side_by_side:
        first, second = side_by_side.map(sleeping_drive, networks, [HEAD + TELEPORT] * 2)
    common = sorted(first.keys() & second.keys())
    assert len(common) > 250
    assert min(float.fromhex(first[stamp].split()[0]) for stamp in common) < -2.5, "it was put there"
    assert [stamp for stamp in common if first[stamp] != second[stamp]] == []


STEPPING_CONTROLLER = """
import threading

import rospy
from geometry_msgs.msg import Twist
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger

from husky_highlevel_controller.srv import ListObjects, StepWorld

rospy.init_node("stepping_controller")
velocity = rospy.Publisher("cmd_vel", Twist, queue_size=1)
pause, step, list_objects = (
    rospy.ServiceProxy(f"husky_simulator/{name}", kind)
    for name, kind in (("pause", Trigger), ("step", StepWorld), ("list", ListObjects))
)
scans, computed = [], threading.Event()


def compute():
    while not computed.is_set():  # a process that sleeps is not waited for
        pass


def ask_for_a_step():
    print("stepped:", step(3).status_message, flush=True)


def on_scan(scan):
    scans.append(scan)
    if len(scans) == 5:
        pause()
        caller = threading.Thread(target=ask_for_a_step)
        caller.start()
        threading.Thread(target=compute, daemon=True).start()
        for _ in range(3):
            list_objects("")  # answered while the scan waits for a command
        print("the step waits:", caller.is_alive(), flush=True)
        computed.set()
    velocity.publish(Twist())


rospy.Subscriber("front/scan", LaserScan, on_scan)
rospy.spin()
"""


def test_a_step_asked_for_while_a_scan_waits_for_its_answer_is_made_afterwards(network):
    ros = network("paused")
    launched = ros.roslaunch("simulator.launch", "lockstep:=true", "real_time_factor:=0")
    controller = ros.start(sys.executable, "-c", STEPPING_CONTROLLER)
    controller.says("stepped: 3 steps; it is now ")
    assert "the step waits: True" in controller.output
    assert "continuing without lockstep" not in launched.output, launched.output
