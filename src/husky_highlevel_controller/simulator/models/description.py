"""Robot description: expands a robot's xacro into the URDF of RViz, robot_state_publisher and physics.

In: arguments, a user's own description on the parameter server. Out: URDF text.
"""

from __future__ import annotations

import os
import re
import sys
from typing import Any, Dict, List, Mapping, Optional

from husky_highlevel_controller.paths import mesh_folder, share_folder
from husky_highlevel_controller.robot import ROBOTS, VERSIONS, load_robot
from husky_highlevel_controller.simulator.models.own_description import VARIABLE, choose_description
from husky_highlevel_controller.urdf import DescriptionError

FLAGS = ("true", "false", "True", "False", "1", "0")
_FLAG = ("|".join(FLAGS), "true|false")  # entry of ARGUMENTS for a flag
_CALLER = "/robot_description"  # name that this program tells the ROS master
CAMERA_FRAME = "camera_frame_optical"
_NUMBER = r"[-+]?\d*\.?\d+(?:[eE][-+]?\d+)?"
_TRIPLE = rf"\s*{_NUMBER}\s+{_NUMBER}\s+{_NUMBER}\s*"  # pattern of three numbers
# environment variables that set arguments of the lidar's mount
LIDAR_VARIABLES = {"laser_xyz": "HUSKY_LMS1XX_XYZ", "laser_rpy": "HUSKY_LMS1XX_RPY"}
# Patterns of environment variables of the Husky's launch files that cause no warning: the variables that have
# an effect in this simulator, and the variables of drivers, which a simulation does not need.
_SUPPORTED_VARIABLES = r"\w*LMS1XX_(ENABLED|TOPIC|PREFIX|TOWER|XYZ|RPY)|HUSKY_(KINECT_ENABLED|SIMULATOR_\w+)"
_DRIVER_VARIABLES = r"\w*_(PORT|IP|HOST|BAUD|DEVICE|LOGITECH)"
# For each argument, the pattern of its values, and a text that describes these values for the user. No
# pattern accepts a `$`, because xacro would read it as the beginning of an expression.
ARGUMENTS = {
    "robot": ("|".join((*ROBOTS, *VERSIONS)), "|".join((*ROBOTS, *VERSIONS))),
    "laser_enabled": _FLAG,
    "laser_tower": _FLAG,
    "laser_prefix": (r"[\w./-]+", "a name, e.g. front"),
    "laser_xyz": (_TRIPLE, "three numbers [m], e.g. HUSKY_LMS1XX_XYZ='0.2206 0 0.00635'"),
    "laser_rpy": (_TRIPLE, "three numbers [rad], e.g. HUSKY_LMS1XX_RPY='0 0 0'"),
    "kinect_enabled": _FLAG,
    "profile": ("gazebo|robot", "gazebo|robot"),
    "meshes": (r"([\w.+-]+://[^$]+)?", "a URI, e.g. file:///opt/meshes or package://name/meshes"),
}


def variables_without_effect(environment: Mapping[str, str]) -> List[str]:
    """Return NAME=VALUE of each HUSKY_ variable that is set, but has no effect in this simulator.

    The user gets a warning about these variables. Variables that are set to false are not returned, nor are
    variables of drivers, because drivers are not simulated.
    """
    without_warning = re.compile(f"{_SUPPORTED_VARIABLES}|{_DRIVER_VARIABLES}")
    return [
        f"{name}={value}"
        for name, value in sorted(environment.items())
        if name.startswith("HUSKY_")
        and value not in ("", "0", "false", "False")
        and not without_warning.fullmatch(name)
    ]


def mesh_uri() -> str:
    """URI of the folder of the Husky's meshes; empty if there is none."""
    folder = mesh_folder()
    return folder.as_uri() if folder else ""


def robot_description(robot: str = "husky", meshes: Optional[str] = None, **arguments: Any) -> str:
    """Expand the xacro of one of ROBOTS into URDF text.

    Args:
        robot: name of the robot.
        meshes: URI of the folder of meshes; empty for plain shapes, None for the meshes from PyBullet.
        **arguments: any other ARGUMENTS; these arguments have an effect on the Husky only.

    Raises:
        DescriptionError: an argument is unknown, or its value is not valid.
    """
    arguments = {name: str(value) for name, value in arguments.items()}
    arguments.update(robot=robot, meshes=mesh_uri() if meshes is None else meshes)
    for name, value in arguments.items():
        if name not in ARGUMENTS:
            usage = " ".join(f"{argument}:={form}" for argument, (_, form) in ARGUMENTS.items())
            raise DescriptionError(f"unknown argument '{name}'; there are {usage}")
        pattern, form = ARGUMENTS[name]
        if not re.fullmatch(pattern, value):
            raise DescriptionError(f"{name} is '{value}'; use {form}")
    import xacro  # imported only here, because only making a URDF needs xacro

    source = share_folder() / "urdf" / load_robot(robot).description
    # Python writes True and False, but xacro reads true and false
    mappings = {name: value.lower() if value in FLAGS else value for name, value in arguments.items()}
    # the URDF is written in short lines, because Bullet cuts lines after 8 kB
    return str(xacro.process_file(str(source), mappings=mappings).toprettyxml(indent="  "))


def _own_or_given(given: str, arguments: Mapping[str, str]) -> str:
    """Return the user's own description if the simulator can use it, otherwise the given description.

    Args:
        given: URDF text that the arguments produce.
        arguments: arguments of the command line by name, see ARGUMENTS.

    Raises:
        DescriptionError: the user's own description is not a text.
    """
    own = _own_description()
    name = arguments.get("robot", "husky")
    # To find the parts that the user has added, the user's description is compared with descriptions that
    # have all equipment of the robot. The user may have started from the description with meshes (None) or
    # with plain shapes (""), so there is one of each.
    fully_equipped = [robot_description(name, meshes, kinect_enabled=True) for meshes in (None, "")]
    sensor_frames = _sensor_frames(name, arguments)
    text, warning = choose_description(own, given, fully_equipped, load_robot(name), sensor_frames)
    if warning:
        print(f"warning: {warning}", file=sys.stderr)
    return text


def _own_description() -> str:
    """Return the user's own description from the parameter server. Raises DescriptionError if it is not text.

    A launch file may spawn a robot of its own description by spawn_model. Then this description is on the
    parameter server, and the environment variable VARIABLE has the name of its parameter.
    """
    # imported only here, because every launch waits for this program, but few launches need `ask`
    from husky_highlevel_controller.xml_rpc import ask

    master_uri, parameter = os.environ.get("ROS_MASTER_URI", "http://localhost:11311"), os.environ[VARIABLE]
    own = ask(master_uri, "getParam", _CALLER, parameter)
    if not isinstance(own, str):
        raise DescriptionError(
            f"{VARIABLE} names the parameter {parameter}, which holds no robot description; set it to a URDF"
        )
    return own


def _sensor_frames(robot: str, arguments: Mapping[str, str]) -> List[str]:
    """Return the names of the frames of the sensors that the arguments enable on a robot of ROBOTS."""
    frames = []
    if _is_true(arguments.get("laser_enabled", "true")):
        if robot == "smb":
            frames.append(load_robot(robot).lidar_mount.frame)
        else:
            # only on the Husky, the argument laser_prefix changes the name of the lidar's frame
            frames.append(f"{arguments.get('laser_prefix', 'front')}_laser")
    if _is_true(arguments.get("kinect_enabled", "false")):
        frames.append(CAMERA_FRAME)
    return frames


def _is_true(flag: str) -> bool:
    return flag.lower() in ("true", "1")


def main() -> None:
    """Print the URDF for `name:=value` arguments; exit with 2 if an argument is wrong.

    If HUSKY_SIMULATOR_DESCRIPTION is set (by spawn_model), print the user's own description instead of the
    URDF for the arguments, if the simulator can use it.
    """
    arguments: Dict[str, str] = {}
    for argument in sys.argv[1:]:
        name, _, value = argument.partition(":=")
        arguments[name] = value
    # pose of the lidar from environment variables, unless an argument gives it
    mount = {
        name: os.environ[variable] for name, variable in LIDAR_VARIABLES.items() if variable in os.environ
    }
    try:
        text = robot_description(**{**mount, **arguments})
        if VARIABLE in os.environ:
            text = _own_or_given(text, arguments)
        print(text)
    except DescriptionError as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from None
