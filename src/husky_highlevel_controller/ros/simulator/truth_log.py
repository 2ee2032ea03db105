"""True poses, and calls that changed the world, over a private socket to the parent process.

Every node can write to ROS topics and parameters. But no node can write to this Unix socket, because its
listener accepts only the first connection. So grading uses only the messages on the socket.
"""

from __future__ import annotations

import json
import os
import select
import socket
import threading
from typing import Any, Callable, Optional

import rospy

from husky_highlevel_controller.datatypes import Snapshot

# environment variable with the path of the socket; without this variable, nothing is written
VARIABLE = "HUSKY_TRUTH_SOCKET"
# [s] if the reader neither reads nor answers for this wall time, nothing more is sent to it
SEND_TIMEOUT = 5.0
POLL_PERIOD = 0.02  # [s] wall time between two checks whether the reader has let simulated time begin


class TruthLog:
    """Log of a run for the program that grades it, over a socket: one JSON object with one key on each line.

    The keys are "ready" (the simulator waits for the reader), "truth" (the numbers of a `TrueState`),
    "changed" (a sentence on a call), "asleep" and "unanswered" (sentences on a controller, see `Lockstep`).
    The reader answers "ready" and each "truth" with one byte, and simulated time stands still until then.
    """

    def __init__(self) -> None:
        """Connect to the reader, if the environment names its socket."""
        path = os.environ.get(VARIABLE)
        self._socket: Optional[socket.socket] = None
        # lock that is held while a line is sent, because the threads of services also send lines
        self._lock = threading.Lock()
        if path:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            self._socket.settimeout(SEND_TIMEOUT)
            self._socket.connect(path)

    @property
    def is_open(self) -> bool:
        """Return whether a program that grades this run reads the log."""
        return self._socket is not None

    def wait_to_begin(self, meanwhile: Callable[[], None]) -> None:
        """Wait until the reader, if there is one, lets time begin; call `meanwhile` again and again."""
        self.write_line("ready", "")
        while self._socket and not rospy.is_shutdown():
            readable, _, _ = select.select([self._socket], [], [], POLL_PERIOD)
            if readable:  # the reader has answered, or has closed the socket
                self._wait_for_reader()
                return
            meanwhile()

    def write(self, snapshot: Snapshot) -> None:
        """Write the true state, and wait until the reader has read it; call this before /clock is published.

        The reader gives each message of another node the time of the last true state that it has read. A node
        may send a message as soon as it gets /clock. So the reader must have the new time before.
        """
        if self.is_open:
            self.write_line("truth", snapshot.true_state.to_numbers())
            self._wait_for_reader()

    def _wait_for_reader(self) -> None:
        """Wait for the byte with which the reader answers; end the log if the byte does not come."""
        connection = self._socket  # read once, because another thread may end the log
        try:
            # `recv` returns no byte if the reader has closed the socket
            if connection is not None and not connection.recv(1):
                raise ConnectionResetError("it has closed the socket")
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        """Write nothing more, and log the reason; the simulation goes on without a reader."""
        rospy.logwarn(f"the reader of {VARIABLE} has closed: {error}")
        self._socket = None

    def write_line(self, key: str, value: Any) -> None:
        """Write a line with one key and its value, if there is a reader; any thread may call this."""
        connection = self._socket  # read once, because another thread may end the log
        if connection is None:
            return
        try:
            with self._lock:
                connection.sendall((json.dumps({key: value}) + "\n").encode())
        except OSError as error:
            self._give_up(error)
