"""Rays against shapes: held against distance fields, and against closed forms."""

from math import inf, pi
from typing import List, Tuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_highlevel_controller.datatypes import Box, Cylinder, Plane, Pose, Shape, Sphere, beams_at
from husky_highlevel_controller.geometry import matrix_from_quat, quat_from_rpy
from husky_highlevel_controller.simulator.sensors import raycast
from husky_highlevel_controller.simulator.sensors.raycast import cast_rays, make_scene

Placed = List[Tuple[Shape, Pose]]

ORIGIN = Pose()
ALL_ROUND = np.linspace(-pi, pi, 121)
SICK = np.linspace(-2.35619, 2.35619, 720)
REACH = 12.0  # [m]
LAW = settings(derandomize=True, deadline=None, max_examples=60)

edges = st.floats(0.05, 3.0)
angles = st.one_of(st.sampled_from([0.0, pi / 2.0, pi]), st.floats(-pi, pi))
quats = st.builds(quat_from_rpy, angles, angles, angles)
lengths = st.floats(-8.0, 8.0)
# about the laser's height, so that most of them are met
level_poses = st.builds(Pose, st.tuples(lengths, lengths, st.floats(-1.0, 1.0)), quats)
tilts = st.one_of(st.just(0.0), st.floats(-0.3, 0.3))
tilted = st.builds(quat_from_rpy, st.one_of(tilts, st.just(pi)), tilts, angles)
lasers = st.builds(Pose, st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-0.5, 0.5)), tilted)

boxes = st.builds(Box, st.tuples(edges, edges, edges))
cylinders = st.builds(Cylinder, edges, edges)
spheres = st.builds(Sphere, st.floats(0.05, 2.0))
planes = st.just(Plane((0.0, 0.0, 1.0), (1.0, 1.0)))


def worlds(*shapes, most=6):
    return st.lists(st.tuples(st.one_of(*shapes), level_poses), max_size=most)


def cast(world: Placed, laser: Pose = ORIGIN, bearings=ALL_ROUND, reach: float = REACH) -> np.ndarray:
    return cast_rays(make_scene(world), laser, beams_at(bearings), reach)


def ahead(world: Placed, reach: float = REACH) -> float:
    """Range of the beam straight ahead [m]."""
    return float(cast(world, bearings=[0.0], reach=reach)[0])


def at(x: float, y: float = 0.0, z: float = 0.0, roll=0.0, pitch=0.0, yaw=0.0) -> Pose:
    return Pose((x, y, z), quat_from_rpy(roll, pitch, yaw))


# ---------------------------------------------------------------------------- distance fields


def outside_by(shape: Shape, points: np.ndarray) -> np.ndarray:
    """How far points (N, 3) in a shape's frame are from its surface [m]; negative inside a solid."""
    if isinstance(shape, Plane):
        return np.abs(points @ shape.normal)
    if isinstance(shape, Sphere):
        return np.linalg.norm(points, axis=1) - shape.radius
    if isinstance(shape, Box):
        over = np.abs(points) - np.array(shape.size) / 2.0
    else:
        around = np.hypot(points[:, 0], points[:, 1]) - shape.radius
        over = np.column_stack([around, np.abs(points[:, 2]) - shape.length / 2.0])
    return np.linalg.norm(np.maximum(over, 0.0), axis=1) + np.minimum(over.max(axis=1), 0.0)


def clearance(world: Placed, points_in_world: np.ndarray) -> np.ndarray:
    """Distance of points (N, 3) to the nearest surface of a world [m]; negative inside a solid."""
    nearest = np.full(len(points_in_world), np.inf)
    for shape, pose in world:
        points = (points_in_world - pose.position) @ matrix_from_quat(pose.quat_xyzw)
        nearest = np.minimum(nearest, outside_by(shape, points))
    return nearest


def beams_of(laser: Pose, bearings: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Where beams start (3,) and point (N, 3), in the world."""
    flat = np.column_stack([np.cos(bearings), np.sin(bearings), np.zeros(len(bearings))])
    return np.array(laser.position), flat @ matrix_from_quat(laser.quat_xyzw).T


def free_lengths(world: Placed, start: np.ndarray, directions: np.ndarray, reach: float) -> np.ndarray:
    """How far each ray surely flies free [m]: it steps ahead by its clearance as long as there is any."""
    flown = np.zeros(len(directions))
    for _ in range(150):
        left = clearance(world, start + flown[:, None] * directions)
        flown = np.minimum(flown + np.where(left > 1e-7, left, 0.0), reach)
    return flown


@pytest.mark.parametrize("few", [raycast.MAX_ONE_BY_ONE, -1], ids=["one by one", "all at once"])
def test_every_beam_ends_on_the_first_surface_it_meets(few, monkeypatch):
    """Nothing stands before a hit, a hit is on a surface, and a laser inside a solid reads 0."""
    monkeypatch.setattr(raycast, "MAX_ONE_BY_ONE", few)

    @LAW
    @given(st.one_of(worlds(boxes, cylinders, spheres, planes), worlds(cylinders, most=3)), lasers)
    def hold(world, laser):
        got = cast(world, laser)
        start, directions = beams_of(laser, ALL_ROUND)
        if clearance(world, start[None])[0] < -1e-6:
            assert set(got) == {0.0}
            return
        hit = np.isfinite(got)
        points = start + got[hit, None] * directions[hit]
        assert np.abs(clearance(world, points)) == pytest.approx(0.0, abs=1e-6)
        free = free_lengths(world, start, directions, REACH)
        assert np.all(got >= free - 1e-6)
        # where the march stopped, it met something that the ray must not fly through ...
        stops = start + free[:, None] * directions
        blocked = (free < REACH - 1e-6) & (clearance(world, stops + 1e-3 * directions) < -1e-6)
        assert np.all(np.abs(got - free)[blocked] < 1e-3)

    hold()


# ---------------------------------------------------------------------------- plain cases


def test_gazebo_sees_the_same_three_beams_of_the_exercise_s_pillar():
    # Gazebo 11 with husky 0.6.10: pillar at (20, 5), upside-down laser 0.337 m ahead and 0.44 m up
    pillar = (Cylinder(0.2, 2.0), at(20.0, 5.0, 0.5))
    laser = at(0.3370, 0.0, 0.44023, roll=pi)
    ranges = cast([pillar], laser, np.linspace(-2.35619, 2.35619, 720), 30.0)
    assert np.flatnonzero(np.isfinite(ranges)).tolist() == [321, 322, 323]
    assert ranges[321:323] == pytest.approx([20.1020, 20.0986], abs=0.002)
    # on the flank 0.0002 rad of the robot's heading are 0.02 m of range
    assert ranges[323] == pytest.approx(20.2421, abs=0.03)


CUBE, BALL, ROUND = Box((1.0, 1.0, 1.0)), Sphere(0.5), Cylinder(0.5, 2.0)


@pytest.mark.parametrize(
    ("world", "distance"),
    [
        ([], inf),
        ([(Box((1.0, 2.0, 3.0)), at(5.0))], 4.5),
        ([(Box((4.0, 1.0, 1.0)), at(5.0, y=1.5, yaw=pi / 2.0))], 4.5),
        ([(CUBE, at(5.0, yaw=pi / 4.0))], 5.0 - 0.5**0.5),
        ([(CUBE, at(5.0, z=0.51))], inf),
        ([(CUBE, at(5.0, y=0.51))], inf),
        ([(CUBE, at(5.0, y=0.51, yaw=pi / 2.0))], inf),
        ([(CUBE, at(-5.0))], inf),
        ([(CUBE, at(REACH + 0.5))], REACH),
        ([(CUBE, at(REACH + 0.501))], inf),
        ([(BALL, at(5.0, z=0.3))], 5.0 - 0.4),
        ([(BALL, at(5.0, z=-0.51))], inf),
        ([(ROUND, at(5.0, z=1.01))], inf),
        ([(ROUND, at(5.0, z=0.51, roll=pi / 2.0))], inf),
        ([(ROUND, at(5.0, pitch=pi / 2.0))], 4.0),
        ([(BALL, at(7.0)), (BALL, at(5.0)), (BALL, at(9.0))], 4.5),
    ],
)
def test_what_a_beam_straight_ahead_reads(world, distance):
    assert ahead(world) == pytest.approx(distance)


def test_a_far_shape_is_as_exact_as_a_near_one_and_no_beams_read_nothing():
    pillar = [(Cylinder(0.2, 2.0), at(900.0, 0.1))]
    assert ahead(pillar, 1000.0) == pytest.approx(900.0 - 0.03**0.5, abs=1e-9)
    assert cast(pillar, bearings=[]).shape == (0,)


FLOOR = (Plane((0.0, 0.0, 1.0), (1.0, 1.0)), at(0.0))


def test_a_floor_is_met_where_a_tilted_laser_looks_down_as_far_as_the_reach_and_nowhere_by_a_level_one():
    assert set(cast([FLOOR], at(0.0, z=0.5))) == {inf}
    ranges = cast([FLOOR], at(0.0, z=0.5, pitch=pi / 6.0), [-pi / 2.0, 0.0, pi / 3.0, pi])
    assert ranges == pytest.approx([inf, 1.0, 2.0, inf])
    for distance, seen in ((0.999 * REACH, 0.999 * REACH), (1.001 * REACH, inf)):
        laser = at(0.0, z=0.5, pitch=float(np.arcsin(0.5 / distance)))
        assert cast([FLOOR], laser, [0.0]) == pytest.approx([seen])


def test_a_plane_s_normal_is_in_its_own_frame_and_both_sides_are_seen():
    wall = [(Plane((1.0, 0.0, 0.0), (1.0, 1.0)), at(0.0, 3.0, yaw=pi / 2.0))]  # y = 3
    for y, distance in ((0.0, 3.0), (5.0, 2.0), (2.8, 0.2)):
        assert np.nanmin(cast(wall, at(7.0, y))) == pytest.approx(distance, abs=0.01)


@pytest.mark.parametrize("others", [0, raycast.MAX_ONE_BY_ONE])
def test_a_shape_that_moved_is_seen_where_it_is_now(others):
    floor = (Plane((0.0, 0.0, 1.0), (1.0, 1.0)), at(0.0, z=-1.0))
    behind = [(Sphere(0.5), at(-5.0))] * others
    scene = make_scene([(Sphere(0.5), at(5.0)), floor, (Box((1.0, 4.0, 1.0)), at(0.0, 5.0)), *behind])
    scene.move(1, at(3.0, yaw=pi / 2.0))  # the box, second of the solid shapes
    assert cast_rays(scene, Pose(), beams_at([0.0, pi / 2.0]), REACH) == pytest.approx([1.0, inf])


# ---------------------------------------------------------------------------- what is left out


def many_bodies(count: int) -> Placed:
    """Shapes without anything special about where they stand: no ray touches an edge exactly."""
    rng = np.random.default_rng(4)
    world: Placed = []
    for _ in range(count):
        a, b, c = rng.uniform(0.1, 1.5, 3)
        shape = [Box((a, b, c)), Cylinder(a / 2.0, b), Sphere(a / 2.0)][rng.integers(3)]
        x, y = rng.uniform(-50.0, 50.0, 2)
        turned = rng.uniform(-pi, pi, 3) if rng.random() < 0.5 else (0.0, 0.0, rng.uniform(-pi, pi))
        world.append((shape, at(x, y, rng.uniform(-0.3, 0.8), *turned)))
    return world


FIELD = [FLOOR, *many_bodies(1000)]


@settings(LAW, max_examples=10)
@given(st.tuples(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0), st.floats(0.2, 0.8)), tilted)
def test_a_thousand_objects_read_the_same_all_at_once_as_each_alone(position, quat):
    """None is left out that would have been seen."""
    laser = Pose(position, quat)
    each = np.min([cast([body], laser, SICK, 30.0) for body in FIELD], axis=0)
    assert np.isfinite(each).sum() > 100, "there is something to see"
    np.testing.assert_allclose(cast(FIELD, laser, SICK, 30.0), each, rtol=0.0, atol=1e-9)
