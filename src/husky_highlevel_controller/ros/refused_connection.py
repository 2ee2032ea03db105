"""Shortens rospy's line of the log on a connection with a wrong type of messages to one sentence.

rospy 1.15.15 (tcpros_base.py) appends the whole header of the connection, with the definition of the message,
so the line is very long. In: a line of the log. Out: the line. This module imports only the standard library,
because `./dev launch` uses it.
"""

from __future__ import annotations

import ast
import re

# rospy's words on a refused connection: fixed words, the reason, and the header as a dictionary of Python
_WORDS = re.compile(r"Could not process inbound connection: (?P<reason>[^{]*)(?P<header>\{'.*'\})")


def shorten(line: str) -> str:
    """Return a line of the log; rospy's words on a refused connection are replaced by one sentence.

    rospy writes `Could not process inbound connection: REASON{'topic': '/scan', 'callerid': '/walker', ...}`.
    The sentence is `/walker cannot connect to /scan: REASON`.
    """
    words = _WORDS.search(line)
    if words is None:
        return line
    try:
        header = ast.literal_eval(words["header"])
        sentence = f"{header['callerid']} cannot connect to {header['topic']}: {words['reason']}"
    except (ValueError, SyntaxError, KeyError, TypeError, MemoryError, RecursionError):
        return line
    return line[: words.start()] + sentence + line[words.end() :]
