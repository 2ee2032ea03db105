"""The inertial measurement unit on the Husky: what one feels, turning and being pushed.

In: two motions of base_link one period apart, gravity, a random generator. Out: an `ImuSample`.
Must not know: ROS, PyBullet.

Numbers: husky_description 0.6.10, husky.urdf.xacro. Its plugin measures at base_link's origin, along
base_link's axes, and its messages name that frame. So do we; imu_link, 0.19 m further ahead, would also feel
the centripetal 0.19 m times the turning rate squared.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from husky_highlevel_controller.datatypes import ImuSample, RobotState, Vector3
from husky_highlevel_controller.geometry import quat_inverse, rotate


@dataclass(frozen=True)
class ImuConfig:
    """What the IMU is; defaults are the Noetic Husky's."""

    acceleration_noise: float = field(
        default=0.005, metadata={"min": 0.0, "max": 10.0, "help": "standard deviation on each axis [m/s^2]"}
    )
    rate_noise: float = field(
        default=0.005, metadata={"min": 0.0, "max": 10.0, "help": "standard deviation on each axis [rad/s]"}
    )


def measure(
    before: RobotState,
    now: RobotState,
    duration: float,
    gravity_in_world: Vector3,
    config: ImuConfig,
    rng: np.random.Generator,
    stamp: float,
) -> ImuSample:
    """One sample at one instant.

    The specific force is the mean over the period, as an accelerometer that integrates between two samples
    tells it: a knock of a millisecond is in one sample, however short, and nothing is counted twice.

    Args:
        before: the robot's motion `duration` s ago.
        now: the robot's motion.
        duration: one period [s].
        gravity_in_world: [m/s^2].
        config: the noise.
        rng: where the noise comes from.
        stamp: of now [s].
    """
    old = rotate(before.pose_in_world.quat_xyzw, before.velocity_in_base)
    new = rotate(now.pose_in_world.quat_xyzw, now.velocity_in_base)
    # in the world, because there gravity stands still and velocities may be subtracted
    pushed = [(b - a) / duration - g for a, b, g in zip(old, new, gravity_in_world)]
    force = rotate(quat_inverse(now.pose_in_world.quat_xyzw), pushed)
    noise = rng.standard_normal(6).tolist()
    fx, fy, fz = (value + config.acceleration_noise * draw for value, draw in zip(force, noise[:3]))
    wx, wy, wz = (
        value + config.rate_noise * draw for value, draw in zip(now.angular_velocity_in_base, noise[3:])
    )
    return ImuSample(stamp, now.pose_in_world.quat_xyzw, (wx, wy, wz), (fx, fy, fz))
