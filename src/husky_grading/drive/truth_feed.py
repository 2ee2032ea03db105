"""Reader of the simulator's private socket: true poses, and calls that changed the world."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
from pathlib import Path
from typing import Callable, Optional

from husky_highlevel_controller.datatypes import TrueState

BUFFER = 1 << 16  # [bytes]
# answer to "ready" and to each true state; the simulator waits for it, so simulated time stands still while a
# state is recorded
READ = b"."


class TruthFeed:
    """Receives true poses and other events from the simulator, over a socket and not over ROS.

    So a submission can neither read nor forge them. Only the first connection is taken. A submission starts
    later than the simulator, so it cannot connect any more.
    """

    def __init__(
        self, path: Path, on_truth: Callable[[TrueState], None], on_event: Callable[[str, str], None]
    ) -> None:
        """Listen on a socket, which is removed when the simulator connects.

        Args:
            path: path of the socket.
            on_truth: function that is called with each true state.
            on_event: function that is called with kind and text of each event, such as a changed world.
        """
        self._path, self._on_truth, self._on_event = path, on_truth, on_event
        # first exception of a callback; the reader continues after it. None if there is none.
        self.failure: Optional[Exception] = None
        self._may_begin = threading.Event()  # set by `begin`: simulated time may begin
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(str(path))
        path.chmod(0o600)  # only our own user can connect
        self._listener.listen(1)
        threading.Thread(target=self._read, daemon=True).start()

    def begin(self) -> None:
        """Let simulated time begin, by the answer to the simulator's message "ready"."""
        self._may_begin.set()

    def _read(self) -> None:
        """Take the simulator's lines until it disconnects, in a thread of its own.

        The simulator waits for an answer to each state. It also waits for an answer to "ready", so simulated
        time begins only after a call of `begin`. Each callback runs before the answer, so that simulated time
        does not advance meanwhile.
        """
        connection, _ = self._listener.accept()
        self._listener.close()
        self._path.unlink()
        with connection, connection.makefile("r", buffering=BUFFER) as lines:
            for line in lines:
                try:
                    # a line has one key: "truth" with a state, "ready", or the kind of an event with its text
                    ((key, value),) = json.loads(line).items()
                    state = TrueState.from_numbers(value) if key == "truth" else None
                except (ValueError, TypeError, AttributeError):  # a broken line
                    continue
                try:
                    if state is not None:
                        self._on_truth(state)
                    elif key == "ready":
                        self._may_begin.wait()
                    else:
                        self._on_event(key, str(value))
                except Exception as error:
                    self.failure = self.failure or error
                if key in ("truth", "ready"):  # the simulator waits for an answer to these two messages
                    with contextlib.suppress(OSError):
                        connection.sendall(READ)
