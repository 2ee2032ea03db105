"""State bar of the page, above its tabs: the emergency stop, and what the robot does in one line."""

from __future__ import annotations

from html import escape
from typing import Any, NamedTuple, Optional

import viser

from husky_highlevel_controller.ros.web.curves import fixed

LEVELS = ("ok", "warn", "error", "error")  # of diagnostic_msgs/DiagnosticStatus: OK, WARN, ERROR, STALE
LOCKED = "emergency stop: no command is obeyed"
PHRASES = {"stopped": "standing still until Start is pressed", "driving": "driving to the pillar"}
NO_NEWS_TIME = 2.0  # [s] of wall time without a message of the robot until the page says so


class RobotStatus(NamedTuple):
    """Numbers and words of the state bar."""

    is_locked: bool = False  # by the emergency stop
    is_paused: bool = False  # the simulated world
    is_silent: bool = False  # no odometry has come for NO_NEWS_TIME
    level: int = 0  # of the controller's diagnostics
    activity: str = ""  # of the controller, in its own words
    distance: Optional[float] = None  # [m] to go
    speed: Optional[float] = None  # [m/s], measured
    time: Optional[float] = None  # [s]


class StateBar:
    """Shown on every tab."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._e_stop = gui.add_html(e_stop_html(False))
        self._state = gui.add_html(state_html(RobotStatus()))

    def update(self, status: RobotStatus) -> None:
        """Show a new state."""
        set_html(self._e_stop, e_stop_html(status.is_locked))
        set_html(self._state, state_html(status))


def e_stop_html(is_locked: bool) -> str:
    """Button of the emergency stop, whose clicks the page's script sends on."""
    if is_locked:
        return _button("locked", "false", "STOPPED &mdash; RELEASE")
    return _button("", "true", "EMERGENCY STOP")


def state_html(status: RobotStatus) -> str:
    """State bar as one line of HTML; texts of nodes are escaped."""
    if status.is_locked:
        level, sentence = "error", LOCKED
    elif status.is_paused:
        level, sentence = "warn", "PAUSED"
    elif status.is_silent:
        level, sentence = "error", "no news from the robot"
    else:
        level = LEVELS[min(max(status.level, 0), 3)] if status.activity else ""
        sentence = PHRASES.get(status.activity, status.activity) or "waiting for the controller"
    numbers = [
        f"{fixed(value, digits)}&nbsp;{unit}"
        for value, digits, unit in (
            (status.distance, 2, "m to go"),
            (status.speed, 2, "m/s"),
            (status.time, 1, "s"),
        )
        if value is not None
    ]
    time = "" if status.time is None else f' data-time="{status.time:.3f}"'
    return (
        f'<div class="husky-block husky-state {level}"{time} role="status">'
        f'<span class="husky-light {level}"></span><b>{escape(sentence)}</b>'
        f"<span>{' &middot; '.join(numbers)}</span></div>"
    )


def set_html(element: Any, content: str) -> None:
    """Change an element's HTML if it differs: every change is sent to every page."""
    if element.content != content:
        element.content = content


def _button(style: str, locks: str, words: str) -> str:
    return (
        '<div class="husky-block">'
        f'<button class="husky-e-stop {style}" data-husky-e-stop="{locks}">{words}</button></div>'
    )
