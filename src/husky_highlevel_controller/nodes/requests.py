"""Work that other threads ask of the one that owns the simulation."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any, Callable, Deque, Optional, Tuple

import rospy

GLANCE = 0.1  # [s] of wall time between two looks at whether the node is to end


class _Answer:
    def __init__(self) -> None:
        self.given = threading.Event()
        self.result: Any = None
        self.error: Optional[Exception] = None


class Requests:
    """A queue of calls; each is answered when the owner has made it."""

    def __init__(self) -> None:
        self._waiting: Deque[Tuple[Callable[[], Any], _Answer]] = deque()
        self._arrived = threading.Event()

    def ask(self, work: Callable[[], Any]) -> Any:
        """Let the owner do `work`; its result, or its error raised. For every thread but the owner's.

        Raises:
            ROSInterruptException: the node ends before the work was done.
        """
        answer = _Answer()
        self._waiting.append((work, answer))
        self._arrived.set()
        while not answer.given.wait(GLANCE):
            if rospy.is_shutdown():
                raise rospy.ROSInterruptException("the simulator ends")
        if answer.error is not None:
            raise answer.error
        return answer.result

    def serve(self, patience: float = 0.0) -> None:
        """Do what was asked for; if there is nothing, wait for it up to `patience` s. For the owner."""
        if patience > 0.0:
            self._arrived.wait(patience)
            self._arrived.clear()
        while self._waiting:
            work, answer = self._waiting.popleft()
            try:
                answer.result = work()
            except Exception as error:  # whose fault it is, the asker knows
                answer.error = error
            answer.given.set()
