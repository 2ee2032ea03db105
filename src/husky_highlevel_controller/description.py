"""Makes the robot's description: the one URDF that RViz, robot_state_publisher and physics read.

In: arguments. Out: URDF text. Must not know: ROS, PyBullet.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Optional, Sequence

from husky_highlevel_controller.datatypes import HuskyError


class DescriptionError(HuskyError):
    """A robot description that cannot be made or used."""

    def __init__(self, problem: str) -> None:
        super().__init__(f"robot description: {problem}")


def share_folder() -> Path:
    """The package's folder of data files: its source tree, or share/ beside the installed module's lib/.

    Catkin's devel space runs the modules of the source tree, so it needs no case of its own.

    Raises:
        DescriptionError: neither has a folder urdf/.
    """
    here = Path(__file__).resolve()
    candidates = (here.parents[2], here.parents[4] / "share" / here.parent.name)
    for candidate in candidates:
        if (candidate / "urdf").is_dir():
            return candidate
    raise DescriptionError("no folder urdf/ in " + " or ".join(map(str, candidates)))


def mesh_folder() -> str:
    """URI of the Husky's meshes that come with PyBullet; empty where PyBullet is not installed."""
    spec = importlib.util.find_spec("pybullet_data")  # finds it without loading it
    if spec is None or spec.origin is None:
        return ""
    meshes = Path(spec.origin).resolve().parent / "husky" / "meshes"
    return meshes.as_uri() if meshes.is_dir() else ""


def robot_description(
    laser_enabled: bool = True,
    laser_tower: bool = True,
    laser_prefix: str = "front",
    kinect_enabled: bool = False,
    meshes: Optional[str] = None,
) -> str:
    """Expand the Husky's xacro into URDF text.

    Args:
        laser_enabled: whether there is a lidar.
        laser_tower: upside-down, as on the real robot; False is upright.
        laser_prefix: its frames are <prefix>_laser_mount and <prefix>_laser.
        kinect_enabled: whether there is a depth camera on an arch.
        meshes: URI of the folder of meshes; empty for plain shapes, None for those that come with PyBullet.

    Raises:
        DescriptionError: an empty prefix, meshes that are no URI, or no xacro to be found.
    """
    if not laser_prefix:
        raise DescriptionError("laser_prefix is empty; use a name, e.g. front")
    if meshes and "://" not in meshes:
        raise DescriptionError(
            f"meshes is '{meshes}'; use a URI, e.g. file:///opt/meshes or package://name/meshes"
        )
    import xacro  # here, because it is only needed to make a URDF, not to read one

    arguments = {
        "laser_enabled": str(laser_enabled).lower(),
        "laser_tower": str(laser_tower).lower(),
        "laser_prefix": laser_prefix,
        "kinect_enabled": str(kinect_enabled).lower(),
        "meshes": mesh_folder() if meshes is None else meshes,
    }
    source = share_folder() / "urdf" / "husky.urdf.xacro"
    # in lines, because Bullet cuts a URDF's lines after 8 kB
    return str(xacro.process_file(str(source), mappings=arguments).toprettyxml(indent="  "))


def main(arguments: Optional[Sequence[str]] = None) -> None:
    """Print the URDF for `name:=value` arguments; exit with 2 on one that is wrong."""
    try:
        print(robot_description(**_parse_arguments(sys.argv[1:] if arguments is None else arguments)))
    except DescriptionError as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from None


def _parse_arguments(arguments: Sequence[str]) -> dict:
    switches = {"true": True, "1": True, "false": False, "0": False}
    flags = ("laser_enabled", "laser_tower", "kinect_enabled")
    parsed: dict = {}
    for argument in arguments:
        name, separator, value = argument.partition(":=")
        if not separator or name not in (*flags, "laser_prefix", "meshes"):
            raise DescriptionError(
                f"unknown argument '{argument}'; there are laser_enabled:=true|false laser_tower:=true|false "
                "laser_prefix:=NAME kinect_enabled:=true|false meshes:=URI"
            )
        if name in flags:
            if value.lower() not in switches:
                raise DescriptionError(f"{name} is '{value}'; use true or false (or 1 or 0)")
            parsed[name] = switches[value.lower()]
        else:
            parsed[name] = value
    return parsed


if __name__ == "__main__":
    main()
