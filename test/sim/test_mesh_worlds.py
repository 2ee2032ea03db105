"""Meshes in the simulation: wheels drive on them, the lidar and the camera see them, walls stop the robot."""

from dataclasses import replace

import numpy as np
import pytest
from stage import HUSKY, body, drive
from trimesh import creation

from husky_highlevel_controller.datatypes import Box
from husky_highlevel_controller.meshes import make_mesh
from husky_highlevel_controller.simulator.bullet.world import PlacementError
from husky_highlevel_controller.simulator.simulator_config import simulator_config

EXACT = replace(simulator_config(), lidar=replace(simulator_config().lidar, noise=0.0))


def mesh_of(*solids):
    """One mesh of solids, and of their triangles once more halved, so that wheels cross edges."""
    triangles = np.concatenate([solid.subdivide().subdivide().triangles for solid in solids])
    return make_mesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))


def box(size, x, y, z):
    return creation.box(size).apply_translation((x, y, z))


HALL = mesh_of(
    box((20.0, 20.0, 0.2), 0.0, 0.0, -0.1),
    box((0.2, 20.0, 3.0), 5.0, 0.0, 1.5),
    box((0.2, 20.0, 3.0), -5.0, 0.0, 1.5),
)


@pytest.fixture
def in_hall(simulate):
    return lambda: simulate(ground=body("hall", HALL), robot=HUSKY, config=EXACT, seed=1)


def test_the_robot_drives_on_a_floor_of_triangles_up_to_a_wall_that_it_sees(in_hall):
    simulation = in_hall()
    start = drive(simulation, 1.0)
    scan = next(s.scan for s in reversed(start) if s.scan is not None)
    middle = scan.ranges[len(scan.ranges) // 2]
    assert middle == pytest.approx(4.9 - 0.337, abs=0.02)
    end = drive(simulation, 4.0, 1.0)
    x, y, z = end[-1].robot.pose_in_world.position
    assert x == pytest.approx(4.0, abs=0.2)
    assert abs(y) < 0.1
    assert z == pytest.approx(start[-1].robot.pose_in_world.position[2], abs=0.005)
    assert drive(simulation, 2.0, 1.0)[-1].contacts == ("hall",)
    assert simulation.step().robot.pose_in_world.position[0] < 4.9 - 0.49 + 0.02


def test_the_same_drive_among_triangles_is_the_same_to_the_last_bit(in_hall):
    def trace():
        simulation = in_hall()
        snapshots = drive(simulation, 2.0, 0.8, 0.5)
        return [s.true_state.to_numbers() for s in snapshots], [
            s.scan.ranges.tolist() for s in snapshots if s.scan
        ]

    assert trace() == trace()


def test_a_ramp_of_triangles_is_climbed(simulate):
    wedge = creation.box((4.0, 3.0, 0.2))
    simulation = simulate(
        body("ramp", mesh_of(wedge), x=3.5, z=0.2, rpy=(0.0, -0.12, 0.0)), robot=HUSKY, config=EXACT, seed=1
    )
    highest = max(s.robot.pose_in_world.position[2] for s in drive(simulation, 6.0, 0.7))
    assert highest > 0.3


def test_a_mesh_that_can_move_is_pushed_and_seen_where_it_is(simulate):
    crate = body("crate", mesh_of(creation.box((0.5, 0.5, 1.0))), x=1.5, z=0.5, mass=4.0)
    simulation = simulate(crate, robot=HUSKY, config=EXACT, seed=1)
    snapshots = drive(simulation, 3.0, 0.5)
    assert simulation.pose_of("crate").position[0] > 1.7
    scan = next(s.scan for s in reversed(snapshots) if s.scan is not None)
    nose = simulation.pose_of("crate").position[0] - 0.25 - snapshots[-1].robot.pose_in_world.position[0]
    assert scan.ranges[len(scan.ranges) // 2] == pytest.approx(nose - 0.337, abs=0.1)


def test_other_things_stand_on_a_mesh_and_a_place_in_it_is_refused(simulate):
    simulation = simulate(body("table", mesh_of(creation.box((2.0, 2.0, 1.0))), x=4.0, z=0.5), seed=1)
    simulation.spawn([body("cup", mesh_of(creation.box((0.2, 0.2, 0.2))), x=4.0, z=1.2, mass=1.0)])
    drive(simulation, 1.0)
    assert simulation.pose_of("cup").position[2] == pytest.approx(1.1, abs=0.01)
    with pytest.raises(PlacementError, match="'post' would stand inside 'table'"):
        simulation.spawn([body("post", Box((0.2, 0.2, 0.4)), x=3.0, z=0.5)])


@pytest.mark.parametrize("top", [0.0342, -0.4, 0.0777])
def test_the_robot_starts_on_a_floor_of_triangles_at_any_height(simulate, top):
    floor = body("floor", mesh_of(creation.box((14.0, 20.0, 0.1))), z=top - 0.05)
    simulation = simulate(ground=floor, robot=HUSKY, config=EXACT, seed=1)
    z = drive(simulation, 0.5)[-1].robot.pose_in_world.position[2]
    assert z == pytest.approx(top + 0.132, abs=0.005)
