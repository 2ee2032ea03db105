"""Teleoperation: commands of the pages, and the emergency stop, in a thread that nothing else delays."""

from __future__ import annotations

import re
import threading
import time
from math import inf
from typing import Any, Callable, Dict, Optional

import rospy
from geometry_msgs.msg import Twist
from std_msgs.msg import Bool

from husky_highlevel_controller.datatypes import STOP, Twist2D
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.node import contained, publish

# [s] time between two commands; twist_mux ignores an input that has been silent for 0.5 s, and the wheels
# stop 0.25 s after the last command
PERIOD = 0.05

SLOWEST = 0.1  # lowest value of the sliders for speed [m/s] and for turning [rad/s]
# [s] the robot stops if a page sends nothing for this time; a page sends every 0.05 s while a key is held
EXPIRY = 0.25
# [s] after the emergency stop was switched on, a page can release it only when this time has passed, because
# the second click of a double click would release it
RELEASE_AFTER = 1.0
# names of nodes that only look at e_stop, so they do not stop a robot
WATCHERS = re.compile(r"(.*/)?(rqt|rviz|rosbag|rostopic|record_|husky_web)")


def clamp_axis(value: Any) -> Optional[float]:
    """Return the axis of a joystick, clamped to -1..1; None if it is not a finite number."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value != value:
        return None
    return float(max(-1, min(1, value))) if abs(value) != inf else None


def set_speed(teleop: Teleop, limit: str, high: float, event: Any) -> None:
    """Set a limit of driving by hand to a slider's value, unless it is NaN or outside of the slider."""
    if SLOWEST <= event.target.value <= high:
        setattr(teleop, limit, event.target.value)


class HoldToDrive:
    """Decides which page drives: the first one, until it releases control or sends nothing for EXPIRY."""

    def __init__(self) -> None:
        self._holder: Optional[int] = None  # number of the page that has control; None if no page has it
        # last twist of this page, and time [s] at which it came
        self._twist, self._heard_at = STOP, 0.0
        self._has_to_stop = False  # true if control was released, but STOP was not sent yet

    @property
    def is_active(self) -> bool:
        """Return whether there is something to send."""
        return self._holder is not None or self._has_to_stop

    def hold(self, page: int, twist: Twist2D, now: float) -> None:
        """Take a page's twist at `now` [s]; a zero twist releases control."""
        # another page drives, and its last message is younger than EXPIRY, so this page has to wait
        if self._holder not in (None, page) and now - self._heard_at < EXPIRY:
            return
        if twist == STOP:
            self.release(page)
        else:
            self._holder, self._twist, self._heard_at = page, twist, now

    def release(self, page: int) -> None:
        """Release control of a page."""
        if page == self._holder:
            self._holder, self._has_to_stop = None, True

    def command(self, now: float) -> Optional[Twist2D]:
        """Return the twist to send at `now` [s]: the page's twist, or STOP once after it, or None."""
        if self._holder is not None and now - self._heard_at >= EXPIRY:
            self.release(self._holder)
        if self._holder is not None:
            return self._twist
        if self._has_to_stop:
            self._has_to_stop = False
            return STOP
        return None


class Teleop:
    """Commands on kb_teleop/cmd_vel and e_stop."""

    def __init__(self, simulator: str) -> None:
        """Start the thread; the node `simulator` latches its emergency stop on its topic `locked`."""
        # function that is called when a page presses the emergency stop
        self.on_lock: Callable[[], None] = lambda: None
        self.max_linear, self.max_angular = 0.5, 0.8  # [m/s], [rad/s] largest speeds of driving by hand
        self.is_locked = False  # true if any node has switched the emergency stop on
        self._locked_at = -inf  # [s] wall time at which the emergency stop was switched on the last time
        # value that this node sends to each new subscriber of e_stop; None if it sends no value, because none
        # has come yet, or because another node has released the emergency stop
        self.latched: Optional[bool] = None
        self._hold = HoldToDrive()  # decides which page drives
        # lock of `_hold`, because messages of the pages come in another thread than the one that publishes
        self._turn = threading.Lock()
        self._wake = threading.Event()  # set if there may be a command, so that the thread wakes up at once
        self._velocity = rospy.Publisher("kb_teleop/cmd_vel", Twist, queue_size=1)
        self._e_stop = rospy.Publisher(
            "e_stop", Bool, queue_size=1, subscriber_listener=_TellNewSubscribers(self)
        )
        # The page learns the state of the emergency stop from two topics. On `locked`, a simulator also tells
        # it to pages that start later. A robot with a twist_mux has no such topic, so `e_stop` is read, too.
        rospy.Subscriber("e_stop", Bool, self._on_e_stop, queue_size=1)
        rospy.Subscriber(f"{simulator}/locked", Bool, self._on_locked, queue_size=1)
        threading.Thread(target=self._run, name="teleop", daemon=True).start()

    def on_message(self, page: int, message: Dict[str, Any]) -> None:
        """Take a page's message: {"linear": -1..1, "angular": -1..1} or {"e_stop": bool}."""
        if message.get("e_stop") is True:
            self._switch(True)
            self.on_lock()
        elif message.get("e_stop") is False and time.monotonic() - self._locked_at >= RELEASE_AFTER:
            self._switch(False)
        linear, angular = clamp_axis(message.get("linear")), clamp_axis(message.get("angular"))
        if linear is not None and angular is not None:
            twist = Twist2D(linear * self.max_linear, angular * self.max_angular)
            with self._turn:
                self._hold.hold(page, twist, time.monotonic())
            self._wake.set()

    def on_leave(self, page: int) -> None:
        """Release control of a closed page."""
        with self._turn:
            self._hold.release(page)
        self._wake.set()

    @property
    def is_held(self) -> bool:
        """Return whether a page drives."""
        return self._hold.is_active

    @property
    def has_listener(self) -> bool:
        """Return whether a node subscribes to the emergency stop that may obey it."""
        names = {link.endpoint_id for link in self._e_stop.impl.connections} - {rospy.get_name()}
        return not all(map(WATCHERS.match, names))

    def _switch(self, on: bool) -> None:
        """Switch the emergency stop on or off."""
        self._keep(on)
        self.latched = on
        publish(self._e_stop, Bool(on))

    def _keep(self, is_locked: bool) -> None:
        """Keep the state of the emergency stop, and the time at which it was switched on."""
        if is_locked and not self.is_locked:
            self._locked_at = time.monotonic()
        self.is_locked = is_locked

    def _on_e_stop(self, msg: Bool) -> None:
        """Keep a value that a node has sent on e_stop; this node receives its own values, too."""
        if msg._connection_header["callerid"] != rospy.get_name():
            # this node repeats a stop of another node to new subscribers, but it must not repeat a release
            self.latched = True if msg.data else None
        self._keep(msg.data)

    def _on_locked(self, msg: Bool) -> None:
        """Keep whether the emergency stop is on."""
        self._keep(msg.data)

    def _run(self) -> None:
        """Publish the commands of the page that drives, every PERIOD, and sleep while none drives."""
        while not rospy.is_shutdown():
            with self._turn:
                # None while no page drives. When the last page stops driving, `command` returns STOP once,
                # and `is_active` is false from this STOP on.
                twist = self._hold.command(time.monotonic())
                is_active = self._hold.is_active
                if not is_active:
                    # a command that comes after this block sets the event again, so it is not missed
                    self._wake.clear()
            if twist is not None:
                with contained("driving by hand"):
                    publish(self._velocity, conversions.twist_to_msg(twist))
            if is_active:
                time.sleep(PERIOD)
            else:
                self._wake.wait(1.0)  # [s] longest wait, so that this thread notices the end of the node


class _TellNewSubscribers(rospy.SubscribeListener):
    """Tells the state of the emergency stop to each node that subscribes to e_stop.

    A latched publisher of rospy is not enough. It repeats the last value that this node has sent, even if
    another node has sent a newer value.
    """

    def __init__(self, teleop: Teleop) -> None:
        super().__init__()
        self._teleop = teleop

    def peer_subscribe(self, _topic: str, _publish: Any, publish_to_peer: Callable[[Bool], None]) -> None:
        """Answer the subscription of a node; rospy calls this in the thread of the connection."""
        value = self._teleop.latched  # another thread may change it
        if value is not None:
            publish_to_peer(Bool(value))
