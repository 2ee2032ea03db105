"""Output of launched nodes: each traceback is shown once, and its repetitions are counted.

rospy's long line on a refused connection is shortened, see `refused_connection`.
"""

from __future__ import annotations

import contextlib
import os
import pty
import re
import select
import termios
import threading
import time
from typing import Callable, Dict, List, Tuple

from husky_highlevel_controller.ros.refused_connection import shorten

REPORT_PERIOD = 5.0  # [s] wall time between two reports of repetitions
MAX_LINES = 200  # longest traceback that is held back until its end
CLOSE_TIMEOUT = 2.0  # [s] longest wait for programs that hold the output open
TRACEBACK = "Traceback (most recent call last):"
# first words of the lines that Python prints between the tracebacks of exceptions that caused each other
BETWEEN = ("During handling of the above exception", "The above exception was the direct cause")
# code of a terminal's colour, and the beginning of such a code at the end of the data
_COLOUR = re.compile(rb"\x1b(\[([0-9;]*m|[0-9;]*$)|$)")


class Folder:
    """Filter of a stream of bytes: each traceback passes once, and its repetitions are dropped and counted.

    Tracebacks that differ only in the numbers of their last line are repetitions of each other.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._line = b""  # start of a line that has not ended yet and has not passed
        self._has_start_passed = False  # true if the start of the line has passed, so its rest passes, too
        self._held: List[bytes] = []  # lines of a traceback that has not ended yet
        self._is_dropping = False  # true if the last traceback was dropped as a repetition
        # for each traceback, the number of repetitions that no report has counted yet
        self._counts: Dict[Tuple[str, ...], int] = {}
        self._counts_since = now()  # time of the first repetition that no report has counted yet

    def feed(self, data: bytes) -> bytes:
        """Take data, and return the part that passes."""
        *lines, self._line = (self._line + data).split(b"\n")
        passed = b"".join(self._take(line + b"\n") for line in lines)
        # the start of a line passes without its rest if possible, because it may be a question to a person
        if self._line and not self._held and not self._must_wait(self._line):
            passed += self._line
            self._line = b""
            self._has_start_passed = True
        return passed + self.report_when_due()

    def report_when_due(self) -> bytes:
        """Return a line for each traceback with repetitions, if the first one came REPORT_PERIOD ago."""
        if self._now() - self._counts_since < REPORT_PERIOD:
            return b""
        return self._report()

    def close(self) -> bytes:
        """Return the lines that were held back, and the last counts."""
        held = b"".join(self._held) + self._line
        self._held = []
        return held + self._report()

    def _take(self, line: bytes) -> bytes:
        """Take a line with its end, and return what passes now."""
        if self._has_start_passed:  # `line` is only the rest of a line whose start has passed
            self._has_start_passed = False
            return line
        text = _plain(line)
        if self._held:
            return self._hold(line, text)
        # rospy prints a line with "bad callback" before the traceback of a callback
        if text == TRACEBACK or ": bad callback: " in text:
            self._held = [line]
            return b""
        if self._is_dropping and (not text or text.startswith(BETWEEN)):
            return b""  # the line between the dropped traceback and the next one is dropped, too
        self._is_dropping = False
        return os.fsencode(shorten(os.fsdecode(line)))

    def _hold(self, line: bytes, text: str) -> bytes:
        """Hold another line; at the end of the traceback, return all its lines, or drop a repetition.

        A traceback ends with its first line that is not indented.
        """
        self._held.append(line)
        lines = [_plain(each) for each in self._held]
        # the line before TRACEBACK, if any, is rospy's line with "bad callback"
        begin = lines.index(TRACEBACK) if TRACEBACK in lines[:2] else None
        if begin is not None and (text == TRACEBACK or text.startswith(" ")) and len(lines) < MAX_LINES:
            return b""
        held, self._held = b"".join(self._held), []
        self._is_dropping = False
        if begin is None:  # no traceback follows rospy's line
            return held
        key = (*lines[begin:-1], re.sub(r"\d+", "#", text))  # the same for all repetitions of a traceback
        if key not in self._counts:
            self._counts[key] = 0
            return held
        if not any(self._counts.values()):
            self._counts_since = self._now()
        self._counts[key] += 1
        self._is_dropping = True
        return b""

    def _report(self) -> bytes:
        """Return a line for each traceback with repetitions, and begin to count again."""
        sentences = [f"[dev] {count} times more: {key[-1]}\n" for key, count in self._counts.items() if count]
        self._counts = dict.fromkeys(self._counts, 0)
        return "".join(sentences).encode()

    def _must_wait(self, start: bytes) -> bool:
        """Return whether the start of a line must wait for its rest, because the line may have to change."""
        if self._has_start_passed:
            return False
        text = _plain(start)
        # beginnings of the lines that may be dropped or shortened
        begins = [TRACEBACK, "[ERROR", "[WARN"]
        if self._is_dropping:
            begins += BETWEEN
        # `text` may be longer than such a beginning, or only the first letters of it
        return any(begin.startswith(text) or text.startswith(begin) for begin in begins)


def _plain(line: bytes) -> str:
    """Return a line without colours and without its end."""
    return _COLOUR.sub(b"", line).decode(errors="replace").rstrip("\r\n")


class FoldedOutput:
    """Standard output and error of this process and its children, each through a `Folder` of its own."""

    def __init__(self) -> None:
        # 1 and 2 are the numbers of the standard output and of the standard error of a process
        if os.path.sameopenfile(1, 2):
            self._channels = [self._divert((1, 2))]
        else:
            self._channels = [self._divert((1,)), self._divert((2,))]

    @staticmethod
    def _divert(targets: Tuple[int, ...]) -> Tuple[Tuple[int, ...], int, threading.Thread]:
        """Let `_copy` read everything that is written to `targets`, numbers of open files with one output.

        Returns:
            Targets, a copy of their real output, and the thread of `_copy`.
        """
        real = os.dup(targets[0])
        if os.isatty(real):  # if the real output is a terminal, nodes write to a terminal, too
            source, sink = pty.openpty()
            attributes = termios.tcgetattr(sink)
            attributes[1] &= ~termios.OPOST  # line ends stay as they are; the real terminal converts them
            termios.tcsetattr(sink, termios.TCSANOW, attributes)
            with contextlib.suppress(termios.error, AttributeError):  # Python before 3.11 has no tcsetwinsize
                termios.tcsetwinsize(sink, termios.tcgetwinsize(real))
        else:
            source, sink = os.pipe()
        for target in targets:
            os.dup2(sink, target)
        os.close(sink)
        thread = threading.Thread(target=_copy, args=(source, real), daemon=True)
        thread.start()
        return targets, real, thread

    def close(self) -> None:
        """Let this process write to the real output again, and wait until the rest of the data is copied."""
        for targets, real, thread in self._channels:
            for target in targets:
                os.dup2(real, target)
            thread.join(CLOSE_TIMEOUT)


def _copy(source: int, real: int) -> None:
    """Copy the output from `source` to `real` through a `Folder`, until nobody writes to it any more."""
    tracebacks = Folder()
    # an OSError ends the copy: nobody writes to the terminal any more, or the real output is closed
    with contextlib.suppress(OSError):
        while True:
            while not select.select([source], [], [], REPORT_PERIOD)[0]:
                _write(real, tracebacks.report_when_due())
            data = os.read(source, 65536)
            if not data:
                break
            _write(real, tracebacks.feed(data))
    with contextlib.suppress(OSError):
        _write(real, tracebacks.close())


def _write(target: int, data: bytes) -> None:
    """Write all data; one call of os.write may write only a part."""
    while data:
        data = data[os.write(target, data) :]
