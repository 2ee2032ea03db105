"""Records what the view shows, to be downloaded and replayed: as viser's own file, or as one HTML page.

The file is replayed by this page (page.js hands it to viser's player in a tab of its own); the HTML page
holds player and recording, and needs no server.
"""

from __future__ import annotations

import threading
from typing import Any, Optional

import viser

from husky_highlevel_controller.datatypes import HuskyError, Vector3
from husky_highlevel_controller.ros.web.actions import Actions
from husky_highlevel_controller.ros.web.gate import replay_page

MAX_TIME = 300.0  # [s], then a recording ends by itself: it is kept in memory
CAMERA_OFFSET = (-5.0, -4.0, 3.5)  # [m], of a replay's first view from where the robot is at the beginning
OPEN = """<div class="husky-block"><label class="husky-open" title="a file that was saved here before">
Replay a file<input type="file" accept=".viser" data-husky-replay="true"></label></div>"""
RECORD, STOP = "Record", "Stop"
FILE, HTML = "Replay file", "HTML page"


class Recorder:
    """Buttons to record and to download, and the recording; `tick` is called by the thread that draws."""

    def __init__(self, server: viser.ViserServer, actions: Actions) -> None:
        self._server, self._actions = server, actions
        self._serializer: Optional[Any] = None
        self._started, self._last = 0.0, 0.0  # [s]
        self._request: Optional[bool] = None  # a change that the buttons ask for
        self._turn = threading.Lock()
        self._recording = b""
        gui = server.gui
        with gui.add_folder("Recording"):
            self._state = gui.add_html(_html("nothing is recorded"))
            gui.add_button_group("View", (RECORD, STOP)).on_click(self._on_record)
            gui.add_button_group(
                "Save as", (FILE, HTML), hint="the file is replayed by this page; the HTML page from disk"
            ).on_click(self._on_save)
            gui.add_html(OPEN)

    def tick(self, now: float, base: Optional[Vector3]) -> None:
        """Let `now` [s] pass in the recording; begin and end it as the buttons say."""
        request, self._request = self._request, None
        if request and self._serializer is None:
            self._start(now, base)
        elif self._serializer is not None:
            self._serializer.insert_sleep(now - self._last)
            self._last = now
            length = now - self._started
            if request is False or length >= MAX_TIME:
                self.stop()
            else:
                self._say(f"recording, {length:.0f} s")

    def stop(self) -> None:
        """End a recording; it can be saved then."""
        serializer, self._serializer = self._serializer, None
        if serializer is not None:
            length = self._last - self._started
            self._actions.do(lambda: self._finish(serializer, length), None, "Recording")

    def _start(self, now: float, base: Optional[Vector3]) -> None:
        x, y, z = base or (0.0, 0.0, 0.0)
        dx, dy, dz = CAMERA_OFFSET
        camera = self._server.initial_camera
        camera.up, camera.position, camera.look_at = (0.0, 0.0, 1.0), (x + dx, y + dy, z + dz), (x, y, z)
        self._serializer = self._server.get_scene_serializer()
        self._started = self._last = now
        self._say("recording, 0 s")

    def _finish(self, serializer: Any, length: float) -> None:
        self._say(f"packing {length:.0f} s")
        data: bytes = serializer.serialize()
        with self._turn:
            self._recording = data
        self._say(f"{length:.0f} s recorded, {len(data) / 1e6:.1f} MB")

    def _on_record(self, event: Any) -> None:
        self._request = event.target.value == RECORD

    def _on_save(self, event: Any) -> None:
        kind, client = event.target.value, event.client
        self._actions.do(lambda: self._save(kind, client), client, "Recording")

    def _save(self, kind: str, client: viser.ClientHandle) -> None:
        with self._turn:
            data = self._recording
        if not data:
            raise HuskyError(f"nothing is recorded yet: press {RECORD}, then {STOP}")
        if kind == FILE:
            client.send_file_download("drive.viser", data)
        else:
            client.send_file_download("drive.html", replay_page(data))

    def _say(self, words: str) -> None:
        content = _html(words)
        if self._state.content != content:
            self._state.content = content


def _html(words: str) -> str:
    return f'<div class="husky-block">{words}</div>'
