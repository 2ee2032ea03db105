"""Pairs each scan with the pose of its own stamp from TF; no callback waits.

A scan and its transform travel by separate topics and arrive in either order. The scan is kept pending, and
whichever of the two arrives last completes the observation. If the transform does not come, the node's
main loop ends the wait after some wall time. ROS time may stand still until the scan is answered.
"""

from __future__ import annotations

import threading
import time
from typing import Any, Callable, NamedTuple, Optional, Tuple

import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped

from husky_highlevel_controller.controller.behaviour import Observation
from husky_highlevel_controller.controller.sensor_faults import ClockOffset, frame_sentence
from husky_highlevel_controller.datatypes import Pose, Scan
from husky_highlevel_controller.footprint import Footprint
from husky_highlevel_controller.geometry import pose_to_2d
from husky_highlevel_controller.ros.controller.display import BASE, ODOM
from husky_highlevel_controller.ros.conversions import pose_from_transform
from husky_highlevel_controller.ros.transforms import latest_stamp, lookup_transform

# [s] longest wall time for which the first scan waits for its transforms; the wait makes repeated runs in
# lockstep with the simulator start in the same way
START_TIMEOUT = 4.0
TRANSFORM_TIMEOUT = 2.0  # [s] longest wall time for which a later scan waits for the transform of its stamp
MIN_OFFSET = 0.05  # [s] a larger offset between the clocks of scans and odometry causes a warning
MAX_AGE = 2.0  # [s] a pose in odom is not used if it is older than the scan by more than this
REPORT_PERIOD = 5.0  # [s] time between two warnings about a missing transform
# number of scans in a row without the lidar's transform after which a warning is logged
MAX_UNPLACED_SCANS = 50


class Listener(tf2_ros.TransformListener):
    """Fills a TF buffer, and tells a placement of scans about every message on /tf and /tf_static."""

    def __init__(self, buffer: tf2_ros.Buffer, placement: ScanPlacement) -> None:
        # must be set before `super().__init__`, which subscribes, so that messages may come at once
        self._placement = placement
        super().__init__(buffer, tcp_nodelay=True)

    def callback(self, data: Any) -> None:
        """Take moving transforms."""
        super().callback(data)
        self._placement.update()

    def static_callback(self, data: Any) -> None:
        """Take fixed transforms."""
        super().static_callback(data)
        self._placement.forget_mount()
        self._placement.update()


class _PendingScan(NamedTuple):
    scan: Scan
    stamp: rospy.Time
    arrived_at: float  # [s] wall time at which the scan came


class ScanPlacement:
    """Turns every scan into one observation, as soon as TF has the pose of its stamp.

    At most one scan is pending. Only the newest of the scans that arrive meanwhile is kept, as the next one.
    """

    def __init__(
        self,
        transforms: tf2_ros.BufferCore,
        on_observation: Callable[[Observation], None],
        footprint: Footprint,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Set up without a pending scan.

        Args:
            transforms: buffer of TF, which the node's `Listener` fills.
            on_observation: called for one observation at a time, in the thread that completes it.
            footprint: outline of the robot, which becomes a part of each observation.
            clock: returns the wall time [s].
        """
        self._transforms, self._on_observation, self._clock = transforms, on_observation, clock
        self._footprint = footprint
        self._lock = threading.Lock()  # held while the pending scan and the next scan change
        self._pending_scan: Optional[_PendingScan] = None
        self._next_scan: Optional[_PendingScan] = None
        self._has_placed = False  # true after the first observation
        # stamp of the newest transform when the last overdue scan gave up waiting; later scans do not wait
        # until a newer transform comes. None if no scan was overdue
        self._stamp_when_overdue: Optional[rospy.Time] = None
        self._clock_offset = ClockOffset(MIN_OFFSET)  # measures how far the scans' clock is from odometry's
        self._unplaced_scans = 0  # number of scans in a row without a pose of the lidar
        # frame of the lidar and its pose in base_link, if the pose is fixed; None if /tf_static does not have
        # it
        self._static_mount: Optional[Tuple[str, Pose]] = None

    def add(self, scan: Scan, stamp: rospy.Time) -> None:
        """Take a scan, and its stamp exact to the nanosecond; any thread may call this."""
        with self._lock:
            odometry_stamp = latest_stamp(self._transforms, ODOM, BASE)
            if odometry_stamp > 0.0:  # 0 means that TF has no odometry yet, or that it is fixed
                self._clock_offset.add_reference(odometry_stamp)
            # compares the scan's stamp with the newest stamp of odometry; stamps are compared for a window of
            # wall time, so the call also needs the wall time
            self._clock_offset.add(scan.stamp, self._clock())
            pending = self._pending_scan
            # a smaller stamp means that the simulator was started again
            if pending is None or stamp < pending.stamp:
                self._pending_scan, self._next_scan = _PendingScan(scan, stamp, self._clock()), None
            elif stamp != pending.stamp:
                # this scan is newer than the pending scan; a scan with an equal stamp is the pending scan
                # itself, which the simulator may send again
                self._next_scan = _PendingScan(scan, stamp, self._clock())
        self.update()

    def update(self) -> None:
        """Hand on the pending scan if it can be placed or is overdue; any thread may call it."""
        # the check needs no lock, because `add` calls `update` again after it has added a scan
        if self._pending_scan is None:
            return
        with self._lock:
            while self._pending_scan is not None:
                observation = self._place(self._pending_scan)
                if observation is None:
                    return
                self._has_placed = True
                self._pending_scan, self._next_scan = self._next_scan, None
                self._on_observation(observation)

    def discard(self) -> None:
        """Forget the pending scans, because a newer one is unusable."""
        with self._lock:
            self._pending_scan = self._next_scan = None

    def forget_mount(self) -> None:
        """Forget the fixed pose of the lidar, because a message on /tf_static may have changed it."""
        self._static_mount = None

    def lookup(
        self, parent: str, child: str, stamp: Optional[rospy.Time] = None
    ) -> Optional[TransformStamped]:
        """Return the transform of a child frame in its parent frame; None if TF does not have it.

        It is the transform at a stamp, or the latest one if the stamp is None. The lookup never waits.
        """
        return lookup_transform(self._transforms, parent, child, stamp)

    @property
    def ahead_of_odometry(self) -> float:
        """Time by which the scans' clock is ahead of odometry's clock [s]; 0 if it is not ahead."""
        return max(self._clock_offset.seconds, 0.0)

    def _place(self, pending: _PendingScan) -> Optional[Observation]:
        """Return the observation of a scan, or None while its transform may still come.

        The first scan also waits for the lidar's pose and for odometry. In the observation of an overdue
        scan, an unknown pose is None.
        """
        frame = pending.scan.frame
        timeout = TRANSFORM_TIMEOUT if self._has_placed else START_TIMEOUT
        overdue = self._clock() - pending.arrived_at > timeout
        # the first observation must be complete, so that repeated runs in lockstep with the simulator start
        # in the same way
        if not self._has_placed and not overdue:
            has_all_frames = self.lookup(BASE, frame) and self.lookup(ODOM, BASE)
            if not has_all_frames:
                return None
        must_wait, transform = self._base_in_odom(pending.stamp, overdue)
        if must_wait:
            return None
        base_in_odom = pose_to_2d(pose_from_transform(transform)) if transform else None
        return Observation(
            pending.scan, self._laser_in_base(frame), base_in_odom, self._footprint, self.ahead_of_odometry
        )

    def _base_in_odom(self, stamp: rospy.Time, overdue: bool) -> Tuple[bool, Optional[TransformStamped]]:
        """Return whether to wait for a better transform of base_link in odom, and the best one so far.

        The best transform is the one at the stamp. If it will not come, the latest transform is used. This
        has three causes: TF has passed the stamp, odometry has stopped, or the scans' clock is ahead of
        odometry's clock. The transform is None if TF has none, or if the latest one is older than MAX_AGE. A
        transform with stamp 0 is fixed, so it never gets old.

        Args:
            stamp: stamp of the scan.
            overdue: whether the scan has waited for too long.
        """
        # the latest transform is looked up first, because it mostly has the scan's stamp, and a lookup of a
        # missing stamp takes longer
        latest = self.lookup(ODOM, BASE)
        if latest is None or latest.header.stamp == stamp:
            return False, latest
        newest_stamp = latest.header.stamp
        has_passed = newest_stamp > stamp
        # a transform with stamp 0 is fixed, or comes from the beginning of simulated time
        if has_passed or newest_stamp.is_zero():
            exact = self.lookup(ODOM, BASE, stamp)
            if exact is not None:
                return False, exact
        if has_passed:  # TF has moved on, so the transform at the stamp no longer comes
            return False, latest
        # TF has not reached the stamp yet. A wait is in vain if odometry has stopped, or if the scans' clock
        # is ahead of odometry's clock
        has_stopped, ahead = self._has_odometry_stopped(newest_stamp, overdue), self.ahead_of_odometry
        must_wait = not has_stopped and not ahead
        # the last pose of odometry that has stopped is not used after MAX_AGE, because the robot would drive
        # blindly; a fixed transform, with stamp 0, does not age
        age = (stamp - newest_stamp).to_sec() - ahead  # [s] age of the pose by odometry's clock
        is_old = not newest_stamp.is_zero() and age > MAX_AGE
        return must_wait, None if is_old else latest

    def _has_odometry_stopped(self, newest_stamp: rospy.Time, overdue: bool) -> bool:
        """Return whether a scan, this one or an earlier one, has waited in vain for a newer transform.

        Args:
            newest_stamp: stamp of the newest transform of odometry.
            overdue: whether this scan has waited for too long.
        """
        if overdue:
            self._stamp_when_overdue = newest_stamp
        return newest_stamp == self._stamp_when_overdue

    def _laser_in_base(self, frame: str) -> Optional[Pose]:
        """Pose of the lidar, None if unknown; warn if it was unknown for many scans in a row."""
        # read only once, because a message on /tf_static sets it to None in another thread (`forget_mount`)
        mount = self._static_mount
        if mount is not None:
            static_frame, static_pose = mount
            if static_frame == frame:
                return static_pose
        transform = self.lookup(BASE, frame)
        self._unplaced_scans = 0 if transform else self._unplaced_scans + 1
        if self._unplaced_scans > MAX_UNPLACED_SCANS:
            rospy.logwarn_throttle(REPORT_PERIOD, f"the robot stands still: {frame_sentence(frame)}")
        if transform is None:
            return None
        pose = pose_from_transform(transform)
        # stamp 0 means that every transform between the two frames comes from /tf_static
        if transform.header.stamp.is_zero():
            self._static_mount = frame, pose
        return pose
