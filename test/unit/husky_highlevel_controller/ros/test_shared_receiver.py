"""One thread receives all topics whole and in order; an error of one connection leaves the others alone."""

import queue
import socket
import struct
import threading

import pytest

pytest.importorskip("rospy")

import rospy.core
from rospy.impl.tcpros_base import TCPROSTransport
from rospy.impl.tcpros_pubsub import TCPROSSub
from std_msgs.msg import String

from husky_highlevel_controller.ros import shared_receiver
from husky_highlevel_controller.ros.shared_receiver import SharedReceiver, receive_in_one_thread

TIMEOUT = 60.0  # [s] of wall time, for anything that hangs


@pytest.fixture
def receiver(monkeypatch):
    monkeypatch.setattr(shared_receiver, "SHUTDOWN_POLL_PERIOD", 0.01)
    before = set(threading.enumerate())
    receiver = SharedReceiver()
    (thread,) = set(threading.enumerate()) - before
    yield receiver
    monkeypatch.setattr(rospy.core, "is_shutdown", lambda: True)
    thread.join(TIMEOUT)
    assert not thread.is_alive()


@pytest.fixture
def received():
    """Topic, text, header and thread of each message, in the order of the callbacks."""
    return queue.Queue()


@pytest.fixture
def connect(receiver, received):
    """Connects a subscriber of a topic, and returns it with the publisher's end of the socket."""
    opened = []

    def connect(topic, early=b""):
        theirs, ours = socket.socketpair()
        connection = TCPROSTransport(TCPROSSub(topic, String, queue_size=10), topic)
        connection.socket, connection.header = ours, {"callerid": "/talker"}
        connection.read_buff.write(early)
        opened.extend([theirs, connection])

        def callback(messages, _connection):
            for message in messages:
                header = message._connection_header
                received.put((topic, message.data, header, threading.current_thread()))

        receiver.receive_loop(connection, callback)
        return connection, theirs

    yield connect
    for item in opened:
        item.close()


def wire(text):
    """A String message as TCPROS sends it."""
    data = struct.pack("<I", len(text)) + text.encode()
    return struct.pack("<I", len(data)) + data


def next_of(received):
    return received.get(timeout=TIMEOUT)[:2]


def test_messages_of_several_topics_come_in_order_in_one_thread(connect, received):
    _, clock = connect("/clock")
    _, scan = connect("/scan")
    threads = set()
    for number in range(20):
        clock.sendall(wire(f"time {number}"))
        scan.sendall(wire(f"scan {number}"))
        for expected in (("/clock", f"time {number}"), ("/scan", f"scan {number}")):
            topic, text, header, thread = received.get(timeout=TIMEOUT)
            assert (topic, text) == expected
            assert header == {"callerid": "/talker"}
            threads.add(thread)
    assert len(threads) == 1


def test_half_a_message_holds_no_other_topic_up(connect, received):
    scan, publisher = connect("/scan")
    _, clock = connect("/clock")
    whole = wire("a long scan")
    publisher.sendall(whole[:9])
    clock.sendall(wire("1"))
    assert next_of(received) == ("/clock", "1")
    publisher.sendall(whole[9:] + wire("the next scan"))
    assert next_of(received) == ("/scan", "a long scan")
    assert next_of(received) == ("/scan", "the next scan")
    assert scan.stat_num_msg == 2
    assert scan.stat_bytes == len(whole) + len(wire("the next scan"))


def test_messages_larger_than_a_read_come_whole(connect, received):
    scan, publisher = connect("/scan")
    texts = [letter * 3 * scan.protocol.buff_size for letter in "ab"]
    publisher.settimeout(TIMEOUT)
    for text in texts:
        publisher.sendall(wire(text))
    assert [next_of(received)[1] for _ in texts] == texts


def test_a_message_that_came_with_the_header_is_delivered(connect, received):
    connect("/tf_static", early=wire("mount"))
    assert next_of(received) == ("/tf_static", "mount")


def test_a_publisher_that_ends_closes_its_connection_and_no_other(connect, received):
    scan, publisher = connect("/scan")
    _, clock = connect("/clock")
    closed = threading.Event()
    scan.set_cleanup_callback(lambda _connection: closed.set())
    publisher.close()
    assert closed.wait(TIMEOUT)
    clock.sendall(wire("1"))
    assert next_of(received) == ("/clock", "1")


def test_a_subscriber_that_ends_leaves_its_number_to_the_next_connection(connect, received):
    for number in range(20):
        scan, publisher = connect(f"/scan{number}")
        publisher.sendall(wire("1"))
        assert next_of(received) == (f"/scan{number}", "1")
        scan.close()  # as rospy does in another thread, after `unregister`
        publisher.close()


@pytest.mark.parametrize("when", ["later", "with the header"])
def test_rospy_connects_again_after_a_message_that_is_broken(when, connect, received, monkeypatch):
    broken = struct.pack("<I", 2) + b"xx"  # too short to be a String
    _, clock = connect("/clock")
    again, ours = socket.socketpair()

    def reconnect(connection):
        connection.socket = ours

    monkeypatch.setattr(TCPROSTransport, "_reconnect", reconnect)
    scan, publisher = connect("/scan", early=broken if when == "with the header" else b"")
    if when == "later":
        publisher.sendall(broken)
    again.sendall(wire("whole"))
    assert next_of(received) == ("/scan", "whole")
    clock.sendall(wire("1"))
    assert next_of(received) == ("/clock", "1")
    scan.close()
    again.close()


def test_every_subscriber_of_the_process_is_received_so(monkeypatch):
    taken = []
    monkeypatch.setattr(TCPROSTransport, "receive_loop", TCPROSTransport.receive_loop)
    monkeypatch.setattr(
        shared_receiver.SharedReceiver, "receive_loop", lambda _self, *arguments: taken.append(arguments)
    )
    receive_in_one_thread()
    connection = TCPROSTransport(TCPROSSub("/scan", String), "/scan")
    connection.receive_loop(print)
    assert taken == [(connection, print)]
