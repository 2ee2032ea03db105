"""Access to the ROS network of a run: commands, services, parameters and frames."""

from __future__ import annotations

import re
import threading
import time
import xmlrpc.client
from contextlib import suppress
from http.client import HTTPException
from typing import Any, Collection, Dict, Optional, Set, Tuple
from xml.parsers.expat import ExpatError

import rosgraph
import rospy
import rosservice
from geometry_msgs.msg import Twist
from geometry_msgs.msg import Vector3 as LinearVelocity
from std_srvs.srv import SetBool

from husky_grading.drive.ros_graph import callers
from husky_grading.exercises.watch import Answer
from husky_grading.nodes.marker_watch import MarkerWatch
from husky_highlevel_controller.datatypes import Vector3

# errors that a query to the ROS master may raise. There are many, because a submission may set a parameter
# that XML-RPC cannot send, or may end the master and answer in its place.
UNANSWERED = (
    OSError, HTTPException, ExpatError, ValueError, TypeError, rospy.ROSException, rosgraph.MasterException,
    xmlrpc.client.Error,
)  # fmt: skip
ANSWER_DEADLINE = 10.0  # [s] wall time
# our own queries for the types of services come to the ROS master under this name, so they do not count as
# calls of the submission
TYPE_CALLER = "/rosservice"
# a service whose name ends like this comes from ROS itself, so its type is not requested; a tf2_ros.Buffer
# offers tf2_frames
EVERY_NODES_SERVICES = ("/get_loggers", "/set_logger_level", "/set_parameters", "/tf2_frames")
# the types of at most this number of services are requested, because each request has its own thread
MAX_SERVICES = 100
# at most this number of characters of a robot description is searched
MAX_DESCRIPTION = 2_000_000
# start of a link in a URDF, with its name
_LINK = re.compile(r"<link\s{1,20}name\s{0,5}=\s{0,5}[\"']([^\"'<]{1,200})[\"']")


class _Call:
    """Call of a service, which a thread makes."""

    def __init__(self) -> None:
        self.answer: Optional[Answer] = None  # None until the answer or an error comes
        self.give_up_at = time.monotonic() + ANSWER_DEADLINE  # [s] then the call counts as not answered


class DriveAccess:
    """Access of an exercise's watch to the ROS network of a run; it fulfils `watch.RosAccess` by rospy."""

    def __init__(self, our_nodes: Set[str], transforms: MarkerWatch) -> None:
        """Prepare the access.

        Args:
            our_nodes: names of the grader's nodes; their calls and parameters are not the submission's.
            transforms: the watch of markers, which also keeps all transforms.
        """
        self._our_nodes, self._transforms = our_nodes, transforms
        self._velocity: Optional[rospy.Publisher] = None  # made by `advertise_commands`
        self._requested_types: Set[str] = set()  # services whose types were requested
        self._known_types: Dict[str, str] = {}  # types by service; the threads of `_ask_type` add them
        self._last_call: Optional[_Call] = None  # call that `answer` waits for; None before the first call

    def advertise_commands(self) -> None:
        """Advertise velocity commands; lockstep then waits for the commands of this node."""
        self._velocity = self._velocity or rospy.Publisher("cmd_vel", Twist, queue_size=1)

    def command(self, speed: float) -> None:
        """Publish a command to drive ahead with this speed [m/s]."""
        if self._velocity is not None:
            self._velocity.publish(Twist(linear=LinearVelocity(speed, 0.0, 0.0)))

    def service_types(self, names: Collection[str]) -> Dict[str, str]:
        """Return the types of services as far as they are known; threads ask for the types of new names."""
        for name in names:
            if name.endswith(EVERY_NODES_SERVICES):  # services of ROS itself
                continue
            if name not in self._requested_types and len(self._requested_types) < MAX_SERVICES:
                self._requested_types.add(name)
                threading.Thread(target=self._ask_type, args=(name,), daemon=True).start()
        return self._known_types.copy()  # a copy, because threads may add further types

    def _ask_type(self, name: str) -> None:
        """Ask the node that offers a service for its type, and keep the type; a thread runs this."""
        try:
            kind = rosservice.get_service_type(name)
        except Exception:
            # The submission answers this request, so any error is possible. The type is requested again
            # later.
            self._requested_types.discard(name)
        else:
            if kind:  # None if the service has gone
                self._known_types[name] = kind

    def call(self, name: str, value: bool) -> None:
        """Call a service of type std_srvs/SetBool; `answer` returns its answer later."""
        call = self._last_call = _Call()

        def ask() -> None:
            """Call the service, and keep its answer or error, in a thread, because a call may take long."""
            try:
                response = rospy.ServiceProxy(name, SetBool)(value)
                call.answer = Answer(bool(response.success), str(response.message))
            except Exception as error:
                # The submission answers this call, so any error is possible. The error becomes the answer,
                # because the run waits for an answer.
                call.answer = Answer(False, str(error) or type(error).__name__, is_error=True)

        threading.Thread(target=ask, daemon=True).start()

    def answer(self) -> Optional[Answer]:
        """Return the answer to the last call; None if it has not come yet."""
        call = self._last_call
        if call is None:
            return None
        if call.answer is not None:
            return call.answer
        if time.monotonic() < call.give_up_at:
            return None
        return Answer(False, f"no answer within {ANSWER_DEADLINE:g} s", is_error=True)

    def callers(self, service: str) -> Dict[str, int]:
        """Return the number of lookups of a service by each node of the submission."""
        return callers(rosgraph.get_master_uri(), service, {*self._our_nodes, TYPE_CALLER})

    def parameters(self) -> Dict[str, Any]:
        """Return the values of the submission's parameters, as far as the master answers."""
        values: Dict[str, Any] = {}
        with suppress(*UNANSWERED):
            # beginnings of the names of our nodes' private parameters
            our_prefixes = tuple(f"{node}/" for node in self._our_nodes)
            for name in rospy.get_param_names():
                if not name.startswith(our_prefixes):
                    values[name] = rospy.get_param(name, None)
        return values

    def place(self, frame: str) -> Optional[Vector3]:
        """Return the position of a frame in base_link [m] by the newest transforms; None if it is unknown."""
        return self._transforms.place(frame)

    def places(self) -> Dict[str, Vector3]:
        """Return the positions in base_link [m] of all frames that transforms connect with base_link."""
        return self._transforms.places()

    def descriptions(self, frames: Collection[str]) -> Tuple[str, ...]:
        """Return the names of the parameters with a URDF that has a link for at least one of these frames."""
        names = []
        with suppress(*UNANSWERED):  # names so far are returned if the master stops answering
            for name in rospy.get_param_names():
                if name.endswith("_description"):
                    text = str(rospy.get_param(name, ""))[:MAX_DESCRIPTION]
                    if set(_LINK.findall(text)) & set(frames):
                        names.append(name)
        return tuple(sorted(names))
