"""Queue of calls that service threads make into the thread that owns the simulation."""

from __future__ import annotations

import threading
from collections import deque
from concurrent.futures import Future, wait
from functools import partial
from typing import Any, Callable, Deque, Tuple

import rospy
from std_srvs.srv import Empty

from husky_highlevel_controller.datatypes import HuskyError

SHUTDOWN_POLL_PERIOD = 0.1  # [s] wall time between two checks whether the node is shutting down


class CallQueue:
    """Queue of calls; each returns when the thread that owns the simulation (the owner) has made it.

    Calls that step or reset the simulation wait until the owner is not in the middle of a step itself.
    """

    def __init__(self, report: Callable[[str], None] = lambda _: None) -> None:
        """Call `report` with a sentence about each request that changed the world or read its true state."""
        self.report = report
        self._has_changed_world = False  # true if work has changed the world since `take_change`
        self._calls: Deque[Tuple[Callable[[], Any], Future]] = deque()
        self._calls_between_steps: Deque[Tuple[Callable[[], Any], Future]] = deque()
        self._arrived = threading.Event()

    def call(self, work: Callable[[], Any], between_steps: bool = False) -> Any:
        """Let the owner do `work`, and return its result or raise its error.

        The owner itself must not call this method, because it would wait for itself.
        The owner also does work in the middle of a step, while lockstep waits there. But work `between_steps`
        waits for the end of the step. A node that ends before the work is done raises ROSInterruptException.
        """
        future: Future = Future()
        calls = self._calls_between_steps if between_steps else self._calls
        calls.append((work, future))
        self._arrived.set()
        while not wait([future], SHUTDOWN_POLL_PERIOD).done:  # the loop ends when the call is made
            if rospy.is_shutdown():
                raise rospy.ROSInterruptException("the simulator ends")
        return future.result()

    def ask(
        self, work: Callable[[], str], changes: bool = True, between_steps: bool = False
    ) -> Tuple[bool, str]:
        """Let the owner do work that returns a sentence. Return success and a message; log a refusal.

        If the work `changes` the world, `report` gets the sentence, too. The work begins at once, or
        `between_steps`, see `call`.
        """

        def change() -> str:
            """Do work that changes the world, in the owner's thread."""
            sentence = work()
            self._has_changed_world = True
            return sentence

        try:
            sentence = self.call(change if changes else work, between_steps)
            if changes:
                self.report(sentence)
            return True, sentence
        except HuskyError as error:
            rospy.logwarn(f"refused: {error}")
            return False, str(error)

    def offer(self, name: str, kind: Any, work: Callable[[Any], str], **options: bool) -> None:
        """Offer a service that lets the owner do `work` for each request.

        The response has a success and a message, as `ask` returns them; the `options` are `changes` and
        `between_steps` of `ask`. The response of an Empty service has no fields, so a refused call of it ends
        with an error for the caller.
        """

        def respond(request: Any) -> Tuple:
            success, message = self.ask(partial(work, request), **options)
            if kind is not Empty:
                return success, message
            if not success:
                raise rospy.ServiceException(message)
            return ()

        rospy.Service(name, kind, respond)

    def take_change(self) -> bool:
        """Return whether requests have changed the world since the last call of this; for the owner only."""
        has_changed, self._has_changed_world = self._has_changed_world, False
        return has_changed

    def process(self, timeout: float = 0.0) -> None:
        """Make all calls; if there is none, wait for one up to `timeout` s.

        Only the owner may call this, between two steps.
        """
        if timeout > 0.0:
            self._arrived.wait(timeout)
            self._arrived.clear()
        self.process_during_step()
        while self._calls_between_steps:
            _make(*self._calls_between_steps.popleft())

    def process_during_step(self) -> None:
        """Make the calls that need not wait for the end of a step; only the owner may call this."""
        while self._calls:
            _make(*self._calls.popleft())


def _make(work: Callable[[], Any], future: Future) -> None:
    """Make a call, and give its result or its error to the caller."""
    try:
        future.set_result(work())
    except Exception as error:  # `call` raises this error again, in the thread that waits for the result
        future.set_exception(error)
