"""Shortens rospy's line of the log on a connection with a wrong type of messages to one sentence.

rospy 1.15.15 (tcpros_base.py) appends the whole header of the connection, with the definition of the message,
so the line is very long. In: a line of the log. Out: the line. This module imports only the standard library,
because `./dev launch` uses it.
"""

from __future__ import annotations

import ast
import re

BEGIN = "Could not process inbound connection: "  # rospy's words before the reason and the header
# finds BEGIN and two groups: `reason`, and then `header`, which is a dictionary such as {'topic': '/scan'}
_LINE = re.compile(rf"{BEGIN}(?P<reason>[^{{]*)(?P<header>\{{'.*'\}})")


def shorten(line: str) -> str:
    """Return a line with the node and the topic in place of the header; every other line as it is.

    rospy's line begins with fixed words (BEGIN), then has the reason, then the header as a Python dictionary.
    """
    found = _LINE.search(line)
    if found is None:
        return line
    try:
        # `callerid` is the name of the node that cannot connect, and `topic` is the topic of the connection
        header = ast.literal_eval(found["header"])
        sentence = f"{header['callerid']} cannot connect to {header['topic']}: {found['reason']}"
    except (ValueError, SyntaxError, KeyError, TypeError, MemoryError, RecursionError):
        return line
    return line[: found.start()] + sentence + line[found.end() :]
