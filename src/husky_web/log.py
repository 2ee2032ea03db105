"""The log: a ring of lines, filtered, as HTML.

In: rosgraph_msgs/Log, and rosout's file with earlier lines. Out: HTML.
"""

from __future__ import annotations

import re
from collections import deque
from datetime import datetime, timezone
from html import escape
from typing import Any, Deque, Dict, Iterable, List, NamedTuple, Optional

from husky_highlevel_controller.ros.refused_connection import shorten

LEVELS = {"debug": 1, "info": 2, "warn": 4, "error": 8, "fatal": 16}  # rosgraph_msgs/Log
CAPACITY = 2000  # largest number of lines that are kept
EARLIER = 1000  # largest number of older lines, from before the page's start, that are read from rosout.log
# pattern of a line of rosout.log: stamp, level, node and message; the place in the code and the topics of the
# node, both in brackets, are skipped
_ROSOUT = re.compile(
    r"(\d+\.\d+) (DEBUG|INFO|WARN|ERROR|FATAL) (\S+) (?:\[[^\]]*\] )?(?:\[topics: [^\]]*\] )?(.*)"
)
_NUMBER = re.compile(r"[-+]?\d[\d.]*")
DAY_ONE = 1e9  # [s] a stamp above this (after 2001) is wall-clock time; a stamp below this is simulated time
# largest number of lines and characters that a page shows, because a browser is too slow for more
SHOWN, SHOWN_LETTERS = 150, 30_000
MAX_LETTERS = 5000  # largest number of characters of a line


class Line(NamedTuple):
    """Line of the log."""

    level: int
    stamp: float  # [s]
    node: str
    text: str


class LogRow(NamedTuple):
    """Row of the log in the page: a group of lines that differ only in their numbers."""

    line: Line  # newest line of the group
    times: int  # number of lines in the group


class Filter(NamedTuple):
    """Conditions of a shown line, which must all be met; every line meets an empty condition."""

    level: int = LEVELS["info"]  # lowest level
    node: str = ""  # text that the node's name must contain
    text: str = ""  # text that the line must contain, in upper or lower case

    def passes(self, line: Line) -> bool:
        """Return whether a line is shown."""
        return (
            line.level >= self.level
            and self.node.lower() in line.node.lower()
            and self.text.lower() in line.text.lower()
        )


class LogBuffer:
    """The last lines of the whole network."""

    def __init__(self) -> None:
        # number of all lines that were added so far; a page shows the log again if this number has changed
        self.count = 0
        self.warning: Optional[Line] = None  # newest line with the level WARN or worse; None if there is none
        self._lines: Deque[Line] = deque(maxlen=CAPACITY)

    def add(self, msg: Any) -> None:
        """Keep a message of /rosout."""
        line = Line(msg.level, msg.header.stamp.to_sec(), msg.name[:MAX_LETTERS], _cut(msg.msg))
        if line.level >= LEVELS["warn"]:
            self.warning = line
        self._lines.append(line)
        self.count += 1

    def add_earlier(self, lines: Iterable[Line]) -> None:
        """Put the last EARLIER lines of a file before the lines that came as messages.

        Lines of the file that came as messages, too, are left out.
        """

        def rounded(line: Line) -> Line:
            """Return a line with a stamp of six digits after the point, as in the file."""
            return line._replace(stamp=round(line.stamp, 6))

        received = {rounded(line) for line in list(self._lines)}
        earlier = [line for line in lines if rounded(line) not in received]
        # the newest of the earlier lines are kept, so that no line is missing between them and the messages
        room = min(EARLIER, CAPACITY - len(self._lines))
        earlier = earlier[max(0, len(earlier) - room) :]
        # `extendleft` puts each line before all others, so the newest of the earlier lines must come first
        self._lines.extendleft(reversed(earlier))
        self.count += len(earlier)  # a page shows the log again if this number has changed

    def select(self, condition: Filter) -> List[LogRow]:
        """Return the newest lines that pass, newest first, as many as a page can show.

        If a text is searched, each line is a row of its own. Otherwise, lines of a node that differ only in
        their numbers are one row.
        """
        lines = [line for line in reversed(list(self._lines)) if condition.passes(line)]
        rows = [LogRow(line, 1) for line in lines] if condition.text else _grouped(lines)
        shown: List[LogRow] = []
        letters = 0
        for row in rows[:SHOWN]:
            letters += len(row.line.text)
            if letters > SHOWN_LETTERS:
                break
            shown.append(row)
        return shown


def _grouped(lines: Iterable[Line]) -> List[LogRow]:
    """Return a row for each group of lines that differ only in their numbers; all newest first."""
    rows: Dict[Any, LogRow] = {}  # a dictionary keeps the order in which the rows were added
    for line in lines:
        key = (line.level, line.node, _NUMBER.sub("#", line.text))
        row = rows.get(key, LogRow(line, 0))  # the first line of a group is its newest line
        rows[key] = row._replace(times=row.times + 1)
    return list(rows.values())


def lines_of_rosout(text: str) -> List[Line]:
    """Return the lines of the rosout node's file; a row without a stamp belongs to the line above it."""
    lines: List[Line] = []
    for row in text.splitlines():
        found = _ROSOUT.match(row)
        if found:
            stamp, level, node, message = found.groups()
            lines.append(Line(LEVELS[level.lower()], float(stamp), node, message))
        elif lines and row:
            lines[-1] = lines[-1]._replace(text=f"{lines[-1].text}\n{row}")
    return [line._replace(node=line.node[:MAX_LETTERS], text=_cut(line.text)) for line in lines]


def _cut(text: str) -> str:
    """Return the text of a line, with MAX_LETTERS at most."""
    text = shorten(text)
    return text if len(text) <= MAX_LETTERS else f"{text[:MAX_LETTERS]} ..."


def log_to_html(rows: Iterable[LogRow]) -> str:
    """Return rows as HTML; texts of nodes are escaped."""
    names = {number: name for name, number in LEVELS.items()}
    divisions = []
    for line, times in rows:
        # a node may send a level that is not in LEVELS
        style, level = names.get(line.level, "info"), names.get(line.level, "?")
        repetitions = f" <i>&times;{times}</i>" if times > 1 else ""
        divisions.append(
            f'<div class="{style}"><span class="time">{_moment(line.stamp)}</span> '
            f'<b>{level}</b> <span class="node">{escape(line.node)}</span> '
            f"{escape(line.text)}{repetitions}</div>"
        )
    return f'<div class="husky-block husky-log">{"".join(divisions) or "no lines pass the filter"}</div>'


def _moment(stamp: float) -> str:
    """Return simulated time in seconds, or the time of day (UTC) of a node that uses the wall clock."""
    if stamp < DAY_ONE:
        return f"{stamp:.2f}"
    return datetime.fromtimestamp(stamp, timezone.utc).strftime("%H:%M:%S")
