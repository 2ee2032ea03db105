"""Launched with paused:=true the world waits for gazebo/unpause_physics; gazebo/pause_physics holds it."""

from math import isfinite

import rospy
from geometry_msgs.msg import Point, Pose, Quaternion
from harness import RosTest, simulator_service
from husky_highlevel_controller.srv import MoveObject
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Empty, Trigger
from tf2_msgs.msg import TFMessage


def children(messages):
    return {transform.child_frame_id for msg in list(messages) for transform in msg.transforms}


def positions(messages, child):
    """Where the transforms put a frame in its parent [m], with their stamps [s]."""
    found = [t for msg in list(messages) for t in msg.transforms if t.child_frame_id == child]
    return [(t.header.stamp.to_sec(), t.transform.translation.x, t.transform.translation.y) for t in found]


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
        transforms = self.remember("tf", TFMessage)
        self.wait_until(lambda: len(children(transforms)) == 5, "base_link and the wheels are told")
        self.move_and_see(transforms)
        # scans have had no subscriber before the move
        scans = self.remember("front/scan", LaserScan)
        self.wait_until(lambda: scans, "a scan of the beginning")
        nearest = min(distance for distance in scans[0].ranges if isfinite(distance))
        self.assertAlmostEqual(nearest, 20.0 - 10.0 - 0.337 - 0.2, delta=0.05, msg="of the pillar")
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

    def move_and_see(self, transforms):
        """Move the robot during the pause, twice; those who subscribe already see it."""
        self.addCleanup(simulator_service("reset", Trigger))
        move, truth = (
            simulator_service("move", MoveObject),
            self.remember("husky_simulator/world_tf", TFMessage),
        )
        for x in (5.0, 10.0):
            self.assertTrue(
                move("husky", Pose(Point(x, 5.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0)), "").success
            )
            for messages in (transforms, truth):
                self.wait_until(
                    lambda messages=messages, x=x: positions(messages, "base_link")[-1][1:] == (x, 5.0),
                    "the move is shown",
                )
        stamps = [stamp for stamp, _, _ in positions(transforms, "base_link")]
        self.assertEqual(len(stamps), len(set(stamps)), "TF ignores a repeated stamp")
        self.assertLess(stamps[-1], 0.005, "before the next step")
