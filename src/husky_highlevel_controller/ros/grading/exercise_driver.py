"""Acts in a drive: drives the robot in exercise 2, calls the start/stop service in exercise 5."""

from __future__ import annotations

import re
import threading
import xmlrpc.client
from contextlib import suppress
from dataclasses import replace
from typing import Any, Collection, List, Optional, Sequence, Set, Tuple

import rosgraph
import rospy
import rosservice
from geometry_msgs.msg import Twist, Vector3
from std_srvs.srv import SetBool

from husky_highlevel_controller.grading.drive.call_plan import (
    FORWARD,
    SERVICE,
    CallPlan,
    exercise_2_over,
    exercise_2_speed,
)
from husky_highlevel_controller.grading.notes import Kind, Note
from husky_highlevel_controller.grading.recording import Call

# a master that does not answer, or cannot: a submission's parameter may hold what XML-RPC cannot send
UNANSWERED = (OSError, rospy.ROSException, rosgraph.MasterException, xmlrpc.client.Error)
ANSWER_DEADLINE = 10.0  # [s] of wall time
MAX_DESCRIPTION = 2_000_000  # letters of a URDF
_LINK = re.compile(r"<link\s{1,20}name\s{0,5}=\s{0,5}[\"']([^\"'<]{1,200})[\"']")


class ExerciseDriver:
    """Acts a little each time `work` is called."""

    def __init__(self, driver: str, scan_topic: str, our_nodes: Set[str]) -> None:
        self._driver, self._scan_topic, self._our_nodes = driver, scan_topic, our_nodes
        self.services: Set[str] = set()  # that are a std_srvs/SetBool
        self.other_services: Set[str] = set()  # "/name (package/Type)"
        self.calls: List[Call] = []
        self._plan, self._calling = CallPlan(), False
        self._answer: Optional[Call] = None
        self._probed: Set[str] = set()
        self._velocity = rospy.Publisher("cmd_vel", Twist, queue_size=1) if driver == FORWARD else None

    def answer_scans(self) -> None:
        """Publish commands in place of a submission that publishes none: lockstep would wait for it."""
        self._velocity = self._velocity or rospy.Publisher("cmd_vel", Twist, queue_size=1)
        self.answer(0.0)

    def answer(self, now: float) -> None:
        """Answer a scan, in exercise 2, whose submissions do not drive."""
        if self._driver == FORWARD and self._velocity is not None:
            self._velocity.publish(Twist(linear=Vector3(exercise_2_speed(now), 0.0, 0.0)))

    def look(self, services: Sequence[Any]) -> None:
        """Find the submission's services in the master's list."""
        if self._driver != SERVICE:
            return
        for name, nodes in services:
            if set(nodes) - self._our_nodes and name not in self._probed and not _internal(name):
                self._probed.add(name)
                threading.Thread(target=self._probe, args=(name,), daemon=True).start()

    def _probe(self, name: str) -> None:
        try:
            kind = rosservice.get_service_type(name)
            if kind == "std_srvs/SetBool":
                self.services.add(name)
            elif kind:
                self.other_services.add(f"{name} ({kind})")
        except (rosservice.ROSServiceException, OSError):
            self._probed.discard(name)

    def work(self, now: float, speed: float) -> Optional[Note]:
        """Do what is due at this simulated time [s] and true speed [m/s]; why the drive is over, if it is."""
        if self._driver == FORWARD:
            over = Note(Kind.PLAN_DONE, "the drive of the marking")
            return over if exercise_2_over(now) else None
        if self._driver != SERVICE or (self._calling and not self._collect(now)):
            return None
        if self.services:
            value = self._plan.due(now, speed)
            if value is not None:
                self._calling = True
                name = sorted(self.services)[0]
                threading.Thread(target=self._call, args=(name, value, now), daemon=True).start()
                return None
        return self._plan.reason(now, bool(self.services))

    def _collect(self, now: float) -> bool:
        """Whether the last call has been answered, or will not be."""
        if self._answer is None:
            return False
        self.calls.append(replace(self._answer, answered_at=now))
        self._plan.answered(now)
        self._calling, self._answer = False, None
        return True

    def _call(self, name: str, data: bool, now: float) -> None:
        answer: List[Call] = []

        def ask() -> None:
            try:
                response = rospy.ServiceProxy(name, SetBool)(data)
                answer.append(Call(now, data, bool(response.success), str(response.message), now))
            except (rospy.ServiceException, rospy.ROSException, OSError) as error:
                answer.append(Call(now, data, False, str(error), now))

        caller = threading.Thread(target=ask, daemon=True)
        caller.start()
        caller.join(ANSWER_DEADLINE)
        self._answer = answer[0] if answer else Call(now, data, False, "no answer", now)

    def parameters(self) -> Tuple[Tuple[str, ...], Tuple[str, ...]]:
        """Private parameters with the scans' topic, and those that are a queue's size."""
        topics, queues = [], []
        with suppress(*UNANSWERED):
            for name in rospy.get_param_names():
                if any(name.startswith(node + "/") for node in self._our_nodes):
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
        return tuple(sorted(topics)), tuple(sorted(queues))

    def descriptions(self, frames: Collection[str]) -> Tuple[str, ...]:
        """Parameters with the URDF of a robot, any of whose links is among these frames."""
        names = []
        with suppress(*UNANSWERED):
            for name in rospy.get_param_names():
                if name.endswith("_description"):
                    text = str(rospy.get_param(name, ""))[:MAX_DESCRIPTION]
                    if set(_LINK.findall(text)) & set(frames):
                        names.append(name)
        return tuple(sorted(names))


def _internal(name: str) -> bool:
    return name.endswith(("/get_loggers", "/set_logger_level", "/set_parameters"))
