"""Odometry: dead reckoning from the wheels, and from the wheels with a gyro.

In: the wheels' angles, the gyro's yaw rate. Out: poses in odom and twists in base_link.

There are two odometries. The wheel odometry takes the forward speed and the yaw rate from the wheels, as the
Husky's diff_drive_controller does; it drifts, because the wheels skid. The filtered odometry takes the
forward speed from the wheels and the yaw rate from the gyro.

The filtered odometry stands in for ekf_localization_node of robot_localization 2.7 (Noetic). On the Husky,
this node takes the forward speed from the wheels and the heading mostly from the IMU, in two dimensions, so
that odom -> base_link has no height. No test runs the original, which Debian does not have.
`test_odometry_drifts.py` compares both odometries with the true pose.
"""

from __future__ import annotations

from typing import Optional

from husky_highlevel_controller.datatypes import Odometry, OdometrySample, Pose2D, Twist2D, WheelState
from husky_highlevel_controller.geometry import advance
from husky_highlevel_controller.robot import DriveConfig
from husky_highlevel_controller.simulator.diff_drive import twist_of_wheels


class Odometer:
    """Wheel odometry and filtered odometry of the robot, sampled together."""

    def __init__(self, config: DriveConfig, dt: float) -> None:
        """Make an odometer; `dt` is the duration of a physics step [s]."""
        self._config, self._dt = config, dt

    def reset(self, wheels: WheelState) -> None:
        """Start at the origin of odom, at step 0."""
        self._last_wheels, self._last_odometry_step, self._last_wheel_step = wheels, 0, 0
        self._from_wheels = self.filtered = Odometry()

    def relocate(self, pose_base_in_odom: Pose2D) -> None:
        """Set the pose of the filtered odometry, because the robot was put elsewhere, at rest.

        The wheel odometry keeps its pose, because no wheel has turned. The caller must first call `sample`
        for the present step, with a reading of the wheels. Otherwise the next sample would add the distance
        that the robot drove before.
        """
        # a new `Odometry` has no velocity
        self.filtered = Odometry(pose_base_in_odom)
        self._from_wheels = Odometry(self._from_wheels.pose_base_in_odom)

    def sample(self, wheels: Optional[WheelState], yaw_rate: float, step: int) -> OdometrySample:
        """Advance both odometries to a physics step, and return them.

        A real Husky reads its encoders less often than odometry is needed. Between two readings, the wheel
        odometry stays as it is. The filtered odometry continues with the last speed of the wheels.

        Args:
            wheels: reading of the encoders; None between two readings.
            yaw_rate: yaw rate of the gyro [rad/s].
            step: number of physics steps since the reset.
        """
        # a second reading in the same step has no new information
        if wheels is not None and step > self._last_wheel_step:
            period = (step - self._last_wheel_step) * self._dt  # [s] time since the last reading
            # mean speeds [rad/s] of the wheels since the last reading
            front_left, front_right, rear_left, rear_right = (
                (angle - last_angle) / period
                for angle, last_angle in zip(wheels.angles, self._last_wheels.angles)
            )
            self._last_wheels, self._last_wheel_step = wheels, step
            left, right = (front_left + rear_left) / 2.0, (front_right + rear_right) / 2.0
            twist = twist_of_wheels(left, right, self._config)
            self._from_wheels = advance_odometry(self._from_wheels, twist, period)
        duration = (step - self._last_odometry_step) * self._dt  # [s] time since the last sample
        self._last_odometry_step = step
        # the filtered odometry has the forward speed of the wheels, and the yaw rate of the gyro
        linear = self._from_wheels.twist_in_base.linear
        self.filtered = advance_odometry(self.filtered, Twist2D(linear, yaw_rate), duration)
        return OdometrySample(self._last_wheels, self._from_wheels, self.filtered)


def advance_odometry(odometry: Odometry, twist_in_base: Twist2D, dt: float) -> Odometry:
    """Return the odometry after the robot has moved with a twist for `dt` s, along the exact arc."""
    return Odometry(advance(odometry.pose_base_in_odom, twist_in_base, dt), twist_in_base)
