"""XML-RPC client with a deadline, for ROS masters and nodes that may not answer.

Imports only the standard library, because every launch waits for this module.
"""

from __future__ import annotations

from http.client import HTTPException
from typing import Any, Optional, Tuple
from xml.parsers.expat import ExpatError
from xmlrpc.client import Error, ServerProxy, Transport

DEADLINE = 5.0  # [s] longest wall time for which a call waits for its answer


class _Transport(Transport):
    """Transport of XML-RPC with a deadline for answers, which Python's own transport does not have."""

    def __init__(self, deadline: float) -> None:
        super().__init__()
        self._deadline = deadline

    def make_connection(self, host: Any) -> Any:
        """Make a connection on which each wait for an answer ends at the deadline."""
        connection = super().make_connection(host)
        connection.timeout = self._deadline
        return connection


def server(uri: str, deadline: float) -> ServerProxy:
    """Return a client of an XML-RPC server; its calls raise OSError if no answer comes in `deadline` [s]."""
    return ServerProxy(uri, _Transport(deadline))


def reply(uri: str, method: str, *arguments: Any, deadline: float = DEADLINE) -> Optional[Tuple[int, Any]]:
    """Call a method of a master, node or roslaunch; return code and value, or None without an answer in time.

    The code is 1 for success, -1 for a refusal, 0 for a failure (http://wiki.ros.org/ROS/Master_API).

    Args:
        uri: address of the master, node or roslaunch.
        method: name of the method.
        *arguments: arguments of the method; the first one is the name of the caller.
        deadline: longest time to wait for the answer [s].
    """
    try:
        with server(uri, deadline) as api:
            code, _, value = getattr(api, method)(*arguments)
    except (
        OSError,
        HTTPException,
        Error,
        ExpatError,
        ValueError,
        TypeError,
    ):
        # either the master has not answered, or another program that listens on the port has answered
        return None
    return code, value


def ask(uri: str, method: str, *arguments: Any, deadline: float = DEADLINE) -> Any:
    """Call a method as `reply` does; return its value, or None if it fails or does not answer in time."""
    answer = reply(uri, method, *arguments, deadline=deadline)
    if answer is None:
        return None
    code, value = answer
    return value if code == 1 else None
