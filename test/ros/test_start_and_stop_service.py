"""The service named by a parameter starts and stops the robot, at once and as often as one likes."""

import rospy
from geometry_msgs.msg import Twist
from player import Player, pillar_ahead
from std_srvs.srv import SetBool


class StartAndStopService(Player):
    def test_1_true_drives_false_stops_at_once(self):
        pillar = pillar_ahead(3.0)
        rospy.wait_for_service("let_it_drive", 30.0)
        service = rospy.ServiceProxy("let_it_drive", SetBool)
        for _ in range(5):
            self.assertEqual(self.answer(pillar), Twist(), "start_enabled is false: it waits to be told")
        for _ in range(3):
            answer = service(True)
            self.assertTrue(answer.success)
            self.assertIn("driving", answer.message)
            self.assertGreater(self.answer(pillar).linear.x, 0.5)

            told = len(self.commands)
            answer = service(False)
            self.assertTrue(answer.success)
            self.assertIn("standing still", answer.message)
            self.wait_until(lambda told=told: len(self.commands) > told, "it stops without a scan")
            self.assertEqual(self.commands[-1], Twist())
            for _ in range(5):
                self.assertEqual(self.answer(pillar), Twist(), "it stays where it is")

    def test_2_telling_it_twice_is_no_mistake(self):
        service = rospy.ServiceProxy("let_it_drive", SetBool)
        for wanted in (True, False):
            service(wanted)
            answer = service(wanted)
            self.assertTrue(answer.success)
            self.assertIn("already", answer.message)
