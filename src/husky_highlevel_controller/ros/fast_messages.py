"""Messages that write their bytes faster than the classes that they extend, for the busiest topics.

A generated class packs a message number by number. The messages here write the same bytes from arrays, or
change only the numbers in bytes of the last message. Subscribers see no difference.
"""

from __future__ import annotations

from io import BytesIO
from struct import Struct, pack
from typing import Sequence, Tuple

from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

from husky_highlevel_controller.datatypes import Pose

_STAMP = Struct("<2I")  # seconds, nanoseconds
_POSE = Struct("<7d")  # position [m], quaternion x, y, z, w
_SEQUENCE_SIZE = 4  # number of bytes of a header before its stamp


class ArrayScan(LaserScan):
    """LaserScan whose ranges and intensities are NumPy arrays."""

    def serialize(self, buff: BytesIO) -> None:
        """Write the bytes of the message."""
        stamp, frame = self.header.stamp, self.header.frame_id.encode()
        buff.write(pack(f"<4I{len(frame)}s", self.header.seq, stamp.secs, stamp.nsecs, len(frame), frame))
        angles = self.angle_min, self.angle_max, self.angle_increment
        buff.write(pack("<7f", *angles, self.time_increment, self.scan_time, self.range_min, self.range_max))
        for values in (self.ranges, self.intensities):
            buff.write(pack("<I", len(values)) + values.astype("<f4").tobytes())


class MovingTree(TFMessage):
    """TFMessage between the same frames each time; `move` fills in a stamp and the poses.

    The message consists only of its bytes, so the list `transforms` is empty.
    """

    def __init__(self, branches: Sequence[Tuple[str, str]]) -> None:
        """Make the message; a branch is the name of a parent frame and the name of its child.

        The bytes begin with the number of branches. Then each branch has a sequence number, a stamp, the
        length of each name before the name, and a pose. All but lengths and names are zeros until `move` is
        called.
        """
        super().__init__()
        self._bytes = bytearray(pack("<I", len(branches)))
        self._offsets = []  # positions in `_bytes` of the stamp and of the pose of each transform
        for parent, child in branches:
            stamp_at = len(self._bytes) + _SEQUENCE_SIZE
            self._bytes += bytes(_SEQUENCE_SIZE + _STAMP.size)
            for name in (parent.encode(), child.encode()):
                self._bytes += pack("<I", len(name)) + name
            self._offsets.append((stamp_at, len(self._bytes)))
            self._bytes += bytes(_POSE.size)

    def move(self, seconds: int, nanoseconds: int, poses_child_in_parent: Sequence[Pose]) -> None:
        """Set the stamp of all transforms, and the poses in the order of the branches."""
        for (stamp_at, pose_at), pose in zip(self._offsets, poses_child_in_parent):
            _STAMP.pack_into(self._bytes, stamp_at, seconds, nanoseconds)
            _POSE.pack_into(self._bytes, pose_at, *pose.position, *pose.quat_xyzw)

    def serialize(self, buff: BytesIO) -> None:
        """Write the bytes of the message."""
        buff.write(self._bytes)
