"""Motion of models in frames of other models, as Gazebo's services take and return it.

In: poses and velocities in one frame. Out: the same motion in another frame.

A request to Gazebo's services get_model_state and set_model_state may name a reference frame: another model,
which may be moving.
"""

from __future__ import annotations

from math import hypot

from husky_highlevel_controller.datatypes import IDENTITY, ModelMotion, Pose, Vector3
from husky_highlevel_controller.geometry import compose, cross, inverse, minus, quat_inverse, rotate
from husky_highlevel_controller.simulator.spawn_request import ObjectError, checked_pose

# [m/s, rad/s] largest component of a velocity; a faster body would jump too far in one step of 5 ms
MAX_SPEED = 100.0


def checked_motion(motion: ModelMotion) -> ModelMotion:
    """Return a requested motion with a unit quaternion, or refuse a motion that cannot be simulated.

    As in Gazebo, a quaternion of any length is accepted, and a quaternion of zeros becomes no rotation.

    Raises:
        ObjectError: the pose is too far away, the model too fast, or a number is not finite.
    """
    length = hypot(*motion.pose.quat_xyzw)
    if length == 0.0:
        quat = IDENTITY.quat_xyzw
    else:
        # if the length is NaN or infinite, the result is not a unit quaternion, and `checked_pose` refuses it
        x, y, z, w = (value / length for value in motion.pose.quat_xyzw)
        quat = (x, y, z, w)
    for value in (*motion.velocity, *motion.angular_velocity):
        if not abs(value) <= MAX_SPEED:  # NaN fails this comparison too
            raise ObjectError(f"twist {value:g} is not within {-MAX_SPEED:g}..{MAX_SPEED:g} m/s or rad/s")
    return motion._replace(pose=checked_pose(Pose(motion.pose.position, quat)))


def in_world(motion_in_frame: ModelMotion, frame_in_world: ModelMotion) -> ModelMotion:
    """Return a motion in the world, from a motion in a frame, and the motion of this frame in the world.

    As in Gazebo, the velocity is not relative to the moving frame. It is a velocity in the world whose
    components are given along the frame's axes. So it is only turned, and the velocity of the frame is not
    added.
    """
    pose, velocity, spin = motion_in_frame
    turn = frame_in_world.pose.quat_xyzw
    return ModelMotion(compose(frame_in_world.pose, pose), rotate(turn, velocity), rotate(turn, spin))


def seen_from(motion_in_world: ModelMotion, frame_in_world: ModelMotion) -> ModelMotion:
    """Return a motion relative to a frame that moves, with its components along the frame's axes.

    As in Gazebo, the velocity is the difference of the two velocities. From a frame that turns, a model that
    stands also seems to move around the frame; this part is left out.
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
    # v + w x arm = v - arm x w
    return minus(motion_in_world.velocity, cross(arm, motion_in_world.angular_velocity))
