"""Depth camera: its parameters, and 3D points from its depth image.

In: a depth buffer from a renderer. Out: a depth image, points.

The numbers are from the Kinect of husky_description before 0.4.4 (60 degrees wide, 0.05 to 8 m, 10 images per
second), at half its 640 x 480 pixels. Frames are optical (REP 103): z forward, x to the right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import atan, radians, tan
from typing import Tuple

import numpy as np

from husky_highlevel_controller.config import number


@dataclass(frozen=True)
class CameraConfig:
    """Resolution, field of view and range of the depth camera."""

    width: int = number(16, 1280, "columns of the image", default=320)
    height: int = number(16, 1024, "rows of the image", default=240)
    field_of_view: float = number(10.0, 120.0, "angle from the left to the right edge [deg]", default=60.0)
    near: float = number(0.01, 1.0, "nearer surfaces are not seen [m]", default=0.05)
    far: float = number(1.0, 100.0, "farther surfaces are not seen [m]", default=8.0)

    def __post_init__(self) -> None:
        """Raise ValueError if nothing can be seen, because the limits are in the wrong order."""
        if self.near >= self.far:
            raise ValueError(f"near = {self.near} is not below far = {self.far}")

    @property
    def focal_length(self) -> float:
        """Focal length of both axes [px]."""
        return self.width / 2.0 / tan(radians(self.field_of_view) / 2.0)

    @property
    def vertical_field_of_view(self) -> float:
        """Angle from the upper edge to the lower edge of the image [rad]."""
        return 2.0 * atan(self.height / 2.0 / self.focal_length)

    @property
    def center(self) -> Tuple[float, float]:
        """Column and row of the optical axis in the image [px]; a whole number is the middle of a pixel."""
        return (self.width - 1) / 2.0, (self.height - 1) / 2.0


@dataclass(frozen=True)
class CameraSetup:
    """Depth camera and its rate."""

    camera_rate: int = number(1, 50, "depth images per second [Hz]", default=10)
    camera: CameraConfig = field(default_factory=CameraConfig, metadata={"help": "the depth camera"})


def image_of(buffer: np.ndarray, config: CameraConfig) -> np.ndarray:
    """Convert an OpenGL depth buffer to a depth image, (height, width) float32 [m].

    A depth is the distance along the camera's z axis; NaN if there is no surface up to the far limit.

    Args:
        buffer: values (height, width) within 0..1, from the near limit to the far limit; they are not
            proportional to the depth.
        config: limits of the camera.
    """
    near, far = config.near, config.far
    depth = far * near / (far - (far - near) * np.asarray(buffer, dtype=float))
    # a pixel without a surface has the depth `far`, except for rounding
    return np.where(depth < 0.999 * far, depth, np.nan).astype(np.float32)


def points_in_image(depth: np.ndarray, config: CameraConfig) -> np.ndarray:
    """Return the point that each pixel sees in the camera's optical frame, (height, width, 3) float32 [m]."""
    center_column, center_row = config.center
    height, width = depth.shape
    x = (np.arange(width) - center_column) / config.focal_length * depth
    y = (np.arange(height) - center_row)[:, None] / config.focal_length * depth
    return np.stack([x, y, depth], axis=-1).astype(np.float32)
