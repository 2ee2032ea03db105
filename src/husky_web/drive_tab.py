"""Drive tab: readings and lights, the pad, start and stop, pause and reset."""

from __future__ import annotations

from contextlib import nullcontext
from functools import partial
from html import escape
from math import inf
from time import monotonic
from typing import Any, Callable, ContextManager, Dict, List, NamedTuple, Optional, Sequence, Tuple

import rospy
import viser
from husky_highlevel_controller.srv import StepWorld
from std_srvs.srv import SetBool, Trigger

from husky_highlevel_controller.datatypes import HuskyError
from husky_web.actions import (
    CALL_TIMEOUT,
    LONG_TIMEOUT,
    Actions,
    call,
    parameter,
)
from husky_web.plots import fixed
from husky_web.state_bar import LEVELS, STARTED, STOPPED
from husky_web.teleop import SLOWEST, Teleop, set_speed

PAD = """<div class="husky-block husky-drive">
<div class="husky-pad" aria-hidden="true"><div class="husky-knob"></div></div>
<div>Drag the pad<span class="husky-has-keys">,
or hold <kbd>W</kbd> <kbd>A</kbd> <kbd>S</kbd> <kbd>D</kbd></span>. Let go to stop.<br>
<span class="husky-has-keys"><kbd>Space</kbd> is the emergency stop.</span></div></div>"""
# sliders: label, name of the limit in `Teleop` that the slider sets, and highest value [m/s] or [rad/s]
SPEEDS = (("speed [m/s]", "max_linear", 1.0), ("turning [rad/s]", "max_angular", 2.0))
# name, unit, and digits after the point of each number that this tab shows; the state bar shows the other
# numbers
READINGS = (("bearing of the pillar", "rad", 3), ("real-time factor", "", 2), ("scans", "Hz", 1))
Readings = Sequence[Optional[float]]
START, STOP, PAUSE, STEP, RESUME = "Start", "Stop", "Pause", "Step", "Resume"
BACK = "Back to the start"


class Service(NamedTuple):
    """Service of the simulator."""

    name: str
    kind: Any  # type of the service
    timeout: float = CALL_TIMEOUT  # [s] longest wall time of a call
    arguments: Tuple[Any, ...] = ()  # arguments of the request


# service for each button; STEP requests 20 physics steps of 5 ms
SERVICES = {
    PAUSE: Service("pause", Trigger),
    STEP: Service("step", StepWorld, LONG_TIMEOUT, (20,)),
    RESUME: Service("resume", Trigger),
    BACK: Service("reset", Trigger),
}
# [s] for this wall time after a request to start or stop the controller, a status that contradicts the
# request is ignored, because the status is older than the request
STALE_STATUS = 1.0
# [s] a light is stale if its node has sent no diagnostic for this time; nodes send a diagnostic each second,
# and rqt_robot_monitor also waits 5 s
STALE_LIGHT = 5.0
STALE_LEVEL = 3  # level STALE of a DiagnosticStatus
# largest number of diagnostics that are shown; largest number of characters of a name or a message
MAX_LIGHTS, MAX_LETTERS = 50, 200


class Light(NamedTuple):
    """Last diagnostic of one name."""

    level: int  # level of a DiagnosticStatus, such as 0 for OK
    message: str
    heard_at: float  # [s] wall time at which it came
    # [s] simulated time at which the silence of the node began; None if unknown
    silent_since: Optional[float]


class ControllerStatus(NamedTuple):
    """State of the controller, and its fault."""

    state: str  # such as "driving"; empty if unknown
    level: int = 0  # level of the fault, as in a DiagnosticStatus; 0 for OK
    fault: str = ""  # sentence about the fault; empty if there is none


class DriveTab:
    """Buttons and readings of the first tab."""

    def __init__(
        self,
        server: viser.ViserServer,
        actions: Actions,
        teleop: Teleop,
        show_moving: Callable[[str], ContextManager[None]],
        controller: str,
        simulator: str,
    ) -> None:
        """Build the tab.

        Args:
            server: server of the page.
            actions: queue of service calls, except stops.
            teleop: driving by hand, whose speeds the sliders set, and the emergency stop.
            show_moving: function that takes the name of an object, and returns a context. Inside the context,
                the state bar shows that the object is being moved.
            controller: name of the controller's node.
            simulator: name of the simulator's node.
        """
        self._actions, self._teleop, self._show_moving = actions, teleop, show_moving
        self._stops = Actions()  # a separate queue for stops, because a stop must not wait for other calls
        self._controller, self._simulator = controller, simulator
        # number of requests to stop the controller; a request to start that is older than the last stop is
        # not carried out
        self._stop_count = 0
        # light of each diagnostic; the key is its name, such as husky_highlevel_controller
        self._lights: Dict[str, Light] = {}
        self._state = ""  # state of the controller, from its diagnostics
        # True if a page has requested to start the controller, False if it has requested to stop it; None as
        # soon as the controller's state agrees, or after STALE_STATUS
        self._is_start_requested: Optional[bool] = None
        self._requested_at = -inf  # [s] wall time of the request
        self._add_fields(server.gui)

    def _add_fields(self, gui: viser.GuiApi) -> None:
        """Add the readings, buttons and sliders of the tab, and connect their callbacks."""
        self._readings = gui.add_html(readings_html((None, None, None), []))
        # Start and Stop while the controller's state is unknown; later only the button that changes the state
        self._start: Any = gui.add_button_group("Controller", (START, STOP))
        self._start.on_click(self._on_start_stop)
        with gui.add_folder("Drive by hand"):
            gui.add_html(PAD)
            # a slider sets the attribute `limit` of `teleop`, for example max_linear
            for label, limit, high in SPEEDS:
                slider = gui.add_slider(
                    label, min=SLOWEST, max=high, step=0.05, initial_value=getattr(self._teleop, limit)
                )
                slider.on_update(partial(set_speed, self._teleop, limit, high))
        with gui.add_folder("Simulation"):
            self._time: Any = gui.add_button_group(
                "Time", (PAUSE, STEP), hint=f"{STEP}: 0.1 s of a paused world"
            )
            self._time.on_click(self._on_simulation)
            back = gui.add_button_group("World", (BACK,), hint="robot, objects and world as at the launch")
            back.on_click(self._on_simulation)

    def take(self, diagnostics: List[Any], now: float, time: Optional[float] = None) -> None:
        """Take in messages of /diagnostics that came at `now`, and mark the lights that are stale.

        Args:
            diagnostics: new messages of /diagnostics; may be empty.
            now: wall time [s].
            time: simulated time [s]; None if it is unknown.
        """
        for array in diagnostics:
            for item in array.status:
                name = item.name[:MAX_LETTERS]
                # other diagnostics are not shown if there are MAX_LIGHTS already
                if name in self._lights or len(self._lights) < MAX_LIGHTS:
                    self._lights[name] = Light(item.level, item.message[:MAX_LETTERS], now, time)
                if self._is_of_controller(name):
                    self._take_state(item, now)
        self._mark_stale(now, time)

    def _take_state(self, item: Any, now: float) -> None:
        """Take in the controller's state from its diagnostic, and end a request to start or stop it.

        A state that contradicts the request may be older than the request. So the request ends only if the
        state agrees, or if more than STALE_STATUS has passed; `now` is wall time [s].
        """
        values = {pair.key: pair.value for pair in item.values}
        self._state = values.get("state", "")[:MAX_LETTERS]
        is_started = self._state != STOPPED
        # without a request, `_is_start_requested` is None, so it agrees with no state
        agrees = self._is_start_requested == is_started
        if agrees or now - self._requested_at > STALE_STATUS:
            self._is_start_requested = None

    def _mark_stale(self, now: float, time: Optional[float]) -> None:
        """Mark the lights whose node has been silent for more than STALE_LIGHT.

        `now` is wall time, and `time` is simulated time [s]. If simulated time is known, the node must have
        been silent for STALE_LIGHT in both times. Nodes send their diagnostics by simulated time, which may
        be slow or stand still.
        """
        message = f"no status for more than {STALE_LIGHT:g} s; the node may have ended"
        for name in list(self._lights):
            silence = now - self._lights[name].heard_at
            if time is not None:
                silence = min(silence, self._simulated_silence(name, time))
            if silence > STALE_LIGHT:
                self._lights[name] = self._lights[name]._replace(level=STALE_LEVEL, message=message)
                if self._is_of_controller(name):
                    self._state = ""

    def _simulated_silence(self, name: str, time: float) -> float:
        """Return the simulated time [s] from the last diagnostic of a name to `time` [s].

        If simulated time was unknown when the diagnostic came, or has begun again since then, the silence is
        counted from the first known time after that.
        """
        light = self._lights[name]
        if light.silent_since is None or time < light.silent_since:
            self._lights[name] = light._replace(silent_since=time)
            return 0.0
        return time - light.silent_since

    def _is_of_controller(self, name: str) -> bool:
        """Return whether a diagnostic of this name comes from the controller.

        Its name is the name of the node, or begins with it and a colon, as diagnostic_updater writes it.
        """
        return name.partition(":")[0] == self._controller.strip("/")

    def update(self, readings: Readings, is_paused: Optional[bool]) -> None:
        """Show new readings and states.

        Args:
            readings: numbers of READINGS.
            is_paused: the simulated world is paused; None if there is no simulator.
        """
        lights = [(name, light.level, light.message) for name, light in sorted(self._lights.items())]
        self._readings.content = readings_html(readings, lights)
        state = self.controller_status().state
        if not state:  # the controller's state is unknown
            self._start.options = (START, STOP)
        elif state == STOPPED:
            self._start.options = (START,)
        else:
            self._start.options = (STOP,)
        self._time.options = (RESUME if is_paused else PAUSE, STEP)

    def forget(self) -> None:
        """Drop the lights of nodes that may be gone."""
        self._lights.clear()
        self._state, self._is_start_requested = "", None

    def _on_start_stop(self, event: Any) -> None:
        """Start or stop the controller, as the pressed button says."""
        if event.target.value == STOP:
            self.stop(event.client)
        else:
            stop_count = self._stop_count  # a stop that is requested later cancels this start
            self._actions.do(lambda: self._start_controller(stop_count), event.client, "Controller")

    def stop(self, client: Any = None) -> None:
        """Stop the controller without waiting for other calls, and drop requests to start it that still wait.

        The button Stop and the emergency stop call this function. The emergency stop only blocks the commands
        to the robot. If this function did not stop the controller, the controller would drive on as soon as
        the emergency stop is released. The result is shown in the page of `client`, if there is one.
        """
        self._stop_count += 1
        self._stops.do(lambda: self._call_start_stop(False), client, "Controller")

    def again(self, client: Any) -> None:
        """Bring back the world and the robot as they were at the start, and start the controller.

        The result is shown in the page of `client`.
        """
        stop_count = self._stop_count  # a stop that is requested later cancels this start

        def work() -> str:
            with self._show_moving("robot and world"):
                sentence = call(f"{self._simulator}/reset", Trigger)
                self._start_controller(stop_count)
            return sentence

        self._actions.do(work, client, "Drive again")

    def controller_status(self) -> ControllerStatus:
        """Return the controller's state and fault.

        A request to start or stop counts even before the diagnostics show its effect, so that the page
        changes at once.
        """
        if self._is_start_requested is False:
            return ControllerStatus(STOPPED)
        if self._is_start_requested and self._state == STOPPED:
            return ControllerStatus(STARTED)
        lights = [light for name, light in self._lights.items() if self._is_of_controller(name)]
        if not lights or lights[0].level <= 0:  # no fault is known
            return ControllerStatus(self._state)
        level, fault = lights[0].level, lights[0].message
        if level == STALE_LEVEL:
            # the message says only that a node may have ended, so it gets the controller's name
            fault = f"{self._controller.strip('/')}: {fault}"
        return ControllerStatus(self._state, level, fault)

    def _start_controller(self, stop_count: int) -> str:
        """Start the controller, and return the service's sentence.

        Args:
            stop_count: value of `_stop_count` when the page requested the start.

        Raises:
            HuskyError: the emergency stop is on, a page has requested a stop since, or the service fails.
        """
        stopped = "not started, because a stop was requested after this start; press Start again"
        if self._teleop.is_locked:
            raise HuskyError("the emergency stop is on; release it first")
        if self._stop_count != stop_count:
            raise HuskyError(stopped)
        sentence = self._call_start_stop(True)
        # A stop may have been requested since the check above. The controller may have got the call of this
        # stop before the call that starts it, so the controller is stopped again.
        if self._stop_count != stop_count:
            self._call_start_stop(False)
            raise HuskyError(stopped)
        return sentence

    def _call_start_stop(self, starts: bool) -> str:
        """Start or stop the controller by its service, and return the service's sentence.

        Raises:
            HuskyError: the service fails.
        """
        name = str(parameter(f"{self._controller}/start_stop_service_name", "~start_stop"))
        # "~" stands for the controller's own namespace, but rospy would replace it by the namespace of this
        # node
        service = f"{self._controller}/{name[1:]}" if name.startswith("~") else rospy.resolve_name(name)
        sentence = call(service, SetBool, starts)
        self._requested_at, self._is_start_requested = monotonic(), starts
        return sentence

    def _on_simulation(self, event: Any) -> None:
        """Call the simulator's service of the pressed button."""
        service = SERVICES[event.target.value]
        full_name = f"{self._simulator}/{service.name}"

        def work() -> str:
            # the reset is the only service here that moves the robot and objects, so only the reset is shown
            # as a motion in the state bar
            is_reset = service.name == "reset"
            with self._show_moving("robot and world") if is_reset else nullcontext():
                return call(full_name, service.kind, *service.arguments, timeout=service.timeout)

        self._actions.do(work, event.client, "Simulation")


def readings_html(readings: Readings, lights: List[Tuple[str, int, str]]) -> str:
    """Return HTML of readings and lights; texts of nodes are escaped."""
    table = "".join(
        f"<dt>{name}</dt><dd>{fixed(reading, digits)} {unit}</dd>"
        for (name, unit, digits), reading in zip(READINGS, readings)
    )
    # a node may send a level outside of 0 to 3, so the level is limited to the indices of LEVELS
    lamps = "".join(
        f'<div><span class="husky-light {LEVELS[min(max(level, 0), 3)]}"></span>'
        f"{escape(name)}: {escape(text)}</div>"
        for name, level, text in lights
    )
    no_lamps = '<div><span class="husky-light"></span>no diagnostics</div>'
    return f'<div class="husky-block">{lamps or no_lamps}<dl class="husky-status">{table}</dl></div>'
