"""Collision detection by IMU: a loss of speed that neither wheels nor rough ground explain.

In: IMU samples and wheel speeds. Out: the speed lost in a collision.

The change of velocity over a window counts, not the peak of a sample: on a real A200 single samples of
8 m/s^2 (flooring) to 90 m/s^2 (snow) are vibration, and hardly change the velocity. What counts is

    loss = speed lost in the direction of travel - speed that the wheels lost meanwhile

against `max_loss` on smooth ground, `max_loss_rough` where the robot shakes, and there `vibration_factor`
times the shaking of the other two axes on top. Sideways it is the velocity gained beyond speed times yaw
rate, with twice as much for rough ground.

The direction of gravity is tracked from gyro and accelerometer, so neither the orientation in the messages
nor a level mount is needed.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import hypot, inf, isfinite, sqrt
from typing import Deque, List, NamedTuple, Optional, Tuple

from husky_highlevel_controller.datatypes import ImuSample, Quaternion, Twist2D, Vector3
from husky_highlevel_controller.geometry import cross as _cross
from husky_highlevel_controller.geometry import dot as _dot
from husky_highlevel_controller.geometry import minus as _minus
from husky_highlevel_controller.geometry import quat_inverse, rotate
from husky_highlevel_controller.geometry import unit as _unit

GRAVITY = 9.8  # [m/s^2]
LEVELLING_TIME = 1.0  # [s], time constant with which the accelerometer corrects the gyro's gravity
MEMORY = 1.0  # [s], over which the ground's vibration is averaged
LEARNING_TIME = 0.4  # [s] of samples before the ground is known well enough to judge
LONGEST_PERIOD = 0.2  # [s], a longer gap between samples is a new beginning
SHOCK = 6.0  # [m/s^2], samples above count only as far as they exceed what the vertical axis shows
ROUGH = 0.013  # [m/s], vibration of a window that is rough ground; an A200 standing: 0.005, on flooring: 0.03
SIDEWAYS = 2.0  # times as rough as ahead, for the body rolls on its tyres
WHEEL_SHARE = 0.8  # of the change that the wheels report within a window
STANDING = 0.02  # [m/s], slower wheels have no direction of travel


@dataclass(frozen=True)
class CrashConfig:
    """Limits of a crash."""

    max_loss: float = field(
        default=0.12,
        metadata={"min": 0.01, "max": 5.0, "help": "loss of speed on smooth ground that is no crash [m/s]"},
    )
    window: float = field(
        default=0.1,
        metadata={"min": 0.02, "max": 0.5, "help": "time within which the speed is lost [s]"},
    )
    max_loss_rough: float = field(
        default=0.25,
        metadata={"min": 0.01, "max": 5.0, "help": "the same on ground that shakes the robot [m/s]"},
    )
    vibration_factor: float = field(
        default=1.0,
        metadata={"min": 0.0, "max": 20.0, "help": "times the vibration of a window, added on rough ground"},
    )
    odometry_delay: float = field(
        default=0.1,
        metadata={"min": 0.0, "max": 0.5, "help": "by which odometry may be late or early [s]"},
    )


class _Push(NamedTuple):
    """Sample without gravity, along the ground in the directions of base_link, and upwards."""

    stamp: float  # [s]
    ahead: float  # [m/s], change of velocity since the last sample
    left: float  # [m/s], less that of the curve
    up: float  # [m/s]


class CrashDetector:
    """Feed it wheel speeds and IMU samples as they come."""

    def __init__(self, config: CrashConfig) -> None:
        self._config = config
        self._wheels: Deque[Tuple[float, float]] = deque()  # stamp [s], speed [m/s]
        self.reset()

    def reset(self) -> None:
        """Forget the samples, as after a jump of time."""
        self._up: Optional[Vector3] = None  # unit vector in the IMU's frame
        self._levelling = 0.0  # [s], time constant of `_up`, which is a mean at first
        self._stamp = -inf  # [s]
        self._period, self._same_stamp = 0.0, 1  # [s] before, and number of samples of the last stamp
        self._pushes: Deque[_Push] = deque()
        self._ground: Deque[Tuple[float, float]] = deque()  # stamp [s]; squared sideways and vertical change
        self._allowances: Deque[Tuple[float, float]] = deque()  # stamp [s], allowance [m/s]
        self._wheels.clear()

    def add_odometry(self, stamp: float, twist_in_base: Twist2D) -> None:
        """Take the speed that the wheels measure at a time [s]."""
        if not isfinite(twist_in_base.linear):
            return
        if self._wheels and stamp <= self._wheels[-1][0]:
            if stamp == self._wheels[-1][0]:
                return
            self._wheels.clear()
        self._wheels.append((stamp, twist_in_base.linear))
        while stamp - self._wheels[0][0] > MEMORY:
            self._wheels.popleft()

    def add_sample(
        self, sample: ImuSample, imu_in_base: Quaternion = (0.0, 0.0, 0.0, 1.0)
    ) -> Optional[float]:
        """Take one IMU sample, and judge the window that ended `odometry_delay` before it.

        Args:
            sample: at any rate of 20 Hz or more.
            imu_in_base: how the IMU is mounted; roll and pitch need not be right.

        Returns:
            The unexplained change of velocity of a crash [m/s]; None if there is none.
        """
        if not all(map(isfinite, (*sample.specific_force, *sample.angular_velocity))):
            return None
        duration = sample.stamp - self._stamp
        if self._up is None or abs(duration) > LONGEST_PERIOD:
            self.reset()
            self._stamp, self._up = sample.stamp, _unit(sample.specific_force)
            return None
        if duration <= 0.0:  # stamped by a clock slower than the IMU, or late
            if duration == 0.0 and self._pushes:
                self._average_into_last(sample, imu_in_base)
            return None
        self._stamp, self._period, self._same_stamp = sample.stamp, duration, 1
        self._levelling = min(self._levelling + duration, LEVELLING_TIME)
        self._up = _levelled(self._up, sample, duration, duration / self._levelling)
        self._pushes.append(self._push(sample, duration, imu_in_base))
        return self._judge()

    def _average_into_last(self, sample: ImuSample, imu_in_base: Quaternion) -> None:
        """Make the last velocity change the mean over all samples of its stamp."""
        self._same_stamp += 1
        last, push = self._pushes.pop(), self._push(sample, self._period, imu_in_base)
        share = 1.0 / self._same_stamp
        self._pushes.append(
            _Push(last.stamp, *(old + share * (new - old) for old, new in zip(last[1:], push[1:])))
        )

    def _push(self, sample: ImuSample, duration: float, imu_in_base: Quaternion) -> _Push:
        assert self._up is not None
        up, force = self._up, sample.specific_force
        ahead = rotate(quat_inverse(imu_in_base), (1.0, 0.0, 0.0))
        ahead = _unit(_minus(ahead, up, _dot(ahead, up))) or (1.0, 0.0, 0.0)
        left = _cross(up, ahead)
        vertical = _dot(force, up) - GRAVITY
        speed = self._speed_at(sample.stamp)
        curve = speed * _dot(sample.angular_velocity, up) if speed is not None else 0.0
        along, across = _damped(_dot(force, ahead), vertical), _dot(force, left)
        return _Push(
            sample.stamp,
            along * duration,
            (_clamped(across, SIDEWAYS * SHOCK) - curve) * duration,
            _clamped(vertical, SHOCK) * duration,
        )

    def _judge(self) -> Optional[float]:
        """Judge the window that ended `odometry_delay` ago."""
        config, now = self._config, self._stamp
        end = now - config.odometry_delay
        start = end - config.window
        while self._pushes and self._pushes[0].stamp <= start + 1e-6:
            self._pushes.popleft()
        window = [push for push in self._pushes if push.stamp <= end + 1e-6]
        if not window:
            return None
        ahead, left, up = (sum(push[axis] for push in window) for axis in (1, 2, 3))
        allowance = self._allowance(end, left * left + up * up)
        self._allowances.append((end, allowance))
        while self._allowances[0][0] < start - config.window:
            self._allowances.popleft()
        # sideways by what the ground did before: a push from the side must not pass for rough ground itself
        sideways = abs(left) - SIDEWAYS * self._allowances[0][1]
        excess = max(sideways, *(loss - allowance for loss in self._losses(ahead, start)))
        if excess <= config.max_loss or end - self._ground[0][0] < LEARNING_TIME:
            return None
        return hypot(ahead, left)

    def _allowance(self, stamp: float, ground: float) -> float:
        """Loss of speed [m/s] that the ground may cause, by its sideways and vertical shaking."""
        config = self._config
        self._ground.append((stamp, ground))
        while stamp - self._ground[0][0] > MEMORY:
            self._ground.popleft()
        vibration = sqrt(sum(square for _, square in self._ground) / len(self._ground))
        rough = min(vibration / ROUGH, 1.0) * max(config.max_loss_rough - config.max_loss, 0.0)
        return rough + config.vibration_factor * vibration

    def _losses(self, ahead: float, start: float) -> List[float]:
        """Speed lost beyond what the wheels say [m/s], for each direction in which the robot may travel."""
        speed = self._speed_at(start)
        drop, rise = self._wheel_changes(start)
        losses = []
        if speed is None or speed > -STANDING:
            losses.append(-ahead - drop)
        if speed is None or speed < STANDING:
            losses.append(ahead - rise)
        return losses

    def _wheel_changes(self, start: float) -> Tuple[float, float]:
        """Largest loss and gain of the wheels' speed within a window a bit early or late [m/s]."""
        config = self._config
        changes = [0.0]
        for shift in (-1.0, -0.5, 0.0, 0.5, 1.0):
            begin = start + shift * config.odometry_delay
            before, after = self._speed_at(begin), self._speed_at(begin + config.window)
            if before is not None and after is not None:
                changes.append(after - before)
        return -WHEEL_SHARE * min(changes), WHEEL_SHARE * max(changes)

    def _speed_at(self, stamp: float) -> Optional[float]:
        """The wheels' speed at a time, by linear interpolation [m/s]; None if unknown."""
        later: Optional[Tuple[float, float]] = None
        for at, speed in reversed(self._wheels):
            if at <= stamp:
                if later is None:
                    return speed if stamp - at <= LONGEST_PERIOD else None
                return speed + (later[1] - speed) * (stamp - at) / (later[0] - at)
            later = at, speed
        return later[1] if later is not None else None


def _levelled(up: Vector3, sample: ImuSample, duration: float, share: float) -> Vector3:
    """The vertical in the IMU's frame one sample later: turned by the gyro, drawn to the force."""
    turned = _minus(up, _cross(sample.angular_velocity, up), duration)
    x, y, z = (1.0 - share) * turned[0], (1.0 - share) * turned[1], (1.0 - share) * turned[2]
    fx, fy, fz = sample.specific_force
    scale = share / GRAVITY
    return _unit((x + scale * fx, y + scale * fy, z + scale * fz)) or up


def _damped(force: float, vertical: float) -> float:
    """A horizontal force [m/s^2] without the part above SHOCK that a shock from below explains."""
    size = abs(force)
    if size <= SHOCK:
        return force
    size = SHOCK + max(size - SHOCK - abs(vertical), 0.0)
    return size if force > 0.0 else -size


def _clamped(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
