"""Arriving is said once, in the log and on a latched topic; so is that the robot has left again."""

import rospy
from player import NODE, Player, pillar_ahead
from rosgraph_msgs.msg import Log
from std_msgs.msg import Bool
from std_srvs.srv import SetBool


class ArrivalIsAnnounced(Player):
    def answer_at(self, distance):
        """Answer the scan of a robot so far from a pillar that stands [m]."""
        self.stand_at(x=2.0 - distance)
        self.answer(pillar_ahead(distance))

    def test_each_arrival_is_announced_once(self):
        arrived = self.remember(f"{NODE}/arrived", Bool)
        log = self.remember("rosout", Log)

        def announced():
            return [msg.data for msg in arrived]

        for distance in (1.0, 0.8, 0.6, 0.5, 0.45):
            self.answer_at(distance)
        self.wait_until(lambda: announced() == [False], "it is on its way")
        for distance in (0.405, 0.404, 0.406, 0.405, 0.404):
            self.answer_at(distance)
        self.wait_until(lambda: announced() == [False, True], "it has arrived")

        late = self.remember(f"{NODE}/arrived", Bool)
        self.wait_until(lambda: [msg.data for msg in late] == [True], "who joins late is told as well")

        for distance in (0.6, 0.8, 0.8):
            self.answer_at(distance)
        self.wait_until(lambda: announced() == [False, True, False], "the robot has left")
        for distance in (0.6, 0.405, 0.405, 0.405):
            self.answer_at(distance)
        self.wait_until(lambda: announced() == [False, True, False, True], "it has arrived again")

        said = [line.msg for line in log if line.level == Log.INFO and line.msg.startswith("arrived after")]
        self.wait_until(lambda: len(self.arrivals(log)) == 2, "the log has two arrivals")
        self.assertIn("(stop_distance 0.4 m)", self.arrivals(log)[0])
        self.assertRegex(self.arrivals(log)[0], r"after 0\.50 s of simulated time, 0\.40\d m from the pillar")
        self.assertLessEqual(len(said), 2)

    def test_stop_and_start_at_the_pillar_are_no_arrival(self):
        arrived = self.remember(f"{NODE}/arrived", Bool)
        log = self.remember("rosout", Log)
        start = rospy.Time.now()
        for _ in range(3):
            self.answer_at(0.405)
        self.wait_until(lambda: arrived and arrived[-1].data, "it has arrived")
        told = len(arrived)
        service = rospy.ServiceProxy(f"{NODE}/start_stop", SetBool)
        for wanted in (False, True, False, True):
            service(wanted)
            for _ in range(3):
                self.answer_at(0.405)

        def said():
            return [line.msg for line in list(log) if line.header.stamp >= start and "already" in line.msg]

        self.wait_until(lambda: len(said()) == 2, "it says that it is there already")
        self.assertEqual(len(arrived), told, "it has not left")
        service(False)
        self.stand_at(x=2.0 - 0.8)
        self.play_until(lambda: not arrived[-1].data, pillar_ahead(0.8), "it was carried away")
        service(True)

    def arrivals(self, log):
        return [line.msg for line in list(log) if line.level == Log.INFO and "arrived after" in line.msg]
