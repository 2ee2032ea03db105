"""The robot's body for the engine, read from its URDF, and URDF that is refused."""

import xml.etree.ElementTree as ET
from math import cos, pi, sin

import numpy as np
import pybullet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pybullet_utils.bullet_client import BulletClient

from husky_highlevel_controller.geometry import matrix_from_quat, quat_from_rpy
from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.simulator.models.description import (
    robot_description,
)
from husky_highlevel_controller.simulator.models.robot_model import robot_model
from husky_highlevel_controller.urdf import DescriptionError

HUSKY = robot_description()
WHEEL_JOINTS = load_robot().wheels.joints


def small_robot(body="", extra=""):
    """A robot of 10 kg with four wheels; `body` goes into base_link, `extra` beside it."""
    wheels = "".join(
        f"""<link name="{name}_link">
              <inertial><mass value="2"/>
                <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.1"/></inertial>
              <collision><origin rpy="1.5707963267948966 0 0"/>
                <geometry><cylinder radius="0.2" length="0.1"/></geometry></collision>
            </link>
            <joint name="{name}" type="continuous"><origin xyz="{x} {y} 0"/><axis xyz="0 1 0"/>
              <parent link="base_link"/><child link="{name}_link"/></joint>"""
        for name, x, y in zip(WHEEL_JOINTS, (1, 1, -1, -1), (1, -1, 1, -1))
    )
    return f"""<robot name="small"><link name="base_link">
        <inertial><mass value="10"/><inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="2.5"/></inertial>
        {body}</link>{wheels}{extra}</robot>"""


def fixed_to_base(link, inside="", origin=""):
    return f"""<link name="{link}">{inside}</link><joint name="{link}_joint" type="fixed">{origin}
        <parent link="base_link"/><child link="{link}"/></joint>"""


ABOVE = """<link name="base_footprint"/><joint name="up" type="fixed"><origin xyz="0 0 0.2"/>
    <parent link="base_footprint"/><child link="base_link"/></joint>"""


@pytest.mark.parametrize(
    ("text", "frame", "position", "axes"),
    [
        # as the real one hangs
        (HUSKY, "front_laser", (0.3370, 0.0, 0.30795), (1.0, -1.0, -1.0)),
        (robot_description(laser_tower=False), "front_laser", (0.3568, 0.0, 0.28785), (1.0, 1.0, 1.0)),
        # a wheel's radius less its axle's height
        (HUSKY, "base_footprint", (0.0, 0.0, -0.13228), (1.0, 1.0, 1.0)),
        (small_robot(extra=ABOVE), "base_footprint", (0.0, 0.0, -0.2), (1.0, 1.0, 1.0)),
    ],
    ids=["upside down", "upright", "below base_link", "above base_link"],
)
def test_frames_are_where_the_robot_has_them(text, frame, position, axes):
    pose = robot_model(text).fixed_poses[frame]
    assert pose.position == pytest.approx(position)
    assert matrix_from_quat(pose.quat_xyzw) == pytest.approx(np.diag(axes), abs=1e-12)


def test_a_wheel_turns_about_its_axle_from_where_its_joint_puts_it():
    robot = ET.fromstring(HUSKY)
    origin = robot.find("joint[@name='front_left_wheel']/origin")
    origin.set("rpy", "0 0.3 0")
    wheel = robot_model(ET.tostring(robot, encoding="unicode")).wheels[0]
    pose = wheel.pose_at(0.2)
    assert pose.position == pytest.approx(tuple(map(float, origin.get("xyz").split())))
    assert pose.quat_xyzw == pytest.approx((0.0, sin(0.25), 0.0, cos(0.25)))


def test_without_meshes_the_robot_is_drawn_with_plain_shapes_and_is_the_same_in_physics():
    plain = robot_description(meshes="")
    assert not list(ET.fromstring(plain).iter("mesh"))
    assert len(list(ET.fromstring(plain).iter("visual"))) > 15
    assert robot_model(plain).physics_urdf == robot_model(HUSKY).physics_urdf


def test_the_rigid_body_is_the_published_base_lidar_and_wheels_together():
    """Of 46.034, 1.1 and four times 2.637 kg, where husky_description 0.6.10 has them."""
    model = robot_model(HUSKY)
    inertia = [
        [1.705780, -0.049300, -0.211094],
        [-0.049300, 2.807872, 0.000983],
        [-0.211094, 0.000983, 3.870781],
    ]
    assert not model.inertia.flags.writeable
    assert model.mass == pytest.approx(57.682)
    assert model.com == pytest.approx((0.005908, -0.067836, 0.061354), abs=1e-6)
    assert model.inertia == pytest.approx(np.array(inertia), abs=1e-6)


def test_the_wheels_are_the_published_ones():
    wheels = robot_model(HUSKY).wheels
    assert [wheel.joint for wheel in wheels] == list(WHEEL_JOINTS)
    places = [(x, y, 0.03282) for x in (0.256, -0.256) for y in (0.2854, -0.2854)]
    assert [wheel.position for wheel in wheels] == places
    sizes = {(wheel.radius, wheel.width, wheel.mass, wheel.axial_inertia) for wheel in wheels}
    assert sizes == {(0.1651, 0.1143, 2.637, 0.04411)}


@settings(max_examples=50, derandomize=True, deadline=None)
@given(
    st.tuples(*[st.floats(-1, 1)] * 3),
    st.tuples(st.floats(-pi, pi), st.floats(-pi / 2, pi / 2), st.floats(-pi, pi)),
    st.floats(0.1, 20),
)
def test_a_mass_on_a_turned_link_counts_as_if_it_were_on_base_link(xyz, rpy, mass):
    turn, at = matrix_from_quat(quat_from_rpy(*rpy)), np.array(xyz)
    load = f"""<inertial><mass value="{mass!r}"/>
        <inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="2.5"/></inertial>"""
    origin = '<origin xyz="{!r} {!r} {!r}" rpy="{!r} {!r} {!r}"/>'.format(*xyz, *rpy)
    model = robot_model(small_robot(extra=fixed_to_base("load", load, origin)))
    own = np.diag([1.0, 2.0, 2.5])
    reduced = 18.0 * mass / (18.0 + mass)
    alone = robot_model(small_robot()).inertia
    expected = alone + turn @ own @ turn.T + reduced * (at @ at * np.eye(3) - np.outer(at, at))
    assert model.mass == pytest.approx(18.0 + mass)
    assert model.com == pytest.approx(mass * at / (18.0 + mass), abs=1e-12)
    assert model.inertia == pytest.approx(expected, abs=1e-9)


@pytest.fixture
def load(tmp_path):
    """Loads the model of a robot into an engine, base_link in the world's origin: engine, robot, its base."""
    engine = BulletClient(pybullet.DIRECT)

    def loader(model):
        (tmp_path / "robot.urdf").write_text(model.physics_urdf)
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_USE_IMPLICIT_CYLINDER
        robot = engine.loadURDF(str(tmp_path / "robot.urdf"), flags=flags)
        base = engine.getDynamicsInfo(robot, -1)
        engine.resetBasePositionAndOrientation(robot, base[3], base[4])
        return engine, robot, base

    yield loader
    engine.disconnect()


def test_the_engine_has_one_body_with_mass_centre_and_inertia_of_the_model(load):
    model = robot_model(HUSKY)
    engine, robot, (mass, _, inertia, com, quat, *_) = load(model)
    assert engine.getNumJoints(robot) == 0
    assert mass == pytest.approx(model.mass) == pytest.approx(46.034 + 1.1 + 4 * 2.637)
    assert com == pytest.approx(model.com)
    assert sorted(inertia) == pytest.approx(np.linalg.eigvalsh(model.inertia))
    axes = matrix_from_quat(quat)
    assert axes @ np.diag(inertia) @ axes.T == pytest.approx(model.inertia, abs=1e-9)


@pytest.mark.parametrize(
    ("start", "end", "point"),
    [
        ((2, 0, 0.06), (-2, 0, 0.06), (0.4937, 0, 0.06)),  # nose
        ((-2, 0, 0.06), (2, 0, 0.06), (-0.4937, 0, 0.06)),  # tail
        ((2, 0, 0.2), (-2, 0, 0.2), (0.39496, 0, 0.2)),  # upper body
        ((0, 0, 2), (0, 0, -2), (0, 0, 0.2513)),  # top plate
        ((0, 0, -2), (0, 0, 2), (0, 0, 0)),  # underside
        ((0.256, 0.2854, -2), (0.256, 0.2854, 2), (0.256, 0.2854, -0.13228)),  # a wheel's tread
        ((0.256, 0.3354, -2), (0.256, 0.3354, 2), (0.256, 0.3354, 0.03282 - 0.1601)),  # which is round
        ((-0.256, -2, 0), (-0.256, 2, 0), (-0.256, -0.34255, 0)),
    ],
)
def test_the_shapes_are_where_the_robots_are(start, end, point, load):
    engine, *_ = load(robot_model(HUSKY))
    assert engine.rayTest(start, end)[0][3] == pytest.approx(point, abs=1e-5)


def test_collision_meshes_are_left_out():
    mesh = '<collision><geometry><mesh filename="package://some/where.dae"/></geometry></collision>'
    model = robot_model(small_robot(extra=fixed_to_base("plate", mesh)))
    assert "mesh" not in model.physics_urdf


@pytest.mark.parametrize("radius", ["0.01", "0.0100", "0.01000"])  # moves what a cut would cut
def test_a_robot_of_many_shapes_reaches_the_engine_whole(radius, load):
    ball = f'<geometry><sphere radius="{radius}"/></geometry>'
    heights = [i / 7 for i in range(300)]
    balls = [f'<collision><origin xyz="0 0 {height!r}"/>{ball}</collision>' for height in heights]
    engine, robot, _ = load(robot_model(small_robot("".join(balls))))
    shapes = engine.getCollisionShapeData(robot, -1)
    found = [shape[5][2] for shape in shapes if shape[2] == pybullet.GEOM_SPHERE]
    assert sorted(found) == pytest.approx(heights)


@pytest.mark.parametrize("pitch", [-pi / 2, 0.3, pi / 2])
def test_a_tilted_shape_stays_where_it_was_drawn(pitch, load):
    box = f"""<collision><origin xyz="0 0 2" rpy="0.4 {pitch!r} -1.1"/>
        <geometry><box size="0.2 0.4 0.6"/></geometry></collision>"""
    engine, *_ = load(robot_model(small_robot(box)))
    centre = np.array([0.0, 0.0, 2.0])
    for axis, half in zip(matrix_from_quat(quat_from_rpy(0.4, pitch, -1.1)).T, (0.1, 0.2, 0.3)):
        hit = engine.rayTest((centre + axis).tolist(), (centre - axis).tolist())[0]
        assert hit[3] == pytest.approx(centre + half * axis, abs=1e-5)


def husky_with(old, new, count=-1):
    assert old in HUSKY
    return HUSKY.replace(old, new, count)


HEAVY_ROLL = husky_with("2.637", "0.002").replace("0.02467", "100").replace("0.04411", "100")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "is not valid XML"),
        ("<robot>", "is not valid XML"),
        ('<!DOCTYPE r [<!ENTITY e "boo">]><robot>&e;</robot>', "is not valid XML"),
        ("<sdf/>", "the root element is <sdf>"),
        ('<robot><link name="chassis"/></robot>', "no link 'base_link'; there are: chassis"),
        ("<robot><link/></robot>", "a <link> has no name"),
        (
            husky_with('"rear_left_wheel"', '"back_left_wheel"'),
            "no joint 'rear_left_wheel'; the wheels' joints are",
        ),
        (husky_with('"46.034"', '"-46.034"'), "link 'inertial_link': its mass is -46.034"),
        (husky_with('"46.034"', '"nan"'), "link 'inertial_link': value is 'nan'"),
        (husky_with('<mass value="46.034"/>', ""), "link 'inertial_link': value is missing"),
        (husky_with('"0.6022"', '"inf"'), "link 'inertial_link': ixx is 'inf'"),
        (husky_with('"0.6022"', '"-3"'), "principal moments of inertia"),
        (husky_with('"0.6022"', '"1e300"'), "ixx is '1e300'; no number may be beyond 1e+06"),
        (husky_with('"0.6022"', '"9e5"'), "no moment can be above the sum of the other two"),
        (husky_with('value="2.637"', 'value="1e-9"'), "the mass must be at least 0.001 kg"),
        (husky_with('value="2.637"', 'value="5e-324"'), "the mass must be at least 0.001 kg"),
        (HEAVY_ROLL, "radii of gyration must be within 0.0001 and 100 m"),
        (husky_with('length="0.1143"', 'length="3e38"'), "length is '3e38'"),
        (husky_with('value="2.637"', 'value="0"'), "front_left_wheel_link': mass 0.0"),
        (husky_with('xyz="0.19 0 0.149"', 'xyz="0.19 0"'), "'imu_joint': xyz is '0.19 0'; it must be 3"),
        (husky_with('xyz="0.19 0 0.149"', 'xyz="$(imu) 0 0"'), "joint 'imu_joint': xyz is"),
        (husky_with('radius="0.1651"', 'radius="-0.1651"'), "a collision cylinder has"),
        (
            husky_with('radius="0.1651"', 'radius="0.004"'),
            "radius 0.004 m; a wheel's radius must be more",
        ),
        (husky_with("0.2854 ", "0 "), "'front_left_wheel' is not left of joint 'front_right_wheel': y = 0"),
        (husky_with('<axis xyz="0 1 0"/>', '<axis xyz="0 -1 0"/>'), "in base_link, not about 0 1 0"),
        (husky_with('type="continuous"', 'type="fixed"', 1), "joint 'front_left_wheel' is fixed"),
        (husky_with('<child link="imu_link"/>', '<child link="imu"/>'), "its child 'imu' is not a link"),
        (
            husky_with('"imu_joint" type="fixed"', '"imu_joint" type="revolute"'),
            "'imu_link' is neither fixed to",
        ),
        (small_robot("<collision/>"), "link 'base_link': a <collision> needs a <geometry>"),
        (small_robot().replace("<cylinder", "<capsule"), "has no collision cylinder"),
    ],
)
def test_a_description_physics_cannot_use_is_refused_by_name_and_value(text, sentence):
    with pytest.raises(DescriptionError) as refusal:
        robot_model(text)
    assert sentence in str(refusal.value)
