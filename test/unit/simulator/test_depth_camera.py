"""The depth camera: what its pixels mean."""

from math import radians, tan

import numpy as np
import pytest

from husky_highlevel_controller.simulator.sensors.depth_camera import (
    CameraConfig,
    DepthImage,
    image_of,
    points_of,
)

CAMERA = CameraConfig(width=64, height=48, field_of_view=60.0, near=0.1, far=8.0)


def test_the_outermost_pixels_look_half_the_field_of_view_aside():
    points = points_of(DepthImage(0.0, "f", np.ones((48, 64), dtype=np.float32)), CAMERA)
    edge = 32.0 / 31.5  # from the middle of a pixel to its edge
    assert points[24, 63, 0] * edge == pytest.approx(tan(radians(30.0)), rel=1e-6)
    assert points[24, 0, 0] == pytest.approx(-points[24, 63, 0])
    assert points[47, 32, 1] * (24.0 / 23.5) == pytest.approx(
        tan(CAMERA.vertical_field_of_view / 2.0), rel=1e-6
    )


def test_where_nothing_is_there_is_no_number():
    image = image_of(np.ones((48, 64)), CAMERA, 0.0, "f")
    assert np.isnan(image.depth).all()
    assert np.isnan(points_of(image, CAMERA)).all()
