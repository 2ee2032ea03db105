"""Watches a filter while a bag is played to it: its odometry, and where the sheet's top view is."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Dict, List, Tuple

import numpy as np
import rospy
from nav_msgs.msg import Odometry

from husky_grading.nodes.marker_watch import MarkerWatch
from husky_grading.recording import FILTERED, Playback

TOP_VIEW = "smb_top_view"  # frame
MAX_TOPICS, MAX_ESTIMATES = 10, 50_000
LAST = 1.0  # [s], before the bag's end: an estimate from there is among the last
SILENCE = 10.0  # [s] of wall time without an estimate after the bag's end: no more is to come


class PlaybackWatch:
    """Callbacks append; `is_over` tells when all has come."""

    def __init__(self, transforms: MarkerWatch, known: Playback) -> None:
        """`transforms` tell the places of frames; `known` is what its hand-in says."""
        self._transforms, self._known = transforms, known
        self._paths: Dict[str, List[Tuple[float, float, float]]] = {}
        self._top_view: List[Tuple[float, ...]] = []
        self._came_at = time.monotonic()
        self.subscribers: List[rospy.Subscriber] = []

    def follow(self, topic: str, kind: str) -> None:
        """Subscribe to a topic of the submission, if it is odometry."""
        if kind == "nav_msgs/Odometry" and topic not in self._paths and len(self._paths) < MAX_TOPICS:
            self._paths[topic] = []
            subscriber = rospy.Subscriber(topic, Odometry, self._on_odometry, topic, queue_size=MAX_ESTIMATES)
            self.subscribers.append(subscriber)

    def _on_odometry(self, msg: Odometry, topic: str) -> None:
        self._came_at = time.monotonic()
        if len(self._paths[topic]) < MAX_ESTIMATES:
            place = msg.pose.pose.position
            self._paths[topic].append((msg.header.stamp.to_sec(), place.x, place.y))

    def look(self, now: float) -> None:
        """Keep where the top view is at a simulated time [s], once for each: the clock may stand."""
        place = self._transforms.place(TOP_VIEW)
        if place is not None and now > (self._top_view[-1][0] if self._top_view else 0.0):
            self._top_view.append((now, *place))

    def is_over(self, end: float) -> bool:
        """Whether, after the end of the bag [s], the last estimate has come, or none comes any more."""
        if any(path and path[-1][0] >= end - LAST for path in self._paths.values()):
            return True
        return not self._paths or time.monotonic() - self._came_at > SILENCE

    @property
    def playback(self) -> Playback:
        """The path of the sheet's topic, where it comes, else the longest one; and the top view."""
        longest = max(self._paths, key=lambda topic: len(self._paths[topic]), default="")
        topic = FILTERED if self._paths.get(FILTERED) else longest
        path = np.array(self._paths.get(topic, ())).reshape(-1, 3)
        top_view = np.array(self._top_view).reshape(-1, 4)
        places = {} if self._top_view else self._transforms.places()
        return replace(self._known, path=path, topic=topic, top_view=top_view, places=places)
