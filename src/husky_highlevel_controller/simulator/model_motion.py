"""Motion of models in frames of other models, as Gazebo's services give it.

In: poses and velocities in one frame. Out: the same motion in another frame.
"""

from __future__ import annotations

from math import hypot, isfinite

from husky_highlevel_controller.datatypes import IDENTITY, ModelMotion, Pose, Vector3
from husky_highlevel_controller.geometry import compose, cross, inverse, minus, quat_inverse, rotate
from husky_highlevel_controller.simulator.spawn_request import ObjectError, checked_pose

# [m/s, rad/s] largest component of a velocity; a faster body would jump too far in one step of 5 ms
MAX_SPEED = 100.0


def checked_motion(motion: ModelMotion) -> ModelMotion:
    """Return the motion with its quaternion scaled to length 1; a quaternion of zeros becomes no rotation.

    Gazebo reads quaternions in this way, too.

    Raises:
        ObjectError: the pose is too far away, the model too fast, or a number is not finite.
    """
    length = hypot(*motion.pose.quat_xyzw)
    quat = IDENTITY.quat_xyzw
    # a length of NaN or infinity is not hidden here, so that `checked_pose` refuses the quaternion
    if length > 0.0 or not isfinite(length):
        x, y, z, w = (value / length for value in motion.pose.quat_xyzw)
        quat = (x, y, z, w)
    for value in (*motion.velocity, *motion.angular_velocity):
        if not abs(value) <= MAX_SPEED:  # NaN fails this comparison too
            raise ObjectError(f"twist {value:g} is not within {-MAX_SPEED:g}..{MAX_SPEED:g} m/s or rad/s")
    return motion._replace(pose=checked_pose(Pose(motion.pose.position, quat)))


def in_world(motion_in_frame: ModelMotion, frame_in_world: ModelMotion) -> ModelMotion:
    """Return a motion in the world, from a motion in a frame and the motion of this frame in the world.

    As in Gazebo, the velocity in the frame is a velocity over the ground, along the frame's axes. So the
    velocity of the frame is not added.
    """
    pose, velocity, spin = motion_in_frame
    turn = frame_in_world.pose.quat_xyzw
    return ModelMotion(compose(frame_in_world.pose, pose), rotate(turn, velocity), rotate(turn, spin))


def seen_from(motion_in_world: ModelMotion, frame_in_world: ModelMotion) -> ModelMotion:
    """Return a motion relative to a frame that moves, along the frame's axes.

    As in Gazebo, the result has the difference of the two velocities. A frame that turns also seems to move
    distant models around it, but this part of their velocity is not subtracted.
    """
    pose, velocity, spin = motion_in_world
    back = quat_inverse(frame_in_world.pose.quat_xyzw)
    return ModelMotion(
        compose(inverse(frame_in_world.pose), pose),
        rotate(back, minus(velocity, frame_in_world.velocity)),
        rotate(back, minus(spin, frame_in_world.angular_velocity)),
    )


def velocity_at(motion_in_world: ModelMotion, point_in_world: Vector3) -> Vector3:
    """Return the velocity of a point of a rigid model, in the world [m/s]."""
    arm = minus(point_in_world, motion_in_world.pose.position)
    return minus(motion_in_world.velocity, cross(arm, motion_in_world.angular_velocity))
