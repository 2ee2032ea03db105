"""A search is a full turn, then a widening drive; the log tells of each once, at INFO level."""

from player import NODE, NOTHING, Player, pillar_ahead
from rosgraph_msgs.msg import Log

STEP = 0.5  # [rad] between two scans


class SaysHowItSearches(Player):
    def test_each_stage_is_told_once(self):
        log = self.remember("rosout", Log)

        def said():
            return [m.msg for m in list(log) if m.name == f"/{NODE}" and m.level == Log.INFO]

        def last():
            return said()[-1] if said() else ""

        for step in range(12):
            self.stand_at(yaw=step * STEP)
            command = self.answer(NOTHING)
            self.assertEqual(command.linear.x, 0.0)
            self.assertGreater(command.angular.z, 0.0, "it turns to look around")
        self.wait_until(lambda: "turning to look around" in last(), "it says that it turns")

        for step in range(12, 16):
            self.stand_at(yaw=step * STEP)
            command = self.answer(NOTHING)
        self.assertGreater(command.linear.x, 0.0, "it drives on after a full turn")
        self.wait_until(lambda: "widening search" in last(), "it says that it drives")

        before = len(said())
        for step in range(40):  # a leg, and a turn
            self.stand_at(x=0.1 * min(step, 20), yaw=16 * STEP + STEP * max(step - 20, 0))
            self.answer(NOTHING)
        self.answer(pillar_ahead(3.0))
        self.wait_until(lambda: "driving to the pillar" in last(), "it has found the pillar")
        self.assertEqual(len(said()), before + 1, "and nothing was said in between")
        self.assertRegex(said()[-1], r"smallest range 3\.000 m, pillar at x 3\.\d+ m", "with what it sees")
