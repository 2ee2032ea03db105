"""Conversions between scans, PointCloud2 messages and arrays of points.

In and out: a `Scan`, a PointCloud2, points [m] in the sensor's frame.
"""

from __future__ import annotations

from math import ceil
from typing import Optional

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

from husky_highlevel_controller.datatypes import Scan
from husky_highlevel_controller.ros.conversions import header

# largest number of points of a cloud; the web page cannot draw more points ten times per second
MAX_POINTS = 5000


def points_from_scan(scan: Scan) -> np.ndarray:
    """Return the points at which the beams of a scan have met something, (N, 3) [m] in the lidar's frame."""
    valid = scan.valid
    ranges, bearings = scan.ranges[valid], scan.bearings[valid]
    return np.column_stack([ranges * np.cos(bearings), ranges * np.sin(bearings), np.zeros(len(ranges))])


def points_from_msg(msg: PointCloud2, max_points: int = MAX_POINTS) -> np.ndarray:
    """Return the finite points of a cloud, (N, 3) float32 [m], evenly thinned to at most `max_points`.

    The result is empty if the message does not have x, y and z as 32-bit floats, or if it has fewer bytes
    than its other fields say. Such a message may come from any node.
    """
    rows = _rows_of_msg(msg)
    if rows is None:
        return np.zeros((0, 3), np.float32)
    every = ceil(rows.size / max_points)  # every n-th point is kept, so that there are at most `max_points`
    cloud = rows.ravel()[::every]
    points = np.column_stack([cloud["x"], cloud["y"], cloud["z"]]).astype(np.float32)
    finite: np.ndarray = points[np.isfinite(points).all(axis=1)]
    return finite


def _rows_of_msg(msg: PointCloud2) -> Optional[np.ndarray]:
    """Return the points of a cloud, (height, width), as numpy records of x, y and z [m], without a copy.

    The result is None if there are no points, or if the message is not valid, as in `points_from_msg`.
    """
    # number of bytes from the beginning of a point to each of its fields; a cloud may have more fields than
    # x, y and z, such as a colour
    offsets = {field.name: field.offset for field in msg.fields if field.datatype == PointField.FLOAT32}
    if not {"x", "y", "z"} <= set(offsets) or not msg.width * msg.height:
        return None
    row_size = msg.width * msg.point_step
    row_step = msg.row_step or row_size  # some drivers leave row_step at 0
    # each field is a 32-bit float of 4 bytes, and must end before the next point begins
    if max(offsets[axis] for axis in "xyz") + 4 > msg.point_step or row_step < row_size:
        return None
    # a row may end with unused bytes; after the last row, they may be missing
    if len(msg.data) < (msg.height - 1) * row_step + row_size:
        return None
    number_format = ">f4" if msg.is_bigendian else "<f4"
    point_format = np.dtype(
        {
            "names": ["x", "y", "z"],
            "formats": [number_format] * 3,
            "offsets": [offsets[axis] for axis in "xyz"],
            "itemsize": msg.point_step,
        }
    )
    return np.ndarray((msg.height, msg.width), point_format, msg.data, strides=(row_step, msg.point_step))


def points_to_msg(points: np.ndarray, stamp: float, frame: str) -> PointCloud2:
    """Return points (height, width, 3) [m] as a message; a beam or pixel that has met nothing is NaN.

    A row has the points of one row of the depth camera's image, or of one ring of the 3D lidar.
    """
    height, width, _ = points.shape
    return PointCloud2(
        header=header(stamp, frame),
        height=height,
        width=width,
        fields=[
            PointField(name=axis, offset=4 * i, datatype=PointField.FLOAT32, count=1)
            for i, axis in enumerate("xyz")
        ],
        is_bigendian=False,
        point_step=12,  # bytes of a point, which is three floats of 4 bytes
        row_step=12 * width,
        data=points.astype("<f4").tobytes(),
        is_dense=False,
    )
