"""/status and /diagnostics of a real Husky's base, once per simulated second.

Stands in for husky_base 0.6.10 (Noetic, repository husky_robot). Names, thresholds and levels of the four
diagnostics are the original's. No test runs the original, because it needs the base's board.
`test_robot_launch_drives.py` reads the messages of this module.
"""

from __future__ import annotations

from typing import Any, List, Optional, Sequence, Tuple

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from husky_highlevel_controller.datatypes import PowerState
from husky_highlevel_controller.msg import HuskyStatus
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.simulator.publishers import publish_if_subscribed

PERIOD = 1.0  # [s] simulated time between two messages on /status and on /diagnostics
HARDWARE = "husky_base"
# each pair has the limit for a warning and the limit for an error
LOW_VOLTAGE, HIGH_VOLTAGE = (19.0, 18.0), (29.0, 30.0)  # [V]
DRIVER_TEMPERATURE, MOTOR_TEMPERATURE = (50.0, 60.0), (65.0, 80.0)  # [deg C]
LOW_CHARGE = (0.3, 0.2)  # fractions of a full battery
SAFETY_FIELDS = ("timeout", "lockout", "e_stop", "ros_pause", "no_battery", "current_limit")

Level = Tuple[int, str]  # level of a diagnostic, and the sentence for it
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class BaseStatus:
    """Publishes the state of the simulated base, once per simulated second."""

    def __init__(self, control_rate: float) -> None:
        """Advertise the topics; `control_rate` is the rate of the base's control loop [Hz]."""
        self._control_rate = control_rate
        self._status = rospy.Publisher("status", HuskyStatus, queue_size=10)
        self._diagnostics = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=10)
        self._published_at: Optional[float] = None  # [s] stamp of the last messages

    def update(self, power: PowerState, e_stop: bool, stamp: float) -> None:
        """Publish status and diagnostics if they are due at `stamp` [s]. Call it several times a second."""
        # slightly less than PERIOD, because of rounding errors
        if self._published_at is not None and stamp - self._published_at < PERIOD - 1e-6:
            return
        self._published_at = stamp
        status = status_to_msg(power, self._control_rate, e_stop, stamp)
        publish_if_subscribed(self._status, lambda: status)
        publish_if_subscribed(self._diagnostics, diagnostics_of, status)


def status_to_msg(power: PowerState, control_rate: float, e_stop: bool, stamp: float) -> HuskyStatus:
    """Return the state of the base at `stamp` [s] as a message; except `e_stop`, all its faults are false."""
    left, right = 0, 1  # index of the left side, and of the right side, in each pair of `power`
    return HuskyStatus(
        header=conversions.header(stamp, ""),
        uptime=round(1000.0 * power.uptime),  # [ms]
        ros_control_loop_freq=control_rate,
        mcu_and_user_port_current=power.electronics_current,
        left_driver_current=power.currents[left],
        right_driver_current=power.currents[right],
        battery_voltage=power.voltage,
        left_driver_voltage=power.voltage,
        right_driver_voltage=power.voltage,
        left_driver_temp=power.driver_temperatures[left],
        right_driver_temp=power.driver_temperatures[right],
        left_motor_temp=power.motor_temperatures[left],
        right_motor_temp=power.motor_temperatures[right],
        capacity_estimate=round(power.capacity),
        charge_estimate=power.charge,
        e_stop=e_stop,
    )


def diagnostics_of(status: HuskyStatus) -> DiagnosticArray:
    """Return the four diagnostics of husky_base: system, power, safety and software."""
    charge_level = _level_if_low(status.charge_estimate, LOW_CHARGE)
    array = DiagnosticArray(header=status.header)
    # `_fields` chooses the fields of the status by the last word of their names
    array.status = [
        _diagnostic("system_status", _system_level(status), _fields(status, "voltage", "current", "temp")),
        _diagnostic(
            "power_status",
            (charge_level, "low charge" if charge_level > OK else "power OK"),
            _fields(status, "estimate"),  # capacity and charge
        ),
        _diagnostic(
            "safety_status",
            (ERROR, "emergency stop") if status.e_stop else (OK, "safety OK"),
            [(name, getattr(status, name)) for name in SAFETY_FIELDS],
        ),
        _diagnostic("software_status", (OK, "software OK"), _fields(status, "freq")),
    ]
    return array


def _system_level(status: HuskyStatus) -> Level:
    """Return the level and the sentence of the worst problem of voltages and temperatures."""
    driver = max(status.left_driver_temp, status.right_driver_temp)
    motor = max(status.left_motor_temp, status.right_motor_temp)
    levels = [
        (_level_if_low(status.battery_voltage, LOW_VOLTAGE), "battery voltage too low"),
        (_level_if_high(status.battery_voltage, HIGH_VOLTAGE), "battery voltage too high"),
        (_level_if_high(driver, DRIVER_TEMPERATURE), "motor drivers too hot"),
        (_level_if_high(motor, MOTOR_TEMPERATURE), "motors too hot"),
    ]
    worst_level, sentence = max(levels, key=lambda level: level[0])
    return (worst_level, sentence) if worst_level > OK else (OK, "system OK")


def _level_if_high(value: float, limits: Sequence[float]) -> int:
    """Return the level of a value that should be small; `limits` are those for a warning and for an error."""
    # the number of exceeded limits is the level: 0 is OK, 1 is WARN, 2 is ERROR
    return sum(value > limit for limit in limits)


def _level_if_low(value: float, limits: Sequence[float]) -> int:
    """Return the level of a value that should be large; `limits` are those for a warning and for an error."""
    return sum(value < limit for limit in limits)


def _fields(status: HuskyStatus, *kinds: str) -> List[Tuple[str, Any]]:
    """Return names and values of the fields whose last word is one of `kinds`, such as left_motor_temp."""
    names = [name for name in status.__slots__ if name.rsplit("_", 1)[-1] in kinds]
    return [(name, getattr(status, name)) for name in names]


def _diagnostic(name: str, level: Level, values: Sequence[Tuple[str, Any]]) -> DiagnosticStatus:
    """Return a diagnostic of the base: its name, its level with a sentence, and its values by name."""
    pairs = [KeyValue(key.replace("_", " "), str(value)) for key, value in values]
    return DiagnosticStatus(level[0], f"{HARDWARE}: {name}", level[1], HARDWARE, pairs)
