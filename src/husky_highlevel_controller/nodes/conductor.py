"""What marking itself does in a drive: drives for exercise 2, calls the start/stop service for exercise 5."""

from __future__ import annotations

import threading
from math import inf
from typing import Any, List, Sequence, Set, Tuple

import rosgraph
import rospy
import rosservice
from geometry_msgs.msg import Twist, Vector3
from std_srvs.srv import SetBool

from husky_highlevel_controller.recording import Call

EX2_SPEED, EX2_FROM, EX2_SECONDS = 0.5, 2.0, 10.0  # [m/s], [s], [s]
CALM = 4.0  # [s], simulated, from one call to the next
CALLS = (False, True, False, True)  # stop and start, twice; the other way round where True stops
DRIVES = 0.1  # [m/s]
ANSWER_DEADLINE = 10.0  # [s] of wall time


class Conductor:
    """Acts a little each time `work` is called."""

    def __init__(self, exercise: int, scan_topic: str, ours: Set[str]) -> None:
        self._exercise, self._scan_topic, self._ours = exercise, scan_topic, ours
        self.services: Set[str] = set()
        self.calls: List[Call] = []
        self.over = ""
        self._probed: Set[str] = set()
        self._drove_at = self._due = inf
        self._busy = self._nudged = False
        self._velocity = rospy.Publisher("cmd_vel", Twist, queue_size=1) if exercise == 2 else None

    def stand_in(self) -> None:
        """Take the place of a controller that is not there: lockstep would wait for it."""
        self._velocity = self._velocity or rospy.Publisher("cmd_vel", Twist, queue_size=1)
        self.answer(0.0)

    def nudge(self) -> None:
        """Let lockstep go on, once: the robot stands, and is told to stand."""
        if not self._nudged:
            self.stand_in()
            assert self._velocity is not None
            if self._velocity.get_num_connections():
                self._velocity.publish(Twist())
                self._nudged = True

    def answer(self, now: float) -> None:
        """Answer a scan, in exercise 2, whose submissions do not drive."""
        if self._exercise == 2 and self._velocity is not None:
            drives = EX2_FROM <= now < EX2_FROM + EX2_SECONDS
            self._velocity.publish(Twist(linear=Vector3(EX2_SPEED * drives, 0.0, 0.0)))

    def look(self, services: Sequence[Any]) -> None:
        """Find the submission's SetBool services in the master's list."""
        if self._exercise != 5:
            return
        for name, nodes in services:
            if set(nodes) - self._ours and name not in self._probed and not _internal(name):
                self._probed.add(name)
                threading.Thread(target=self._probe, args=(name,), daemon=True).start()

    def _probe(self, name: str) -> None:
        try:
            if rosservice.get_service_type(name) == "std_srvs/SetBool":
                self.services.add(name)
        except (rosservice.ROSServiceException, OSError):
            self._probed.discard(name)

    def work(self, now: float, speed: float) -> None:
        """Do what is due at this simulated time [s], with this true speed [m/s]."""
        if self._exercise == 2 and now > EX2_FROM + EX2_SECONDS + 1.0:
            self.over = "the drive of the marking"
        if self._exercise != 5:
            return
        if abs(speed) > DRIVES:
            self._drove_at = min(self._drove_at, now)
        # it may wait for the first call to drive at all
        begin = min(self._drove_at + 1.0, 8.0)
        if self._busy or not self.services or now < begin:
            if now > 25.0 and not self.services:
                self.over = "no start/stop service for 25 s"
            return
        last = self.calls[-1].at if self.calls else -inf
        if now < last + CALM:
            return
        if len(self.calls) >= len(CALLS):
            self.over = "all calls are made"
            return
        self._busy = True
        data = CALLS[len(self.calls)]
        threading.Thread(target=self._call, args=(sorted(self.services)[0], data, now), daemon=True).start()

    def _call(self, name: str, data: bool, now: float) -> None:
        answer: List[Call] = []

        def ask() -> None:
            try:
                response = rospy.ServiceProxy(name, SetBool)(data)
                answer.append(Call(now, data, bool(response.success), str(response.message)))
            except (rospy.ServiceException, rospy.ROSException, OSError) as error:
                answer.append(Call(now, data, False, str(error)))

        caller = threading.Thread(target=ask, daemon=True)
        caller.start()
        caller.join(ANSWER_DEADLINE)
        self.calls.append(answer[0] if answer else Call(now, data, False, "no answer"))
        self._busy = False

    def parameters(self) -> Tuple[Tuple[str, ...], Tuple[str, ...]]:
        """Private parameters with the scans' topic, and those that are a queue's size."""
        topics, queues = [], []
        try:
            for name in rospy.get_param_names():
                if any(name.startswith(node + "/") for node in self._ours):
                    continue
                value = rospy.get_param(name, None)
                if (
                    isinstance(value, str)
                    and value
                    and rosgraph.names.ns_join("/", value) == self._scan_topic
                ):
                    topics.append(name)
                if isinstance(value, int) and "queue" in name.lower():
                    queues.append(name)
        except (OSError, rospy.ROSException):
            pass
        return tuple(sorted(topics)), tuple(sorted(queues))


def _internal(name: str) -> bool:
    return name.endswith(("/get_loggers", "/set_logger_level", "/set_parameters"))
