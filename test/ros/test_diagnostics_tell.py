"""/diagnostics reports once a second how the controller is: OK, WARN or ERROR, figures and a remedy."""

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from harness import stamp
from player import NODE, NOTHING, PERIOD, Player, pillar_ahead


class DiagnosticsTell(Player):
    def setUp(self):
        super().setUp()
        self.told = self.remember("/diagnostics", DiagnosticArray)

    def last(self):
        return self.told[-1].status[0] if self.told else DiagnosticStatus(level=-1)

    def play_now(self, condition, ranges, what):
        """Scans of the present, for those who look at their age."""

        def met():
            Player.moment = rospy.get_time() - PERIOD
            self.answer(ranges)
            return condition()

        self.wait_until(met, what)

    def test_they_follow_what_happens(self):
        self.wait_until(lambda: "no scans" in self.last().message, "there are no scans yet")
        self.assertEqual((self.last().name, self.last().level), (NODE, DiagnosticStatus.ERROR))

        self.play_now(lambda: self.last().level == DiagnosticStatus.OK, pillar_ahead(3.0), "all is well")
        values = {item.key: item.value for item in self.last().values}
        self.assertEqual((values["state"], values["pillar"]), ("driving", "seen"))
        self.assertRegex(values["scan age"], r"^-?\d+\.\d+ s$")
        self.assertRegex(values["scan rate"], r"^\d+\.\d+ Hz$")
        self.assertRegex(values["TF age"], r"^-?\d+\.\d+ s$")

        self.play_now(lambda: self.last().level == DiagnosticStatus.WARN, NOTHING, "there is no pillar")
        self.assertIn("no pillar", self.last().message)

        # and the scans end
        self.wait_until(lambda: "no scans" in self.last().message, "scans are missed")
        self.assertEqual(self.last().level, DiagnosticStatus.ERROR)
        stamps = [stamp(array) for array in self.told][1:]  # the first is for whoever has just come
        self.assertGreater(min(b - a for a, b in zip(stamps, stamps[1:])), 0.5, "once a second")
