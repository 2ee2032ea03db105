"""Messages that are serialized faster than the message classes of genpy, for the busiest topics.

A message class of genpy packs its numbers one by one. `ArrayScan` writes the same bytes from arrays.
`MovingTree` keeps the bytes of its last message, and changes only the numbers in them. Subscribers see no
difference.
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
_SEQUENCE_SIZE = 4  # size of the field seq of a header, which is before the stamp [bytes]


class ArrayScan(LaserScan):
    """LaserScan whose ranges and intensities are NumPy arrays."""

    def serialize(self, buff: BytesIO) -> None:
        """Write the bytes of the message, in the order of the fields of LaserScan."""
        stamp, frame = self.header.stamp, self.header.frame_id.encode()
        buff.write(pack(f"<4I{len(frame)}s", self.header.seq, stamp.secs, stamp.nsecs, len(frame), frame))
        angles = self.angle_min, self.angle_max, self.angle_increment
        buff.write(pack("<7f", *angles, self.time_increment, self.scan_time, self.range_min, self.range_max))
        for values in (self.ranges, self.intensities):
            buff.write(pack("<I", len(values)) + values.astype("<f4").tobytes())


class MovingTree(TFMessage):
    """TFMessage that is sent again and again, with the same frames but other stamps and poses.

    `move` sets stamp and poses before each sending. Only the bytes of the message are kept, so its list
    `transforms` stays empty.
    """

    def __init__(self, branches: Sequence[Tuple[str, str]]) -> None:
        """Make the message; a branch is the name of a parent frame and the name of its child.

        The bytes begin with the number of transforms. Then each transform has the field seq, the stamp, the
        parent's name, the child's name (each after its length), and the pose. seq, stamps and poses are zeros
        until `move` is called.
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
        """Set the stamp of all transforms, and their poses, which are in the order of the branches."""
        for (stamp_at, pose_at), pose in zip(self._offsets, poses_child_in_parent):
            _STAMP.pack_into(self._bytes, stamp_at, seconds, nanoseconds)
            _POSE.pack_into(self._bytes, pose_at, *pose.position, *pose.quat_xyzw)

    def serialize(self, buff: BytesIO) -> None:
        """Write the bytes of the message."""
        buff.write(self._bytes)
