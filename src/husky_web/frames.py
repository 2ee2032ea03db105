"""TF tree: the parent and the recent poses of each frame.

In: poses of children in their parents, with stamps. Out: the pose of any frame in any other.
"""

from __future__ import annotations

from collections import deque
from typing import Deque, Dict, List, Optional, Tuple

from husky_highlevel_controller.datatypes import IDENTITY, Pose
from husky_highlevel_controller.geometry import compose, inverse

# number of poses that are kept for each frame; a Husky's odometry has 100 poses in 2 s, at 50 Hz
MEMORY = 100
MAX_DEPTH = 100  # largest number of frames from a frame up to the root; a longer chain must be a circle


class Frames:
    """TF tree."""

    def __init__(self) -> None:
        self._parents: Dict[str, str] = {}
        # stamps [s] and poses of each frame in its parent frame, the oldest first
        self._poses: Dict[str, Deque[Tuple[float, Pose]]] = {}

    @property
    def names(self) -> List[str]:
        """Return the names of all frames."""
        return sorted({*self._parents, *self._parents.values()})

    def update(self, parent: str, child: str, stamp: float, pose_child_in_parent: Pose) -> None:
        """Take in one transform with its stamp [s].

        The frame's earlier poses are dropped if the stamp runs backwards, for example because a bag is played
        again, or if the frame has another parent now.
        """
        poses = self._poses.setdefault(child, deque(maxlen=MEMORY))
        if self._parents.get(child) != parent or (poses and stamp < poses[-1][0]):
            poses.clear()
        self._parents[child] = parent
        poses.append((stamp, pose_child_in_parent))

    def stamp(self, child: str) -> Optional[float]:
        """Return the stamp [s] of a frame's newest pose in its parent; None for a root or unknown frame."""
        return self._poses[child][-1][0] if child in self._poses else None

    def pose(self, child: str, root: str, stamp: Optional[float] = None) -> Optional[Pose]:
        """Return the pose of `child` in `root` at the known time nearest to `stamp` [s], or the latest pose.

        None if the two frames are not connected.
        """
        if child == root:
            return IDENTITY
        # the frame in which the way up the tree has ended, and the pose of `child` in this frame
        top_of_child, child_in_top = self._climb(child, stamp, stop_at=root)
        if top_of_child == root:
            return child_in_top
        # `root` is not above `child` in the tree, so the poses of both are compared in the frame at the top
        # of the tree
        top_of_root, root_in_top = self._climb(root, stamp, stop_at=top_of_child)
        if top_of_root != top_of_child:
            return None
        return compose(inverse(root_in_top), child_in_top)

    def _climb(self, frame: str, stamp: Optional[float], stop_at: str) -> Tuple[str, Pose]:
        """Climb the tree from a frame to `stop_at`, or to the root if `stop_at` is not above the frame.

        The poses on the way are those nearest to `stamp` [s], or the latest ones if `stamp` is None.

        Returns:
            Frame at which the climb ended, and the pose, in that frame, of the frame at which it began.
        """
        pose = IDENTITY
        for _ in range(MAX_DEPTH):
            if frame == stop_at or frame not in self._parents:
                break
            pose = compose(_nearest(self._poses[frame], stamp), pose)
            frame = self._parents[frame]
        return frame, pose


def _nearest(poses: Deque[Tuple[float, Pose]], stamp: Optional[float]) -> Pose:
    """Return the pose with the stamp nearest to `stamp` [s], or the latest pose if `stamp` is None.

    `poses` has stamps [s] and poses, the oldest first.
    """
    nearest_stamp, nearest = poses[-1]
    if stamp is not None:
        # the search begins with the newest pose, because `stamp` is mostly recent
        for pose_stamp, pose in reversed(poses):
            if abs(pose_stamp - stamp) > abs(nearest_stamp - stamp):
                break
            nearest_stamp, nearest = pose_stamp, pose
    return nearest
