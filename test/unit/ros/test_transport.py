"""Messages reach a subscriber at once and whole, in order; one that hangs holds nobody up."""

from __future__ import annotations

import socket
import threading
import time

import pytest

pytest.importorskip("rospy")

import rospy.topics
from rospy.exceptions import TransportTerminated
from rospy.impl.tcpros_base import TCPROSTransport
from rospy.impl.tcpros_pubsub import TCPROSPub
from std_msgs.msg import String

from husky_highlevel_controller.ros.transport import PromptConnection, send_promptly

TIMEOUT = 20.0  # [s] of wall time, for anything that hangs
SIZE = 200_000  # [bytes] of a message, more than a socket's buffer takes at once


@pytest.fixture
def ends():
    """A transport of rospy's, and the subscriber's end of its socket."""
    ours, theirs = socket.socketpair()
    ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SIZE // 4)
    theirs.settimeout(TIMEOUT)
    transport = TCPROSTransport(TCPROSPub("/scan", String), "/scan")
    transport.socket = ours
    yield transport, theirs
    theirs.close()
    transport.close()


def message(number):
    return bytes([number]) * SIZE


def receive(theirs):
    """The number of the next message, which must be whole."""
    data = bytearray()
    while len(data) < SIZE:
        part = theirs.recv(SIZE - len(data))
        assert part, "the connection is closed"
        data += part
    assert set(data) == {data[0]}, "two messages in one"
    return data[0]


def publish(connection, numbers):
    """Publish from a thread of its own, which must come back."""
    thread = threading.Thread(
        target=lambda: [connection.write_data(message(n)) for n in numbers], daemon=True
    )
    thread.start()
    thread.join(TIMEOUT)
    assert not thread.is_alive(), "publishing waits for the subscriber"


def test_a_small_message_is_sent_before_publish_returns(ends):
    transport, theirs = ends
    connection = PromptConnection(transport, queue_size=1)
    connection.write_data(b"scan")
    assert theirs.recv(100, socket.MSG_DONTWAIT) == b"scan"
    assert (transport.stat_bytes, transport.stat_num_msg) == (4, 1)


def test_a_message_larger_than_the_socket_s_buffer_arrives_whole(ends):
    transport, theirs = ends
    connection = PromptConnection(transport, queue_size=1)
    for number in range(1, 4):
        publish(connection, [number])
        assert receive(theirs) == number
    end = time.monotonic() + TIMEOUT
    while transport.stat_bytes < 3 * SIZE and time.monotonic() < end:
        time.sleep(0.001)  # its thread counts after it has sent
    assert transport.stat_bytes == 3 * SIZE


@pytest.mark.parametrize("queue_size", [1, 3])
def test_a_subscriber_that_hangs_holds_nobody_up_and_gets_the_newest_afterwards(ends, queue_size):
    transport, theirs = ends
    connection = PromptConnection(transport, queue_size)
    publish(connection, range(1, 31))
    numbers = []
    while 30 not in numbers:
        numbers.append(receive(theirs))
    assert numbers == sorted(set(numbers))
    # the one it hung at, perhaps what its thread had taken by then, and the newest
    assert numbers[0] == 1
    assert numbers[-queue_size:] == list(range(31 - queue_size, 31))
    assert len(numbers) <= 1 + 2 * queue_size
    publish(connection, [40])
    assert receive(theirs) == 40


def test_a_subscriber_that_has_gone_is_an_error_that_rospy_knows(ends):
    transport, theirs = ends
    connection = PromptConnection(transport, queue_size=1)
    theirs.close()
    with pytest.raises(TransportTerminated):
        connection.write_data(b"scan")
    assert transport.done


def test_every_publisher_with_a_queue_sends_so(ends, monkeypatch):
    monkeypatch.setattr(rospy.topics, "QueuedConnection", rospy.topics.QueuedConnection)
    send_promptly()
    publisher = rospy.topics._PublisherImpl("/scan", String)
    publisher.set_queue_size(1)
    transport, theirs = ends
    publisher.add_connection(transport)
    (connection,) = publisher.connections
    assert isinstance(connection, PromptConnection)
    connection.write_data(b"scan")
    assert theirs.recv(100, socket.MSG_DONTWAIT) == b"scan"
