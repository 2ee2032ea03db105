"""Depth camera: images of the world, drawn in another process, and what their pixels mean."""

from dataclasses import replace
from math import radians, tan

import numpy as np
import pytest
from stage import GROUND, body

from husky_highlevel_controller.datatypes import Box, Pose
from husky_highlevel_controller.simulator.sensors.depth_camera import (
    CameraConfig,
    image_of,
    points_in_image,
)
from husky_highlevel_controller.simulator.sensors.renderer import Renderer

CAMERA = CameraConfig(width=160, height=120)
AHEAD = Pose((0.0, 0.0, 1.0), (-0.5, 0.5, -0.5, 0.5))  # optical: z along the world's x
DEADLINE = 120.0  # [s]


@pytest.fixture
def renderer():
    made = Renderer(CAMERA)
    yield made
    made.close()


def draw(renderer, *bodies, poses=None):
    renderer.start({t.name: t for t in bodies}, poses or {}, AHEAD)
    buffer = renderer.take(DEADLINE)
    assert buffer is not None
    return image_of(buffer, CAMERA)


def test_a_wall_is_as_far_as_it_is_and_the_sky_is_nothing(renderer):
    wall = body("wall", Box((0.2, 2.0, 1.0)), x=4.1, z=0.5)
    depth = draw(renderer, GROUND, wall)
    assert depth[62, 80] == pytest.approx(4.0, abs=0.01), "just below the horizon"
    assert np.isnan(depth[10, 80]), "above the wall"
    # the ground, one metre below, lies at depth d where the pixel looks down by 1 / d
    focal = CAMERA.focal_length
    assert depth[119, 80] == pytest.approx(focal / (119 - 59.5), rel=0.02)
    assert np.isnan(depth[55, 20]), "past the wall's side"


def test_left_of_the_robot_is_left_in_the_image(renderer):
    depth = draw(renderer, body("post", Box((0.2, 0.4, 2.0)), x=3.0, y=0.8, z=1.0))
    columns = np.flatnonzero(np.isfinite(depth).any(axis=0))
    assert columns.max() < 80


def test_things_move_come_and_go(renderer):
    box = body("box", Box((0.4, 4.0, 2.0)), x=3.0, z=1.0, mass=1.0)
    assert draw(renderer, box)[60, 80] == pytest.approx(2.8, abs=0.01)
    assert draw(renderer, box, poses={"box": Pose((5.0, 0.0, 1.0))})[60, 80] == pytest.approx(4.8, abs=0.02)
    nearer = body("screen", Box((0.4, 4.0, 2.0)), x=2.0, z=1.0)
    assert draw(renderer, box, nearer)[60, 80] == pytest.approx(1.8, abs=0.01)
    assert np.isnan(draw(renderer, GROUND)[40, 80])


def test_a_movable_link_without_collisions_is_drawn_by_its_visuals(renderer):
    """Its mass is SDF's default, so that its pose is sent."""
    solid = body("screen", Box((0.4, 4.0, 2.0)), x=3.0, z=1.0, mass=1.0)
    screen = replace(solid, collisions=(), visuals=solid.collisions)
    assert draw(renderer, screen, poses={"screen": screen.pose_in_world})[60, 80] == pytest.approx(
        2.8, abs=0.01
    )
    assert np.isnan(draw(renderer, GROUND)[40, 80])


def test_a_renderer_that_has_died_is_an_error_and_not_a_wait_for_ever(renderer):
    renderer._process.kill()
    renderer._process.wait()
    with pytest.raises((OSError, EOFError)):
        draw(renderer, GROUND)


# ---------------------------------------------------------------------------- what a pixel means

SMALL = CameraConfig(width=64, height=48, field_of_view=60.0, near=0.1, far=8.0)


def test_the_outermost_pixels_look_half_the_field_of_view_aside():
    points = points_in_image(np.ones((48, 64), dtype=np.float32), SMALL)
    edge = 32.0 / 31.5  # from the middle of a pixel to its edge
    assert points[24, 63, 0] * edge == pytest.approx(tan(radians(30.0)), rel=1e-6)
    assert points[24, 0, 0] == pytest.approx(-points[24, 63, 0])
    assert points[47, 32, 1] * (24.0 / 23.5) == pytest.approx(
        tan(SMALL.vertical_field_of_view / 2.0), rel=1e-6
    )


def test_where_nothing_is_there_is_no_number():
    image = image_of(np.ones((48, 64)), SMALL)
    assert np.isnan(image).all()
    assert np.isnan(points_in_image(image, SMALL)).all()
