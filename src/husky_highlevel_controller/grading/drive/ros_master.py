"""Asks a ROS master over XML-RPC: parameters, services, who subscribes to what.

In: a master's address. Out: values. Must not know: rospy, what the answers are for.
"""

from __future__ import annotations

from typing import Any, Tuple
from xmlrpc.client import Error as XmlRpcError
from xmlrpc.client import ServerProxy

CALLER = "/marking"


def has_parameter(uri: str, name: str) -> bool:
    """Whether a parameter is set."""
    return bool(_ask(uri, "hasParam", name))


def number(uri: str, name: str) -> float:
    """A parameter that is a number; 0 where it is not set."""
    value = _ask(uri, "getParam", name)
    return float(value) if isinstance(value, (int, float)) else 0.0


def has_service(uri: str, name: str) -> bool:
    """Whether a node offers a service."""
    return bool(_ask(uri, "lookupService", name))


def subscriptions(uri: str, node: str) -> Tuple[str, ...]:
    """Topics that a node subscribes to."""
    state = _ask(uri, "getSystemState")
    return tuple(sorted(topic for topic, nodes in state[1] if node in nodes)) if state else ()


def _ask(uri: str, method: str, *arguments: str) -> Any:
    """The master's answer; None where it has none."""
    try:
        with ServerProxy(uri) as master:
            code, _, value = getattr(master, method)(CALLER, *arguments)
    except (OSError, XmlRpcError, ValueError):
        return None
    return value if code == 1 else None
