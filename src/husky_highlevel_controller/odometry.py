"""Where the robot believes it is.

In: the wheels' speeds and the gyro's yaw rate. Out: pose in odom and twist in base_link.
Must not know: ROS, PyBullet, the truth.

A small stand-in for robot_localization's EKF (not in Debian), which on the Husky takes the forward speed
from the wheels and the heading mostly from the IMU, in two dimensions: odom -> base_link has no height.
"""

from __future__ import annotations

from husky_highlevel_controller.datatypes import Odometry, Twist2D
from husky_highlevel_controller.drive import DriveConfig, twist_of_wheels
from husky_highlevel_controller.geometry import advance


def advance_odometry(
    odometry: Odometry, left: float, right: float, yaw_rate: float, dt: float, config: DriveConfig
) -> Odometry:
    """Dead reckoning over one step of `dt` s, from wheel speeds [rad/s] and the gyro's yaw rate [rad/s]."""
    twist = Twist2D(twist_of_wheels(left, right, config).linear, yaw_rate)
    return Odometry(advance(odometry.pose_base_in_odom, twist, dt), twist)
