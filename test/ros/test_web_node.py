"""The page's node without a browser: how many pages it lets in, and what it does without its ROS master."""

import json
import re
import socket
import threading
import time
from contextlib import contextmanager, suppress
from unittest.mock import Mock
from urllib.error import HTTPError
from urllib.request import urlopen
from xmlrpc.server import SimpleXMLRPCServer

import psutil
import pytest
import rospy
import viser
from network import wait_until
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from husky_highlevel_controller.ros.registration import Registration
from husky_web import actions, node
from husky_web.node import Master, WebConfig, WebNode
from husky_web.page_server import MAX_PAGES
from husky_web.state_bar import Figures, RobotStatus, StateBar, e_stop_html, state_html
from husky_web.teleop import RELEASE_AFTER

ADDRESS = re.compile(r": (http://127\.0\.0\.1:\d+)\n")
VISER = f"viser-v{viser.__version__}"
MB = 1e6
DEADLINE = 20.0  # [s]
OURS = "http://robot:4000/"


def test_the_next_page_is_told_that_there_are_too_many_and_memory_is_given_back(ros):
    ros.core()
    launched = ros.roslaunch("web.launch")
    launched.says("open this page in a browser")
    address = ADDRESS.search(launched.output).group(1)
    (pid,) = ros.pids("husky_web")

    def memory():
        return psutil.Process(pid).memory_full_info().pss / MB

    def open_page():  # which reads nothing by itself
        return connect(
            address.replace("http", "ws", 1), subprotocols=[VISER], max_size=None, ping_interval=None
        )

    open_page().close()
    wait_until(lambda: urlopen(address).status == 200, "there is room")
    before = memory()
    pages = [open_page() for _ in range(MAX_PAGES)]
    wait_until(lambda: memory() > before + 0.5 * MAX_PAGES, "they take memory")
    with pytest.raises(HTTPError, match="503") as refusal:
        urlopen(address)
    told = f"{MAX_PAGES} pages are open, which is the limit. Close one of them, then load this page again"
    assert refusal.value.read().decode() == told
    with open_page() as one_more, pytest.raises(ConnectionClosed, match="pages are open"):
        one_more.recv()
    pages.pop().close()
    wait_until(lambda: _status(address) == 200, "there is room again")
    for page in pages:
        page.close()
    wait_until(lambda: memory() < before + 0.1 * MAX_PAGES, "memory is given back")


def _status(address):
    try:
        return urlopen(address).status
    except HTTPError as error:
        return error.code


NAMESPACE = """<launch>
  <group ns="robot1">
    <include file="$(find husky_highlevel_controller)/launch/controller.launch">
      <arg name="gui" value="false"/>
      <arg name="web" value="true"/>
    </include>
  </group>
</launch>"""


def test_after_an_emergency_stop_in_a_namespace_the_controller_stays_stopped(ros):
    (ros.folder / "namespace.launch").write_text(NAMESPACE)
    launched = ros.start("roslaunch", "-p", str(ros.port), str(ros.folder / "namespace.launch"))
    launched.says("open this page in a browser")
    wait_until(lambda: 'value: "driving"' in ros.echo("/diagnostics"), "the controller drives")
    address = ADDRESS.search(launched.output).group(1)
    with connect(f"{address.replace('http', 'ws', 1)}/drive") as drive:
        for is_pressed in (True, False):
            drive.send(json.dumps({"e_stop": is_pressed}))
            time.sleep(RELEASE_AFTER)
        wait_until(lambda: 'value: "stopped"' in ros.echo("/diagnostics"), "the controller is stopped")
    subscriptions = ros.subscriptions("/robot1/husky_web")
    assert {f"/robot1/husky_simulator/{topic}" for topic in ("paused", "locked")} <= subscriptions


@pytest.fixture
def page(monkeypatch):
    """A node without a server of pages, and a network without topics."""
    monkeypatch.setattr(rospy, "get_name", lambda: "/husky_web")
    monkeypatch.setattr(rospy, "get_node_uri", lambda: OURS)
    monkeypatch.setattr(rospy, "logwarn_throttle", Mock())
    page = object.__new__(WebNode)
    page.__dict__.update(
        {f"_{name}": Mock() for name in ("server", "scene", "tuning", "depth_box", "recorder", "mouse")}
    )
    page._scene.layers = {"depth": False}
    page._topics = Mock(names=dict.fromkeys(("truth", "command", "error", "pillar", "cloud"), "/topic"))
    page._config, page._description, page._world_name = WebConfig(), "", "before"
    page._master = Master.KNOWS_NODE
    return page


def meet(page, monkeypatch, port):
    """Let a page meet the master of a port."""
    monkeypatch.setenv("ROS_MASTER_URI", f"http://127.0.0.1:{port}")
    page._registration = Registration()
    page._follow_network()


@contextmanager
def served(handle):
    """The port of a server that is handled by a function in a thread."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=handle, args=(server,), daemon=True).start()
        yield server.getsockname()[1]


@pytest.mark.parametrize(
    "answer",
    [
        b"",
        b"SSH-2.0-OpenSSH\r\n",
        b"HTTP/1.1 500 Internal Server Error\r\nContent-Length: 0\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\nContent-Length: 5\r\n\r\n<xml>",
        b"HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\nContent-Length: 99\r\n\r\n<xml>",
    ],
)
def test_a_master_that_dies_in_its_answer_is_gone(page, monkeypatch, answer):
    def answer_all(server):
        with suppress(OSError):  # the test ends by closing the server
            while True:
                connection, _ = server.accept()
                with connection:
                    connection.recv(4096)
                    connection.sendall(answer)

    with served(answer_all) as port:
        meet(page, monkeypatch, port)
    assert page._master is Master.IS_SILENT


def test_a_master_that_hangs_over_a_parameter_does_not_hold_the_view(page, monkeypatch):
    for module in (actions, node):
        monkeypatch.setattr(module, "MASTER_DEADLINE", 0.2)
    release = threading.Event()
    answers = {
        "lookupNode": lambda *_: (1, "", OURS),
        "lookupService": lambda *_: (1, "", OURS),
        "getPublishedTopics": lambda *_: (1, "", []),
        "searchParam": lambda *_: (1, "", "/robot_description"),
        "getParam": lambda *_: (release.wait(DEADLINE), (1, "", "late"))[1],
    }
    with SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
        for name, answer in answers.items():
            server.register_function(answer, name)
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        look = threading.Thread(target=meet, args=(page, monkeypatch, server.server_address[1]), daemon=True)
        look.start()
        look.join(DEADLINE / 2.0)
        is_back = not look.is_alive()
        release.set()
        server.shutdown()
        thread.join()
    assert is_back
    assert page._world_name == ""
    assert page._master is Master.KNOWS_NODE, "it answers otherwise"


def test_a_page_that_a_new_master_does_not_know_says_so_and_listens_anew(page, monkeypatch):
    with SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False, allow_none=True) as server:
        server.register_function(lambda *_: (-1, "unknown node", ""), "lookupNode")
        server.register_function(lambda *_: (1, "", []), "getPublishedTopics")
        server.register_function(lambda *_: (-1, "not set", 0), "searchParam")
        server.register_function(lambda *_: (-1, "not set", 0), "getParam")
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        page._topics.is_open = True
        meet(page, monkeypatch, server.server_address[1])
        server.shutdown()
        thread.join()
    assert page._master is Master.IS_NEW
    page._topics.close.assert_called_once_with()


def test_the_next_page_begins_without_the_state_that_the_last_page_showed(page):
    for name in ("objects", "numbers", "drive", "drivers", "teleop"):
        setattr(page, f"_{name}", Mock())
    page._server.gui.add_html.side_effect = lambda html: Mock(content=html)
    page._state_bar = bar = StateBar(page._server.gui)
    bar.update(RobotStatus(activity="driving"), Figures(2.0, 1.0, 17.0), now=100.0)
    for page._teleop.is_locked in (False, True):  # the second time by another node, after the page has gone
        page._teleop.has_listener = True
        page._forget()
        page._topics.is_open = False
        assert bar._e_stop.content == e_stop_html(page._teleop.is_locked)
        assert bar._state.content == state_html(RobotStatus(page._teleop.is_locked), Figures())
    bar.update(RobotStatus(), Figures(time=18.0), now=100.1)
    assert 'data-time="18.000"' in bar._state.content
