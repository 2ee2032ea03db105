"""Robot model for physics, from a URDF: masses, wheels, collision shapes, mounts of sensors.

In: the text of a URDF of a robot on four wheels. Out: a `RobotModel`.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from types import MappingProxyType
from typing import List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from husky_highlevel_controller import urdf
from husky_highlevel_controller.datatypes import Pose, Vector3
from husky_highlevel_controller.geometry import (
    compose,
    matrix_from_quat,
    quat_from_rpy,
    quat_multiply,
    rotate,
)
from husky_highlevel_controller.robot import Robot, load_robot
from husky_highlevel_controller.urdf import DescriptionError

# The collision shape of a wheel is two cylinders on one axle: a narrow disc, the tread, on which the wheel
# stands, and the flanks, which are as wide as the tyre and have a radius that is smaller by FLANK_DEPTH.
# A single rigid cylinder would stand on one of its two edges, which would change the loads of all wheels.
TREAD_WIDTH = 0.004  # [m]
FLANK_DEPTH = 0.005  # [m] difference between the radius of the tread and the radius of the flanks

# Limits of a robot description. Beyond these limits, numbers in Bullet overflow, and the robot's pose becomes
# NaN without an error.
MIN_MASS = 0.001  # [kg] least mass of the body and of each wheel
MIN_GYRATION, MAX_GYRATION = 1e-4, 100.0  # [m] limits of sqrt(moment of inertia / mass)
# Each moment of inertia may be at most this multiple of the sum of the other two. The exact limit is 1, which
# a flat plate reaches; the rest is a margin for rounding.
FLATNESS = 1.001
MIN_SEPARATION = 0.01  # [m] least distance between the left and the right wheels
MIN_SIZE, MAX_SIZE = 1e-4, 1000.0  # [m] limits of the size of a collision shape


class Inertial(NamedTuple):
    """Mass of a link, or of a rigid body of several links, and how it is distributed."""

    mass: float  # [kg]
    com: Vector3  # [m] centre of mass in base_link
    inertia: np.ndarray  # (3, 3) [kg m^2] inertia about the centre of mass, along base_link's axes


@dataclass(frozen=True)
class Wheel:
    """A driven wheel; it turns about base_link's y axis, forward is positive."""

    joint: str
    link: str
    pose: Pose  # pose of the wheel's link in base_link, when the angle of its joint is 0
    radius: float  # [m] radius of the collision cylinder
    width: float  # [m] width of the collision cylinder
    mass: float  # [kg]
    axial_inertia: float  # [kg m^2] inertia about the axle

    @property
    def position(self) -> Vector3:
        """Centre in base_link [m]."""
        return self.pose.position

    def pose_at(self, angle: float) -> Pose:
        """Return the pose of the wheel's link in base_link when the wheel has turned by an angle [rad]."""
        turned = quat_from_rpy(0.0, angle, 0.0)
        return Pose(self.pose.position, quat_multiply(turned, self.pose.quat_xyzw))


@dataclass(frozen=True, eq=False)
class RobotModel:
    """Robot as physics needs it: one rigid body that stands on four wheels."""

    fixed_poses: Mapping[str, Pose]  # pose in base_link of every link that is fixed to it
    # parent link, child link, and pose of the child in the parent, for each fixed joint
    fixed_joints: Tuple[Tuple[str, str, Pose], ...]
    # name of the lidar's link, at which the rays begin; not in `fixed_poses` if the robot has no lidar
    laser_frame: str
    mass: float  # [kg] mass of the robot, wheels included
    com: Vector3  # [m] centre of mass in base_link, wheels included
    inertia: np.ndarray  # (3, 3) [kg m^2] inertia about com, along base_link's axes, wheels included
    wheels: Tuple[Wheel, ...]  # wheels in the order front left, front right, rear left, rear right
    # URDF for PyBullet: one link, base_link, with the collision shapes of all links, except meshes
    physics_urdf: str

    @property
    def base_height(self) -> float:
        """Height of base_link over level ground on which the wheels stand [m]."""
        return self.wheels[0].radius - self.wheels[0].position[2]


def robot_model(
    urdf_text: str, robot: Optional[Robot] = None, laser_frame: Optional[str] = None
) -> RobotModel:
    """Read a URDF of base_link, four wheels and the links fixed to base_link.

    All links become one rigid body for the physics, wheels included, see `RobotModel.physics_urdf`. A link
    without <inertial> weighs nothing, although PyBullet would give it 1 kg.

    Args:
        urdf_text: the URDF, e.g. the parameter robot_description.
        robot: names of the wheels' joints and of the lidar's link; None for the Husky.
        laser_frame: name of the link in which the beams of the lidar start; None for the name in `robot`. A
            robot without this link has no lidar.

    Raises:
        DescriptionError: the text is not a URDF, a link or joint is missing, or physics cannot use a number.
    """
    robot = robot or load_robot()
    wheel_joints = robot.wheels.joints
    root, links, joints = urdf.read_urdf(urdf_text)
    if "base_link" not in links:
        raise DescriptionError(f"no link 'base_link'; there are: {', '.join(links) or 'none'}")
    for name in wheel_joints:
        if name not in joints:
            raise DescriptionError(f"no joint '{name}'; the wheels' joints are {', '.join(wheel_joints)}")

    # 1. `fixed_joints` has the parent, the child, and the pose of the child in the parent, for each fixed
    # joint. `poses` has the pose of base_link and of all links fixed to it, in base_link.
    joint_elements = [joint for joint in joints.values() if joint.get("type") == "fixed"]
    fixed_joints = urdf.joined_links(links, joint_elements)
    poses = urdf.poses_of_links("base_link", fixed_joints)
    # 2. base_link and all links fixed to it become one body in the new URDF
    physics = ET.Element("robot", name=root.get("name", "robot"))
    base = ET.SubElement(physics, "link", name="base_link")
    fixed_links = [(links[name], pose) for name, pose in poses.items()]
    inertial_without_wheels = _merge([_inertial(link, pose) for link, pose in fixed_links])
    _require_solid(inertial_without_wheels, "base_link's rigid body")
    _write_collisions(base, fixed_links)
    # 3. the wheels are added to this body
    wheels: List[Wheel] = []
    inertials = [inertial_without_wheels]
    for name in wheel_joints:
        wheel, inertial = _write_wheel(base, joints[name], links, poses)
        wheels.append(wheel)
        inertials.append(inertial)
    front_left, front_right, _, _ = wheels
    # `not >=` also refuses a distance of NaN
    if not front_left.position[1] - front_right.position[1] >= MIN_SEPARATION:
        positions = f"y = {front_left.position[1]:g} and {front_right.position[1]:g} m"
        names = f"joint '{front_left.joint}' is not left of joint '{front_right.joint}'"
        raise DescriptionError(f"{names}: {positions}")
    inertial_of_robot = _merge(inertials)
    _write_inertial(base, inertial_of_robot)
    other_links = set(links) - set(poses) - {wheel.link for wheel in wheels}
    if other_links:
        raise DescriptionError(
            f"link '{min(other_links)}' is neither fixed to base_link nor a wheel; only wheels can move"
        )
    for element in physics.iter():
        element.tail = "\n"  # each element ends with a line break, because Bullet cuts lines after 8 kB
    return RobotModel(
        fixed_poses=MappingProxyType(poses),
        fixed_joints=fixed_joints,
        laser_frame=laser_frame or robot.lidar_mount.frame,
        mass=inertial_of_robot.mass,
        com=inertial_of_robot.com,
        inertia=inertial_of_robot.inertia,
        wheels=tuple(wheels),
        physics_urdf=ET.tostring(physics, encoding="unicode"),
    )


def _write_wheel(
    base: ET.Element, joint: ET.Element, links: urdf.Elements, fixed_poses: Mapping[str, Pose]
) -> Tuple[Wheel, Inertial]:
    """Check a wheel, write its collision shapes into base_link, and return the wheel and its inertial.

    The shapes are fixed to base_link and do not turn. They need not turn, because a wheel is round. They only
    carry the robot. They have no friction in Bullet, because `Chassis` computes the forces with which the
    ground drives the robot.

    Args:
        base: <link> of base_link in the URDF for PyBullet, which gets the shapes.
        joint: joint of the wheel.
        links: all links by name.
        fixed_poses: poses in base_link of the links that are fixed to it.

    Raises:
        DescriptionError: joint and link do not describe a wheel that turns about base_link's y axis.
    """
    pose, child = _pose_of_wheel(joint, links, fixed_poses)
    link, link_label = links[child], urdf.label_of(links[child])
    cylinder = link.find("collision/geometry/cylinder")
    if cylinder is None:
        raise DescriptionError(f"{link_label} has no collision cylinder, so the wheel has no radius")
    inertial = _inertial(link, pose)
    _require_solid(inertial, link_label)
    collisions = _write_collisions(base, [(link, pose)])
    radius = urdf.number_of(cylinder, "radius", link_label)
    # a wheel becomes a tread and flanks, see TREAD_WIDTH. The radius of the flanks is smaller by FLANK_DEPTH,
    # and must be more than half of the wheel's radius.
    if not radius > 2.0 * FLANK_DEPTH:
        limit = f"a wheel's radius must be more than {2.0 * FLANK_DEPTH:g} m"
        raise DescriptionError(f"{link_label}: radius {radius:g} m; {limit}")
    for collision in collisions:
        _make_tread_and_flanks(base, collision)
    wheel = Wheel(
        joint=urdf.name_of(joint),
        link=child,
        pose=pose,
        radius=radius,
        width=urdf.number_of(cylinder, "length", link_label),
        mass=inertial.mass,
        axial_inertia=float(inertial.inertia[1, 1]),  # about base_link's y axis, about which the wheel turns
    )
    return wheel, inertial


def _pose_of_wheel(
    joint: ET.Element, links: urdf.Elements, fixed_poses: Mapping[str, Pose]
) -> Tuple[Pose, str]:
    """Return the pose of a wheel's link in base_link, and the name of this link.

    Raises DescriptionError if the joint does not let the link turn about base_link's y axis.
    """
    where = urdf.label_of(joint)
    parent, child = urdf.ends_of(joint, links)
    if joint.get("type") != "continuous" or parent not in fixed_poses:
        raise DescriptionError(
            f"{where} is {joint.get('type')} and on '{parent}'; "
            "a wheel's joint must be continuous and on base_link"
        )
    pose = compose(fixed_poses[parent], urdf.origin_of(joint, where))
    # URDF's default axis is x
    axis = urdf.numbers_of(joint.find("axis"), "xyz", where, 3, (1.0, 0.0, 0.0))
    axis_in_base = rotate(pose.quat_xyzw, axis)
    if not np.allclose(axis_in_base, (0.0, 1.0, 0.0), atol=1e-3):
        raise DescriptionError(f"{where} turns about {axis_in_base} in base_link, not about 0 1 0")
    return pose, child


def _inertial(link: ET.Element, pose_link_in_base: Pose) -> Inertial:
    """Return mass, centre of mass and inertia of a link in base_link; a link without <inertial> weighs 0."""
    where = urdf.label_of(link)
    element = link.find("inertial")
    if element is None:
        return Inertial(0.0, pose_link_in_base.position, np.zeros((3, 3)))
    mass = urdf.number_of(element.find("mass"), "value", where)
    if mass < 0.0:
        raise DescriptionError(f"{where}: its mass is {mass}; it cannot be negative")
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    xx, xy, xz, yy, yz, zz = (urdf.number_of(element.find("inertia"), name, where) for name in names)
    pose = compose(pose_link_in_base, urdf.origin_of(element, where))
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])  # along the axes of <origin>
    turn = matrix_from_quat(pose.quat_xyzw)  # turns vectors from these axes to base_link's axes
    return Inertial(mass, pose.position, turn @ inertia @ turn.T)


def _merge(parts: Sequence[Inertial]) -> Inertial:
    """Return mass, centre of mass and inertia of one rigid body that consists of several parts."""
    mass = float(sum(part_mass for part_mass, _, _ in parts))
    weighted_sum = sum((part_mass * np.array(com) for part_mass, com, _ in parts), np.zeros(3))
    # if no part has a mass, the sum is zero, and a division by 1 leaves it zero
    centre = weighted_sum / (mass or 1.0)
    inertia = np.zeros((3, 3))
    for part_mass, com, about_com in parts:
        # parallel axis theorem: the inertia about a point that is `arm` away from the part's centre of mass
        # is larger by m (|arm|^2 E - arm arm^T), where E is the unit matrix
        arm = np.array(com) - centre
        inertia += about_com + part_mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    inertia.setflags(write=False)  # `RobotModel` is immutable, so its array must not be writable
    x, y, z = centre.tolist()
    return Inertial(mass, (x, y, z), inertia)


def _require_solid(inertial: Inertial, what: str) -> None:
    """Raise DescriptionError if no solid body has this mass and inertia, or if Bullet cannot use them.

    `what` is the name of the body in the message.
    """
    mass, _, inertia = inertial
    moments = np.linalg.eigvalsh(inertia)  # principal moments, ascending [kg m^2]
    least_moment, middle_moment, greatest_moment = moments
    least_allowed, greatest_allowed = mass * MIN_GYRATION**2, mass * MAX_GYRATION**2
    problem = ""
    if mass <= 0.0 or least_moment <= 0.0:
        problem = "they must be positive"
    elif greatest_moment > FLATNESS * (least_moment + middle_moment):
        # Bullet would set all three moments to zero
        problem = "no moment can be above the sum of the other two"
    elif mass < MIN_MASS or least_moment < least_allowed or greatest_moment > greatest_allowed:
        gyration = f"the radii of gyration must be within {MIN_GYRATION} and {MAX_GYRATION:g} m"
        problem = f"the mass must be at least {MIN_MASS} kg, and {gyration}"
    if problem:
        raise DescriptionError(f"{what}: mass {mass}, principal moments of inertia {moments}; {problem}")


def _write_inertial(link: ET.Element, inertial: Inertial) -> None:
    """Write mass, centre of mass and inertia into a link."""
    mass, com, inertia = inertial
    element = ET.SubElement(link, "inertial")
    urdf.write_origin(element, Pose(com))
    ET.SubElement(element, "mass", value=repr(mass))
    # row and column of each attribute in the symmetric matrix
    cells = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ET.SubElement(element, "inertia", {name: repr(float(inertia[cell])) for name, cell in cells.items()})


def _write_collisions(link: ET.Element, sources: Sequence[Tuple[ET.Element, Pose]]) -> List[ET.Element]:
    """Copy the collision shapes of other links, except meshes, into a link, and return the copies.

    Args:
        link: element <link> that gets the copies.
        sources: elements <link> that are copied from, and their poses in `link`.

    Raises:
        DescriptionError: a shape has no supported type, or a size is not within MIN_SIZE and MAX_SIZE.
    """
    copies = []
    for source, pose_of_source in sources:
        for collision in source.findall("collision"):
            where, shape_and_sizes = urdf.label_of(source), urdf.shape_of(collision, urdf.label_of(source))
            if shape_and_sizes is None:
                raise DescriptionError(
                    f"{where}: a <collision> needs a <geometry> of {', '.join(urdf.SIZES)}"
                )
            shape, sizes = shape_and_sizes
            # a mesh is left out, because its file may be one that only RViz can find or read
            if shape.tag == "mesh":
                continue
            if not all(MIN_SIZE <= size <= MAX_SIZE for size in sizes):
                raise DescriptionError(
                    f"{where}: a collision {shape.tag} has {shape.attrib}; "
                    f"sizes must be within {MIN_SIZE} and {MAX_SIZE:g} m"
                )
            written = ET.SubElement(link, "collision")
            urdf.write_origin(written, compose(pose_of_source, urdf.origin_of(collision, where)))
            ET.SubElement(written, "geometry").append(copy.deepcopy(shape))
            copies.append(written)
    return copies


def _make_tread_and_flanks(link: ET.Element, collision: ET.Element) -> None:
    """Replace the cylinder of a wheel's <collision> by two cylinders: a narrow tread, and wider flanks.

    So the wheel stands on its middle, the tread, and not on one of its edges, see TREAD_WIDTH. Any other
    shape, such as a box, stays as it is.
    """
    tread = collision.find("geometry/cylinder")
    if tread is None:
        return
    # a copy of the <collision> becomes the flanks, and the <collision> itself becomes the tread
    flanks_collision = copy.deepcopy(collision)
    flanks = flanks_collision.find("geometry/cylinder")
    assert flanks is not None
    flanks.set("radius", repr(float(tread.attrib["radius"]) - FLANK_DEPTH))
    link.append(flanks_collision)
    tread.set("length", repr(TREAD_WIDTH))
