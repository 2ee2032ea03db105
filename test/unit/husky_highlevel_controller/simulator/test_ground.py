"""Ground: a world that has none where the robot starts gets a plane, and says so."""

import pytest

from husky_highlevel_controller.datatypes import Body, Box, Geometry, Plane, Pose, Pose2D, Sphere, World
from husky_highlevel_controller.simulator.ground import with_ground


def world(shape, *position, drawn=False):
    part = (Geometry(shape),)
    return World("w", (Body("ground_plane", Pose(position), () if drawn else part, part),))


FLOOR = Box((8.0, 4.0, 0.1))


@pytest.mark.parametrize(
    "carried",
    [
        world(Plane((0.0, 0.0, 1.0), (1.0, 1.0)), 50.0, 0.0, 0.0),
        world(FLOOR, 0.0, 0.0, -0.05),
        world(FLOOR, 0.0, 0.0, -9.0),
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
        (world(FLOOR, 0.0, 0.0, -11.0), Pose2D()),
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
