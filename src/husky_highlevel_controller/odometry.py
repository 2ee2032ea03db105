"""Where the robot believes it is.

In: a twist measured over one step. Out: pose in odom and twist in base_link.
Must not know: ROS, PyBullet, the truth.

The wheel odometry takes both speeds from the wheels, as the Husky's diff_drive_controller does; wheels that
skid make it drift. The fused one takes the yaw rate from the gyro instead: a small stand-in for
robot_localization's EKF (not in Debian), which on the Husky takes the forward speed from the wheels and the
heading mostly from the IMU, in two dimensions: odom -> base_link has no height.
"""

from __future__ import annotations

from husky_highlevel_controller.datatypes import Odometry, Twist2D
from husky_highlevel_controller.geometry import advance


def advance_odometry(odometry: Odometry, twist_in_base: Twist2D, dt: float) -> Odometry:
    """Dead reckoning over one step of `dt` s, along the exact arc."""
    return Odometry(advance(odometry.pose_base_in_odom, twist_in_base, dt), twist_in_base)
