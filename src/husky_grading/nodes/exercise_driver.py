"""Acts in a drive: drives the robot in exercise 2, calls the start/stop service in exercise 5."""

from __future__ import annotations

import re
import threading
import time
import xmlrpc.client
from contextlib import suppress
from dataclasses import replace
from http.client import HTTPException
from typing import Any, Collection, Dict, List, Optional, Sequence, Set, Tuple
from xml.parsers.expat import ExpatError

import rosgraph
import rospy
import rosservice
from geometry_msgs.msg import Twist, Vector3
from rosgraph.names import ns_join
from std_srvs.srv import SetBool

from husky_grading.drive.call_plan import (
    FORWARD,
    SERVICE,
    CallPlan,
    exercise_2_over,
    exercise_2_speed,
)
from husky_grading.drive.ros_graph import callers
from husky_grading.notes import Kind, Note
from husky_grading.recording import Call

# a master that does not answer, or cannot: a submission's parameter may hold what XML-RPC cannot send, and
# a submission may end the master and answer in its place
UNANSWERED = (
    OSError, HTTPException, ExpatError, ValueError, TypeError, rospy.ROSException, rosgraph.MasterException,
    xmlrpc.client.Error,
)  # fmt: skip
ANSWER_DEADLINE = 10.0  # [s] of wall time
OBEYED = 0.5  # [s], simulated, after a call: by then a submission that it stops sends no more
SET_BOOL = "std_srvs/SetBool"
TYPE_CALLER = "/rosservice"  # name by which rosservice asks the master
MAX_SERVICES = 100  # of a submission that are looked at, each in a thread
MAX_DESCRIPTION = 2_000_000  # letters of a URDF
_LINK = re.compile(r"<link\s{1,20}name\s{0,5}=\s{0,5}[\"']([^\"'<]{1,200})[\"']")


class ExerciseDriver:
    """Acts a little each time `work` is called."""

    def __init__(self, driver: str, scan_topic: str, our_nodes: Set[str]) -> None:
        self._driver, self._scan_topic, self._our_nodes = driver, scan_topic, our_nodes
        self._types: List[Tuple[str, str]] = []  # service and type; threads append while others read
        self.calls: List[Call] = []
        self._plan = CallPlan()
        self._made: Optional[Call] = None  # the call that waits for its answer
        self._answers: List[Call] = []  # to it
        self._give_up_at = 0.0  # [s] of wall time
        self._probed: Set[str] = set()
        self._velocity = rospy.Publisher("cmd_vel", Twist, queue_size=1) if driver == FORWARD else None

    @property
    def services(self) -> Set[str]:
        """Services of type std_srvs/SetBool."""
        return {name for name, kind in tuple(self._types) if kind == SET_BOOL}

    @property
    def other_services(self) -> Set[str]:
        """Services of other types, as "/name (package/Type)"."""
        return {f"{name} ({kind})" for name, kind in tuple(self._types) if kind != SET_BOOL}

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
            is_new = name not in self._probed and len(self._probed) < MAX_SERVICES
            if set(nodes) - self._our_nodes and is_new and not _internal(name):
                self._probed.add(name)
                threading.Thread(target=self._probe, args=(name,), daemon=True).start()

    def _probe(self, name: str) -> None:
        try:
            kind = rosservice.get_service_type(name)
        except Exception:  # of whatever kind: the submission answers; it is asked again
            self._probed.discard(name)
        else:
            if kind:
                self._types.append((name, kind))

    def work(self, now: float, speed: float) -> Optional[Note]:
        """Do what is due at this simulated time [s] and true speed [m/s]; why the drive is over, if it is."""
        if self._driver == FORWARD:
            over = Note(Kind.PLAN_DONE, "the drive of the marking")
            return over if exercise_2_over(now) else None
        if self._driver != SERVICE:
            return None
        if self._made:
            if not self._answers and time.monotonic() < self._give_up_at:
                return None
            self.calls.append(replace([*self._answers, self._made][0], answered_at=now))
            self._plan.answered(now)
            self._made = None
        services = self.services
        value = self._plan.due(now, speed) if services else None
        if value is None:
            return self._plan.reason(now, bool(services))
        self._made, self._answers = Call(now, value, False, "no answer", now), []
        self._give_up_at = time.monotonic() + ANSWER_DEADLINE
        call = min(services), self._made, self._answers
        threading.Thread(target=_ask, args=call, daemon=True).start()
        return None

    def callers(self) -> Dict[str, int]:
        """Lookups by each node of the submission of the service that is called here."""
        uri, services = rosgraph.get_master_uri(), self.services
        return callers(uri, min(services), {*self._our_nodes, TYPE_CALLER}) if services else {}

    def has_silenced(self, last_command: float) -> bool:
        """Whether a call came just before a submission's last command [s, simulated], or after it.

        Such a submission sends nothing because it was asked to: it waits for the next call.
        """
        made = self._made
        return any(call.at >= last_command - OBEYED for call in (*self.calls, *([made] if made else [])))

    def parameters(self) -> Tuple[Tuple[str, ...], Tuple[str, ...]]:
        """Private parameters with the scans' topic, and those that are a queue's size."""
        topics, queues = [], []
        with suppress(*UNANSWERED):
            ours = tuple(f"{node}/" for node in self._our_nodes)
            for name in rospy.get_param_names():
                value = None if name.startswith(ours) else rospy.get_param(name, None)
                if isinstance(value, str) and value and ns_join("/", value) == self._scan_topic:
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


def _ask(name: str, call: Call, answers: List[Call]) -> None:
    """Make a call of a service, and append its answer."""
    try:
        response = rospy.ServiceProxy(name, SetBool)(call.data)
        answers.append(replace(call, success=bool(response.success), answer=str(response.message)))
    except Exception as error:  # of whatever kind: the submission answers, and the drive waits for this
        answers.append(replace(call, answer=str(error) or type(error).__name__))


def _internal(name: str) -> bool:
    return name.endswith(("/get_loggers", "/set_logger_level", "/set_parameters"))
