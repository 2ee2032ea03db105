"""Stress client of a simulator for test_faults.py: floods, hangs, dies, and reports what happened.

speed V WORDS: wait until the robot drives at V m/s, then print WORDS.
time T:        wait until simulated time is T s, then print it.
flood N:       send N commands for each of two simulated seconds, then print how many, and the speed.
drive T PID:   answer every scan with a command until simulated time is T s, then print how many scans there
               were, by how much the memory of process PID has grown since second 10 [kB], and every gap
               between two scans [ms].
objects N:     spawn N objects and delete them, then print what is left.
"""

import sys
import time

import rospy
from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3
from husky_highlevel_controller.srv import DeleteObject, ListObjects, SpawnObject
from nav_msgs.msg import Odometry
from network import memory
from sensor_msgs.msg import LaserScan

DEADLINE = 60.0  # [s]


def speed():
    return rospy.wait_for_message("ground_truth/odom", Odometry, DEADLINE).twist.twist.linear.x


def wait_for_speed(wanted, words):
    end = time.monotonic() + DEADLINE
    while abs(speed() - float(wanted)) > 0.1:
        assert time.monotonic() < end, f"the robot never drove at {wanted} m/s"
    print(words)


def wait_for_time(wanted):
    rospy.wait_for_message("ground_truth/odom", Odometry, DEADLINE)
    end = time.monotonic() + DEADLINE
    while rospy.get_time() < float(wanted):
        assert time.monotonic() < end, f"simulated time never was {wanted} s, it is {rospy.get_time()} s"
        time.sleep(0.005)
    print(rospy.get_time())


def flood(rate):
    velocity = rospy.Publisher("cmd_vel", Twist, queue_size=1000)
    command, states = Twist(linear=Vector3(0.5, 0.0, 0.0)), []
    rospy.Subscriber("ground_truth/odom", Odometry, states.append, queue_size=1)
    rospy.wait_for_message("ground_truth/odom", Odometry, DEADLINE)
    begin, many = rospy.get_time(), 2 * int(rate)
    for sent in range(many):
        while rospy.get_time() < begin + sent / float(rate):
            time.sleep(0.001)
        velocity.publish(command)
    print(many, states[-1].twist.twist.linear.x)  # not a later one: without commands it brakes


def drive(end, pid):
    velocity = rospy.Publisher("cmd_vel", Twist, queue_size=1, tcp_nodelay=True)
    stamps, sizes = [], []

    def answer(scan):
        if len(sizes) == 2:
            return  # the node is about to end
        if not stamps or scan.header.stamp != stamps[-1]:  # the first one comes again if its answer was lost
            stamps.append(scan.header.stamp)
        if len(stamps) in (500, round(float(end) * 50)):
            sizes.append(memory(int(pid)))
        turning = 0.5 if len(stamps) % 1000 < 500 else -0.4
        velocity.publish(Twist(Vector3(0.7, 0.0, 0.0), Vector3(0.0, 0.0, turning)))

    rospy.Subscriber("front/scan", LaserScan, answer, queue_size=100, tcp_nodelay=True)
    limit = time.monotonic() + DEADLINE + float(end)
    while len(sizes) < 2:
        assert time.monotonic() < limit, f"simulated time never was {end} s"
        time.sleep(0.05)
    gaps = {(b - a).to_nsec() / 1e6 for a, b in zip(stamps, stamps[1:])}
    print(len(stamps), sizes[1] - sizes[0], *gaps)


def spawn_and_delete(count):
    names = [f"thing_{i}" for i in range(int(count))]
    rospy.wait_for_service("husky_simulator/list", DEADLINE)
    spawn = rospy.ServiceProxy("husky_simulator/spawn", SpawnObject, persistent=True)
    delete = rospy.ServiceProxy("husky_simulator/delete", DeleteObject, persistent=True)
    for i, name in enumerate(names):
        pose = Pose(Point(2.0 + i // 40, i % 40 - 20.0, 0.3), Quaternion(0.0, 0.0, 0.0, 1.0))
        shape = ("box", "cylinder", "sphere")[i % 3]
        made = spawn(model_name=name, shape=shape, size=Vector3(0.5, 0.5, 0.5), mass=1.0, initial_pose=pose)
        assert made.success, made.status_message
    for name in names:
        gone = delete(name)
        assert gone.success, gone.status_message
    print(rospy.ServiceProxy("husky_simulator/list", ListObjects)("").status_message)


if __name__ == "__main__":
    rospy.init_node("stress_client", anonymous=True)
    {
        "speed": wait_for_speed,
        "time": wait_for_time,
        "flood": flood,
        "drive": drive,
        "objects": spawn_and_delete,
    }[sys.argv[1]](*sys.argv[2:])
