"""Nodes of the benchmark, each a process of its own: `probe.py RESULT.json NODE ...`.

first            write the time of the first scan, by the machine's monotonic clock
arrived          write the time of the controller's arrival, by the same clock
scans FROM TO    start simulated time, and measure its real-time factor between two stamps [s]
latency SCANS    send scans of a whole drive at 50 Hz, and measure the time from each scan to its command
answer           answer every scan with a zero command, which is the least that a controller can do
"""

from __future__ import annotations

import argparse
import json
import os
import struct
import time
from math import atan2
from pathlib import Path
from threading import Event
from typing import Any, Dict, List, Tuple

import numpy as np
import rosgraph
import rospy
from geometry_msgs.msg import Twist
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool
from std_srvs.srv import Empty
from tf2_msgs.msg import TFMessage

from husky_evaluation.rollout import model_of
from husky_evaluation.scenarios import course_scenario
from husky_highlevel_controller.datatypes import Pose2D, Snapshot, Twist2D
from husky_highlevel_controller.geometry import pose_from_2d
from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.simulator.simulation import Simulation
from husky_highlevel_controller.simulator.simulator_config import simulator_config

ARRIVED = "/husky_highlevel_controller/arrived"
PERIOD = 0.02  # [s] between two scans
DRIVE_TIME = 19.2  # [s] time of a drive at 1 m/s to 1.2 m from the pillar's centre
ANSWER_TIMEOUT = 1.0  # [s] wall time for the answer to one scan
Arrival = Tuple[float, float]  # stamp of a scan, and when it was received [s]


def first() -> Dict[str, Any]:
    """Receive one scan."""
    rospy.wait_for_message("/front/scan", rospy.AnyMsg)
    return {"first": time.monotonic()}


def arrived() -> Dict[str, Any]:
    """Wait for the arrival of the controller."""
    has_arrived = Event()
    # one subscription, because rospy.wait_for_message in a loop would subscribe again and again: each time it
    # would get the last message, and cost the controller time
    rospy.Subscriber(ARRIVED, Bool, lambda msg: has_arrived.set() if msg.data else None, tcp_nodelay=True)
    has_arrived.wait()
    return {"arrived": time.monotonic()}


def scans(start: float, end: float) -> Dict[str, Any]:
    """Measure the real-time factor from the stamp `start` to the stamp `end`, and whether all scans come.

    Only the stamps of the scans are read, so that this node takes little time from the other nodes.
    """
    arrivals: List[Arrival] = []
    done = Event()

    def receive(msg: rospy.AnyMsg) -> None:
        now = time.monotonic()
        # a scan begins with its header: number of the message, stamp in seconds and nanoseconds
        _, seconds, nanoseconds = struct.unpack_from("<III", msg._buff)
        arrivals.append((seconds + nanoseconds * 1e-9, now))
        if arrivals[-1][0] >= end:
            done.set()

    # without a `queue_size`, rospy drops no message
    begin(rospy.Subscriber("/front/scan", rospy.AnyMsg, receive, tcp_nodelay=True))
    done.wait()
    within = [(stamp, wall) for stamp, wall in arrivals if start - PERIOD / 2 <= stamp <= end + PERIOD / 2]
    stamps = [stamp for stamp, _ in within]
    due = np.arange(round((end - start) / PERIOD) + 1) * PERIOD + start
    has_all_scans = len(stamps) == len(due) and np.allclose(stamps, due, rtol=0.0, atol=1e-6)
    factor = (stamps[-1] - stamps[0]) / (within[-1][1] - within[0][1])
    return {"factor": factor, "has_all_scans": bool(has_all_scans)}


def begin(subscription: rospy.Subscriber) -> None:
    """Start the paused simulator as soon as this node and the controller subscribe to the scans."""
    master = rosgraph.Master(rospy.get_name())
    listeners: List[str] = []
    while not subscription.get_num_connections() or len(listeners) < 2:
        time.sleep(PERIOD)
        listeners = dict(master.getSystemState()[1]).get(subscription.resolved_name, [])
    rospy.wait_for_service("/gazebo/unpause_physics")
    rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()


def latency(count: int) -> Dict[str, Any]:
    """Send `count` recorded scans at 50 Hz, each after its TF; measure the times to their commands [s]."""
    snapshots = recorded(count)
    answered = Event()
    answers: List[float] = []

    def receive(_: Twist) -> None:
        answers.append(time.monotonic())
        answered.set()

    rospy.Subscriber("/cmd_vel", Twist, receive, tcp_nodelay=True)
    fixed = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
    tree = rospy.Publisher("/tf", TFMessage, queue_size=10)
    scan = rospy.Publisher("/front/scan", LaserScan, queue_size=10)
    robot = model_of(load_robot())
    fixed.publish(conversions.tree_to_msg(robot.fixed_joints, 0.0))
    while not scan.get_num_connections() and not rospy.is_shutdown():
        time.sleep(PERIOD)
    times: List[float] = []
    for snapshot in snapshots:
        begin = time.monotonic()
        assert snapshot.scan is not None
        assert snapshot.odometry is not None
        base_in_odom = pose_from_2d(snapshot.odometry.filtered.pose_base_in_odom)
        tree.publish(conversions.tree_to_msg([("odom", "base_link", base_in_odom)], snapshot.stamp))
        msg = conversions.scan_to_msg(snapshot.scan)
        answered.clear()
        sent = time.monotonic()
        scan.publish(msg)
        if answered.wait(ANSWER_TIMEOUT):
            times.append(answers[-1] - sent)
        time.sleep(max(begin + PERIOD - time.monotonic(), 0.0))
    return {"latencies": times[len(times) // 10 :], "missing": count - len(times)}  # the first ones warm up


def recorded(count: int) -> List[Snapshot]:
    """Return snapshots of a straight drive to the course's pillar.

    At first 3 beams meet the pillar, and 50 at the end.
    """
    course = course_scenario()
    (pillar,) = (body for body in course.world.bodies if body.name == course.pillar)
    x, y, _ = pillar.pose_in_world.position
    start = Pose2D(yaw=atan2(y, x))
    simulation = Simulation(course.world, model_of(load_robot()), simulator_config(), start, course.seed)
    found: List[Snapshot] = []
    while simulation.stamp < DRIVE_TIME:
        simulation.command(Twist2D(1.0, 0.0))
        snapshot = simulation.step()
        if snapshot.scan is not None:
            found.append(snapshot)
    simulation.close()
    return [found[index] for index in np.linspace(0, len(found) - 1, count).astype(int)]


def answer() -> None:
    """Answer every scan with a zero command."""
    velocity = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
    rospy.Subscriber(
        "/front/scan", LaserScan, lambda _: velocity.publish(Twist()), queue_size=1, tcp_nodelay=True
    )
    rospy.spin()


def main() -> None:
    """Run one of the nodes."""
    parser = argparse.ArgumentParser()
    parser.add_argument("result", type=Path)
    parser.add_argument("node", choices=["first", "arrived", "scans", "latency", "answer"])
    parser.add_argument("numbers", type=float, nargs="*")  # FROM TO, or SCANS
    wanted = parser.parse_args()
    rospy.init_node(f"bench_{wanted.node}", anonymous=True, disable_rosout=True)
    if wanted.node == "answer":
        answer()
        return
    if wanted.node == "scans":
        figures = scans(*wanted.numbers)
    elif wanted.node == "latency":
        figures = latency(int(wanted.numbers[0]))
    else:
        figures = {"first": first, "arrived": arrived}[wanted.node]()
    partial = wanted.result.with_suffix(".part")
    partial.write_text(json.dumps(figures))
    os.replace(partial, wanted.result)  # a reader never sees half of it


if __name__ == "__main__":
    main()
