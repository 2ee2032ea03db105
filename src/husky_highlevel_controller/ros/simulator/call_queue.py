"""Queue of service calls for the thread that owns the simulation.

rospy answers each service call in a thread of its own, but only one thread may use the simulation. So the
service threads put their work into this queue, and wait until the other thread has done it.
"""

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
    """Queue of work for the thread that owns the simulation (the owner).

    Work that steps or resets the simulation waits until the owner is not in the middle of a step itself.
    """

    def __init__(self, report: Callable[[str], None] = lambda _: None) -> None:
        """Set up without any work."""
        # function that gets a sentence about each request that changed the world or read true poses
        self.report = report
        self._has_changed_world = False  # true if work has changed the world since `take_change`
        # work that the owner may also do in the middle of a step, each with the future of its result
        self._calls: Deque[Tuple[Callable[[], Any], Future]] = deque()
        # work that the owner may do only between two steps, each with the future of its result
        self._calls_between_steps: Deque[Tuple[Callable[[], Any], Future]] = deque()
        self._arrived = threading.Event()  # set when work has come, to wake an owner that waits in `process`

    def call(self, work: Callable[[], Any], between_steps: bool = False) -> Any:
        """Let the owner do `work`, wait until it is done, and return its result or raise its error.

        The owner itself must not call this method, because it would wait for itself.

        Args:
            work: function that the owner calls.
            between_steps: true if the work must wait for the end of the present step; otherwise the owner may
                also do it in the middle of a step, while lockstep waits there.

        Raises:
            rospy.ROSInterruptException: the node ends before the work is done.
        """
        future: Future = Future()
        calls = self._calls_between_steps if between_steps else self._calls
        calls.append((work, future))
        self._arrived.set()
        # `wait` returns the futures that are done within the timeout; the loop ends when the work is done
        while not wait([future], SHUTDOWN_POLL_PERIOD).done:
            if rospy.is_shutdown():
                raise rospy.ROSInterruptException("the simulator ends")
        return future.result()

    def ask(
        self, work: Callable[[], str], changes: bool = True, between_steps: bool = False
    ) -> Tuple[bool, str]:
        """Let the owner do work for a request, and return success and a message for the response.

        Args:
            work: function that the owner calls. It returns a sentence, which is the message. If it raises
                HuskyError, the request is refused: the error is logged, and is the message.
            changes: whether the work changes the world; if so, `report` gets the sentence, too.
            between_steps: true if the work must wait for the end of the present physics step.
        """

        def change() -> str:
            """Do the work in the owner's thread, and note for `take_change` that the world has changed."""
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
        """Offer a service that lets the owner do `work` for each request; by default, `changes` is true.

        Args:
            name: name of the service.
            kind: type of the service; its response has the fields success and message, or no fields (Empty).
            work: function that the owner calls with the request; it returns a sentence for the message.
            **options: options of `ask`: `changes`, whether the work changes the world (defaults to true), and
                `between_steps`, whether it must wait for the end of the present physics step (defaults to
                false).
        """

        def respond(request: Any) -> Tuple:
            """Return the values of the response's fields."""
            success, message = self.ask(partial(work, request), **options)
            if kind is not Empty:
                return success, message
            # a response without fields cannot say that the request was refused, so the call fails instead
            if not success:
                raise rospy.ServiceException(message)
            return ()

        rospy.Service(name, kind, respond)

    def take_change(self) -> bool:
        """Return whether requests have changed the world since the last call; only for the owner."""
        has_changed, self._has_changed_world = self._has_changed_world, False
        return has_changed

    def process(self, timeout: float = 0.0) -> None:
        """Do all work that has come. If none has come, first wait for work, but for at most `timeout` [s].

        Only the owner may call this, between two steps.
        """
        if timeout > 0.0:
            self._arrived.wait(timeout)
            self._arrived.clear()
        self.process_during_step()
        while self._calls_between_steps:
            _do(*self._calls_between_steps.popleft())

    def process_during_step(self) -> None:
        """Do the work that need not wait for the end of a step; only the owner may call this."""
        while self._calls:
            _do(*self._calls.popleft())


def _do(work: Callable[[], Any], future: Future) -> None:
    """Do some work, and give its result or its error to the thread that waits for the future."""
    try:
        future.set_result(work())
    except Exception as error:  # `call` raises this error again, in the thread that waits
        future.set_exception(error)
