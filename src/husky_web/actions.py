"""Service calls of the page, one after the other in their own thread, each with a deadline."""

from __future__ import annotations

import contextlib
import queue
import threading
import traceback
from concurrent import futures
from typing import Any, Callable, Optional

import rosgraph
import rospy
import viser

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.xml_rpc import ask

NOTICE_TIME = 6.0  # [s] time for which a notification is shown
# [s] longest wall time of a service call; LONG_TIMEOUT is for services that may take long, such as load_world
CALL_TIMEOUT, LONG_TIMEOUT = 5.0, 60.0
MASTER_DEADLINE = 2.0  # [s] longest wall time for an answer of the ROS master
# function that does the work of a button; it returns a sentence for the page, or None
Work = Callable[[], Optional[str]]


class Actions:
    """Runs queued service calls in order, and shows each result as a notification."""

    def __init__(self) -> None:
        self._waiting: queue.Queue[Any] = queue.Queue()
        threading.Thread(target=self._run, name="actions", daemon=True).start()

    def do(self, work: Work, client: Optional[viser.ClientHandle], title: str) -> None:
        """Call `work` soon; its sentence, or its error, goes to the page of `client`."""
        self._waiting.put((work, client, title))

    def _run(self) -> None:
        """Work through the queue, in the thread of the calls."""
        while True:
            work, client, title = self._waiting.get()
            try:
                sentence, is_good = work(), True
            except HuskyError as error:
                sentence, is_good = str(error), False
                rospy.logwarn(f"{title}: {error}")
            except Exception as error:  # an error of one call must not stop the calls of other buttons
                sentence, is_good = f"{type(error).__name__}: {error}", False
                rospy.logwarn(f"{title}: {traceback.format_exc()}")
            if sentence and client is not None:  # the client is None if no page waits for the result
                with contextlib.suppress(Exception):  # notifying a page fails if the page has been closed
                    notify(client, title, sentence, is_good)


def parameter(name: str, default: Any) -> Any:
    """Return the value of a parameter; the default if it is not set or the master does not answer in time."""
    value = ask(rosgraph.get_master_uri(), "getParam", rospy.get_name(), name, deadline=MASTER_DEADLINE)
    return default if value is None else value


def notify(client: viser.ClientHandle, title: str, sentence: str, is_good: bool = True) -> None:
    """Show a sentence in one page for a while."""
    client.add_notification(
        title, sentence, color="green" if is_good else "red", auto_close_seconds=NOTICE_TIME
    )


def answer_of(service: str, kind: Any, *args: Any, timeout: Optional[float] = None) -> Any:
    """Call a service, and return its answer, which must come within `timeout` [s], by default CALL_TIMEOUT.

    Raises:
        HuskyError: the service does not exist, fails, or does not answer in time.
    """
    # rospy has no deadline for a call, so another thread makes the call, and this thread waits for the answer
    answer: futures.Future[Any] = futures.Future()

    def ask() -> None:
        """Call the service, and keep its answer or its error."""
        try:
            answer.set_result(rospy.ServiceProxy(service, kind)(*args))
        except Exception as error:  # raised again below
            answer.set_exception(error)

    threading.Thread(target=ask, name=service, daemon=True).start()
    seconds = timeout or CALL_TIMEOUT
    try:
        return answer.result(seconds)
    except futures.TimeoutError:
        # the other thread goes on, because a call cannot be cancelled
        raise HuskyError(f"{service} has not answered for {seconds:g} s; it may still act") from None
    except Exception as error:
        raise HuskyError(f"{service}: {error}") from None


def call(service: str, kind: Any, *args: Any, timeout: Optional[float] = None) -> str:
    """Call a service that answers success and a sentence, and return the sentence.

    Raises:
        HuskyError: the service does not exist, fails, or does not answer in time.
    """
    answer = answer_of(service, kind, *args, timeout=timeout)
    # the sentence is in `status_message` in this project's services, and in `message` in std_srvs
    sentence = getattr(answer, "status_message", getattr(answer, "message", ""))
    if not getattr(answer, "success", True):
        raise HuskyError(str(sentence) or f"{service} failed without a reason")
    return str(sentence)
