"""With a queue of 1 a controller that was busy answers the latest scan, not those that came meanwhile."""

import os
import signal
from xmlrpc.client import ServerProxy

import rosgraph
import rosnode
import rospy
from player import NODE, Player, pillar_ahead

SCANS = 15  # few enough to lie in the sockets' buffers


class AnswersTheLatestScan(Player):
    def test_those_that_came_while_it_was_busy_are_left_out(self):
        self.assertGreater(self.answer(pillar_ahead(3.0)).linear.x, 0.5)
        with ServerProxy(rosnode.get_api_uri(rosgraph.Master("/test"), f"/{NODE}")) as node:
            controller = node.getPid("/test")[2]
        answered, sent = len(self.commands), self.sent()
        os.kill(controller, signal.SIGSTOP)  # nothing is busier
        try:
            for _ in range(SCANS):
                self.send(pillar_ahead(3.0))
            self.stand_at(2.0)
            self.send(pillar_ahead(1.0))  # where it is to stop
            self.wait_until(lambda: self.sent() > sent + SCANS, "all scans are on their way")
        finally:
            os.kill(controller, signal.SIGCONT)
        self.wait_until(lambda: self.commands[-1].linear.x == 0.0, "the last scan is answered")
        self.assertLess(len(self.commands) - answered, SCANS // 2)

    def sent(self):
        """Scans that have left for the controller."""
        with ServerProxy(rospy.get_node_uri()) as node:
            published = node.getBusStats("/test")[2][0]
        (connections,) = (each[2] for each in published if each[0] == self.scans.resolved_name)
        return sum(messages for _, _, messages, *_ in connections)
