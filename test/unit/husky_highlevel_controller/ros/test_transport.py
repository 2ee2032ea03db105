"""Messages reach a subscriber at once, whole, in order; a peer that hangs or is silent holds nobody up."""

import socket
import threading
import time

import pytest

pytest.importorskip("rospy")

import rospy.topics
from rosgraph.network import encode_ros_handshake_header
from rosgraph.xmlrpc import XmlRpcHandler, XmlRpcNode
from rosgraph_server import end
from rospy.exceptions import TransportTerminated
from rospy.impl import tcpros_base
from rospy.impl.tcpros_base import TCPROSTransport
from rospy.impl.tcpros_pubsub import QueuedConnection, TCPROSPub
from std_msgs.msg import String

from husky_highlevel_controller.ros import transport as transport_module
from husky_highlevel_controller.ros.transport import PromptConnection, replace_transport

TIMEOUT = 60.0  # [s] of wall time, for anything that hangs
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
    # a process that is being forked at this moment has the socket, too, so closing it here may not end it
    theirs.shutdown(socket.SHUT_RDWR)
    theirs.close()
    with pytest.raises(TransportTerminated):
        connection.write_data(b"scan")
    assert transport.done


@pytest.fixture
def replaced(monkeypatch):
    """rospy with the transport of this package, until the test ends."""
    monkeypatch.setattr(rospy.topics, "QueuedConnection", rospy.topics.QueuedConnection)
    monkeypatch.setattr(tcpros_base, "read_ros_handshake_header", tcpros_base.read_ros_handshake_header)
    monkeypatch.setattr(
        tcpros_base.TCPROSServer, "_tcp_server_callback", tcpros_base.TCPROSServer._tcp_server_callback
    )
    monkeypatch.setattr(XmlRpcNode, "start", XmlRpcNode.start)
    replace_transport()


def test_every_publisher_with_a_queue_sends_a_small_message_at_once(ends, replaced, monkeypatch):
    monkeypatch.setattr(QueuedConnection, "write_data", lambda *_: pytest.fail("queued"))
    publisher = rospy.topics._PublisherImpl("/scan", String)
    publisher.set_queue_size(1)
    transport, theirs = ends
    publisher.add_connection(transport)
    (connection,) = publisher.connections
    assert isinstance(connection, PromptConnection)
    connection.write_data(b"scan")
    assert theirs.recv(100, socket.MSG_DONTWAIT) == b"scan", "before publish returns"
    assert (transport.stat_bytes, transport.stat_num_msg) == (4, 1)


@pytest.fixture
def server(replaced):
    """A running server of rospy's whose services say yes, with what it was asked for."""
    server = tcpros_base.TCPROSServer()
    server.calls = []

    def serve(sock, _address, header):
        server.calls.append((header["service"], sock.gettimeout()))
        with sock:
            sock.sendall(b"yes")

    server.service_connection_handler = serve
    server.start_server()
    yield server
    with server.tcp_ros_server.server_sock.dup() as listener:
        server.shutdown()
        listener.shutdown(socket.SHUT_RDWR)  # or rospy's thread takes one more connection, and leaves it open


def connected(server):
    return socket.create_connection(("127.0.0.1", server.get_address()[1]), TIMEOUT)


def test_a_connection_that_says_nothing_keeps_no_service_from_answering(server, monkeypatch):
    monkeypatch.setattr(transport_module, "HEADER_TIMEOUT", 10.0 * TIMEOUT)
    with connected(server), connected(server) as client:
        client.sendall(encode_ros_handshake_header({"service": "/start_stop"}))
        assert client.recv(100) == b"yes"
        assert server.calls == [("/start_stop", None)], "a call may take as long as it likes"


@pytest.mark.parametrize("begin", [b"", b"\x40\x00"])
def test_a_connection_that_says_too_little_is_closed(server, monkeypatch, begin):
    monkeypatch.setattr(transport_module, "HEADER_TIMEOUT", 0.1)
    with connected(server) as silent:
        silent.sendall(begin)
        assert silent.recv(100) == b""


def test_a_node_is_registered_when_its_server_has_started(replaced):
    class Handler(XmlRpcHandler):
        uri, looks = None, 0

        def _ready(self, uri):
            self.uri = uri

        def _is_registered(self):
            self.looks += self.uri is not None
            return self.looks == 3

    handler = Handler()
    node = XmlRpcNode(0, handler)
    node.start()
    assert (handler.looks, handler.uri) == (3, node.uri), "rospy's next look is a tenth of a second away"
    end(node)
