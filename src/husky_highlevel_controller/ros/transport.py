"""Transport of topics and services, because rospy's own is slow, or waits for a peer that sends nothing.

Sending: a message is sent at once if the socket has room. rospy hands every message of a publisher with a
queue to a thread of each subscriber, and waking that thread takes four times as long as sending. Here the
queue and its thread work only while a subscriber is busy, so a subscriber that hangs delays no other.

Replacing rospy's class is worth it. With rospy's class, the simulator needs 16 % and the controller 12 % more
CPU time at real time, and 28 % and 20 % more in lockstep. The time from a scan to its command is 8 % longer
(p50; p99 11 %). These are medians of four pairs of runs on a busy machine.

Accepting: each connection has a thread and a deadline. rospy reads the headers of all connections in one
thread, without a deadline. So a TCP connection that sent nothing blocked all services of the node, such as
`start_stop`, and all new subscribers, until the connection was closed (measured).

Starting: the wait for the registration checks every millisecond. rospy checks at once, mostly too early, and
then only 0.1 s later, which is a twelfth of the time that a launch takes.

test_transport.py tests the parts of rospy that this module replaces.
"""

from __future__ import annotations

import socket
import threading
import time
from typing import Any, List, Optional

import rospy.core
import rospy.topics
from rosgraph.xmlrpc import XmlRpcNode
from rospy.impl import tcpros_base
from rospy.impl.tcpros_pubsub import QueuedConnection

REGISTRATION_POLL_PERIOD = 0.001  # [s] wall time
HEADER_TIMEOUT = 10.0  # [s] a connection is closed if no byte of its header has come for this wall time


class PromptConnection(QueuedConnection):
    """Connection to a subscriber that sends each message at once, in the thread that publishes it.

    If the subscriber is busy and the socket has no room, the rest of the message is sent by the thread of the
    connection (`_run`). Later messages wait in rospy's queue until this thread has sent all earlier ones.
    """

    # these attributes are made by rospy's class
    _connection: Any  # rospy's plain connection to the subscriber; its `write_data` waits until all is sent
    _queue: List[bytes]  # messages that the thread of `_run` must send after `_unsent`
    _lock: threading.Lock  # held while `_queue`, `_unsent` or `_error` is used
    _cond_data_available: threading.Condition  # condition of `_lock`; wakes the thread of `_run`
    _error: Optional[Exception]  # error of the thread of `_run`; rospy's `write_data` raises it

    def __init__(self, connection: Any, queue_size: int) -> None:
        """Make a connection with an empty queue."""
        self._write_lock = threading.Lock()  # held by the thread that writes to the socket
        self._unsent = b""  # rest of a message of which only the first part was sent; empty if there is none
        # must come last, because rospy's constructor starts the thread, which uses the attributes above
        super().__init__(connection, queue_size)

    def write_data(self, data: bytes) -> bool:
        """Send a message, or queue it while the socket is busy. Return True, as rospy's method does."""
        # if another thread holds the lock, it is writing to the socket, so this message goes into the queue
        if self._write_lock.acquire(blocking=False):
            try:
                has_earlier_data = self._queue or self._unsent  # must be sent before this message
                is_closed = self._connection.socket is None
                if not has_earlier_data and not is_closed:
                    return self._send(data)
            finally:
                self._write_lock.release()
        # rospy's method puts the message into the queue, and wakes the thread of `_run`
        return bool(super().write_data(data))

    def _send(self, data: bytes) -> bool:
        """Send as much of a message as the socket has room for, and leave the rest to the thread of `_run`.

        The caller holds `_write_lock`. The result is always true, as in `write_data`.
        """
        connection = self._connection
        try:
            sent = connection.socket.send(data, socket.MSG_DONTWAIT)
        except BlockingIOError:
            sent = 0
        except OSError:
            # rospy's own method gets the same error again, and handles it
            return bool(connection.write_data(data))
        connection.stat_bytes += sent  # `stat_bytes` and `stat_num_msg` are rospy's statistics
        if sent < len(data):
            with self._lock:
                self._unsent = data[sent:]  # rest of this message, which `_run` sends
                self._cond_data_available.notify()  # wakes the thread
        else:
            connection.stat_num_msg += 1
        return True

    def _run(self) -> None:
        """Send what `write_data` could not send at once; rospy runs this in a thread of the connection.

        This thread may wait for the subscriber, because it does not delay the publisher.
        """
        while not self._connection.done:
            with self._lock:
                while not self._queue and not self._unsent and not self._connection.done:
                    self._cond_data_available.wait()  # releases `_lock` during the wait
            # While this thread holds `_write_lock`, `write_data` puts new messages into the queue. So no new
            # message is written before the older messages that are taken here.
            with self._write_lock:
                for data in self._take_waiting():
                    try:
                        # this method of rospy's plain connection waits until the socket has taken the data
                        self._connection.write_data(data)
                    except Exception as error:
                        # The loop goes on, as in rospy, because a further write to a closed connection fails
                        # at once. The next `write_data` that uses the queue raises the error.
                        with self._lock:
                            self._error = error

    def _take_waiting(self) -> List[bytes]:
        """Return all data that wait, oldest first; afterwards, `_unsent` and the queue are empty."""
        with self._lock:
            waiting = self._queue
            if self._unsent:  # this comes first, because it is the rest of an older message
                waiting = [self._unsent, *waiting]
            self._unsent, self._queue = b"", []  # rest of a message, and the messages after it
        return waiting


def _read_header(sock: socket.socket, buffer: Any, size: int) -> Any:
    """Read the header of a new connection as rospy does, but raise an error after HEADER_TIMEOUT."""
    sock.settimeout(HEADER_TIMEOUT)
    header = _READ_HEADER(sock, buffer, size)
    sock.settimeout(None)
    return header


def _accept(server: tcpros_base.TCPROSServer, sock: socket.socket, address: Any) -> None:
    """Serve a new connection in a thread of its own, so that a peer that sends nothing delays no other."""
    threading.Thread(target=_SERVE, args=(server, sock, address), name="accepted", daemon=True).start()


def _start(node: XmlRpcNode) -> None:
    """Start the server of a node, and wait until the node is registered with the master.

    This function replaces XmlRpcNode.start (see `replace_transport`), which does not wait.
    `rospy.init_node` calls `start`, and then tests every 0.1 s whether the node is registered. When this
    function returns, the node is registered, so the first of these tests succeeds. This saves up to 0.1 s.
    """
    handler = node.handler
    _START(node)
    while not handler._is_registered() and not rospy.core.is_shutdown():
        time.sleep(REGISTRATION_POLL_PERIOD)


# rospy's own functions, which the functions above call
_READ_HEADER, _SERVE = tcpros_base.read_ros_handshake_header, tcpros_base.TCPROSServer._tcp_server_callback
_START = XmlRpcNode.start


def replace_transport() -> None:
    """Let every publisher and server of this process use this transport; call it before the first is made."""
    rospy.topics.QueuedConnection = PromptConnection
    tcpros_base.read_ros_handshake_header = _read_header
    tcpros_base.TCPROSServer._tcp_server_callback = _accept
    XmlRpcNode.start = _start
