"""Sends a message at once where its subscriber can take it, and queues it only where it cannot.

rospy hands every message of a publisher with a queue to a thread of each subscriber; waking that thread takes
four times as long as sending. Here the queue is used while a subscriber is busy, so that one that hangs still
holds nobody.
"""

from __future__ import annotations

import select
import socket
import threading
from typing import Any, List, Optional

import rospy.topics
from rospy.impl.tcpros_pubsub import QueuedConnection


class PromptConnection(QueuedConnection):
    """rospy's queue, which is passed by as long as there is nothing in it and the socket has room."""

    _queue: List[bytes]

    def __init__(self, connection: Any, queue_size: int) -> None:
        self._turn = threading.Lock()  # of writing to the socket
        super().__init__(connection, queue_size)

    def write_data(self, data: bytes) -> bool:
        """Send or queue a message."""
        if self._turn.acquire(blocking=False):
            try:
                if not self._queue and _has_room(self._connection.socket, len(data)):
                    return bool(self._connection.write_data(data))
            finally:
                self._turn.release()
        return bool(super().write_data(data))

    def _run(self) -> None:
        while not self._connection.done:
            with self._lock:
                while not self._queue and not self._connection.done:
                    self._cond_data_available.wait()
            with self._turn:  # what is in the queue by now goes before what comes later
                with self._lock:
                    queue, self._queue = self._queue, []
                for data in queue:
                    try:
                        self._connection.write_data(data)
                    except Exception as error:  # raised again where the next message is published
                        with self._lock:
                            self._error = error


def _has_room(link: Optional[socket.socket], size: int) -> bool:
    """Whether so many bytes go into a socket's buffer at once: writable means that a third of it is free."""
    return (
        link is not None
        and size <= link.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) // 4
        and bool(select.select((), (link,), (), 0.0)[1])
    )


def send_promptly() -> None:
    """Let every publisher of this process do so; call it before the first is made."""
    rospy.topics.QueuedConnection = PromptConnection
