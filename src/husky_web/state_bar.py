"""State bar of the page, above its tabs: the emergency stop, and what the robot does in one line."""

from __future__ import annotations

from html import escape
from math import inf
from typing import Any, Callable, NamedTuple, Optional

import viser

from husky_web.log import Line
from husky_web.plots import fixed

LEVELS = ("ok", "warn", "error", "error")  # of diagnostic_msgs/DiagnosticStatus: OK, WARN, ERROR, STALE
ARRIVED, STOPPED = "arrived", "stopped"  # the controller's states
MASTER_GONE = (
    "the ROS master has ended, and the emergency stop of this page may reach no robot: "
    "press the red button of the robot, end the launch of this page and start it again"
)
LOCKED = "emergency stop: no command is obeyed"
UNHEARD = "emergency stop, but nobody listens to e_stop: this page cannot stop the robot"
UNCERTAIN = "emergency stop, but no news from the robot: whether it obeys is not known"
PHRASES = {
    STOPPED: "standing still until Start is pressed",
    "driving": "driving to the pillar",
    "searching": "searching for the pillar",
    ARRIVED: "at the pillar",
}
MAX_REASON = 200  # letters
REASON_TIME = 3.0  # [s] between the controller's stop and a warning that says why
AGAIN, ELSEWHERE = "Drive again", "Move the pillar"


class RobotStatus(NamedTuple):
    """Numbers and texts of the state bar."""

    is_locked: bool = False  # by the emergency stop
    has_listener: bool = True  # a node besides this one subscribes to the emergency stop
    is_master_gone: bool = False  # or started anew
    is_paused: bool = False  # the simulated world
    is_silent: bool = False  # no odometry has come for a while
    level: int = 0  # of the controller's diagnostics
    activity: str = ""  # of the controller, in its own words
    distance: Optional[float] = None  # [m] to go
    speed: Optional[float] = None  # [m/s], measured
    time: Optional[float] = None  # [s]
    reason: str = ""  # the warning that came as the controller stopped


class StopReason:
    """Warning that came as the controller stopped, kept while it stands: later ones tell of other things."""

    def __init__(self) -> None:
        self.text = ""
        self._drove_at = -inf  # [s], when the controller was seen last to be not stopped

    def update(self, activity: str, time: Optional[float], warning: Optional[Line]) -> None:
        """Take in the controller's state at a time [s], None: not known, and the newest warning."""
        if time is None or activity != STOPPED:
            self.text, self._drove_at = "", -inf if time is None else time
        elif warning is not None and abs(warning.stamp - self._drove_at) < REASON_TIME:
            self.text = warning.text


class StateBar:
    """Emergency stop and state, shown on every tab; when the robot has arrived, what can be done next."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self.on_again: Callable[[Any], None] = lambda client: None  # called with the page that asks for it
        self.on_elsewhere: Callable[[Any], None] = lambda client: None
        self._e_stop = gui.add_html(e_stop_html(False))
        self._state = gui.add_html(state_html(RobotStatus()))
        self._next = gui.add_button_group(
            "What next?",
            (AGAIN, ELSEWHERE),
            visible=False,
            hint=f"{AGAIN}: from the start. {ELSEWHERE}: to a place 4 to 8 m away; the robot follows it",
        )
        self._next.on_click(self._on_next)

    def update(self, status: RobotStatus) -> None:
        """Show a new state."""
        self._e_stop.content = e_stop_html(status.is_locked, status.has_listener)
        self._state.content = state_html(status)
        self._next.visible = status.activity == ARRIVED and not status.is_locked

    def _on_next(self, event: Any) -> None:
        (self.on_again if event.target.value == AGAIN else self.on_elsewhere)(event.client)


def e_stop_html(is_locked: bool, has_listener: bool = True) -> str:
    """Button of the emergency stop, whose clicks the page's script sends on."""
    state = "STOPPED" if has_listener else "NOT HEARD"
    text, style = (f"{state} &mdash; RELEASE", "locked") if is_locked else ("EMERGENCY STOP", "")
    locks = "false" if is_locked else "true"
    return (
        '<div class="husky-block">'
        f'<button class="husky-e-stop {style}" data-husky-e-stop="{locks}">{text}</button></div>'
    )


def state_html(status: RobotStatus) -> str:
    """State bar as one line of HTML; texts of nodes are escaped."""
    activity = PHRASES.get(status.activity, status.activity) or "waiting for the controller"
    level, sentence = next(
        (level, sentence)
        for applies, level, sentence in (  # what keeps the robot from driving first
            (status.is_master_gone, "error", MASTER_GONE),
            (status.is_locked and not status.has_listener, "error", UNHEARD),
            (status.is_locked and status.is_silent and not status.is_paused, "error", UNCERTAIN),
            (status.is_locked, "error", LOCKED),
            (status.is_paused, "warn", "PAUSED"),
            (status.is_silent, "error", "no news from the robot"),
            (True, LEVELS[min(max(status.level, 0), 3)] if status.activity else "", activity),
        )
        if applies
    )
    numbers = [
        f"{fixed(value, digits)}&nbsp;{unit}"
        for value, digits, unit in (
            (None if status.activity == ARRIVED else status.distance, 2, "m to go"),
            (status.speed, 2, "m/s"),
            (status.time, 1, "s"),
        )
        if value is not None
    ]
    time = "" if status.time is None else f' data-time="{status.time:.3f}"'
    reason = f"<div>{escape(status.reason[:MAX_REASON])}</div>" if status.reason else ""
    return (
        f'<div class="husky-block husky-state {level}"{time}>'
        f'<div><span class="husky-light {level}"></span><b>{escape(sentence)}</b></div>'
        f"<div>{' &middot; '.join(numbers) or '&nbsp;'}</div>{reason}</div>"
    )
