"""Comparison of commands with motion, which shows whether the robot obeys the controller.

In: commands, poses of the robot in odom. Out: whether it has stood still for too long against the commands.
"""

from __future__ import annotations

from math import hypot
from typing import NamedTuple, Optional

from husky_highlevel_controller.datatypes import Pose2D, Twist2D
from husky_highlevel_controller.geometry import wrap_angle

STILL_TIME = 2.0  # [s] a robot that stands still for this time although it is commanded to move does not obey
# [m/s], [rad/s] a real robot might stand still at slower commands, so these commands are not checked
MIN_LINEAR, MIN_ANGULAR = 0.1, 0.1
# [m], [rad] The robot obeys if it moves or turns by more than this limit. The limit is about a tenth of the
# motion that the slowest checked command causes in STILL_TIME.
MOVED, TURNED = 0.02, 0.03


class Obedience(NamedTuple):
    """Memory of the last pose at which the robot obeyed the controller's commands to move."""

    # pose in odom at which the robot last obeyed; None if the pose is unknown or no motion is commanded
    pose: Optional[Pose2D] = None
    since: float = 0.0  # [s], stamp of `pose`
    stamp: float = 0.0  # [s], stamp of the last command

    @property
    def obeys(self) -> bool:
        """Return whether the robot has moved in the last STILL_TIME, or was not commanded to move."""
        return self.pose is None or self.stamp - self.since < STILL_TIME

    def after(self, stamp: float, base_in_odom: Optional[Pose2D], twist: Twist2D) -> Obedience:
        """Return the memory after one more command; `obeys` of the result then answers the question.

        Args:
            stamp: stamp of the scan that the command answers [s].
            base_in_odom: pose of the robot at that stamp; None if it is unknown.
            twist: commanded velocity.
        """
        # without a pose, or without a command to move, there is nothing to compare
        if base_in_odom is None or (abs(twist.linear) < MIN_LINEAR and abs(twist.angular) < MIN_ANGULAR):
            return Obedience(stamp=stamp)
        # a longer time between two commands is a jump of a clock, or the robot was not commanded meanwhile
        if self.pose is not None and 0.0 <= stamp - self.stamp <= STILL_TIME:
            moved = hypot(base_in_odom.x - self.pose.x, base_in_odom.y - self.pose.y)
            turned = abs(wrap_angle(base_in_odom.yaw - self.pose.yaw))
            if not (moved > MOVED or turned > TURNED):
                return self._replace(stamp=stamp)  # the robot still stands at the old pose
        # the robot has moved, this is the first command to move, or the time has jumped; in all three cases
        # the memory begins again with the present pose
        return Obedience(pose=base_in_odom, since=stamp, stamp=stamp)
