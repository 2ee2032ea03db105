"""Collision detection by IMU: a loss of speed that neither wheels nor rough ground explain.

In: IMU samples and wheel speeds. Out: the speed lost in a collision.

The change of velocity counts, not the peak of a sample, because on a real A200 single samples of 8 m/s^2
(flooring) to 90 m/s^2 (snow) are vibration. Vibration swings back within 0.1 to 0.2 s, but the speed that a
collision takes stays lost. So the detector computes

    change = mean velocity after the collision - mean velocity before the collision
    loss = speed that this change takes from the robot - speed that the wheels lose in the same time

and compares the loss with a limit. The change that ends at the time `end` has three parts:

         BEFORE         window        AFTER
    |--------------|--------------|-----------|
     mean velocity    collision     mean      end
     before                         velocity
                                    after

The *age* of a sample is the time from the sample to `end`.

Without vibration the limit is `max_loss`. Vibration sideways and upwards raises the limit in two ways. The
limit grows from `max_loss` to `max_loss_rough`, which it reaches at ROUGH_VIBRATION. On every ground,
`vibration_factor` times the vibration is added. A push from the side is a crash, too. Its size is the
sideways velocity that the robot gains within `window` and then keeps, without the part that driving a curve
causes. For a push, vibration raises the limit twice as much.

The direction of gravity is tracked from gyro and accelerometer, so neither the orientation in the messages
nor a level mount is needed.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import islice
from math import copysign, hypot, inf, isfinite, sqrt
from typing import Deque, List, NamedTuple, Optional, Tuple

import numpy as np

from husky_highlevel_controller.config import number
from husky_highlevel_controller.datatypes import ImuSample, Quaternion, Twist2D, Vector3
from husky_highlevel_controller.geometry import cross, dot, minus, quat_inverse, rotate, unit

GRAVITY = 9.8  # [m/s^2]
# [s] time constant with which the accelerometer corrects the direction of gravity; the gyro turns this
# direction between the corrections
LEVELLING_TIME = 2.0
# [m/s^2] the accelerometer corrects the direction of gravity less if the measured force differs from gravity
# by more than this, because such a force is a shock
LEVELLING_FORCE = 20.0
# [s] Odometry may come this much later than IMU samples. So with each IMU sample, the detector judges a
# change of velocity that ended this long before the sample.
LATENESS = 0.05
AFTER = 0.15  # [s] time after the collision over which the velocity is averaged
BEFORE = 0.4  # [s] time before the collision over which the velocity is averaged
MEMORY = 1.0  # [s] time over which the ground's vibration is averaged
# [s] No crash is detected until the direction of gravity is known. It is known when the durations of the
# samples that have corrected it add up to this time, on smooth ground and on rough ground.
LEARNING_TIME, LEARNING_ROUGH = 0.7, 1.1
# [s] The detector starts again after a longer gap between two IMU samples. If the last message of odometry is
# older than this, the speed of the wheels is unknown.
LONGEST_PERIOD = 0.2
PATIENCE = 2.0  # [s] IMU samples are evaluated without odometry if no odometry has come for this time
LONGEST_WAIT = 2.5  # [s] an IMU sample that has waited this long for its odometry is evaluated without it
LONGEST_DELAY = 10.0  # [s] wheel speeds are kept this long for IMU samples that come later than odometry
# [m/s^2] A shock from below also causes horizontal force. So if the force ahead is larger than SHOCK_FORCE,
# its part above SHOCK_FORCE is reduced by the size of the vertical force. The vertical force itself counts
# only up to SHOCK_FORCE, and the sideways force only up to SIDEWAYS_FACTOR * SHOCK_FORCE.
SHOCK_FORCE = 6.0
# [m/s] The roughness of the ground, 0 to 1, is its measured vibration divided by this vibration. Ground with
# a stronger vibration has the roughness 1, too. A real Husky A200 measures 0.005 at rest, and 0.03 while it
# drives on flooring.
ROUGH_VIBRATION = 0.013
# vibration of the ground may change the sideways velocity this many times more than the forward velocity,
# because the body rolls on its tyres
SIDEWAYS_FACTOR = 2.0
STANDING_SPEED = 0.02  # [m/s] the direction of travel is unknown if the wheels are slower than this


@dataclass(frozen=True)
class CrashConfig:
    """Limits of a crash."""

    max_loss: float = number(
        0.01, 5.0, "largest loss of speed on smooth ground without a crash [m/s]", default=0.12
    )
    window: float = number(0.02, 0.5, "time within which the speed is lost [s]", default=0.1)
    max_loss_rough: float = number(
        0.01, 5.0, "largest loss of speed on rough ground without a crash [m/s]", default=0.24
    )
    vibration_factor: float = number(
        0.0, 20.0, "factor of the vibration, which is added to the largest loss on every ground", default=1.0
    )
    odometry_delay: float = number(0.0, 0.5, "largest delay or lead of odometry [s]", default=0.1)


class Change(NamedTuple):
    """Change of velocity, and vibration by the ground."""

    # [m/s] speed that the robot has lost in the direction of travel, minus the speed that its wheels have
    # lost
    loss: float
    sideways: float  # [m/s] sideways velocity that the robot has gained in a short time and has kept
    vibration: float  # [m/s] vibration of the ground, averaged until now
    vibration_before: float  # [m/s] vibration of the ground, averaged until the change of velocity began

    def excess(self, config: CrashConfig) -> float:
        """Return the loss or push without the part that rough ground may cause [m/s].

        The larger of the two counts. It is a crash if it is above `max_loss`.
        """
        unexplained_loss = self.loss - self._allowance(self.vibration, config)
        # a push from the side also causes vibration, so only the vibration before the push is subtracted
        unexplained_push = self.sideways - SIDEWAYS_FACTOR * self._allowance(self.vibration_before, config)
        return max(unexplained_loss, unexplained_push)

    def _allowance(self, vibration: float, config: CrashConfig) -> float:
        """Return the change of velocity that the ground may cause in addition to `max_loss` [m/s].

        `vibration` is the vibration of the ground [m/s].
        """
        for_rough_ground = _roughness(vibration) * max(config.max_loss_rough - config.max_loss, 0.0)
        return for_rough_ground + config.vibration_factor * vibration


class _Increment(NamedTuple):
    """Change of velocity since the last sample, without gravity: along the ground, and upwards."""

    stamp: float  # [s]
    ahead: float  # [m/s] change of the forward velocity
    left: float  # [m/s] change of the velocity to the left, without the part that driving a curve causes
    up: float  # [m/s]


class _VelocityChanges(NamedTuple):
    """Changes of velocity by the IMU that end at one time."""

    # [m/s] change of the forward velocity, from its mean over the time BEFORE to its mean over the time AFTER
    ahead: float
    left: float  # [m/s] the same change of the velocity to the left; negative if it is to the right
    # [m/s] velocity to the left that was gained in the time `window`, which lies between BEFORE and AFTER
    pushed_left: float
    # [m^2/s^2] Squared velocity that was gained to the left and upwards in the last `window` seconds. It is
    # measured at every sample, also without a collision. The vibration of the ground is the root of the mean
    # of the values of the last MEMORY seconds.
    squared_swing: float

    @property
    def sideways_push(self) -> float:
        """Return the velocity to one side that the robot gained within `window` and then kept [m/s].

        If the robot gains 0.5 m/s to the left and keeps 0.3 m/s, the push is 0.3 m/s. If the push is to the
        right, both values are negative, so their signs are changed.
        """
        push_to_left = min(self.pushed_left, self.left)
        push_to_right = min(-self.pushed_left, -self.left)
        return max(push_to_left, push_to_right)


class CrashDetector:
    """Detector of crashes; give it wheel speeds and IMU samples as they come."""

    def __init__(self, config: CrashConfig) -> None:
        """Begin without a sample; `config` has the limits of a crash."""
        self._config = config
        self._wheel_speeds: Deque[Tuple[float, float]] = deque()  # stamp [s] and speed [m/s] of the wheels
        # IMU samples that wait for odometry, each with the orientation of the IMU in base_link
        self._waiting_samples: Deque[Tuple[ImuSample, Quaternion]] = deque()
        # [s] stamp of the first IMU sample after the newest odometry; inf until this sample comes
        self._odometry_silent_since = inf
        self.reset()

    def reset(self) -> None:
        """Forget the judged samples, as after a jump of time; later samples are judged without them."""
        # unit vector upwards in the IMU's frame; None before the first sample
        self._vertical: Optional[Vector3] = None
        # [s] Time constant of the filter of `_vertical`. It is the sum of the durations of the samples that
        # have corrected `_vertical`, up to LEVELLING_TIME. While it grows, `_vertical` is the mean of these
        # samples.
        self._levelling_time = 0.0
        self._last_stamp = -inf  # [s] stamp of the last judged sample
        self._period = 0.0  # [s] time between the last two stamps
        self._samples_of_stamp = 1  # number of samples with the last stamp, which are averaged
        # changes of velocity from sample to sample, by the IMU, with ages up to AFTER + window + BEFORE
        self._increments: Deque[_Increment] = deque()
        # stamp [s]; squared velocity that the body gained sideways and upwards in the time `config.window`
        # before this stamp [m^2/s^2]
        self._squared_swings: Deque[Tuple[float, float]] = deque()
        # stamp [s]; vibration of the ground, which is the root of the mean of _squared_swings [m/s]
        self._vibrations: Deque[Tuple[float, float]] = deque()
        # result of the last call of `add_sample`; None if the call evaluated no sample
        self.change: Optional[Change] = None

    def add_odometry(self, stamp: float, twist_in_base: Twist2D) -> None:
        """Store the speed that the wheels measure at a time [s], for the samples of that time.

        Only the forward speed of the twist counts.
        """
        if not isfinite(twist_in_base.linear):
            return  # a speed of NaN or infinity says nothing about the wheels
        if self._wheel_speeds and stamp == self._wheel_speeds[-1][0]:
            return  # the message has come twice
        if self._wheel_speeds and stamp < self._wheel_speeds[-1][0]:  # time goes back
            self._wheel_speeds.clear()
        self._wheel_speeds.append((stamp, twist_in_base.linear))
        self._odometry_silent_since = inf  # the next IMU sample sets this stamp
        self._drop_unneeded_speeds()

    def _drop_unneeded_speeds(self) -> None:
        """Drop the wheel speeds that are too old for all later samples, so that the memory stays small."""
        newest = self._wheel_speeds[-1][0]  # [s] stamp of the newest wheel speed
        # [s] Samples are judged in the order of their stamps, so no later sample is older than the last
        # judged sample. If that sample is newer than `newest`, the newest wheel speed must still stay.
        oldest_sample = min(newest, self._last_stamp)
        # samples that come later than LONGEST_DELAY after their odometry have no wheel speeds
        oldest_sample = max(oldest_sample, newest - LONGEST_DELAY)
        # [s] Time before a sample from which wheel speeds are needed. The change that is judged with the
        # sample ends LATENESS before the sample, and odometry may be shifted by `odometry_delay`.
        needed_age = LATENESS + AFTER + self._config.window + BEFORE + self._config.odometry_delay
        # at least MEMORY is kept, so that a wheel speed before the oldest needed time is usually stored, too
        oldest_kept = oldest_sample - max(needed_age, MEMORY)
        while self._wheel_speeds[0][0] < oldest_kept:
            self._wheel_speeds.popleft()

    @property
    def delay(self) -> float:
        """Time by which the judgement of samples is late [s], because samples wait for their odometry."""
        if not self._waiting_samples:
            return 0.0
        (oldest, _), (newest, _) = self._waiting_samples[0], self._waiting_samples[-1]
        return newest.stamp - oldest.stamp

    def add_sample(
        self, sample: ImuSample, imu_in_base: Quaternion = (0.0, 0.0, 0.0, 1.0)
    ) -> Optional[float]:
        """Take one IMU sample, and judge the waiting samples whose odometry has come.

        On a busy machine a sample arrives before its odometry. Without the odometry, braking would look like
        a crash, so the sample waits.

        Args:
            sample: sample of an IMU with a rate of 20 Hz or more.
            imu_in_base: orientation of the IMU; roll and pitch need not be right.

        Returns:
            The change of velocity in the first crash [m/s], without the part that a curve explains. None if
            there is no crash.
        """
        self.change = None  # `_judge_change` sets it if a sample is judged
        if not all(map(isfinite, (*sample.specific_force, *sample.angular_velocity))):
            return None
        if self._waiting_samples and sample.stamp < self._waiting_samples[-1][0].stamp - LONGEST_PERIOD:
            self._waiting_samples.clear()  # time goes back, and this is not just one sample that comes late
        # no sample waits so long for its odometry, so time has gone back since this odometry
        if self._wheel_speeds and sample.stamp < self._wheel_speeds[0][0] - LONGEST_WAIT:
            self._wheel_speeds.clear()
        self._waiting_samples.append((sample, imu_in_base))
        # inf since the last odometry, unless an earlier sample has replaced it by its own stamp
        self._odometry_silent_since = min(self._odometry_silent_since, sample.stamp)
        # a call returns only one crash, so after a crash the remaining samples wait for the next call
        loss = None
        while (
            loss is None
            and self._waiting_samples
            and self._can_be_judged(self._waiting_samples[0][0].stamp, sample.stamp)
        ):
            loss = self._judge_sample(*self._waiting_samples.popleft())
        return loss

    def _can_be_judged(self, stamp: float, now: float) -> bool:
        """Return whether a waiting sample can be judged now, because it needs no later odometry.

        All the odometry that the sample needs has come, or the sample has waited for too long. If odometry
        has stopped, no sample waits.

        Args:
            stamp: stamp of the sample [s].
            now: stamp of the newest sample [s].
        """
        has_stopped = now - self._odometry_silent_since > PATIENCE
        if has_stopped or now - stamp > LONGEST_WAIT:
            return True
        # up to three stamps of odometry, the newest first, and the periods between them
        newest_stamps = [odometry_stamp for odometry_stamp, _ in islice(reversed(self._wheel_speeds), 3)]
        if not newest_stamps:
            return False  # no odometry has come yet, so the sample waits for it
        periods = [after - before for after, before in zip(newest_stamps, newest_stamps[1:])]
        # a lost message makes a period too long, so the shorter period counts
        period = min(periods, default=0.0)
        # [s] The sample may be newer than the newest odometry by this. Then the change that is judged with it
        # ends before the next odometry, because the change ends LATENESS before the sample, and the next
        # odometry is expected `period` after the newest one.
        largest_lead = period + LATENESS
        return stamp - newest_stamps[0] <= largest_lead

    def _judge_sample(self, sample: ImuSample, imu_in_base: Quaternion) -> Optional[float]:
        """Add a sample to the stored ones; return the change of velocity [m/s] if there was a crash, or None.

        The first sample, or a sample after a gap, starts the detector again and is not judged. The detector
        does not start while odometry is about to begin, because it would take the unknown acceleration of the
        wheels for a part of gravity. A sample with the stamp of the last sample is averaged with the last
        sample. An older sample is dropped.
        """
        duration = sample.stamp - self._last_stamp
        if self._vertical is None or abs(duration) > LONGEST_PERIOD:
            self.reset()
            if self._wheel_acceleration(sample.stamp) is not None:
                self._last_stamp, self._vertical = sample.stamp, unit(sample.specific_force)
            return None
        if duration <= 0.0:
            if duration == 0.0 and self._increments:
                self._average_into_last(sample, imu_in_base)
            return None
        self._last_stamp, self._period, self._samples_of_stamp = sample.stamp, duration, 1
        self._level_vertical(sample, duration, imu_in_base)
        self._increments.append(self._increment(sample, duration, imu_in_base))
        return self._judge_change()

    def _average_into_last(self, sample: ImuSample, imu_in_base: Quaternion) -> None:
        """Make the last velocity increment the mean over all samples with its stamp.

        Several samples have the same stamp if the clock of the stamps is coarse.
        """
        self._samples_of_stamp += 1
        mean, new = self._increments.pop(), self._increment(sample, self._period, imu_in_base)
        # a new value changes the mean of n values by 1/n of its difference from the mean
        share = 1.0 / self._samples_of_stamp
        self._increments.append(
            _Increment(
                mean.stamp,
                ahead=mean.ahead + share * (new.ahead - mean.ahead),
                left=mean.left + share * (new.left - mean.left),
                up=mean.up + share * (new.up - mean.up),
            )
        )

    def _level_vertical(self, sample: ImuSample, duration: float, imu_in_base: Quaternion) -> None:
        """Update `_vertical`, the direction upwards in the IMU's frame, by a sample.

        First, the gyro turns the vertical. Then the accelerometer corrects it slowly, because without driving
        the measured force points upwards. If the acceleration of the wheels is unknown, the accelerometer
        does not correct the vertical. `duration` is the time since the last sample [s], which is above 0.
        """
        assert self._vertical is not None
        # The IMU turns with the rate w, so the vertical in its frame turns by -(w x vertical) * duration.
        # `unit` returns None for a vector without a direction; then the vertical stays as it is.
        turn_rate = cross(sample.angular_velocity, self._vertical)
        self._vertical = unit(minus(self._vertical, turn_rate, duration)) or self._vertical
        wheel_acceleration = self._wheel_acceleration(sample.stamp)
        if wheel_acceleration is None:
            return
        # the direction of gravity is not known well at first and must be corrected quickly, so the time
        # constant begins with the duration of one sample and grows to its final value
        self._levelling_time = min(self._levelling_time + duration, LEVELLING_TIME)
        # [m/s^2] difference from the force that gravity causes along the present vertical
        force = self._force_without_driving(sample, wheel_acceleration, imu_in_base)
        error = minus(force, self._vertical, GRAVITY)
        # a large error is a shock, so the error counts only up to the size LEVELLING_FORCE
        error_size = max(sqrt(dot(error, error)), 1e-6)
        counted_part = min(LEVELLING_FORCE / error_size, 1.0)
        # A low-pass filter corrects the part duration / _levelling_time of the error. The error is divided by
        # GRAVITY, because the error is a force, but the vertical has the length 1.
        pull = counted_part * duration / (self._levelling_time * GRAVITY)
        # subtracting -pull * error adds pull * error, so the vertical turns towards the force
        self._vertical = unit(minus(self._vertical, error, -pull)) or self._vertical

    def _force_without_driving(
        self, sample: ImuSample, wheel_acceleration: float, imu_in_base: Quaternion
    ) -> Vector3:
        """Return the measured force in the IMU's frame, without the accelerations by driving [m/s^2].

        These are the acceleration of the wheels [m/s^2], and the one of the curve. Without a shock, the rest
        is only gravity.
        """
        ahead, left = self._ground_axes(imu_in_base)
        force = minus(sample.specific_force, ahead, wheel_acceleration)
        return minus(force, left, self._curve_acceleration(sample))

    def _ground_axes(self, imu_in_base: Quaternion) -> Tuple[Vector3, Vector3]:
        """Return unit vectors ahead and to the left along the ground, in the IMU's frame."""
        assert self._vertical is not None
        # base_link's x axis, without its part along the vertical; if nothing is left, any direction will do
        ahead = rotate(quat_inverse(imu_in_base), (1.0, 0.0, 0.0))
        ahead = unit(minus(ahead, self._vertical, dot(ahead, self._vertical))) or (1.0, 0.0, 0.0)
        return ahead, cross(self._vertical, ahead)

    def _wheel_acceleration(self, stamp: float) -> Optional[float]:
        """Return the acceleration of the wheels at a time [m/s^2], by the messages before and after it.

        If the next message has not come yet, the last two messages before this time count. The result is None
        if there are no two messages, because odometry is about to begin. The result is 0 if odometry has
        stopped or has never come, because it may never come again.
        """
        if not self._wheel_speeds or stamp - self._wheel_speeds[-1][0] > LONGEST_PERIOD:
            return 0.0
        # pairs of neighbouring messages, the newest pair first
        newest_first = reversed(self._wheel_speeds)
        one_older = islice(reversed(self._wheel_speeds), 1, None)
        for (later, later_speed), (earlier, earlier_speed) in zip(newest_first, one_older):
            if earlier < stamp:
                return (later_speed - earlier_speed) / (later - earlier)
        return None

    def _curve_acceleration(self, sample: ImuSample) -> float:
        """Return the acceleration to the left that driving a curve causes [m/s^2]: speed times yaw rate."""
        assert self._vertical is not None
        speed = self._speed_at(sample.stamp) or 0.0
        yaw_rate = dot(sample.angular_velocity, self._vertical)
        return speed * yaw_rate

    def _increment(self, sample: ImuSample, duration: float, imu_in_base: Quaternion) -> _Increment:
        """Return the change of velocity in the time of a sample: its acceleration times its duration [s].

        Gravity, and the acceleration to the left that driving a curve causes, are not part of the change.
        """
        assert self._vertical is not None
        ahead, left = self._ground_axes(imu_in_base)
        force = sample.specific_force
        force_up = dot(force, self._vertical) - GRAVITY  # `_vertical` points upwards
        # A shock from below comes from the ground and is not a crash, so each force is limited.
        # A large force ahead is reduced by the size of the vertical force at the same time.
        force_ahead = _damped(dot(force, ahead), force_up)
        # the body rolls on its tyres, so a shock causes more force to the left, and the limit is higher
        force_left = _clamped(dot(force, left), SIDEWAYS_FACTOR * SHOCK_FORCE)
        force_left -= self._curve_acceleration(sample)
        force_up = _clamped(force_up, SHOCK_FORCE)
        return _Increment(
            sample.stamp, ahead=force_ahead * duration, left=force_left * duration, up=force_up * duration
        )

    def _judge_change(self) -> Optional[float]:
        """Judge the change of velocity that ended LATENESS ago; return its size [m/s] if it is a crash.

        The change is the mean velocity over the time AFTER, minus the mean velocity over the time BEFORE. The
        time `window` lies between them. `self.change` gets the part of the change that neither wheels nor
        curve explain, and the vibration of the ground. Nothing is judged until the direction of gravity is
        known, which takes LEARNING_TIME on smooth ground and LEARNING_ROUGH on rough ground.
        """
        end = self._last_stamp - LATENESS
        changes = self._velocity_changes(end)
        vibration, vibration_before = self._add_vibration(changes.squared_swing, end)
        # [s] from LEARNING_TIME on smooth ground to LEARNING_ROUGH on rough ground
        learning_time = LEARNING_TIME + _roughness(vibration) * (LEARNING_ROUGH - LEARNING_TIME)
        # [s] sum of the durations of the samples that have corrected the direction of gravity; it stops at
        # LEVELLING_TIME, which is longer than any learning time
        learned_for = self._levelling_time
        if learned_for < learning_time:
            return None
        loss = self._unexplained_loss(changes.ahead, end)
        self.change = Change(loss, changes.sideways_push, vibration, vibration_before)
        is_crash = self.change.excess(self._config) > self._config.max_loss
        return hypot(changes.ahead, changes.left) if is_crash else None

    def _velocity_changes(self, end: float) -> _VelocityChanges:
        """Return the changes of velocity that end at a time [s], and drop the increments before them.

        Each change is a sum over the increments of the samples. The time up to `end` has three parts: first
        BEFORE, then the `window` of a possible collision, and at last AFTER.
        """
        window = self._config.window
        longest = AFTER + window + BEFORE
        while self._increments and self._increments[0].stamp <= end - longest:
            self._increments.popleft()
        # [s] Limits of the age of an increment, which is the time from the increment to `end`. Ages have
        # rounding errors, so each limit is shifted by 1e-6 s. Then an increment exactly at a limit always
        # counts on the same side.
        collision_end, collision_begin = AFTER - 1e-6, AFTER + window - 1e-6
        oldest_swing = window - 1e-6
        ahead = left = pushed_left = swung_left = swung_up = 0.0
        for stamp, ahead_by, left_by, up_by in self._increments:
            age = end - stamp
            if age < -1e-6:
                break  # this increment and all later ones come after `end`
            # the weighted sum is the mean velocity over AFTER, minus the mean velocity over BEFORE
            weight = self._weight(age)
            ahead += weight * ahead_by
            left += weight * left_by
            # velocity that a collision gives to the robot
            if collision_end < age < collision_begin:
                pushed_left += left_by
            # velocity by the present vibration of the ground
            if age < oldest_swing:
                swung_left += left_by
                swung_up += up_by
        squared_swing = swung_left * swung_left + swung_up * swung_up
        return _VelocityChanges(ahead, left, pushed_left, squared_swing)

    def _add_vibration(self, squared_swing: float, end: float) -> Tuple[float, float]:
        """Store a new value for the vibration of the ground, and return the vibration at two times.

        The vibration is the root of the mean of all values of the last MEMORY seconds [m/s].

        Args:
            squared_swing: new value, as in `_VelocityChanges` [m^2/s^2].
            end: time of the value [s].

        Returns:
            The vibration at the time `end`, and the vibration when the time `window` of the collision began,
            because a collision shakes the robot, too.
        """
        self._squared_swings.append((end, squared_swing))
        while end - self._squared_swings[0][0] > MEMORY:
            self._squared_swings.popleft()
        vibration = sqrt(sum(each for _, each in self._squared_swings) / len(self._squared_swings))
        self._vibrations.append((end, vibration))
        # all vibrations before the collision are dropped, so the oldest one is of the time when it began
        collision_begin = end - AFTER - self._config.window
        while self._vibrations[0][0] < collision_begin:
            self._vibrations.popleft()
        _, vibration_before = self._vibrations[0]
        return vibration, vibration_before

    def _weight(self, age: float) -> float:
        """Return the weight, 0 to 1, of a velocity increment in the change between the two mean velocities.

        A change consists of the time BEFORE, then the time `window`, then the time AFTER. The change is the
        mean velocity over AFTER minus the mean velocity over BEFORE. An increment adds to all later
        velocities:

        - within BEFORE, to the second mean and to a part of the first, so the weight rises from 0 to 1
        - within `window`, to the second mean and not to the first, so the weight is 1
        - within AFTER, to a part of the second mean, so the weight falls from 1 to 0

        `age` is the time from the increment to the end of the change [s].
        """
        since_begin = AFTER + self._config.window + BEFORE - age  # [s] time from the beginning of the change
        return max(min(age / AFTER, since_begin / BEFORE, 1.0), 0.0)

    def _unexplained_loss(self, change_ahead: float, end: float) -> float:
        """Return the speed that the robot has lost, minus the speed that its wheels have lost [m/s].

        A robot that brakes loses speed as fast as its wheels, so the result is near 0. In a crash, the result
        is large. The odometry may be shifted in time, so the shift that explains most of the loss counts. If
        the direction of travel is unknown, the larger of the losses in both directions counts.

        Args:
            change_ahead: change of the velocity ahead, by the IMU [m/s].
            end: time at which the change ended [s].
        """
        wheel_changes = self._possible_wheel_changes(end)
        # Forwards, a loss of speed is a negative change. If the robot's velocity changes by -0.5 m/s, and the
        # speed of its wheels by -0.2 m/s, the loss is 0.3 m/s. The most negative change of the wheels
        # explains most of the loss.
        loss_forwards = min(wheel_changes) - change_ahead
        # backwards, all signs are the other way round
        loss_backwards = change_ahead - max(wheel_changes)
        # the change ends with the time AFTER, and the collision is in the time `window` before AFTER
        collision_begin = end - AFTER - self._config.window
        speed_before = self._speed_at(collision_begin)  # the sign shows the direction of travel
        if speed_before is None or abs(speed_before) < STANDING_SPEED:
            return max(loss_forwards, loss_backwards)
        return loss_forwards if speed_before > 0.0 else loss_backwards

    def _possible_wheel_changes(self, end: float) -> List[float]:
        """Return possible changes of the wheels' mean speed from BEFORE to AFTER [m/s].

        `end` is the end of the time AFTER [s]. Odometry may be late or early by up to `odometry_delay`, so a
        change is computed for each of five shifts in time. The result also has the change 0. Otherwise, if
        the wheels became faster and the robot did not, this would count as a loss of the robot's speed.
        """
        wheel_changes = [0.0]
        for shift in (-1.0, -0.5, 0.0, 0.5, 1.0):
            shifted_end, change = end + shift * self._config.odometry_delay, 0.0
            # As for the IMU, a change is a weighted sum of increments. Here an increment is the change of
            # speed from one message to the next. Its age is the age of the middle between the two messages.
            pairs = zip(self._wheel_speeds, islice(self._wheel_speeds, 1, None))
            for (stamp, speed), (next_stamp, next_speed) in pairs:
                if next_speed != speed:
                    age = shifted_end - 0.5 * (stamp + next_stamp)
                    change += (next_speed - speed) * self._weight(age)
            wheel_changes.append(change)
        return wheel_changes

    def _speed_at(self, stamp: float) -> Optional[float]:
        """Return the wheels' speed at a time, by linear interpolation [m/s]; None if it is unknown."""
        if not self._wheel_speeds or stamp - self._wheel_speeds[-1][0] > LONGEST_PERIOD:
            return None  # odometry has stopped, so the wheels may have another speed by now
        # from the last message on, `interp` returns the last speed
        stamps, speeds = zip(*self._wheel_speeds)
        return float(np.interp(stamp, stamps, speeds))


def _roughness(vibration: float) -> float:
    """Return the roughness of ground, 0 to 1, by its vibration [m/s]; 1 from ROUGH_VIBRATION on."""
    return min(vibration / ROUGH_VIBRATION, 1.0)


def _damped(force: float, force_up: float) -> float:
    """Return a horizontal force [m/s^2] without the part that a shock from below explains.

    The part of the force up to SHOCK_FORCE always counts. The rest is reduced by the size of the vertical
    force.
    """
    size = abs(force)
    return copysign(min(size, SHOCK_FORCE) + max(size - SHOCK_FORCE - abs(force_up), 0.0), force)


def _clamped(value: float, limit: float) -> float:
    """Return the value, or the nearer of `limit` and -`limit` if the value is beyond them."""
    return min(max(value, -limit), limit)
