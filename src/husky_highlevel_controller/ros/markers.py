"""Conversions to visualization_msgs markers for RViz.

In: points, sizes, words. Out: messages.
"""

from __future__ import annotations

from typing import Sequence

from genpy import Duration
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from husky_highlevel_controller.ros.conversions import header

DRAWN_HEIGHT = 0.8  # [m], about the scan plane; a planar scan cannot see how tall a pillar is


def pillar_to_marker(
    center: Point, radius: float, stamp: float, frame: str, namespace: str, color: ColorRGBA
) -> Marker:
    """A cylinder that stands at the pillar's centre."""
    marker = _marker(stamp, frame, namespace, Marker.ADD)
    marker.type = Marker.CYLINDER
    marker.pose.position = center
    marker.scale = Vector3(2.0 * radius, 2.0 * radius, DRAWN_HEIGHT)
    marker.color = color
    return marker


def disc_to_marker(
    center: Point, radius: float, stamp: float, frame: str, namespace: str, color: ColorRGBA
) -> Marker:
    """A flat disc that lies about a point."""
    marker = pillar_to_marker(center, radius, stamp, frame, namespace, color)
    marker.scale.z = 0.02
    return marker


def ball_to_marker(
    center: Point, radius: float, stamp: float, frame: str, namespace: str, color: ColorRGBA
) -> Marker:
    """A small sphere at a point."""
    marker = pillar_to_marker(center, radius, stamp, frame, namespace, color)
    marker.type = Marker.SPHERE
    marker.scale.z = 2.0 * radius
    return marker


def line_to_marker(
    points: Sequence[Point], width: float, stamp: float, frame: str, namespace: str, color: ColorRGBA
) -> Marker:
    """A line from point to point."""
    marker = _marker(stamp, frame, namespace, Marker.ADD)
    marker.type = Marker.LINE_STRIP
    marker.points = list(points)
    marker.scale.x = width
    marker.color = color
    return marker


def text_to_marker(
    text: str, position: Point, height: float, stamp: float, frame: str, namespace: str, color: ColorRGBA
) -> Marker:
    """Text that faces the camera, each letter `height` m tall."""
    marker = _marker(stamp, frame, namespace, Marker.ADD)
    marker.type = Marker.TEXT_VIEW_FACING
    marker.text = text
    marker.pose.position = position
    marker.scale.z = height
    marker.color = color
    return marker


def no_marker(stamp: float, frame: str, namespace: str) -> Marker:
    """Take a marker away."""
    return _marker(stamp, frame, namespace, Marker.DELETE)


def _marker(stamp: float, frame: str, namespace: str, action: int) -> Marker:
    marker = Marker(header=header(stamp, frame), ns=namespace, id=0, action=action, lifetime=Duration(0))
    marker.pose.orientation.w = 1.0  # an all-zero quaternion is not a rotation
    return marker
