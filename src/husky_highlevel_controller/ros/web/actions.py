"""What the page asks the network to do: services, called one after the other by a thread of their own."""

from __future__ import annotations

import queue
import threading
from typing import Any, Callable, Optional

import rospy
import viser

from husky_highlevel_controller.datatypes import HuskyError

NOTICE_TIME = 6.0  # [s] that a sentence stays in the page
Work = Callable[[], Optional[str]]  # returns a sentence for the page; None: nothing worth saying


class Actions:
    """Runs the page's wishes in order, and tells the page that asked what became of each."""

    def __init__(self) -> None:
        self._waiting: queue.Queue[Any] = queue.Queue()
        threading.Thread(target=self._run, name="actions", daemon=True).start()

    def do(self, work: Work, client: Optional[viser.ClientHandle], title: str) -> None:
        """Call `work` soon; its sentence, or its error, goes to the page of `client`."""
        self._waiting.put((work, client, title))

    def _run(self) -> None:
        while not rospy.is_shutdown():
            try:
                work, client, title = self._waiting.get(timeout=1.0)
            except queue.Empty:
                continue
            try:
                sentence, is_good = work(), True
            except (HuskyError, rospy.ROSException, rospy.ServiceException, OSError, ValueError) as error:
                sentence, is_good = str(error), False
                rospy.logwarn(f"{title}: {error}")
            if sentence and client is not None:
                notify(client, title, sentence, is_good)


def notify(client: viser.ClientHandle, title: str, sentence: str, is_good: bool = True) -> None:
    """Show a sentence in one page for a while."""
    client.add_notification(
        title, sentence, color="green" if is_good else "red", auto_close_seconds=NOTICE_TIME
    )


def call(service: str, kind: Any, *args: Any) -> str:
    """Call a service that answers success and a sentence; the sentence.

    Raises:
        HuskyError: it is not there, or refuses.
    """
    try:
        answer = rospy.ServiceProxy(service, kind)(*args)
    except (rospy.ServiceException, rospy.ROSException) as error:
        raise HuskyError(f"{service}: {error}") from None
    sentence = getattr(answer, "status_message", getattr(answer, "message", ""))
    if not getattr(answer, "success", True):
        raise HuskyError(str(sentence) or f"{service} says no")
    return str(sentence)
