"""Recording of a run, which can be downloaded as one HTML page that replays the run."""

from __future__ import annotations

from math import inf, nan
from typing import Any, List, Optional, Tuple

import numpy as np
import viser

from husky_highlevel_controller.course import PILLARS
from husky_highlevel_controller.datatypes import HuskyError, Pose, Vector3
from husky_highlevel_controller.drawing.replay import Replay, to_html
from husky_highlevel_controller.geometry import pose_to_2d
from husky_highlevel_controller.robot import ROBOTS, load_robot
from husky_web.actions import Actions

MAX_TIME = 3600.0  # [s] longest recording, because it is kept in memory
# [s] if time goes back by more than this, the simulator was started again; otherwise a message is late
RESTART_STEP = 1.0
RECORD, END, SAVE = "Record", "End", "Save as a page"
# row of a recording: time [s]; x, y [m] and yaw [rad] of base_link; x, y [m] of the pillar, NaN if unknown
Row = Tuple[float, ...]


class Recorder:
    """Buttons to record and to save, and the recording."""

    def __init__(self, server: viser.ViserServer, actions: Actions) -> None:
        self._actions = actions  # does the work of the buttons
        self._is_on = False  # true while a run is recorded
        self.robot_name = ""  # name of the robot in its URDF; the node sets it later
        self._rows: List[Row] = []  # the recording, with a row for each time
        gui = server.gui
        with gui.add_folder("Recording"):
            self._state = gui.add_html("")
            self._buttons: Any = gui.add_button_group(
                "Run", (RECORD,), hint=f"{SAVE}: a file that replays the run, without this page"
            )
            self._buttons.on_click(self._on_click)
        self._show()

    def tick(self, time: Optional[float], base: Optional[Pose], pillar: Optional[Vector3]) -> None:
        """Record the robot's pose and the pillar's position [m], both in the fixed frame, at a time [s].

        The times of a recording must grow. So a late message is left out, and the recording ends if the
        simulator is started again.
        """
        rows = self._rows
        if not self._is_on or time is None:
            return
        last_time = rows[-1][0] if rows else -inf  # [s]
        if time < last_time - RESTART_STEP:  # the simulator was started again
            if len(rows) > 1:
                self.stop()
                return
            # RECORD was pressed after the old run had ended, so the only row is the last moment of the old
            # run. The recording begins again with the new run.
            rows.clear()
            last_time = -inf
        if base is None or time <= last_time:  # the pose is unknown, or this time is not new
            return
        pillar_x, pillar_y = (nan, nan) if pillar is None else pillar[:2]
        rows.append((time, *pose_to_2d(base), pillar_x, pillar_y))
        if time - rows[0][0] >= MAX_TIME:
            self._is_on = False
        self._show()

    def stop(self) -> None:
        """End a recording, which can be saved afterwards."""
        self._is_on = False
        self._show()

    def _on_click(self, event: Any) -> None:
        """Begin, end or save a recording, as the pressed button says."""

        def save() -> None:
            """Send the recording to the browser as a file."""
            page = recording_page(list(self._rows), self.robot_name).encode()
            event.client.send_file_download("drive.html", page, save_immediately=True)

        if event.target.value == SAVE:
            self._actions.do(save, event.client, "Recording")
            return
        self._is_on = event.target.value == RECORD
        if self._is_on:
            self._rows = []
        self._show()

    def _show(self) -> None:
        """Show the length of the recording, and the buttons that are possible now."""
        # [s] length of the recording
        length = self._rows[-1][0] - self._rows[0][0] if self._rows else 0.0
        text = f"recording, {length:.0f} s" if self._is_on else f"{length:.0f} s recorded"
        self._state.content = f'<div class="husky-block">{text}</div>'
        options = [END if self._is_on else RECORD]
        if self._rows:
            options.append(SAVE)
        self._buttons.options = tuple(options)


def recording_page(rows: List[Row], robot_name: str) -> str:
    """Return an HTML page that replays a run.

    A robot that is not in ROBOTS has the Husky's shape.

    Args:
        rows: recorded rows, each with a time, the robot's pose, and the pillar's position.
        robot_name: name of the robot in its URDF.

    Raises:
        HuskyError: the recording has no rows.
    """
    if not rows:
        raise HuskyError(f"nothing is recorded yet; press {RECORD}, then {END}")
    table = np.array(rows)
    times, poses, pillars = table[:, 0], table[:, 1:4], table[:, 4:]  # the columns of `Row`
    name = robot_name if robot_name in ROBOTS else "husky"
    return to_html(
        Replay(
            "Run",
            f"{times[-1] - times[0]:.0f} s, recorded in the page",
            times,
            poses,
            _without_gaps(pillars),
            pillar_radius=PILLARS[name].radius,
            robot=load_robot(name),
        )
    )


def _without_gaps(pillars: np.ndarray) -> np.ndarray:
    """Return the pillar's positions (N, 2) [m], with a position in place of each NaN; empty if all are NaN.

    While the pillar is lost, the replay shows it at its last known position. Before the controller has found
    it, the replay shows it at the first position that was found. For example, NaN, 3, NaN, 5 become
    3, 3, 3, 5.
    """
    is_known = np.isfinite(pillars).all(axis=1)
    known = pillars[is_known]
    if not len(known):
        return known
    shown = known[0]
    positions = []
    for position, is_position_known in zip(pillars, is_known):
        if is_position_known:
            shown = position
        positions.append(shown)
    return np.array(positions)
