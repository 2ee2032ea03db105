"""Stop request of a guard: calls the stop service until it is answered, and commands zero meanwhile.

Each call of the service has a thread of its own. So if the controller accepts a call and never answers, the
callbacks of the sensors and the next call still work.
"""

from __future__ import annotations

import queue
import threading
import time
from typing import Callable, Optional

from husky_highlevel_controller.ros.node import contained

CALL_TIMEOUT = 2.0  # [s] a call of the stop service fails if it takes longer than this wall time
RETRY_PERIOD = 0.5  # [s] wall time between a failed call of the stop service and the next call
# [s] wall time from the first call of the stop service to the first zero command, if no answer comes
ZERO_DELAY = 0.2
# [s] wall time between two zero commands; it is short, because twist_mux no longer obeys a topic that was
# silent for 0.5 s
ZERO_PERIOD = 0.05
MAX_HUNG_CALLS = 5  # largest number of calls that may hang at the same time; then no new call is made


class StopRequest:
    """Request to stop the controller; callbacks start it, and one thread (`run`) serves it.

    At most one request is pending. Further dangers are then ignored, because the controller is being stopped.
    """

    def __init__(
        self,
        call: Callable[[], Optional[str]],
        command_zero: Callable[[], None],
        on_failure: Callable[[str, str], None],
        on_success: Callable[[str], None],
    ) -> None:
        """Set up without a pending stop.

        Args:
            call: calls the service, and returns the reason of a failure, or None. It may never return, and it
                may raise any error.
            command_zero: publishes a zero Twist.
            on_failure: gets the danger and the reason after each failed call.
            on_success: gets the danger when the service has answered.
        """
        self._call, self._command_zero = call, command_zero
        self._on_failure, self._on_success = on_failure, on_success
        # text that describes the danger of the pending request
        self._dangers: queue.Queue[str] = queue.Queue(maxsize=1)
        self._call_slots = threading.Semaphore(MAX_HUNG_CALLS)  # one slot for each call that is not answered
        # lock of `start`, which several threads call; only one of them may set `pending` and fill the queue
        self._pending_lock = threading.Lock()
        # true from the request until the service has answered; meanwhile `start` ignores further dangers
        self.pending = False

    def start(self, danger: str) -> None:
        """Request a stop because of a danger, given as text, if none is pending; any thread may call this."""
        # the callbacks of the sensors run in several threads, one for each publisher
        with self._pending_lock:
            if not self.pending:
                self.pending = True
                self._dangers.put_nowait(danger)

    def run(self, is_shutdown: Callable[[], bool]) -> None:
        """Serve the requests, one after the other, until the node is shut down.

        If an error comes while a request is served, the error is logged, and the request is served again.
        """
        while not is_shutdown():
            try:
                danger = self._dangers.get(timeout=ZERO_PERIOD)
            except queue.Empty:
                continue
            while self.pending and not is_shutdown():
                with contained("the stop of the controller"):
                    self._serve(danger, is_shutdown)
                    # `start` ignores a danger that comes just before this line; this does no harm, because
                    # the controller has just been stopped
                    self.pending = False
                if self.pending:  # an error has come in `_serve`
                    time.sleep(ZERO_PERIOD)

    def _serve(self, danger: str, is_shutdown: Callable[[], bool]) -> None:
        """Call the service until a call succeeds or the node is shut down.

        A call fails if the service refuses, raises, or does not answer within CALL_TIMEOUT. From ZERO_DELAY
        on, and between two calls, zero commands are sent, because the robot must not drive on meanwhile. If a
        call succeeds before ZERO_DELAY, no zero command is sent, because the controller stops the robot.
        """
        zeros_from = time.monotonic() + ZERO_DELAY  # [s] wall time; the service is first called now
        while not is_shutdown():
            failure = self._failure_of_call(zeros_from, is_shutdown)
            if failure is None:
                self._on_success(danger)
                return
            if is_shutdown():  # the wait for the answer was cut short, so the call has not failed
                return
            self._on_failure(danger, failure)
            again = time.monotonic() + RETRY_PERIOD
            while time.monotonic() < again and not is_shutdown():
                self._command_zero()
                time.sleep(ZERO_PERIOD)

    def _failure_of_call(self, zeros_from: float, is_shutdown: Callable[[], bool]) -> Optional[str]:
        """Call the service, and return why the call has failed, or None if it has succeeded.

        If the service answers quickly, the controller has stopped the robot, and no zero command is needed.
        So zero commands are sent only if there is no answer until the wall time `zeros_from` [s]. If the node
        is shut down during the wait, the call counts as not answered.
        """
        answers = self._start_call()  # queue that gets the reason of a failure, or None for success
        end = time.monotonic() + CALL_TIMEOUT
        while time.monotonic() < end and not is_shutdown():
            try:
                return answers.get(timeout=ZERO_PERIOD)
            except queue.Empty:
                if time.monotonic() > zeros_from:
                    self._command_zero()
        return f"it did not answer within {CALL_TIMEOUT:g} s"

    def _start_call(self) -> queue.Queue[Optional[str]]:
        """Call the service in a new thread, and return the queue that gets the outcome.

        The outcome is the reason of a failure, or None. If MAX_HUNG_CALLS calls still hang, no call is made
        and the queue stays empty.
        """
        answers: queue.Queue[Optional[str]] = queue.Queue()

        def call() -> None:
            """Call the service, and put the outcome into the queue."""
            try:
                answers.put(self._call())
            except Exception as error:  # the service did not answer, or any other error has come
                answers.put(f"{type(error).__name__}: {error}")
            finally:
                self._call_slots.release()

        if self._call_slots.acquire(blocking=False):
            threading.Thread(target=call, daemon=True).start()
        return answers
