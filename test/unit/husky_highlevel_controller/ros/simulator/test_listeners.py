"""Idle processes are told from those that compute, by what their threads do: real processes, real sockets."""

import os
import socket
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest

from husky_highlevel_controller.ros.simulator.listeners import Listeners

# computes for a moment after each byte, in another thread than the one that receives it, and answers
NODE = """
import queue, socket, sys, threading
waiting, server = queue.Queue(), socket.create_connection(("127.0.0.1", int(sys.argv[1])))
def answer():
    while True:
        waiting.get()
        sum(range(200_000))
        server.sendall(b"!")
threading.Thread(target=answer, daemon=True).start()
while server.recv(1):
    waiting.put(1)
"""


@pytest.fixture
def connection():
    """To a process that answers."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = str(listener.getsockname()[1])
        with subprocess.Popen([sys.executable, "-c", NODE, port]) as node, listener.accept()[0] as accepted:
            yield accepted
            node.kill()


@pytest.fixture
def listeners(connection):
    """The process, as a subscriber."""
    publisher = SimpleNamespace(impl=SimpleNamespace(connections=[SimpleNamespace(socket=connection)]))
    return Listeners(publisher, publisher)


def test_a_file_that_a_process_closes_meanwhile_does_not_hide_it(listeners, monkeypatch):
    read = os.readlink

    def readlink(path):
        target = read(path)
        if not target.startswith("socket:"):
            raise FileNotFoundError(path)
        return target

    monkeypatch.setattr(os, "readlink", readlink)
    end = time.monotonic() + 60.0
    while not listeners.asleep():
        assert time.monotonic() < end, "it is never found"


def test_whatever_is_asleep_has_done_its_work(connection, listeners):
    connection.settimeout(0.0)
    for _ in range(50):
        connection.sendall(b"?")
        while not listeners.asleep():
            time.sleep(0.0)
        assert connection.recv(2) == b"!"
