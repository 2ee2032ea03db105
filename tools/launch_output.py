"""Output of launched nodes: a repeated traceback is shown once and counted, rospy's longest line is cut."""

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

REPORT_PERIOD = 5.0  # [s] wall time between two lines that count
MAX_LINES = 200  # longest traceback that is held back until its end
CLOSE_TIMEOUT = 2.0  # [s] longest wait for programs that hold the output open
TRACEBACK = "Traceback (most recent call last):"
BETWEEN = ("During handling of the above exception", "The above exception was the direct cause")
_COLOUR = re.compile(rb"\x1b(\[([0-9;]*m|[0-9;]*$)|$)")


class Folder:
    """Filter of a stream of bytes: each traceback passes once, except for the numbers in its last line."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._line, self._passing = b"", False  # an unfinished line, and whether its begin has passed
        self._held: List[bytes] = []  # lines of a traceback
        self._folded = False  # the last traceback was not shown
        self._counts: Dict[Tuple[str, ...], int] = {}  # number not yet reported, by traceback
        self._counts_since = now()

    def feed(self, data: bytes) -> bytes:
        """Take data, and return the part that passes."""
        *lines, self._line = (self._line + data).split(b"\n")
        passed = b"".join(self._take(line + b"\n") for line in lines)
        if self._line and not self._held and not self._may_be_dropped(self._line):
            passed, self._line, self._passing = passed + self._line, b"", True
        return passed + self.report_when_due()

    def report_when_due(self) -> bytes:
        """A line for each traceback that came again, if the first has waited for REPORT_PERIOD."""
        return self._report() if self._now() - self._counts_since >= REPORT_PERIOD else b""

    def close(self) -> bytes:
        """Return the lines that were held back, and the last counts."""
        held, self._held = b"".join(self._held) + self._line, []
        return held + self._report()

    def _take(self, line: bytes) -> bytes:
        if self._passing:
            self._passing = False
            return line
        text = _plain(line)
        if self._held:
            return self._hold(line, text)
        if text == TRACEBACK or ": bad callback: " in text:
            self._held = [line]
            return b""
        if self._folded and (not text or text.startswith(BETWEEN)):
            return b""
        self._folded = False
        return os.fsencode(shorten(os.fsdecode(line)))

    def _hold(self, line: bytes, text: str) -> bytes:
        """Take another line of a traceback, which ends with the first line that is not indented."""
        self._held.append(line)
        lines = [_plain(each) for each in self._held]
        begin = lines.index(TRACEBACK) if TRACEBACK in lines[:2] else None
        if begin is not None and (text == TRACEBACK or text.startswith(" ")) and len(lines) < MAX_LINES:
            return b""
        held, self._held = b"".join(self._held), []
        self._folded = False
        if begin is None:
            return held
        key = (*lines[begin:-1], re.sub(r"\d+", "#", text))
        if key not in self._counts:
            self._counts[key] = 0
            return held
        if not any(self._counts.values()):
            self._counts_since = self._now()
        self._counts[key] += 1
        self._folded = True
        return b""

    def _report(self) -> bytes:
        sentences = [f"[dev] {count} times more: {key[-1]}\n" for key, count in self._counts.items() if count]
        self._counts = dict.fromkeys(self._counts, 0)
        return "".join(sentences).encode()

    def _may_be_dropped(self, line: bytes) -> bool:
        """Return whether a line that begins like this may not pass, or not as it is."""
        text = _plain(line)
        begins = (TRACEBACK, "[ERROR", "[WARN", *(BETWEEN if self._folded else ()))
        return not self._passing and any(begin.startswith(text) or text.startswith(begin) for begin in begins)


def _plain(line: bytes) -> str:
    return _COLOUR.sub(b"", line).decode(errors="replace").rstrip("\r\n")


class FoldedOutput:
    """Standard output and error of this process and its children, through a `Folder` each."""

    def __init__(self) -> None:
        same = os.path.sameopenfile(1, 2)
        self._channels = [self._divert((1, 2))] if same else [self._divert((1,)), self._divert((2,))]

    @staticmethod
    def _divert(targets: Tuple[int, ...]) -> Tuple[Tuple[int, ...], int, threading.Thread]:
        real = os.dup(targets[0])
        if os.isatty(real):  # nodes that write to a terminal get one
            source, sink = pty.openpty()
            attributes = termios.tcgetattr(sink)
            attributes[1] &= ~termios.OPOST  # the real terminal does this
            termios.tcsetattr(sink, termios.TCSANOW, attributes)
            with contextlib.suppress(termios.error, AttributeError):  # Python 3.11
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
        """Give the real output back, after the rest of the data."""
        for targets, real, thread in self._channels:
            for target in targets:
                os.dup2(real, target)
            thread.join(CLOSE_TIMEOUT)


def _copy(source: int, real: int) -> None:
    folder = Folder()
    with contextlib.suppress(OSError):  # a terminal without writers is an error, a closed real output too
        while True:
            while not select.select([source], [], [], REPORT_PERIOD)[0]:
                _write(real, folder.report_when_due())
            data = os.read(source, 65536)
            if not data:
                break
            _write(real, folder.feed(data))
    with contextlib.suppress(OSError):
        _write(real, folder.close())


def _write(target: int, data: bytes) -> None:
    while data:
        data = data[os.write(target, data) :]
