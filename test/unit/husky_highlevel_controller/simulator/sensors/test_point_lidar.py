"""The 3D lidar's grid of points lies on the shapes that its beams meet."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from husky_highlevel_controller.datatypes import Cylinder, Plane, Pose, RobotState
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_highlevel_controller.simulator.sensors.point_lidar import PointLidar
from husky_highlevel_controller.simulator.sensors.raycast import cast_rays, make_scene
from husky_highlevel_controller.simulator.simulator_config import simulator_config

QUIET = replace(simulator_config("smb").points, noise=0.0)
HEIGHT = 0.6427  # [m], of the SMB's lidar above the ground


def points_of(*shapes, yaw=0.0, config=QUIET):
    scene = make_scene([(Plane((0.0, 0.0, 1.0), (100.0, 100.0)), Pose()), *shapes])
    lidar = PointLidar(config, partial(cast_rays, scene), Pose((0.0, 0.0, HEIGHT)))
    lidar.reset(np.random.default_rng(0))
    state = RobotState(Pose((0.0, 0.0, 0.0), quat_from_rpy(0.0, 0.0, yaw)), (0.0,) * 3, (0.0,) * 3)
    return lidar.sample(state)


def test_rings_below_the_horizon_meet_the_ground_all_round():
    points = points_of()
    assert points.shape == (16, 440, 3)
    below = points[:8]
    np.testing.assert_allclose(below[..., 2], -HEIGHT, atol=1e-9)
    elevations = np.linspace(-0.2618, 0.2618, 16)[:8, None]
    np.testing.assert_allclose(
        np.hypot(*below[..., :2].T).T, np.broadcast_to(HEIGHT / np.tan(-elevations), (8, 440))
    )
    assert np.isnan(points[8:]).all()
    azimuths = np.arctan2(below[0, :, 1], below[0, :, 0]) % (2.0 * np.pi)
    np.testing.assert_allclose(azimuths, 2.0 * np.pi / 440 * np.arange(440), atol=1e-9)


def test_a_pillar_on_the_left_is_met_there_by_every_ring_that_gets_there():
    pillar = (Cylinder(0.2, 2.0), Pose((3.0, 4.0, 1.0)))
    for yaw in (0.0, 1.0, -2.5):
        points = points_of(pillar, yaw=yaw)
        c, s = np.cos(yaw), np.sin(yaw)
        x, y, z = points.reshape(-1, 3).T
        east, north = c * x - s * y, s * x + c * y
        on_pillar = np.isclose(np.hypot(east - 3.0, north - 4.0), 0.2, atol=1e-6)
        assert {*np.unique(np.flatnonzero(on_pillar) // 440)} == set(range(4, 16))
        assert (np.hypot(east, north)[on_pillar] < 5.0).all(), "the near side"
        assert ((z > -HEIGHT) & (z < 2.0 - HEIGHT))[on_pillar].all()


def test_what_is_too_near_or_too_far_is_left_out():
    near = (Cylinder(0.2, 2.0), Pose((0.49, 0.0, 1.0)))
    assert np.isnan(points_of(near)[8, 0]).all(), "0.29 m"
    assert np.isfinite(points_of(near, config=replace(QUIET, range_min=0.2))[8, 0]).all()
    assert np.isnan(points_of(config=replace(QUIET, range_max=30.0))[7]).all(), "37 m"


def test_an_odd_number_of_columns_is_refused_by_name():
    with pytest.raises(ValueError, match="columns = 5 is not even"):
        replace(simulator_config("smb").points, columns=5)
