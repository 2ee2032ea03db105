"""Choice between a user's own robot description and the description from a launch file's arguments.

In: URDF texts. Out: the text that the simulator uses, and a warning for the user.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Iterable, NamedTuple, Optional, Set

from husky_highlevel_controller import urdf
from husky_highlevel_controller.robot import ROBOTS, Robot, load_robot
from husky_highlevel_controller.simulator.models.robot_model import robot_model
from husky_highlevel_controller.urdf import DescriptionError

# environment variable that names the parameter with the user's own robot description
VARIABLE = "HUSKY_SIMULATOR_DESCRIPTION"
# environment variable with the robot's name in Gazebo's topics and services; spawn_model sets it from its
# argument `-model`
MODEL_VARIABLE = "HUSKY_SIMULATOR_MODEL"


def robot_of(text: str) -> Optional[str]:
    """Return the name of the robot of ROBOTS that a URDF text describes; None if it describes another robot.

    The name in the URDF decides. A robot of another name counts, too, if the URDF has the joints of all its
    wheels.

    Raises:
        DescriptionError: the text is not a URDF.
    """
    root, _, joints = urdf.read_urdf(text)
    name = root.get("name")
    if name in ROBOTS:
        return name
    for robot in ROBOTS:
        if set(load_robot(robot).wheels.joints) <= set(joints):
            return robot
    return None


class Choice(NamedTuple):
    """URDF text that the simulator uses, and a warning if a part of the user's text has no effect."""

    text: str
    warning: str


def choose_description(
    own: str, given: str, fully_equipped: Iterable[str], robot: Robot, frames: Iterable[str]
) -> Choice:
    """Choose between a user's own description and the description from a launch file's arguments.

    The user's own description is chosen if the user has added or changed a link or joint, and if the physics
    can use it. Otherwise the description from the arguments is chosen, so that arguments such as
    laser_enabled keep their effect.

    Args:
        own: the user's URDF text.
        given: the robot's URDF text from the arguments.
        fully_equipped: URDF texts of the robot with all its equipment.
        robot: the robot.
        frames: names of links that the simulator's sensors need.
    """
    try:
        # Links and joints that the user has added or changed, as XML. Optional equipment of the robot does
        # not count, because `fully_equipped` contains it.
        added_parts = _parts([own]) - _parts([given, *fully_equipped])
        # `robot_model` raises DescriptionError if the physics cannot use the user's description
        fixed_links = robot_model(own, robot).fixed_poses
    except DescriptionError as error:
        return _refused(given, error.problem, robot)
    if not added_parts:
        return Choice(given, "")
    missing = [frame for frame in frames if frame not in fixed_links]
    if missing:
        return _refused(given, f"no link '{missing[0]}' for a sensor is fixed to base_link", robot)
    # the user's links with a collision mesh; such a mesh has no effect, so a warning names these links
    _, links, _ = urdf.read_urdf(own)
    links_with_mesh = sorted(
        name
        for name, link in links.items()
        if _canonical(link) in added_parts and link.find("collision/geometry/mesh") is not None
    )
    if not links_with_mesh:
        return Choice(own, "")
    remedy = "collision meshes in your robot description have no effect; use a box, cylinder or sphere"
    return Choice(own, f"{remedy}: {', '.join(links_with_mesh)}")


def _refused(given: str, problem: str, robot: Robot) -> Choice:
    """Return the URDF text from the arguments, with a warning about the problem of the user's description."""
    fault = f"your robot description has a fault, so the {robot.title}'s is simulated and shown"
    return Choice(given, f"{fault}: {problem}")


def _parts(texts: Iterable[str]) -> Set[str]:
    """Return the XML of all links and joints of URDF texts, in a form that is equal for equal content."""
    parts: Set[str] = set()
    for text in texts:
        _, links, joints = urdf.read_urdf(text)
        parts.update(_canonical(part) for part in (*links.values(), *joints.values()))
    return parts


def _canonical(element: ET.Element) -> str:
    """Return the XML of an element in a form without unnecessary spaces and with ordered attributes."""
    return ET.canonicalize(ET.tostring(element, encoding="unicode"), strip_text=True)
