"""Keeps the markers of a drive, and finds out where in the world they truly were."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np
import rospy
import tf2_ros
from visualization_msgs.msg import Marker, MarkerArray

from husky_highlevel_controller import messages
from husky_highlevel_controller.datatypes import Pose, Quaternion, Vector3
from husky_highlevel_controller.geometry import compose, transform_point
from husky_highlevel_controller.recording import Shown

BASE = "base_link"
KINDS = {"visualization_msgs/Marker": Marker, "visualization_msgs/MarkerArray": MarkerArray}
PERIOD = 0.019  # [s], simulated, between two of the same marker that are kept
SERIES = 200  # different markers that are kept
POINTS = 1000  # of a marker of many points that are looked at
LIST_TYPES = {
    Marker.LINE_STRIP, Marker.LINE_LIST, Marker.CUBE_LIST, Marker.SPHERE_LIST, Marker.POINTS,
    Marker.TRIANGLE_LIST,
}  # fmt: skip


@dataclass(frozen=True)
class Kept:
    """One marker as it came."""

    at: float  # [s], simulated
    topic: str
    marker: Marker
    stamp: Optional[rospy.Time]  # of the transforms that count; None: there is nothing to look up
    problem: str


class MarkerWatch:
    """Notes markers now; where they were is worked out in the end, when all transforms are known."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._kept: List[Kept] = []
        self._last: Dict[Tuple[str, str], float] = {}
        self._topics: Dict[str, rospy.Subscriber] = {}
        self._buffer = tf2_ros.Buffer(rospy.Duration(3600.0), debug=False)
        self._listener = tf2_ros.TransformListener(self._buffer)

    @property
    def topics(self) -> Tuple[str, ...]:
        """That somebody publishes markers on."""
        return tuple(sorted(self._topics))

    def follow(self, topic: str, kind: str) -> None:
        """Listen to a topic, if its type is one of markers."""
        if kind in KINDS and topic not in self._topics:
            self._topics[topic] = rospy.Subscriber(topic, KINDS[kind], self._on_marker, topic, queue_size=100)

    def _on_marker(self, msg: Any, topic: str) -> None:
        for marker in msg.markers if isinstance(msg, MarkerArray) else [msg]:
            if marker.action == Marker.ADD:
                self._keep(marker, topic)

    def _keep(self, marker: Marker, topic: str) -> None:
        now, key = self._now(), (topic, _name(marker))
        if now - self._last.get(key, -inf) < PERIOD or len({*self._last, key}) > SERIES:
            return
        self._last[key] = now
        stamp, problem, frame = marker.header.stamp, "", _frame(marker)
        if stamp.is_zero():  # the latest transform there is now
            stamp = None
            if frame != BASE:
                try:
                    stamp = self._buffer.get_latest_common_time(BASE, frame)
                except tf2_ros.TransformException as error:
                    problem = _short(error)
        marker.points = marker.points[:POINTS]
        self._kept.append(Kept(now, topic, marker, stamp, problem))

    def shown(self, times: np.ndarray, truth: Sequence[Pose]) -> Tuple[Shown, ...]:
        """All of them, at their true places.

        Args:
            times: when base_link stood where, (N,) [s].
            truth: where it stood in the world, N.
        """
        return tuple(self._shown(kept, times, truth) for kept in list(self._kept)) if len(times) else ()

    def _shown(self, kept: Kept, times: np.ndarray, truth: Sequence[Pose]) -> Shown:
        marker, position = kept.marker, (nan, nan, nan)
        problem = kept.problem or _invisible(marker)
        if not problem:
            try:
                position = self._in_world(kept, times, truth)
            except tf2_ros.TransformException as error:
                problem = _short(error)
        stamp = marker.header.stamp.to_sec()
        return Shown(kept.topic, _name(marker), kept.at, stamp, _frame(marker), position, problem)

    def _in_world(self, kept: Kept, times: np.ndarray, truth: Sequence[Pose]) -> Vector3:
        """Seen from base_link at its stamp, when that stood where it truly stood: so odom may drift."""
        frame_in_base = Pose()
        if _frame(kept.marker) != BASE:
            transform = self._buffer.lookup_transform(BASE, _frame(kept.marker), kept.stamp)
            frame_in_base = messages.pose_from_transform(transform)
        moment = kept.at if kept.stamp is None else kept.stamp.to_sec()
        row = min(int(np.searchsorted(times, moment - 1e-6)), len(times) - 1)
        return transform_point(compose(truth[row], frame_in_base), _middle(kept.marker))


def _name(marker: Marker) -> str:
    return f"{marker.ns}/{marker.id}"


def _frame(marker: Marker) -> str:
    return str(marker.header.frame_id).lstrip("/")


def _middle(marker: Marker) -> Vector3:
    """Of a marker, in its frame; of many points, their mean."""
    p, q = marker.pose.position, marker.pose.orientation
    if marker.type not in LIST_TYPES or not marker.points:
        return (p.x, p.y, p.z)
    x, y, z = np.mean([(point.x, point.y, point.z) for point in marker.points], axis=0).tolist()
    length = float(np.linalg.norm((q.x, q.y, q.z, q.w)))
    quat: Quaternion = (0.0, 0.0, 0.0, 1.0)  # RViz, too, takes zeros for no rotation
    if length > 0.0:
        quat = (q.x / length, q.y / length, q.z / length, q.w / length)
    return transform_point(Pose((p.x, p.y, p.z), quat), (x, y, z))


def _invisible(marker: Marker) -> str:
    """Why RViz would draw nothing of it."""
    p, scale = marker.pose.position, marker.scale
    if not marker.header.frame_id:
        return "it has no frame_id"
    if not all(map(isfinite, (p.x, p.y, p.z))):
        return "its position is not a number"
    if max(scale.x, scale.y, scale.z) <= 0.0:
        return "its scale is 0"
    if marker.color.a <= 0.0 and not any(color.a > 0.0 for color in marker.colors):
        return "its alpha is 0"
    return ""


def _short(error: Exception) -> str:
    return str(error).split(". ")[0].strip()
