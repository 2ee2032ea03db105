"""Sends what is driven by hand, and the emergency stop, from a thread that nothing else delays."""

from __future__ import annotations

import threading
import time
from typing import Any, Callable, Dict

import rospy
from geometry_msgs.msg import Twist
from std_msgs.msg import Bool

from husky_highlevel_controller.datatypes import Twist2D
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.node import publish
from husky_highlevel_controller.ros.web.hold_to_drive import HoldToDrive, clamp_axis

PERIOD = 0.05  # [s] between two commands; twist_mux drops a source after 0.5 s, the wheels stop after 0.25 s


class Teleop:
    """Commands on kb_teleop/cmd_vel and e_stop."""

    def __init__(self) -> None:
        self.on_lock: Callable[[], None] = lambda: None  # called when a page presses the emergency stop
        self.max_linear, self.max_angular = 0.5, 0.8  # [m/s], [rad/s], of a key that is held
        self.is_locked = False  # by e_stop, from any sender
        self._hold = HoldToDrive()
        self._turn = threading.Lock()
        self._wake = threading.Event()
        self._velocity = rospy.Publisher("kb_teleop/cmd_vel", Twist, queue_size=1)
        self._e_stop = rospy.Publisher("e_stop", Bool, queue_size=1, latch=True)
        rospy.Subscriber("e_stop", Bool, self._on_e_stop, queue_size=1)
        threading.Thread(target=self._run, name="teleop", daemon=True).start()

    def on_message(self, page: int, message: Dict[str, Any]) -> None:
        """Take a page's message: {"linear": -1..1, "angular": -1..1} or {"e_stop": bool}."""
        if isinstance(message.get("e_stop"), bool):
            self.lock(message["e_stop"])
            if message["e_stop"]:
                self.on_lock()
        linear, angular = clamp_axis(message.get("linear")), clamp_axis(message.get("angular"))
        if linear is not None and angular is not None:
            twist = Twist2D(linear * self.max_linear, angular * self.max_angular)
            with self._turn:
                self._hold.hold(page, twist, time.monotonic())
            self._wake.set()

    def on_leave(self, page: int) -> None:
        """A page is gone."""
        with self._turn:
            self._hold.release(page)
        self._wake.set()

    def lock(self, locked: bool) -> None:
        """Stop the robot and refuse its commands, or let it go."""
        self.is_locked = locked
        publish(self._e_stop, Bool(locked))

    def _on_e_stop(self, msg: Bool) -> None:
        self.is_locked = msg.data

    def _run(self) -> None:
        while not rospy.is_shutdown():
            with self._turn:
                twist = self._hold.command(time.monotonic())
                is_active = self._hold.is_active
                if not is_active:
                    self._wake.clear()
            if twist is not None:
                publish(self._velocity, conversions.twist_to_msg(twist))
            if is_active:
                time.sleep(PERIOD)
            else:
                self._wake.wait(1.0)
