"""A node for tests: writes the true poses up to a simulated time to a file, to the last bit."""

import sys

import rospy
from nav_msgs.msg import Odometry


def main(path, end):
    rows = []

    def remember(msg):
        p, q = msg.pose.pose.position, msg.pose.pose.orientation
        rows.append(
            (msg.header.stamp.to_nsec(), *(float(v).hex() for v in (p.x, p.y, p.z, q.x, q.y, q.z, q.w)))
        )
        if msg.header.stamp.to_sec() >= end:
            rospy.signal_shutdown("recorded")

    rospy.init_node("recorder")
    rospy.Subscriber("ground_truth/odom", Odometry, remember, queue_size=10000)
    rospy.spin()
    with open(path, "w") as file:
        file.writelines(" ".join(map(str, row)) + "\n" for row in rows)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
