"""A person takes over and hands back, an emergency stop locks everybody out: the Husky's twist_mux."""

import rospy
from geometry_msgs.msg import Twist, TwistStamped
from harness import RosTest, stamp, twist
from std_msgs.msg import Bool

CONTROLLER, PERSON = 0.3, -0.2  # [m/s], so that one sees who drives


class CommandsHavePriorities(RosTest):
    def setUp(self):
        self.out = self.remember("husky_velocity_controller/cmd_vel_out", TwistStamped)
        self.sent = {}
        self.timer = rospy.Timer(rospy.Duration(0.05), self._send)
        self.addCleanup(self.timer.shutdown)

    def _send(self, _event):
        for publisher, command in list(self.sent.values()):
            publisher.publish(command)

    def send(self, topic, linear):
        """Go on commanding on a topic; None: stop."""
        if linear is None:
            del self.sent[topic]
        else:
            self.sent[topic] = self.publisher(topic, Twist), twist(linear)

    def wait_for_speed(self, speed, what):
        self.wait_until(lambda: self.out and abs(self.out[-1].twist.linear.x - speed) < 1e-9, what, 10.0)
        return stamp(self.out[-1])

    def test_a_person_takes_over_from_the_controller_and_hands_back(self):
        passed = self.remember("husky_velocity_controller/cmd_vel", Twist)
        self.send("cmd_vel", CONTROLLER)
        self.wait_for_speed(CONTROLLER, "the controller drives")
        self.send("kb_teleop/cmd_vel", PERSON)
        self.wait_for_speed(PERSON, "the person drives")
        count = len(self.out)
        self.wait(1.0)
        speeds = {round(msg.twist.linear.x, 6) for msg in self.out[count:]}
        self.assertEqual(speeds, {PERSON}, "the controller, which goes on commanding, is not heard")
        self.send("joy_teleop/cmd_vel", 0.1)
        self.wait_for_speed(0.1, "the gamepad comes before the keyboard")
        self.send("joy_teleop/cmd_vel", None)
        self.send("kb_teleop/cmd_vel", None)
        self.wait_for_speed(CONTROLLER, "the controller drives again")
        self.assertEqual({msg.linear.x for msg in passed}, {CONTROLLER, PERSON, 0.1})

    def test_an_emergency_stop_locks_all_until_it_is_released(self):
        stop = self.publisher("e_stop", Bool)
        self.send("cmd_vel", CONTROLLER)
        self.send("husky_velocity_controller/cmd_vel", CONTROLLER)
        self.wait_for_speed(CONTROLLER, "it drives")
        stop.publish(True)
        self.wait_for_speed(0.0, "it stands")
        self.wait(1.0)
        self.assertEqual(self.out[-1].twist.linear.x, 0.0, "nobody moves it")
        stop.publish(False)
        self.wait_for_speed(CONTROLLER, "it drives again")
