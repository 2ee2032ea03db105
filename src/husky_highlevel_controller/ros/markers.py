"""Conversions to visualization_msgs markers for RViz.

In: points, sizes, text. Out: messages.
"""

from __future__ import annotations

from typing import Any, Optional, Sequence

from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from husky_highlevel_controller.ros.conversions import header

DRAWN_HEIGHT = 0.8  # [m], about the scan plane; a planar scan cannot see how tall a pillar is


def pillar_to_marker(
    center: Point, radius: float, stamp: float, frame: str, namespace: str, color: ColorRGBA
) -> Marker:
    """A cylinder that stands at the pillar's centre."""
    size = Vector3(2.0 * radius, 2.0 * radius, DRAWN_HEIGHT)
    return _marker(Marker.CYLINDER, stamp, frame, namespace, center, scale=size, color=color)


def disc_to_marker(
    center: Point, radius: float, stamp: float, frame: str, namespace: str, color: ColorRGBA
) -> Marker:
    """A flat disc that lies about a point."""
    size = Vector3(2.0 * radius, 2.0 * radius, 0.02)
    return _marker(Marker.CYLINDER, stamp, frame, namespace, center, scale=size, color=color)


def ball_to_marker(
    center: Point, radius: float, stamp: float, frame: str, namespace: str, color: ColorRGBA
) -> Marker:
    """A small sphere at a point."""
    size = Vector3(2.0 * radius, 2.0 * radius, 2.0 * radius)
    return _marker(Marker.SPHERE, stamp, frame, namespace, center, scale=size, color=color)


def line_to_marker(
    points: Sequence[Point], width: float, stamp: float, frame: str, namespace: str, color: ColorRGBA
) -> Marker:
    """A line from point to point."""
    fields = {"points": list(points), "scale": Vector3(x=width), "color": color}
    return _marker(Marker.LINE_STRIP, stamp, frame, namespace, **fields)


def text_to_marker(
    text: str, position: Point, height: float, stamp: float, frame: str, namespace: str, color: ColorRGBA
) -> Marker:
    """Text that faces the camera, each letter `height` m tall."""
    fields = {"text": text, "scale": Vector3(z=height), "color": color}
    return _marker(Marker.TEXT_VIEW_FACING, stamp, frame, namespace, position, **fields)


def no_marker(stamp: float, frame: str, namespace: str) -> Marker:
    """Take a marker away."""
    return _marker(0, stamp, frame, namespace, action=Marker.DELETE)


def _marker(
    kind: int, stamp: float, frame: str, namespace: str, position: Optional[Point] = None, **fields: Any
) -> Marker:
    pose = Pose(position or Point(), Quaternion(w=1.0))  # an all-zero quaternion is not a rotation
    return Marker(header=header(stamp, frame), ns=namespace, type=kind, pose=pose, **fields)
