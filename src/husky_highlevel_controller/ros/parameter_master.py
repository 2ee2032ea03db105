"""ROS master of `./dev launch`, which also finds misspelt parameters and absent services.

A parameter is probably misspelt if it is set below the name of a node, the node never reads it, and the node
has asked in vain for a similar name. A service is absent if a node asks for it and no node offers it.

A plain roscore keeps no list of the requests, so nothing is found with it. (rosmaster 1.15.15 logs requests
only with --master-logger-level debug, among all other calls and answers.)
"""

from __future__ import annotations

import sys
import threading
from typing import Any, Dict, Iterable, Iterator, List, Mapping, NamedTuple, Optional, Tuple

import rosmaster.master_api
from rosgraph.names import resolve_name
from rosmaster.main import rosmaster_main

from husky_highlevel_controller.ros.simulator.wrong_topics import UnreadParameter, is_tool
from husky_highlevel_controller.spelling import likeness

MAX_REQUESTS = 10_000  # largest number of requests that the master remembers
# A user has probably misspelt the name of a parameter if its likeness (0 to 1) to a name that a node requests
# is at least this. sped is like speed, but max_range is not like min_range.
MIN_LIKENESS = 0.8


class Request(NamedTuple):
    """Request of a node for a parameter."""

    node: str  # full name of the node
    parameter: str  # full name of the parameter


def never_read(names: Iterable[str], requests: Mapping[Request, bool]) -> Iterator[UnreadParameter]:
    """Yield each parameter that is probably misspelt: its node never reads it, but asks for a similar name.

    Args:
        names: names of all parameters that are set.
        requests: requests of all nodes, and whether each parameter was set when it was last requested.
    """
    absent_by_node: Dict[str, List[str]] = {}  # parameters that each node asked for and that were not set
    for request, is_found in requests.items():
        if not is_found:
            absent_by_node.setdefault(request.node, []).append(request.parameter)
    if not absent_by_node:  # no name can be misspelt if every requested parameter was set
        return
    read_names = {request.parameter.rstrip("/") for request, is_found in requests.items() if is_found}
    for name in names:
        owner = _owner(name, absent_by_node)  # only nodes that asked for an absent parameter count
        # a node that reads a whole namespace reads all parameters in it
        is_read = any(name == read or name.startswith(f"{read}/") for read in read_names)
        if owner is None or is_read:
            continue
        # Compare the name of this parameter with the names that the owner has asked for and that are not set.
        # The most similar name is probably the right spelling.
        likeness_and_asked = [(_likeness(name, asked, owner), asked) for asked in absent_by_node[owner]]
        greatest_likeness, most_similar = max(likeness_and_asked)
        if greatest_likeness >= MIN_LIKENESS:
            yield UnreadParameter(owner, name, most_similar)


def _owner(name: str, nodes: Iterable[str]) -> Optional[str]:
    """Return the node below whose name a parameter is; None if the parameter is below none of the nodes.

    Several nodes may match, because the name of a node may be a namespace of other nodes. Then the node with
    the longest name is the owner.
    """
    owners = [node for node in nodes if name.startswith(f"{node}/")]
    return max(owners, key=len, default=None)


def _likeness(name: str, asked: str, node: str) -> float:
    """Return the likeness, 0 to 1, of a parameter that is set and a parameter that a node asked for in vain.

    The likeness is 0 if the node asked in a namespace that is neither the namespace of the set parameter nor
    the namespace of the node.

    Args:
        name: full name of the set parameter, which lies below the node's name.
        asked: full name of the parameter that the node asked for.
        node: full name of the node.
    """
    namespace, _, set_name = name.rpartition("/")
    asked_namespace, _, asked_name = asked.rpartition("/")
    if asked_namespace not in (namespace, node.rpartition("/")[0]):
        return 0.0
    set_name, asked_name = set_name.lower(), asked_name.lower()
    if set_name != asked_name and set_name.strip("0123456789") == asked_name.strip("0123456789"):
        return 0.0  # names that differ only in their number, such as gain1 and gain2, are two parameters
    return likeness(set_name, asked_name, separator="_")


class ParameterMaster(rosmaster.master_api.ROSMasterHandler):
    """ROS master that remembers the requests for parameters, and the services that were asked for in vain.

    As in rosmaster, its public methods are the methods that nodes call by XML-RPC. The first value of each
    answer is a code, which is 1 for success.
    """

    def __init__(self, *arguments: Any) -> None:
        """Make a master that has had no requests."""
        super().__init__(*arguments)
        self._requests: Dict[Request, bool] = {}  # true if the parameter was set at the last request
        # lock that is held while the attributes here change, because requests come in several threads
        self._requests_lock = threading.Lock()
        # last answer of getUnreadParams; None if a request or a parameter has changed since then
        self._unread: Optional[List[List[str]]] = None
        # nodes that asked for services that do not exist, with the services, in the order of the requests;
        # the values of the dictionary have no meaning
        self._services_in_vain: Dict[Tuple[str, str], None] = {}

    def getParam(self, caller_id: str, key: str) -> Tuple[int, str, Any]:  # noqa: N802
        """Answer as every master, and note that a node has read a parameter."""
        answer = super().getParam(caller_id, key)
        self._note(caller_id, key, is_found=answer[0] == 1)
        return answer

    def hasParam(self, caller_id: str, key: str) -> Tuple[int, str, bool]:  # noqa: N802
        """Answer as every master, and note that a node has asked whether a parameter is set."""
        answer = super().hasParam(caller_id, key)
        self._note(caller_id, key, is_found=bool(answer[2]))
        return answer

    def searchParam(self, caller_id: str, key: str) -> Tuple[int, str, str]:  # noqa: N802
        """Answer as every master, and note that a node has searched a parameter in all its namespaces."""
        code, message, found = super().searchParam(caller_id, key)
        self._note(caller_id, found if code == 1 else key, is_found=code == 1)
        return code, message, found

    def subscribeParam(self, caller_id: str, caller_api: str, key: str) -> Tuple[int, str, Any]:  # noqa: N802
        """Answer as every master, and note that a node has read a parameter, by rospy.get_param_cached."""
        code, message, value = super().subscribeParam(caller_id, caller_api, key)
        # the value of a parameter that is not set is {}
        self._note(caller_id, key, is_found=value != {})
        return code, message, value

    def setParam(self, caller_id: str, key: str, value: Any) -> Tuple[int, str, int]:  # noqa: N802
        """Answer as every master, and note a parameter that a node sets below its own name.

        Such a parameter counts as read, because its name is not misspelt.
        """
        answer = super().setParam(caller_id, key, value)
        self._forget_unread()
        if answer[0] == 1 and resolve_name(key, caller_id).startswith(f"{caller_id}/"):
            self._note(caller_id, key, is_found=True)
        return answer

    def deleteParam(self, caller_id: str, key: str) -> Tuple[int, str, int]:  # noqa: N802
        """Answer as every master; the list of unread parameters may change."""
        answer = super().deleteParam(caller_id, key)
        self._forget_unread()
        return answer

    def lookupService(self, caller_id: str, service: str) -> Tuple[int, str, str]:  # noqa: N802
        """Answer as every master, and note a service that does not exist."""
        code, message, address = super().lookupService(caller_id, service)
        if code != 1 and isinstance(caller_id, str) and isinstance(service, str):
            with self._requests_lock:
                if len(self._services_in_vain) < MAX_REQUESTS:
                    self._services_in_vain[caller_id, resolve_name(service, caller_id)] = None
        return code, message, address

    def getAbsentServices(self, _caller_id: str) -> Tuple[int, str, List[List[str]]]:  # noqa: N802
        """Return the services that nodes asked for and that do not exist now: pairs of node and service."""
        with self._requests_lock:
            asked = list(self._services_in_vain)
        return 1, "", [[node, name] for node, name in asked if name not in self.services]

    def getUnreadParams(self, _caller_id: str) -> Tuple[int, str, List[List[str]]]:  # noqa: N802
        """Return the unread parameters: node, set parameter, and the name that the node asked for in vain."""
        with self._requests_lock:
            if self._unread is None:
                names = self.param_server.get_param_names()
                self._unread = [list(each) for each in never_read(names, self._requests)]
            return 1, "", self._unread

    def _forget_unread(self) -> None:
        """Let the next `getUnreadParams` make its list again, because a parameter was set or deleted."""
        with self._requests_lock:
            self._unread = None

    def _note(self, caller_id: Any, key: Any, is_found: bool) -> None:
        """Remember a node's request for a parameter, and whether the parameter was set.

        A tool such as rqt reads the parameters of all nodes, so its requests do not show that a node uses a
        parameter. Only the requests of a tool for its own parameters count. Any program can send the values,
        so their types are checked.
        """
        if not (isinstance(caller_id, str) and isinstance(key, str) and key):
            return
        name = resolve_name(key, caller_id)
        is_own_parameter = name.startswith(f"{caller_id}/")
        if is_tool(caller_id) and not is_own_parameter:
            return
        request = Request(caller_id, name)
        with self._requests_lock:
            was_found = self._requests.get(request)  # None if the request is new
            if was_found is is_found:
                return
            # a known request is always updated; a new one is stored only up to MAX_REQUESTS requests
            if was_found is not None or len(self._requests) < MAX_REQUESTS:
                self._requests[request] = is_found
                self._unread = None  # the list of unread parameters must be made again


def main() -> None:
    """Run the master with the arguments of rosmaster: `--core -p PORT`."""
    # `rosmaster_main` makes its master from the class of this name
    rosmaster.master_api.ROSMasterHandler = ParameterMaster
    rosmaster_main(sys.argv)


if __name__ == "__main__":
    main()
