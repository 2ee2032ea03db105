"""Launched with paused:=true the world waits for gazebo/unpause_physics; gazebo/pause_physics holds it."""

from math import isfinite

import rospy
from harness import RosTest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Empty
from tf2_msgs.msg import TFMessage


def children(messages):
    return {transform.child_frame_id for msg in list(messages) for transform in msg.transforms}


class PauseHoldsClock(RosTest):
    def test_time_stands_still_while_paused(self):
        clock = self.remember("clock", Clock)
        pause = rospy.ServiceProxy("gazebo/pause_physics", Empty)
        unpause = rospy.ServiceProxy("gazebo/unpause_physics", Empty)
        unpause.wait_for_service(30.0)

        def times():
            return [msg.clock.to_sec() for msg in list(clock)]

        self.wait_until(lambda: len(clock) >= 10, "a paused clock is told all the same")
        self.assertEqual(set(times()), {0.0}, "paused from the start")
        scans, transforms = self.remember("front/scan", LaserScan), self.remember("tf", TFMessage)
        self.wait_until(lambda: scans, "a scan of the beginning")
        self.assertGreater(sum(isfinite(distance) for distance in scans[0].ranges), 0, "of the pillar")
        self.wait_until(lambda: len(children(transforms)) == 5, "base_link and the wheels are told")
        count = len(clock)
        self.wait_until(lambda: len(clock) > count + 10, "the held clock is told")
        self.assertEqual([msg.header.stamp.to_sec() for msg in list(scans)], [0.0], "one scan")
        unpause()
        self.wait_until(lambda: times()[-1] > 1.0, "time goes on")
        pause()
        self.wait_until(lambda: len(times()) > 5 and len(set(times()[-5:])) == 1, "time stands still")
        held, count = times()[-1], len(clock)
        self.wait_until(lambda: len(clock) > count + 10, "the held clock is told")
        self.assertEqual(times()[-1], held)
        unpause()
        self.wait_until(lambda: times()[-1] > held + 1.0, "time goes on where it was held")
        self.assertEqual(times(), sorted(times()), "it never ran backwards")
