"""The course's world and the robot's outline, held to the files that they repeat."""

import xml.etree.ElementTree as ET
from math import cos, pi, sin

import numpy as np
import pytest

from husky_highlevel_controller.course import (
    PILLAR_HEIGHTS,
    PILLAR_NAME,
    PILLAR_POSITION,
    PILLAR_RADIUS,
    course_world,
)
from husky_highlevel_controller.datatypes import Pose2D
from husky_highlevel_controller.footprint import (
    HALF_LENGTH,
    HALF_WIDTH,
    HULL,
    WHEELS,
    clearance,
    clearance_at,
)
from husky_highlevel_controller.simulator.models.husky_xacro import robot_description
from husky_highlevel_controller.simulator.models.robot_model import robot_model
from husky_highlevel_controller.simulator.models.sdf_world import load_world
from husky_highlevel_controller.simulator.simulation import Simulation, SimulatorConfig

URDF = ET.fromstring(robot_description(meshes=""))


def test_the_pillar_is_the_one_in_the_world_file():
    bodies = {body.name: body for body in load_world(course_world()).bodies}
    pillar = bodies[PILLAR_NAME]
    (geometry,) = pillar.collisions
    assert pillar.pose_in_world.position[:2] == PILLAR_POSITION
    assert geometry.shape.radius == PILLAR_RADIUS


def test_the_pillar_s_heights_are_those_at_which_it_stands_in_the_simulation():
    world = load_world(course_world())
    simulation = Simulation(world, robot_model(robot_description(meshes="")), SimulatorConfig(), Pose2D(), 0)
    for _ in range(50):
        simulation.step()
    half = simulation.bodies[PILLAR_NAME].collisions[0].shape.length / 2.0
    middle = simulation.pose_of(PILLAR_NAME).position[2]
    simulation.close()
    assert (middle - half, middle + half) == pytest.approx(PILLAR_HEIGHTS, abs=0.01)


def test_the_hull_is_that_of_the_urdf():
    boxes = [
        [float(edge) for edge in box.get("size").split()]
        for box in URDF.findall("link[@name='base_link']/collision/geometry/box")
    ]
    assert max(x for x, _, _ in boxes) / 2.0 == pytest.approx(HULL[0])
    assert max(y for _, y, _ in boxes) / 2.0 == pytest.approx(HULL[1])


def test_the_wheels_are_those_of_the_urdf():
    origin = URDF.find("joint[@name='front_left_wheel']/origin").get("xyz").split()
    cylinder = URDF.find("link[@name='front_left_wheel_link']/collision/geometry/cylinder")
    x, y = (float(number) for number in origin[:2])
    assert x + float(cylinder.get("radius")) == pytest.approx(WHEELS[0])
    assert y + float(cylinder.get("length")) / 2.0 == pytest.approx(WHEELS[1])


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
    assert clearance_at(x, y) == pytest.approx(distance)


def test_many_points_and_one_agree():
    angles = np.linspace(0.0, 2.0 * pi, 100)
    for radius in (0.3, 0.45, 0.6, 3.0):
        points = np.array([(radius * cos(angle), radius * sin(angle)) for angle in angles])
        assert clearance(points) == pytest.approx([clearance_at(x, y) for x, y in points.tolist()])
