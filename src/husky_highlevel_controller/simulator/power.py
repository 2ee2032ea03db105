"""Power model of a driving Husky: motor currents, battery, temperatures.

In: the torque on each side's wheels, the time. Out: a `PowerState`.

Measured currents of both motors together, at about 24 V (BorealTC):

    straight on, hard ground: 3.9 A at 0.3 m/s, 3.8 A at 1.0 m/s
    straight on, at any speed: 7.5 A on loam, 10 A on snow
    turning in place: 18 A on flooring, 23 A on loam

So the motor of each side draws a constant current for rolling, and a current in proportion to its torque. The
torque is large in a turn, because it drags the wheels sideways over the ground. `torque_per_ampere` is fitted
to the 18 A on hard ground; with it, the model is within 10 % of the 23 A on loam.

The battery has the data sheet's 480 Wh (two sealed 12 V lead-acid batteries of 20 Ah). Its voltages and
resistance, the electronics' current and all temperatures are plausible values, which were not measured.
The temperatures of drivers and motors rise in proportion to the square of the current.

The model replaces the battery and the motors of a real Husky, whose values husky_base 0.6.10 (Noetic,
repository husky_robot) reports in husky_msgs/HuskyStatus. No test runs the original, which needs a robot.
`test_robot_profile.py` compares the currents with the measured ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

from husky_highlevel_controller.config import number
from husky_highlevel_controller.datatypes import PowerState

STANDING_SPEED = 0.005  # [m/s] wheels that are slower than this draw no current
# [V] voltage without load of two lead-acid batteries with six cells each
FULL_VOLTAGE, EMPTY_VOLTAGE = 25.6, 23.0
RESISTANCE = 0.04  # [Ohm] resistance of the battery and its wires
ELECTRONICS_CURRENT = 1.5  # [A] current of the controller and of connected devices
AMBIENT_TEMPERATURE = 20.0  # [deg C]
HEATING_TIME = 600.0  # [s] time constant with which motor drivers and motors become warm
# [K/A^2] difference from AMBIENT_TEMPERATURE after a long time, divided by the squared current of the motor
DRIVER_HEAT, MOTOR_HEAT = 0.06, 0.15


@dataclass(frozen=True)
class PowerConfig:
    """The battery and the motors."""

    torque_per_ampere: float = number(
        0.1, 100.0, "torque of the two wheels of one side per ampere [N m/A]", default=4.4
    )
    capacity: float = number(1.0, 1e4, "capacity of the battery [Wh]", default=480.0)
    charge: float = number(0.0, 1.0, "charge at the start, from 0 to 1 (full)", default=1.0)


class Power:
    """A battery that two motors drain."""

    def __init__(self, config: PowerConfig, rolling_current: float) -> None:
        """`rolling_current`: current of both sides together when the robot drives straight on [A]."""
        self._config = config
        self._rolling_current = rolling_current / 2.0  # [A] current of one side
        self.reset()

    def reset(self) -> None:
        """Charge the battery as the config says, and let everything be cold."""
        self._uptime, self._charge = 0.0, self._config.charge
        # [A^2] squared currents of the (left, right) motor after a low-pass filter; the temperatures of motor
        # and driver rise in proportion to them
        self._squared_currents = (0.0, 0.0)

    def update(
        self, torques: Tuple[float, float], speeds: Tuple[float, float], duration: float
    ) -> PowerState:
        """Advance the battery and the temperatures, and return the power of this moment.

        Args:
            torques: torques with which the (left, right) wheels push the ground, forward positive [N m].
            speeds: speeds of the treads of the (left, right) wheels, forward positive [m/s].
            duration: time since the last call [s].
        """
        left_torque, right_torque = torques
        left_speed, right_speed = speeds
        left_current = self._current(left_torque, left_speed)
        right_current = self._current(right_torque, right_speed)
        current = left_current + right_current + ELECTRONICS_CURRENT  # [A]
        # [V] the voltage is lower if less charge is left, and if current flows through the resistance
        open_circuit_voltage = EMPTY_VOLTAGE + (FULL_VOLTAGE - EMPTY_VOLTAGE) * self._charge
        voltage = open_circuit_voltage - RESISTANCE * current
        energy = voltage * current * duration / 3600.0  # [Wh]
        self._charge = max(self._charge - energy / self._config.capacity, 0.0)
        self._uptime += duration
        # low-pass filter of the squared currents, because drivers and motors become warm slowly
        fraction = min(duration / HEATING_TIME, 1.0)
        left_square, right_square = self._squared_currents
        left_square += fraction * (left_current * left_current - left_square)
        right_square += fraction * (right_current * right_current - right_square)
        self._squared_currents = left_square, right_square
        return PowerState(
            uptime=self._uptime,
            currents=(left_current, right_current),
            electronics_current=ELECTRONICS_CURRENT,
            voltage=voltage,
            charge=self._charge,
            capacity=self._config.capacity,
            driver_temperatures=(
                AMBIENT_TEMPERATURE + DRIVER_HEAT * left_square,
                AMBIENT_TEMPERATURE + DRIVER_HEAT * right_square,
            ),
            motor_temperatures=(
                AMBIENT_TEMPERATURE + MOTOR_HEAT * left_square,
                AMBIENT_TEMPERATURE + MOTOR_HEAT * right_square,
            ),
        )

    def _current(self, torque: float, speed: float) -> float:
        """Return the current of one side [A]; 0 if the side stands, or if the ground drives its wheels."""
        if abs(speed) < STANDING_SPEED:
            return 0.0
        # positive if the motor drives the wheels, negative if the motor brakes them
        driving_torque = torque if speed > 0.0 else -torque
        return max(self._rolling_current + driving_torque / self._config.torque_per_ampere, 0.0)
