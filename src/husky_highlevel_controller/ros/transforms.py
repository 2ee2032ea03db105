"""Lookup of transforms in a TF buffer: never waits, never raises, never returns an impossible pose."""

from __future__ import annotations

from math import isfinite
from typing import Optional

import rospy
import tf2_ros
from geometry_msgs.msg import Transform, TransformStamped

from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.ros.conversions import pose_from_transform

# [m] a pose with a larger coordinate is rejected; tf2 itself rejects NaN, but neither infinity nor 1e308
MAX_COORDINATE = 1e6


def lookup_transform(
    transforms: tf2_ros.BufferCore, parent: str, child: str, stamp: Optional[rospy.Time] = None
) -> Optional[TransformStamped]:
    """Return the transform of a child frame in its parent frame; None if there is no valid one.

    Args:
        transforms: buffer of TF.
        parent: name of the parent frame.
        child: name of the child frame. A leading slash is taken off, because some old nodes still write one.
        stamp: time of the transform; the latest transform if None.

    Returns:
        None if TF has no such transform, if the name of a frame is not legal, if a number of the transform is
        not finite, or if a coordinate is beyond MAX_COORDINATE.
    """
    try:
        stamped = transforms.lookup_transform_core(parent, child.lstrip("/"), stamp or rospy.Time())
    except (tf2_ros.TransformException, ValueError):
        # a ValueError means that the name of a frame is empty or contains a NUL character
        return None
    return stamped if is_pose(stamped.transform) else None


def lookup_pose(
    transforms: tf2_ros.BufferCore, parent: str, child: str, stamp: Optional[rospy.Time] = None
) -> Optional[Pose]:
    """Return the pose of a child frame in its parent frame, as `lookup_transform` finds it; None without."""
    stamped = lookup_transform(transforms, parent, child, stamp)
    return None if stamped is None else pose_from_transform(stamped)


def latest_stamp(transforms: tf2_ros.BufferCore, parent: str, child: str) -> float:
    """Return the stamp of the newest transform between two frames [s]; 0 if there is none, or it is fixed."""
    try:
        stamp: float = transforms.get_latest_common_time(parent, child).to_sec()
    except tf2_ros.TransformException:
        return 0.0
    return stamp


def is_pose(transform: Transform) -> bool:
    """Return whether all numbers of a transform are finite, and its translation within MAX_COORDINATE."""
    t, r = transform.translation, transform.rotation
    return all(abs(value) <= MAX_COORDINATE for value in (t.x, t.y, t.z)) and all(
        isfinite(value) for value in (r.x, r.y, r.z, r.w)
    )
