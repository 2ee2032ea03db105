"""State bar of the page, above its tabs: the robot's activity in one line, numbers, the emergency stop."""

from __future__ import annotations

from contextlib import contextmanager
from html import escape
from math import inf
from time import monotonic
from typing import Any, Callable, Iterator, NamedTuple, Optional, Tuple

import viser

from husky_web.log import Line
from husky_web.plots import fixed

# classes of viser.css for the levels OK, WARN, ERROR and STALE of a DiagnosticStatus
LEVELS = ("ok", "warn", "error", "error")
ARRIVED, STOPPED = "arrived", "stopped"  # the controller's states
STARTED = "waiting"  # state of the controller from its start to its first scan
MASTER_GONE = (
    "the ROS master has ended, so the emergency stop of this page may not reach the robot; "
    "press the red button of the robot, then end the launch of this page and start it again"
)
LOCKED = "emergency stop: the robot obeys no command"
UNHEARD = "emergency stop, but no node subscribes to e_stop, so this page cannot stop the robot"
UNCERTAIN = "emergency stop, but the robot is not responding and may not have stopped"
PHRASES = {
    STOPPED: "standing still until Start is pressed",
    STARTED: "waiting for a scan to drive by",
    "driving": "driving to the pillar",
    "searching": "searching for the pillar",
    ARRIVED: "at the pillar",
}
BY_HAND, MOVING, NO_DRIVER = "driven by hand", "being moved", "no node drives the robot"
MAX_REASON = 200  # largest number of characters of a reason
FIGURES_PERIOD = 0.2  # [s] wall time between two changes of the numbers
# [s] a warning counts as the reason of the controller's stop if it comes at most this time before or after
# the stop
REASON_TIME = 3.0
# [s] simulated time after which the controller has noticed that an object was moved: one or two scans
SEEN_AFTER = 0.03
# [s] longest wall time for which the name of a moved object is shown after the end of its motion; without
# this limit, the name would stay while simulated time is unknown, slow or paused
LONGEST_SHOWN = 0.3
# buttons: the robot drives again from its start, or the pillar moves to another position
DRIVE_AGAIN, MOVE_PILLAR = "Drive again", "Move the pillar"


class RobotStatus(NamedTuple):
    """Facts that the state bar shows in words."""

    is_locked: bool = False  # true if the emergency stop is on
    has_listener: bool = True  # true if another node subscribes to the emergency stop
    is_master_gone: bool = False  # true if the ROS master has ended or was started again
    is_paused: bool = False  # true if simulated time is paused
    is_silent: bool = False  # true if the robot does not respond: it has sent no odometry for a while
    moving: str = ""  # name of the object that a page moves; empty if no page moves one
    is_by_hand: bool = False  # true if a person drives the robot
    driver: str = ""  # name of the node that drives the robot, if it is not the controller
    level: int = 0  # level of the controller's diagnostics, an index of LEVELS
    activity: str = ""  # state of the controller, such as "driving"; empty if unknown
    fault: str = ""  # fault that the controller's diagnostics report; empty if none
    reason: str = ""  # text of the warning that came when the controller stopped


class Figures(NamedTuple):
    """Numbers of the state bar."""

    distance: Optional[float] = None  # [m] remaining distance
    speed: Optional[float] = None  # [m/s] measured speed
    time: Optional[float] = None  # [s] simulated time


class Moving:
    """Name of the object that a page moves in the world, until the robot can have noticed the motion."""

    def __init__(self) -> None:
        self._text = ""
        # [s] wall time at which the motion ended; None while the object is being moved
        self._ended_at: Optional[float] = None
        # [s] first simulated time after the end of the motion, or after a later restart of the simulator;
        # None if unknown
        self._time_after_end: Optional[float] = None

    @contextmanager
    def __call__(self, text: str) -> Iterator[None]:
        """Show the name of an object that is moved during a block."""
        self.begin(text)
        try:
            yield
        finally:
            self.end()

    def begin(self, text: str) -> None:
        """Note that a page moves this object from now on."""
        self._text, self._ended_at, self._time_after_end = text, None, None

    def end(self) -> None:
        """Note that the page has put the object down."""
        self._ended_at = monotonic()

    def text(self, time: Optional[float], now: float) -> str:
        """Return the name of the moved object; empty if there is none.

        The name is forgotten as soon as the controller has had time to notice the motion.

        Args:
            time: simulated time [s]; None if it is unknown.
            now: wall time [s].
        """
        if self._ended_at is None:  # the page still moves the object, or has not moved one yet
            return self._text
        is_seen = self._simulated_seconds_after_end(time) >= SEEN_AFTER
        if is_seen or now - self._ended_at >= LONGEST_SHOWN:
            self._text, self._ended_at = "", None
        return self._text

    def _simulated_seconds_after_end(self, time: Optional[float]) -> float:
        """Return the simulated seconds since the first call after the end of the motion; 0 if unknown.

        After a restart of the simulator, the seconds are counted from the first call after the restart.
        """
        if time is None:
            return 0.0
        if self._time_after_end is None or time < self._time_after_end:  # the first call, or a restart
            self._time_after_end = time
        return time - self._time_after_end


class StopReason:
    """Warning that explains in the state bar why the controller has stopped.

    It is the newest warning that came at most REASON_TIME before or after the stop.
    """

    def __init__(self) -> None:
        self.text = ""
        self._drove_at = -inf  # [s] last time at which the controller was not stopped

    def forget(self) -> None:
        """Show no reason, and count no warning until the controller drives again."""
        self.text, self._drove_at = "", -inf

    def update(self, activity: str, time: Optional[float], warning: Optional[Line]) -> None:
        """Take in the controller's state at a time [s], None if unknown, and the newest warning.

        While the controller is not stopped, or the time is unknown, there is no reason.
        """
        if time is None:
            self.forget()
        elif activity != STOPPED:
            self.text, self._drove_at = "", time
        # a warning is the reason of the stop only if it came near the time of the stop
        elif warning is not None and abs(warning.stamp - self._drove_at) < REASON_TIME:
            self.text = warning.text


class StateBar:
    """State, emergency stop and next actions, shown on every tab."""

    def __init__(self, gui: viser.GuiApi) -> None:
        # functions of the buttons DRIVE_AGAIN and MOVE_PILLAR; they get the page on which the button was
        # pressed
        self.on_again: Callable[[Any], None] = lambda client: None
        self.on_elsewhere: Callable[[Any], None] = lambda client: None
        self._state = gui.add_html(state_html(RobotStatus(), Figures()))
        self._e_stop = gui.add_html(e_stop_html(False))
        # numbers that are shown, and wall time [s] of their next change
        self._figures, self._figures_due = Figures(), 0.0
        self._next = gui.add_button_group(
            "What next?",
            (DRIVE_AGAIN, MOVE_PILLAR),
            hint=f"{DRIVE_AGAIN}: from the start. {MOVE_PILLAR}: to a position 4 to 8 m away; "
            "the robot follows it",
        )
        self._next.on_click(self._on_next)

    def update(self, status: RobotStatus, figures: Figures, now: float) -> None:
        """Show a new state at once, and new numbers each FIGURES_PERIOD; `now` [s] wall time."""
        if now >= self._figures_due:
            self._figures, self._figures_due = figures, now + FIGURES_PERIOD
        self._show(status)

    def forget(self, is_locked: bool, has_listener: bool) -> None:
        """Drop the state and the numbers, because they would be old when the next page opens.

        The emergency stop is still shown: `is_locked` is true if it is on, and `has_listener` is true if
        another node subscribes to it.
        """
        self._figures, self._figures_due = Figures(), 0.0
        self._show(RobotStatus(is_locked=is_locked, has_listener=has_listener))

    def _show(self, status: RobotStatus) -> None:
        """Show a state with the numbers that were kept last."""
        self._e_stop.content = e_stop_html(status.is_locked, status.has_listener)
        self._state.content = state_html(status, self._figures)

    def _on_next(self, event: Any) -> None:
        """Call the function of the pressed button, for the page on which it was pressed."""
        action = self.on_again if event.target.value == DRIVE_AGAIN else self.on_elsewhere
        action(event.client)


def e_stop_html(is_locked: bool, has_listener: bool = True) -> str:
    """Return HTML of the button of the emergency stop; the page's script sends its clicks.

    `has_listener` is true if a node subscribes to the emergency stop.
    """
    # a click on the button sends `request`: "true" switches the emergency stop on, and "false" releases it
    if is_locked:
        state = "STOPPED" if has_listener else "NOT HEARD"
        text, style, request = f"{state} &mdash; RELEASE", "locked", "false"
    else:
        text, style, request = "EMERGENCY STOP", "", "true"
    return (
        '<div class="husky-block">'
        f'<button class="husky-e-stop {style}" data-husky-e-stop="{request}">{text}</button></div>'
    )


def _summary(status: RobotStatus) -> Tuple[str, str]:
    """Return the colour of the light, a class of viser.css, and the sentence on the robot's state.

    If several facts hold, a reason that keeps the robot from driving comes first.
    """
    doing = PHRASES.get(status.activity, status.activity)  # empty if the controller's state is unknown
    # a node may send a level outside of 0 to 3
    fault_light = LEVELS[min(max(status.level, 0), 3)]
    # rows with a fact (true if it holds), the colour of the light, and the sentence; the first row with a
    # true fact is shown
    facts = (
        (status.is_master_gone, "error", MASTER_GONE),
        (status.is_locked and not status.has_listener, "error", UNHEARD),
        (status.is_locked and status.is_silent and not status.is_paused, "error", UNCERTAIN),
        (status.is_locked, "error", LOCKED),
        (status.is_paused, "warn", "PAUSED"),
        (status.is_silent, "error", "the robot is not responding"),
        (bool(status.moving), "busy", f"{MOVING}: {status.moving}"),
        (status.is_by_hand, "busy", BY_HAND),
        (bool(status.driver), "ok", f"{status.driver} drives the robot"),
        (bool(status.fault), fault_light, status.fault),
        (bool(doing), "" if status.activity == STOPPED else "ok", doing),
    )
    for holds, light, sentence in facts:
        if holds:
            return light, sentence
    return "", NO_DRIVER


def state_html(status: RobotStatus, figures: Figures) -> str:
    """Return HTML of state and numbers; texts of nodes are escaped."""
    light, sentence = _summary(status)
    # [m] remaining distance; it is shown as 0 at the pillar, and never as a negative number
    to_go = figures.distance
    if to_go is not None:
        has_arrived = status.activity == ARRIVED
        to_go = 0.0 if has_arrived else max(0.0, to_go)
    numbers = "".join(
        f"<div><dd>{fixed(value, digits)} <small>{unit}</small></dd><dt>{name}</dt></div>"
        for value, digits, unit, name in (
            (to_go, 2, "m", "to go"),
            (figures.speed, 2, "m/s", "speed"),
            (figures.time, 1, "s", "time"),
        )
    )
    # page.css shows "Waiting for news of the robot" until this attribute exists
    time = "" if figures.time is None else f' data-time="{figures.time:.3f}"'
    reason = f'<div class="husky-reason">{escape(status.reason[:MAX_REASON])}</div>' if status.reason else ""
    return (
        f'<div class="husky-block husky-state {light}"{time}>'
        f'<div><span class="husky-light {light}"></span><b>{escape(sentence)}</b></div>'
        f'<dl class="husky-figures">{numbers}</dl>{reason}</div>'
    )
