"""ROS master of `./dev launch`, which also lists parameters and services that nodes ask for in vain.

It lists parameters that are set and that their node never reads, and services that no node offers.
Any other master writes the requests for parameters nowhere (rosmaster 1.15.15 has them in its log only with
--master-logger-level debug, with every other call and answer). So nothing is found if a plain roscore runs.
"""

from __future__ import annotations

import sys
import threading
from typing import Any, Dict, Iterable, Iterator, List, Mapping, NamedTuple, Optional, Tuple

import rosmaster.master_api
from rosgraph.names import resolve_name
from rosmaster.main import rosmaster_main

from husky_highlevel_controller.ros.simulator.wrong_topics import TOOLS, UnreadParameter
from husky_highlevel_controller.spelling import likeness

MAX_REQUESTS = 10_000  # requests that are kept
MIN_LIKENESS = 0.8  # sped is like speed, but max_range is not like min_range
READERS_OF_ALL = ("/rosparam", "/roslaunch")  # begins of names of tools that are not nodes


class Request(NamedTuple):
    """Request of a node for a parameter."""

    node: str
    parameter: str


def never_read(names: Iterable[str], requests: Mapping[Request, bool]) -> Iterator[UnreadParameter]:
    """Yield the parameters below a node's name that no node has read, if it asked for a like one in vain.

    Args:
        names: names of all parameters that are set.
        requests: whether the parameter was there, at the last request.
    """
    in_vain: Dict[str, List[str]] = {}
    for request, is_found in requests.items():
        if not is_found:
            in_vain.setdefault(request.node, []).append(request.parameter)
    if not in_vain:
        return
    read = {request.parameter.rstrip("/") for request, is_found in requests.items() if is_found}
    for name in names:
        owner = max((node for node in in_vain if name.startswith(f"{node}/")), key=len, default=None)
        if owner is None or any(name == each or name.startswith(f"{each}/") for each in read):
            continue
        likes = [(_likeness(name, asked, owner), asked) for asked in in_vain[owner]]
        best, asked = max(likes)
        if best >= MIN_LIKENESS:
            yield UnreadParameter(owner, name, asked)


def _likeness(name: str, asked: str, node: str) -> float:
    """Likeness of a parameter below a node's name and one that the node asked for there, or outside."""
    place, _, own = name.rpartition("/")
    asked_place, _, other = asked.rpartition("/")
    if asked_place not in (place, node.rpartition("/")[0]):
        return 0.0
    own, other = own.lower(), other.lower()
    if own != other and own.strip("0123456789") == other.strip("0123456789"):
        return 0.0  # gain1 and gain2 are two parameters
    return likeness(own, other, "_")


class ParameterMaster(rosmaster.master_api.ROSMasterHandler):
    """Master whose public methods are its XML-RPC methods."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._requests: Dict[Request, bool] = {}
        self._requests_lock = threading.Lock()
        # last answer; None if a request or a parameter has changed since then
        self._unread: Optional[List[List[str]]] = None
        # nodes and services, in the order of requests
        self._services_in_vain: Dict[Tuple[str, str], None] = {}

    def getParam(self, caller_id: str, key: str) -> Tuple[int, str, Any]:  # noqa: N802
        """Answer as every master, and note it."""
        answer = super().getParam(caller_id, key)
        self._note(caller_id, key, answer[0] == 1)
        return answer

    def hasParam(self, caller_id: str, key: str) -> Tuple[int, str, bool]:  # noqa: N802
        """Answer as every master, and note it."""
        answer = super().hasParam(caller_id, key)
        self._note(caller_id, key, bool(answer[2]))
        return answer

    def searchParam(self, caller_id: str, key: str) -> Tuple[int, str, str]:  # noqa: N802
        """Answer as every master, and note it."""
        code, message, found = super().searchParam(caller_id, key)
        self._note(caller_id, found if code == 1 else key, code == 1)
        return code, message, found

    def subscribeParam(self, caller_id: str, caller_api: str, key: str) -> Tuple[int, str, Any]:  # noqa: N802
        """Answer as every master, and note it."""
        code, message, value = super().subscribeParam(caller_id, caller_api, key)
        self._note(caller_id, key, value != {})
        return code, message, value

    def setParam(self, caller_id: str, key: str, value: Any) -> Tuple[int, str, int]:  # noqa: N802
        """Answer as every master; a parameter that a node sets below its own name counts as read."""
        answer = super().setParam(caller_id, key, value)
        self._forget_unread()
        if answer[0] == 1 and resolve_name(key, caller_id).startswith(f"{caller_id}/"):
            self._note(caller_id, key, True)
        return answer

    def deleteParam(self, caller_id: str, key: str) -> Tuple[int, str, int]:  # noqa: N802
        """Answer as every master."""
        answer = super().deleteParam(caller_id, key)
        self._forget_unread()
        return answer

    def lookupService(self, caller_id: str, service: str) -> Tuple[int, str, str]:  # noqa: N802
        """Answer as every master, and note a service that is not there."""
        code, message, address = super().lookupService(caller_id, service)
        if code != 1 and isinstance(caller_id, str) and isinstance(service, str):
            with self._requests_lock:
                if len(self._services_in_vain) < MAX_REQUESTS:
                    self._services_in_vain[caller_id, resolve_name(service, caller_id)] = None
        return code, message, address

    def getAbsentServices(self, _caller_id: str) -> Tuple[int, str, List[List[str]]]:  # noqa: N802
        """Return the services that a node asked for and that do not exist: node, service."""
        with self._requests_lock:
            asked = list(self._services_in_vain)
        return 1, "", [[node, name] for node, name in asked if name not in self.services]

    def getUnreadParams(self, _caller_id: str) -> Tuple[int, str, List[List[str]]]:  # noqa: N802
        """Return the unread parameters: node, parameter, and the parameter that the node asked for."""
        with self._requests_lock:
            if self._unread is None:
                names = self.param_server.get_param_names()
                self._unread = [list(each) for each in never_read(names, self._requests)]
            return 1, "", self._unread

    def _forget_unread(self) -> None:
        with self._requests_lock:
            self._unread = None

    def _note(self, caller_id: Any, key: Any, is_found: bool) -> None:
        if not (isinstance(caller_id, str) and isinstance(key, str) and key):
            return
        name = resolve_name(key, caller_id)
        is_own = name.startswith(f"{caller_id}/")
        if not is_own and (TOOLS.match(caller_id) or caller_id.startswith(READERS_OF_ALL)):
            return
        request = Request(caller_id, name)
        with self._requests_lock:
            is_new = self._requests.get(request) is not is_found
            if is_new and (request in self._requests or len(self._requests) < MAX_REQUESTS):
                self._requests[request] = is_found
                self._unread = None


def main() -> None:
    """Run it: `--core -p PORT`."""
    rosmaster.master_api.ROSMasterHandler = ParameterMaster
    rosmaster_main(sys.argv)


if __name__ == "__main__":
    main()
