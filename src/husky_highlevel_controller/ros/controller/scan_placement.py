"""Pairs each scan with the pose that the robot had at the stamp of the scan; no callback waits.

A scan and its transform come on separate topics, and in either order. So the scan is kept (it is pending)
until both are there. Then it becomes an observation, in the callback of the message that came last. If the
transform does not come, the node's main loop ends the wait. The longest wait is measured in wall time,
because ROS time may stand still until the scan is answered.
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

# [s] longest wall time for which the first scan waits for its transforms. Because of this wait, all runs in
# lockstep with the simulator start in the same way.
START_TIMEOUT = 4.0
TRANSFORM_TIMEOUT = 2.0  # [s] longest wall time for which a later scan waits for the transform of its stamp
MIN_OFFSET = 0.05  # [s] smallest offset between the clocks of scans and odometry that causes a warning
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
        """Take moving transforms, for which a scan may be waiting; tf2 calls this for a message on /tf."""
        super().callback(data)
        self._placement.update()

    def static_callback(self, data: Any) -> None:
        """Take fixed transforms, such as the pose of the lidar; tf2 calls this for each on /tf_static."""
        super().static_callback(data)
        self._placement.forget_mount()
        self._placement.update()


class _PendingScan(NamedTuple):
    """Scan that waits for its transform, with its exact stamp and the time from which it waits."""

    scan: Scan
    stamp: rospy.Time  # stamp of the scan, exact to the nanosecond
    arrived_at: float  # [s] wall time at which the scan came


class ScanPlacement:
    """Makes an observation of each scan, as soon as TF has the pose of the robot at the stamp of the scan.

    At most one scan is pending. Of the scans that come during its wait, only the newest is kept, as the next
    scan.
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
            on_observation: is called with each observation, in the thread whose message completes it; never
                in two threads at once.
            footprint: outline of the robot, which becomes a part of each observation.
            clock: returns the wall time [s].
        """
        self._transforms, self._on_observation, self._clock = transforms, on_observation, clock
        self._footprint = footprint
        self._lock = threading.Lock()  # held while the pending scan and the next scan change
        self._pending_scan: Optional[_PendingScan] = None  # scan that waits for its transform
        # newest scan that has come while the pending scan waits; it is the next pending scan
        self._next_scan: Optional[_PendingScan] = None
        self._has_placed = False  # true after the first observation
        # Stamp of the newest transform of odometry when a scan had waited for too long; None before that. As
        # long as no newer transform comes, odometry counts as stopped, and later scans do not wait.
        self._stamp_when_overdue: Optional[rospy.Time] = None
        self._clock_offset = ClockOffset(MIN_OFFSET)  # measures how far the scans' clock is from odometry's
        self._unplaced_scans = 0  # number of scans in a row without a pose of the lidar
        # fixed pose of the lidar: the frame of the lidar, and its pose in base_link; None if the pose is not
        # fixed, or not yet known
        self._static_mount: Optional[Tuple[str, Pose]] = None

    def add(self, scan: Scan, stamp: rospy.Time) -> None:
        """Take a new scan; any thread may call this.

        `stamp` is the scan's stamp, exact to the nanosecond, because it is compared with the stamps of
        transforms, and the number `scan.stamp` is rounded.
        """
        with self._lock:
            odometry_stamp = latest_stamp(self._transforms, ODOM, BASE)
            # 0 means that TF has no odometry yet, or that its transform is static, which has no stamp
            if odometry_stamp > 0.0:
                self._clock_offset.add_reference(odometry_stamp)
            # the stamps of odometry and of scans together show how far the two clocks differ
            self._clock_offset.add(scan.stamp, self._clock())
            pending = self._pending_scan
            # time goes back when the simulator is started again
            has_time_gone_back = pending is not None and stamp < pending.stamp
            if pending is None or has_time_gone_back:
                self._pending_scan, self._next_scan = _PendingScan(scan, stamp, self._clock()), None
            elif stamp != pending.stamp:
                # This scan is newer than the pending scan. A scan with an equal stamp is ignored, because the
                # simulator may send the pending scan again.
                self._next_scan = _PendingScan(scan, stamp, self._clock())
        self.update()

    def update(self) -> None:
        """Make an observation of the pending scan if its transform has come, or if it has waited too long.

        Any thread may call this, after each message of TF and again and again.
        """
        # the check needs no lock, because `add` calls `update` again after it has added a scan
        if self._pending_scan is None:
            return
        with self._lock:
            # the loop runs a second time if another scan has come during the wait
            while self._pending_scan is not None:
                observation = self._place(self._pending_scan)
                if observation is None:  # the scan must still wait
                    return
                self._has_placed = True
                self._pending_scan, self._next_scan = self._next_scan, None
                self._on_observation(observation)

    def discard(self) -> None:
        """Forget the scans that wait, because a newer scan is not valid and has stopped the robot."""
        with self._lock:
            self._pending_scan = self._next_scan = None

    def forget_mount(self) -> None:
        """Forget the fixed pose of the lidar, because a message on /tf_static may have changed it."""
        self._static_mount = None

    def lookup(
        self, parent: str, child: str, stamp: Optional[rospy.Time] = None
    ) -> Optional[TransformStamped]:
        """Return the transform of a child frame in its parent frame; None if TF does not have it.

        The transform is the one at a stamp, or the latest one if the stamp is None. The lookup never waits.
        """
        return lookup_transform(self._transforms, parent, child, stamp)

    @property
    def ahead_of_odometry(self) -> float:
        """Time by which the scans' clock is ahead of odometry's clock [s]; 0 if it is not ahead."""
        return max(self._clock_offset.seconds, 0.0)

    def _place(self, pending: _PendingScan) -> Optional[Observation]:
        """Return the observation of a scan, or None if the scan must still wait for a transform.

        The first scan also waits until TF has the lidar's pose and odometry. In the observation of a scan
        that has waited for too long (an overdue scan), each pose that TF does not have is None.
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
        latest = self.lookup(ODOM, BASE)  # latest transform of base_link in odom; None without odometry
        transform = self._at_stamp(pending.stamp, latest)
        if transform is None and latest is not None:
            if self._may_still_come(pending.stamp, latest.header.stamp, overdue):
                return None  # the scan waits
            transform = self._unless_old(pending.stamp, latest)
        base_in_odom = pose_to_2d(pose_from_transform(transform)) if transform else None
        return Observation(
            pending.scan, self._laser_in_base(frame), base_in_odom, self._footprint, self.ahead_of_odometry
        )

    def _at_stamp(self, stamp: rospy.Time, latest: Optional[TransformStamped]) -> Optional[TransformStamped]:
        """Return the transform of base_link in odom at the stamp of a scan; None if TF does not have it.

        `latest` is the latest transform. TF is asked for the stamp only if it may have the transform, because
        a lookup in vain takes longer.
        """
        if latest is None or latest.header.stamp == stamp:
            return latest
        # A fixed transform has the stamp 0 and is valid at every time. The first moving transform of a
        # simulation has the stamp 0, too, but is not valid at the stamp of a later scan.
        may_be_fixed = latest.header.stamp.is_zero()
        if may_be_fixed or latest.header.stamp > stamp:
            return self.lookup(ODOM, BASE, stamp)
        return None

    def _may_still_come(self, stamp: rospy.Time, newest_stamp: rospy.Time, overdue: bool) -> bool:
        """Return whether the transform at the stamp of a scan may still come, so that the scan waits for it.

        It cannot come if odometry is already past the stamp. It does not come in time if odometry counts as
        stopped, or if the scans' clock is ahead of odometry's clock. An overdue scan lets odometry count as
        stopped until a newer transform comes.

        Args:
            stamp: stamp of the scan, at which TF has no transform.
            newest_stamp: stamp of the latest transform.
            overdue: whether the scan has waited for too long.
        """
        if newest_stamp > stamp:
            return False
        if overdue:
            self._stamp_when_overdue = newest_stamp
        has_odometry_stopped = newest_stamp == self._stamp_when_overdue
        are_scans_ahead = self.ahead_of_odometry > 0.0  # exactly 0 if the clocks agree
        return not (has_odometry_stopped or are_scans_ahead)

    def _unless_old(self, stamp: rospy.Time, latest: TransformStamped) -> Optional[TransformStamped]:
        """Return the latest transform if it may be used for the scan with this stamp, or None.

        None means that the transform is older than the scan by more than MAX_AGE, because the robot would
        drive blindly. A stamp of 0 does not show the age of a transform, so such a transform is never old.
        """
        # The stamps differ by the age of the transform, and by the time by which the scans' clock is ahead,
        # which does not count as age.
        age = (stamp - latest.header.stamp).to_sec() - self.ahead_of_odometry  # [s]
        return None if age > MAX_AGE and not latest.header.stamp.is_zero() else latest

    def _laser_in_base(self, frame: str) -> Optional[Pose]:
        """Return the pose of the lidar; None if TF does not have it, with a warning after many such scans.

        A fixed pose is kept until the next message on /tf_static, because a lookup in TF takes time.
        """
        # `_static_mount` is read only once, because another thread may set it to None (`forget_mount`)
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
