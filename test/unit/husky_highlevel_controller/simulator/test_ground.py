"""Ground: a world that has none where the robot starts gets a plane, and says so."""

import pytest

from husky_highlevel_controller.datatypes import Body, Box, Geometry, Plane, Pose, Pose2D, Sphere, World
from husky_highlevel_controller.simulator.ground import floor_height, with_ground
from husky_highlevel_controller.simulator.sensors.raycast import make_scene


def world(shape, *position, drawn=False):
    part = (Geometry(shape),)
    return World("w", (Body("ground_plane", Pose(position), () if drawn else part, part),))


FLOOR = Box((8.0, 4.0, 0.1))


@pytest.mark.parametrize(
    "carried",
    [
        world(Plane((0.0, 0.0, 1.0), (1.0, 1.0)), 50.0, 0.0, 0.0),
        world(FLOOR, 0.0, 0.0, -0.05),
        world(FLOOR, 0.0, 0.0, -50.0),
        world(FLOOR, 3.0, 1.0, -0.05),
        world(Sphere(100.0), 0.0, 0.0, -100.0),
    ],
)
def test_a_world_that_carries_the_robot_stays_as_it_is(carried, caplog):
    assert with_ground(carried, Pose2D()) is carried
    assert not caplog.records


@pytest.mark.parametrize(
    ("groundless", "start"),
    [
        (World("w", ()), Pose2D()),
        (world(FLOOR, 0.0, 0.0, -0.05), Pose2D(5.0, 0.0)),
        (world(FLOOR, 0.0, 0.0, -0.05), Pose2D(0.0, -3.0)),
        (world(FLOOR, 0.0, 0.0, 3.0), Pose2D()),
        (world(FLOOR, 0.0, 0.0, -0.05, drawn=True), Pose2D()),
    ],
)
def test_one_without_ground_gets_a_plane_with_a_warning(groundless, start, caplog):
    (*bodies, ground) = with_ground(groundless, start).bodies
    assert tuple(bodies) == groundless.bodies
    assert ground.collisions[0].shape == Plane((0.0, 0.0, 1.0), (100.0, 100.0))
    assert (ground.pose_in_world, ground.mass) == (Pose(), 0.0)
    assert ground.name not in {body.name for body in bodies}
    (message,) = caplog.messages
    assert f"'w' has no ground at ({start.x:g}, {start.y:g})" in message


SLAB = Box((8.0, 8.0, 1.0))


@pytest.mark.parametrize(
    ("shape", "middle", "height", "floor"),
    [
        (SLAB, -0.5, 0.0, 0.0),
        *[(SLAB, top - 0.5, 0.0, top) for top in (0.05, 0.2, 0.3, 0.5, -0.4, -3.0)],
        (SLAB, 2.0, 2.0, 0.5),  # from inside it
        (SLAB, 2.0, 6.0, -3.5),  # from above it
        (Box((1.0, 1.0, 1.0)), 0.3, 0.0, 0.0),  # an obstacle
        (Box((8.0, 8.0, 5.0)), 0.0, 0.0, 2.5),
        (SLAB, 2.0, 0.0, 0.0),  # a roof
        (Sphere(20.0), 0.0, 0.0, 0.0),  # no end in sight
    ],
)
def test_the_floor_is_what_is_under_all_wheels_at_any_height(shape, middle, height, floor):
    scene = make_scene([(shape, Pose((0.0, 0.0, middle)))])
    assert floor_height(scene, Pose((0.0, 0.0, height))) == pytest.approx(floor, abs=1e-6)


def test_on_uneven_ground_the_floor_is_above_its_highest_point():
    step = (Box((8.0, 8.0, 1.0)), Pose((4.2, 0.0, -0.45)))  # 0.05 m high, from x = 0.2 m on
    scene = make_scene([(SLAB, Pose((0.0, 0.0, -0.5))), step])
    for height in (0.0, 3.0, -0.05):
        found = height + floor_height(scene, Pose((0.0, 0.0, height)))
        assert found == pytest.approx(0.07, abs=1e-6)
    high_step = (Box((8.0, 8.0, 1.0)), Pose((4.2, 0.0, -0.1)))
    edge = make_scene([(SLAB, Pose((0.0, 0.0, -0.5))), high_step])
    assert floor_height(edge, Pose()) == 0.0, "an edge is no floor"


def test_a_start_below_the_ground_needs_no_second_ground(caplog):
    ground = world(Plane((0.0, 0.0, 1.0), (1.0, 1.0)), 0.0, 0.0, 0.0)
    assert with_ground(ground, Pose2D(), -0.3) is ground
    assert with_ground(ground, Pose2D(), 50.0) is ground


def test_ground_is_looked_for_from_the_height_at_which_the_robot_starts():
    upstairs = world(FLOOR, 0.0, 0.0, 3.0)
    assert with_ground(upstairs, Pose2D(), 3.2) is upstairs
