"""Progress of many tasks on standard error: a bar on a terminal, otherwise a line every ten seconds.

In: the number of tasks that have ended. Out: text for people.
"""

from __future__ import annotations

import sys
import time
from typing import Any, Callable

from tqdm import tqdm

# [s] time between two lines of progress if standard error is not a terminal, as in a CI log
LINE_PERIOD = 10.0


class Progress:
    """Progress of `total` tasks; a context manager."""

    def __init__(self, total: int, title: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._total, self._title, self._clock = total, title, clock
        self._done, self._begin = 0, clock()
        self._last_line = self._begin
        # with `disable=None`, the bar is shown only in a terminal
        self._bar = tqdm(total=total, desc=title, disable=None)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: Any) -> None:
        self._bar.close()

    def update(self, count: int = 1) -> None:
        """Count tasks that have ended, and show their number and the remaining time."""
        self._done += count
        self._bar.update(count)
        now = self._clock()
        has_terminal = not self._bar.disable
        if not has_terminal and now - self._last_line >= LINE_PERIOD and self._done < self._total:
            # [s] remaining time, if the other tasks take as long as those that have ended
            left = (now - self._begin) * (self._total - self._done) / self._done
            print(f"{self._title}: {self._done} of {self._total} done, {left:.0f} s left", file=sys.stderr)
            self._last_line = now
