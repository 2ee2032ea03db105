"""Readings of wheel odometry and IMU, and their conversion to planar measurements.

In: poses, velocities and accelerations with their frames. Out: `Measurement`s of base_link on the plane.

Selection of values, rotation by the sensor's mounting, and differential poses follow robot_localization's
ros_filter.cpp.
"""

from __future__ import annotations

from typing import Any, List, NamedTuple, Optional, Tuple

import numpy as np

from husky_highlevel_controller.datatypes import HuskyError, Pose, Quaternion
from husky_highlevel_controller.estimation.filter_config import InputConfig
from husky_highlevel_controller.estimation.planar_ekf import AX, AY, VX, VY, YAW, YAW_RATE, Measurement, X, Y
from husky_highlevel_controller.geometry import (
    compose,
    inverse,
    matrix_from_quat,
    quat_from_rpy,
    quat_inverse,
    rotate,
    rpy_from_quat,
    wrap_angle,
)  # fmt: skip

ON_PLANE = (0, 1, 5)  # indices of x, y and yaw in the list x, y, z, roll, pitch, yaw
# The axes of a sensor may be turned against the axes of the robot. The parameters say which axes of the
# sensor are used. A used axis of the sensor measures an axis of the robot unless the two axes are
# perpendicular. Two axes count as perpendicular if the component of one unit vector along the other is
# smaller than this.
MIN_COMPONENT = 1e-6


class ReadingError(HuskyError):
    """A reading that is not usable."""


class Reading(NamedTuple):
    """A message of odometry or IMU; a part that it lacks is None."""

    stamp: float  # [s]
    # measured pose of the robot; only its orientation counts if the sensor is an IMU
    pose: Optional[Pose] = None
    pose_covariance: np.ndarray = np.zeros((6, 6))
    # (6,) [m/s, rad/s] linear and angular velocity along the sensor's axes
    velocity: Optional[np.ndarray] = None
    velocity_covariance: np.ndarray = np.zeros((6, 6))
    specific_force: Optional[np.ndarray] = None  # (3,) [m/s^2], specific force along the sensor's axes
    force_covariance: np.ndarray = np.zeros((3, 3))


class Mounting(NamedTuple):
    """Poses of a sensor and of the frame in which it gives its poses."""

    sensor_in_base: Pose = Pose()  # pose of the sensor in base_link
    pose_frame_in_odom: Pose = Pose()  # pose in odom of the frame in which the sensor gives its poses


class MotionSensor:
    """Sensor of a topic, which remembers the readings that differential and relative poses need."""

    def __init__(self, name: str, config: InputConfig, gravity: float) -> None:
        """Make a sensor from the name of its parameters, odomN or imuN; gravity in m/s^2."""
        self._config, self._is_imu, self._gravity = config, name.startswith("imu"), gravity
        # mask of x, y, z, roll, pitch, yaw (0 to 5), their velocities (6 to 11) and accelerations (12 to 14)
        used = np.array(config.config, dtype=bool)
        if self._is_imu:
            used[[0, 1, 2, 6, 7, 8]] = False  # an IMU measures no position and no velocity
        else:
            used[12:] = False  # odometry measures no acceleration
        # masks of the used values along and about x, y, z: pose (6,), velocity (6,), acceleration (3,)
        self._pose_used, self._velocity_used, self._force_used = used[:6], used[6:12], used[12:]
        # with the parameter `relative`, all poses are measured from this first pose
        self._first_pose: Optional[Pose] = None
        # stamp [s], pose and covariance of the last reading; with the parameter `differential`, the motion
        # since this reading gives a velocity
        self._last_reading: Optional[Tuple[float, Pose, np.ndarray]] = None

    def forget(self) -> None:
        """Forget all readings."""
        self._first_pose = self._last_reading = None

    def checked(self, reading: Reading) -> Reading:
        """Return the reading with zeros in place of NaN and infinity in unused values.

        Otherwise the rotation by the sensor's mounting would spread NaN from unused to used values.

        Raises:
            ReadingError: a used value is NaN or infinity.
        """
        pose = reading.pose
        pose_used = self._pose_used.copy()
        # subtracting gravity needs the orientation, so the orientation must be finite, too
        if self._config.remove_gravitational_acceleration and self._force_used.any():
            pose_used[3:] = True
        pose_values = None if pose is None else _numbers(pose)
        # for each part of a reading: its name for messages, its values, their covariance, and a mask of the
        # used values
        for part, values, covariance, used in (
            ("pose", pose_values, reading.pose_covariance, pose_used),
            ("velocity", reading.velocity, reading.velocity_covariance, self._velocity_used),
            ("acceleration", reading.specific_force, reading.force_covariance, self._force_used),
        ):
            if values is None:
                continue
            used_numbers = {part: values[used], f"{part}'s covariance": covariance[used][:, used]}
            for name, numbers in used_numbers.items():
                if not np.isfinite(numbers).all():
                    raise ReadingError(f"its {name} is {numbers.tolist()}")
        velocity, force = reading.velocity, reading.specific_force
        return Reading(
            stamp=reading.stamp,
            pose=None if pose is None else Pose(*(tuple(_finite(part)) for part in pose)),
            pose_covariance=_finite(reading.pose_covariance),
            velocity=None if velocity is None else _finite(velocity),
            velocity_covariance=_finite(reading.velocity_covariance),
            specific_force=None if force is None else _finite(force),
            force_covariance=_finite(reading.force_covariance),
        )

    def measurements(self, reading: Reading, mounting: Mounting, yaw_rate: float) -> List[Measurement]:
        """Return the planar measurements of base_link that a reading gives.

        `yaw_rate` is the yaw rate of the robot [rad/s]; the motion that it adds at the sensor is removed.
        """
        sensor_in_base = mounting.sensor_in_base
        parts = [
            self._pose(reading, mounting),
            self._velocity(reading, sensor_in_base, yaw_rate),
            self._acceleration(reading, sensor_in_base, yaw_rate),
        ]
        return [part for part in parts if part is not None and part.states]

    def _pose(self, reading: Reading, mounting: Mounting) -> Optional[Measurement]:
        """Return the measured pose of base_link, or the velocity by two poses; None if the pose is not used.

        With the parameter `differential`, the result is the velocity since the last reading, or None for the
        first reading. With the parameter `relative`, the pose is measured from the pose of the first reading.
        So this method stores the last pose or the first pose. IMUs and odometry may have these parameters.
        """
        if reading.pose is None or not self._pose_used.any():
            return None
        pose = reading.pose
        if self._is_imu:
            pose, turn = _level_attitude(pose, mounting.sensor_in_base)
        elif self._config.differential:
            turn = Pose().quat_xyzw  # the velocity is along the axes of base_link, as the pose is
        else:
            turn = mounting.pose_frame_in_odom.quat_xyzw
        # The used values and the covariance are along the axes of the reading. They are turned to the axes of
        # the measurement that is returned.
        axes = matrix_from_quat(turn)
        used, covariance = _turned(axes, self._pose_used), _turned_covariance(axes, reading.pose_covariance)
        if self._config.differential:
            return self._velocity_since_last(reading.stamp, pose, used, covariance)
        if self._config.relative:
            self._first_pose = self._first_pose or pose
            pose = compose(inverse(self._first_pose), pose)
        # odometry gives its pose in a frame of its own, so it is turned to odom like the covariance above; an
        # IMU gives only an attitude, which needs no frame
        if not self._is_imu:
            pose = compose(mounting.pose_frame_in_odom, pose)
        return _planar(reading.stamp, (X, Y, YAW), used, _numbers(pose), covariance)

    def _velocity_since_last(
        self, stamp: float, pose: Pose, used: np.ndarray, covariance: np.ndarray
    ) -> Optional[Measurement]:
        """Return the mean velocity from the last pose to this pose, and store this pose as the last one.

        The result is None for the first pose.

        Args:
            stamp: stamp of the reading [s].
            pose: measured pose.
            used: mask of the used values of the pose, (6,).
            covariance: covariance of the pose, (6, 6).
        """
        last = self._last_reading
        self._last_reading = (stamp, pose, covariance)
        if last is None:
            return None
        last_stamp, last_pose, last_covariance = last
        duration = stamp - last_stamp
        velocity = _numbers(compose(inverse(last_pose), pose)) / duration
        # a variance should be divided by duration^2, but robot_localization multiplies by `duration`, and
        # this filter must give the same results
        velocity_covariance = (covariance + last_covariance) * duration
        return _planar(stamp, (VX, VY, YAW_RATE), used, velocity, velocity_covariance)

    def _velocity(self, reading: Reading, sensor_in_base: Pose, yaw_rate: float) -> Optional[Measurement]:
        """Return the velocity of base_link by a reading; None if it is not measured or not used.

        The velocity that the robot's `yaw_rate` [rad/s] adds at the sensor's position is removed.
        """
        if reading.velocity is None or not self._velocity_used.any():
            return None
        axes = matrix_from_quat(sensor_in_base.quat_xyzw)  # rotation from the sensor to base_link
        x, y, _ = sensor_in_base.position
        values = np.concatenate((axes @ reading.velocity[:3], axes @ reading.velocity[3:]))
        # a robot that turns moves a sensor at (x, y) by (-y, x) * yaw_rate, which is subtracted
        values[:2] += y * yaw_rate, -x * yaw_rate
        # the mask of the used values and the covariance are along the sensor's axes, so they are rotated, too
        used = _turned(axes, self._velocity_used)
        covariance = _turned_covariance(axes, reading.velocity_covariance)
        return _planar(reading.stamp, (VX, VY, YAW_RATE), used, values, covariance)

    def _acceleration(self, reading: Reading, sensor_in_base: Pose, yaw_rate: float) -> Optional[Measurement]:
        """Return the acceleration of base_link by a reading; None if it is not measured or not used.

        The result is without gravity. It is also without the acceleration that a sensor beside base_link's
        origin has because the robot turns. `yaw_rate` is the yaw rate of the robot [rad/s].
        """
        if reading.specific_force is None or not self._force_used.any():
            return None
        axes = matrix_from_quat(sensor_in_base.quat_xyzw)  # rotation from the sensor to base_link
        force = reading.specific_force
        if self._config.remove_gravitational_acceleration:
            # An accelerometer at rest measures a force upwards. This force, turned to the sensor's axes, is
            # subtracted. The pose in an IMU's reading is the attitude of the IMU itself. Without this pose,
            # the robot is taken to be level, so the mounting alone gives the attitude of the IMU.
            sensor_attitude = reading.pose.quat_xyzw if reading.pose else sensor_in_base.quat_xyzw
            force = force - rotate(quat_inverse(sensor_attitude), (0.0, 0.0, self._gravity))
        # the turning of the robot gives a sensor at (x, y) the acceleration -(x, y) * yaw_rate^2, which is
        # subtracted
        values = (axes @ force)[:2] + np.array(sensor_in_base.position[:2]) * yaw_rate**2
        covariance = (axes @ reading.force_covariance @ axes.T)[:2, :2]
        # axes of base_link (0 for x, 1 for y) along which a used axis of the sensor measures
        kept = [i for i in (0, 1) if np.linalg.norm(axes[i] * self._force_used) >= MIN_COMPONENT]
        states = tuple((AX, AY)[i] for i in kept)
        return Measurement(reading.stamp, states, values[kept], covariance[np.ix_(kept, kept)])


def _finite(numbers: Any) -> np.ndarray:
    """Return the numbers with 0 in place of NaN and infinity."""
    return np.asarray(np.nan_to_num(numbers, nan=0.0, posinf=0.0, neginf=0.0))


def _numbers(pose: Pose) -> np.ndarray:
    """Return position [m], roll, pitch and yaw [rad] of a pose, (6,)."""
    return np.array([*pose.position, *rpy_from_quat(pose.quat_xyzw)])


def _level_attitude(attitude: Pose, sensor_in_base: Pose) -> Tuple[Pose, Quaternion]:
    """Return the attitude of base_link from that of an IMU, and the yaw of the mounting as a quaternion.

    As in robot_localization, roll, pitch and yaw of the mounting are subtracted from those of the IMU. Then
    the vector (roll, pitch) is turned by the yaw of the mounting.
    """
    offsets = rpy_from_quat(sensor_in_base.quat_xyzw)
    angles = [wrap_angle(a - b) for a, b in zip(rpy_from_quat(attitude.quat_xyzw), offsets)]
    turn = quat_from_rpy(0.0, 0.0, offsets[2])
    roll, pitch, yaw = rotate(turn, angles)
    return Pose(quat_xyzw=quat_from_rpy(roll, pitch, yaw)), turn


def _turned(axes: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Return the mask of used values along rotated axes, (6,) bool.

    The value of a rotated axis counts as used if a used axis of the sensor is not perpendicular to it.

    Args:
        axes: rotation matrix; each row is a rotated axis, as a unit vector along the sensor's axes (3, 3).
        used: mask of the used values along the sensor's axes, three linear and three angular (6,).
    """
    # The product with the mask sets the components along unused axes to 0. The rest of a rotated axis is
    # almost 0 if all used axes are perpendicular to the rotated axis.
    linear = np.linalg.norm(axes * used[:3], axis=1) >= MIN_COMPONENT
    angular = np.linalg.norm(axes * used[3:], axis=1) >= MIN_COMPONENT
    return np.concatenate((linear, angular))


def _turned_covariance(axes: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the covariance (6, 6) of three linear and three angular values along rotated axes."""
    turn = np.kron(np.eye(2), axes)  # (6, 6) matrix with `axes` in the upper left and in the lower right
    return np.asarray(turn @ covariance @ turn.T)


def _planar(
    stamp: float, states: Tuple[int, ...], used: np.ndarray, values: np.ndarray, covariance: np.ndarray
) -> Measurement:
    """Return the used values that lie on the plane (see ON_PLANE) as a measurement of states.

    Args:
        stamp: stamp of the measurement [s].
        states: the three states that belong to ON_PLANE.
        used: mask of the used values, (6,).
        values: values along or about x, y and z, (6,).
        covariance: covariance of the values, (6, 6).
    """
    kept_indices, kept_states = [], []
    for index, state in zip(ON_PLANE, states):
        if used[index]:
            kept_indices.append(index)
            kept_states.append(state)
    kept_covariance = covariance[np.ix_(kept_indices, kept_indices)]
    return Measurement(stamp, tuple(kept_states), values[kept_indices], kept_covariance)
