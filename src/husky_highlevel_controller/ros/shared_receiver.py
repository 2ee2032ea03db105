"""Receiving of all topics in one thread, because rospy starts a thread for each connection, which costs time.

The controller gets a message on /clock, one on /tf and a scan at nearly the same moment. With rospy's
threads, these messages wake three threads, and the threads wait for each other, because Python runs only one
thread at a time. One thread receives the messages one after the other, in the order in which they came. In
lockstep, the controller then needs 12 % less CPU time, and the simulation is 9 % faster (median of ten pairs
of runs).

Only a node whose callbacks never wait may use this module, because a callback that waits delays all topics.

test_shared_receiver.py tests the parts of rospy that this module replaces or calls.
"""

from __future__ import annotations

import contextlib
import select
import threading
from io import BytesIO
from typing import Any, Callable, Dict, List, Tuple

import rospy.core
from rospy.exceptions import TransportTerminated
from rospy.impl.tcpros_base import TCPROSTransport, recv_buff

SHUTDOWN_POLL_PERIOD = 1.0  # [s] wall time between two checks whether the node is shutting down

# function of rospy; its arguments are the new messages of a connection, and this connection
MessagesCallback = Callable[[List[Any], TCPROSTransport], None]


class SharedReceiver:
    """Thread that receives the messages of all connections to publishers, and calls their callbacks.

    rospy itself connects to a publisher, in a thread of its own, and connects again after an error.
    """

    def __init__(self) -> None:
        """Start the thread, without a connection."""
        self._epoll = select.epoll()  # tells on which sockets data have come
        # connection of each socket, and the function that gets its messages, by the socket's file descriptor
        self._connections: Dict[int, Tuple[TCPROSTransport, MessagesCallback]] = {}
        self._lock = threading.Lock()  # held while a connection is added or removed
        threading.Thread(target=self._run, name="receiver", daemon=True).start()

    def receive_loop(self, connection: TCPROSTransport, callback: MessagesCallback) -> None:
        """Take over a new connection; this method replaces rospy's `TCPROSTransport.receive_loop`.

        rospy calls this in the thread that has connected. rospy's own method would receive in that thread
        until the connection ends. This method returns at once, so that thread ends.
        """
        sock = connection.socket
        if sock is None or connection.done:  # the connection was closed meanwhile
            return
        try:
            sock.setblocking(False)  # the thread must never wait for the rest of a message
            # rospy may have read the first messages together with the header of the connection
            _deliver(connection, callback)
            with self._lock:
                self._connections[sock.fileno()] = connection, callback
                # With EPOLLET, `poll` returns the sockets in the order in which their data came, and each
                # socket only once until new data come. It returns this socket, too, if its first data came
                # before this call.
                self._epoll.register(sock.fileno(), select.EPOLLIN | select.EPOLLET)
        except Exception as error:
            _give_back(connection, callback, error)

    def _run(self) -> None:
        """Wait for data, and deliver the messages, until the node is shut down."""
        while not rospy.core.is_shutdown():
            # each descriptor is the file descriptor of a socket on which data have come
            for descriptor, _ in self._epoll.poll(SHUTDOWN_POLL_PERIOD):
                connection, callback = self._connections[descriptor]
                try:
                    _receive(connection, callback)
                except Exception as error:
                    self._remove(descriptor, connection)
                    _give_back(connection, callback, error)

    def _remove(self, descriptor: int, connection: TCPROSTransport) -> None:
        """Remove a connection, unless a new connection already has its descriptor.

        If another thread has closed the socket, a new socket may have got the same descriptor.
        """
        with self._lock:
            if self._connections[descriptor][0] is connection:
                del self._connections[descriptor]
                with contextlib.suppress(OSError):  # a closed socket is no longer registered
                    self._epoll.unregister(descriptor)


def _receive(connection: TCPROSTransport, callback: MessagesCallback) -> None:
    """Read all data that have come on a connection, and call the callback for the complete messages.

    The first part of a message that is not complete stays in the buffer of the connection.

    Raises:
        TransportTerminated: the publisher has closed the connection.
        DeserializationError: the data are not a message of this type.
    """
    size = connection.protocol.buff_size
    while not connection.done:
        count = recv_buff(connection.socket, connection.read_buff, size)
        connection.stat_bytes += count
        _deliver(connection, callback)
        # fewer bytes than `size` mean that the socket has no more data; `recv_buff` returns 0 if it has none
        if count < size:
            return


def _deliver(connection: TCPROSTransport, callback: MessagesCallback) -> None:
    """Call the callback with the messages that are complete in the buffer, as rospy's `receive_once` does.

    Raises:
        DeserializationError: the data are not a message of this type.
    """
    messages: List[Any] = []
    connection.protocol.read_messages(connection.read_buff, messages, connection.socket)
    if not messages:
        return
    connection.stat_num_msg += len(messages)  # rospy's count of received messages
    for message in messages:
        message._connection_header = connection.header
    if connection.is_latched:
        connection.latch = messages[-1]  # rospy gives this message to callbacks that are added later
    if not connection.done and not rospy.core.is_shutdown():
        callback(messages, connection)


def _give_back(connection: TCPROSTransport, callback: MessagesCallback, error: Exception) -> None:
    """Give a connection with an error back to rospy, which closes it or connects again, in a new thread."""
    sock = connection.socket
    if sock is None or connection.done:  # another thread has closed the connection
        return
    # rospy's loop closes the connection if the publisher has ended it. After any other error, the socket
    # becomes None here, so that the loop connects again. Then the buffer must be empty, because it may have
    # the rest of a broken message.
    if not isinstance(error, TransportTerminated):
        rospy.core.logerr(f"{connection.name}: {error}; connecting to the publisher again")
        sock.close()
        connection.socket, connection.read_buff = None, BytesIO()
    threading.Thread(target=_RECEIVE_LOOP, args=(connection, callback), daemon=True).start()


_RECEIVE_LOOP = TCPROSTransport.receive_loop  # rospy's own method, before it is replaced


def receive_in_one_thread() -> None:
    """Let one thread receive all topics of this process; call it before the first subscriber is made."""
    receiver = SharedReceiver()
    # A lambda in a class becomes a method, so it gets the connection as its first argument. The method
    # `receiver.receive_loop` would get only the callback.
    TCPROSTransport.receive_loop = lambda connection, callback: receiver.receive_loop(connection, callback)
