"""Controller that drives for long: stress_client.py SECONDS PID.

It answers every scan with a command until so much simulated time has passed, then prints how many scans there
were, by how much the memory of process PID has grown since second 10 [kB], and every gap between two scans
[ms].
"""

import sys
import time

import psutil
import rospy
from geometry_msgs.msg import Twist, Vector3
from sensor_msgs.msg import LaserScan

DEADLINE = 60.0  # [s] of wall time, and a second more for each simulated one


def main(end, pid):
    rospy.init_node("stress_client")
    velocity = rospy.Publisher("cmd_vel", Twist, queue_size=1, tcp_nodelay=True)
    stamps, sizes = [], []

    def answer(scan):
        if len(sizes) == 2:
            return  # the node is about to end
        if not stamps or scan.header.stamp != stamps[-1]:  # the first one comes again if its answer was lost
            stamps.append(scan.header.stamp)
        if len(stamps) in (500, round(float(end) * 50)):
            sizes.append(psutil.Process(int(pid)).memory_info().rss // 1024)
        turning = 0.5 if len(stamps) % 1000 < 500 else -0.4
        velocity.publish(Twist(Vector3(0.7, 0.0, 0.0), Vector3(0.0, 0.0, turning)))

    rospy.Subscriber("front/scan", LaserScan, answer, queue_size=100, tcp_nodelay=True)
    limit = time.monotonic() + DEADLINE + float(end)
    while len(sizes) < 2:
        assert time.monotonic() < limit, f"simulated time never was {end} s"
        time.sleep(0.05)
    gaps = {(b - a).to_nsec() / 1e6 for a, b in zip(stamps, stamps[1:])}
    print(len(stamps), sizes[1] - sizes[0], *gaps)


main(*sys.argv[1:])
