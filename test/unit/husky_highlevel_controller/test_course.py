"""The course's world and the robot's outline, held to the files that they repeat."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from husky_highlevel_controller.course import (
    PILLAR_NAME,
    PILLAR_POSITION,
    PILLAR_RADIUS,
    course_world,
)
from husky_highlevel_controller.datatypes import Pose2D
from husky_highlevel_controller.geometry import rotate
from husky_highlevel_controller.robot import ROBOTS, load_robot
from husky_highlevel_controller.simulator.models.description import robot_description
from husky_highlevel_controller.simulator.models.robot_model import robot_model
from husky_highlevel_controller.simulator.models.sdf_world import load_world
from husky_highlevel_controller.simulator.simulation import Simulation
from husky_highlevel_controller.simulator.simulator_config import simulator_config

OUTLINE = load_robot().footprint
HALF_LENGTH, HALF_WIDTH, HULL = OUTLINE.half_length, OUTLINE.half_width, OUTLINE.hull


def test_the_pillar_is_the_one_in_the_world_file_lifted_out_of_the_ground():
    model = robot_model(robot_description("husky", meshes=""), load_robot())
    simulation = Simulation(load_world(course_world()), model, simulator_config(), Pose2D(), 0)
    for _ in range(50):
        simulation.step()
    pillar, middle = simulation.bodies[PILLAR_NAME], simulation.pose_of(PILLAR_NAME).position[2]
    simulation.close()
    (geometry,) = pillar.collisions
    assert pillar.pose_in_world.position[:2] == PILLAR_POSITION
    assert geometry.shape.radius == PILLAR_RADIUS
    half = geometry.shape.length / 2.0
    assert (middle - half, middle + half) == pytest.approx((0.0, 2.0), abs=0.01)


@pytest.mark.parametrize("name", ROBOTS)
def test_outline_lidar_and_masses_are_those_of_the_urdf(name):
    robot, description = load_robot(name), robot_description(name, meshes="")
    outline, model = robot.footprint, robot_model(description, robot)
    boxes = ET.fromstring(description).findall("link/collision/geometry/box")
    longest = max(float(box.get("size").split()[0]) for box in boxes)
    assert longest / 2.0 == pytest.approx(outline.hull[0])
    wheel = model.wheels[0]
    assert wheel.position[0] + wheel.radius == pytest.approx(outline.wheels[0])
    assert wheel.position[1] - wheel.width / 2.0 == pytest.approx(outline.wheels[1])
    assert wheel.position[1] + wheel.width / 2.0 == pytest.approx(outline.wheels[2])
    pose = model.fixed_poses[robot.lidar_mount.frame]
    assert pose.position == pytest.approx((robot.lidar_mount.x, 0.0, robot.lidar_mount.z))
    assert (rotate(pose.quat_xyzw, (0.0, 0.0, 1.0))[2] < 0.0) is robot.lidar_mount.upside_down
    assert model.mass == pytest.approx(robot.hull.mass + 4 * robot.wheels.mass, abs=1.2), "and the lidar"
    assert [wheel.joint for wheel in model.wheels] == list(robot.wheels.joints)


@pytest.mark.parametrize(
    ("x", "y", "distance"),
    [
        (HALF_LENGTH + 1.0, 0.0, 1.0),
        (0.0, -HALF_WIDTH - 1.0, 1.0),
        (-HALF_LENGTH - 0.3, HULL[1] + 0.4, 0.5),
        (0.3, 0.3, 0.0),
        (HALF_LENGTH - 0.02, HULL[1] + 0.02, 0.02),  # in the notch between hull and wheel
    ],
)
def test_clearance_is_the_distance_from_the_union_of_hull_and_wheels(x, y, distance):
    assert OUTLINE.clearance(np.array((x, y))) == pytest.approx(distance)
