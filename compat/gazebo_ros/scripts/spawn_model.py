"""Node that puts a model into this package's simulator, with the arguments of gazebo_ros's spawn_model.

The URDF of a Husky or an SMB is the robot: it starts the simulator, as husky_gazebo's spawn_husky does.
What the URDF adds to the robot is simulated with it.

Stands in for spawn_model of gazebo_ros 2.9 (Noetic). No test runs the original, which Debian does not have.
test/ros/test_run.py and test/ros/test_sheets_launch_file.py launch this node with the original's arguments.
"""

import argparse
import os
import sys
import time
from pathlib import Path

import rospy
import rosservice
from gazebo_msgs.srv import SpawnModel
from geometry_msgs.msg import Point, Pose, Quaternion
from std_srvs.srv import Empty

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_highlevel_controller.simulator.models.own_description import MODEL_VARIABLE, VARIABLE, robot_of

SPAWN_HUSKY = Path(__file__).resolve().parents[2] / "husky_gazebo" / "scripts" / "spawn_husky"
OWN = "/own_robot_description"  # parameter that takes the robot's URDF to the simulator's launch file
ARGUMENTS = "HUSKY_SIMULATOR_ARGUMENTS"  # variable with arguments of simulator.launch; the last one counts
QUIET = 10.0  # [s] wall time without a simulator after which the node logs that it waits


def parse() -> argparse.Namespace:
    """The arguments of gazebo_ros's spawn_model."""
    parser = argparse.ArgumentParser("spawn_model", allow_abbrev=False)
    form = parser.add_mutually_exclusive_group(required=True)
    form.add_argument("-urdf", action="store_true")
    form.add_argument("-sdf", action="store_true")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("-file")
    source.add_argument("-param")
    source.add_argument("-database")
    source.add_argument("-stdin", action="store_true")
    parser.add_argument("-model", required=True)
    parser.add_argument("-reference_frame", default="")
    parser.add_argument("-unpause", action="store_true")
    for axis in ("-x", "-y", "-z", "-R", "-P", "-Y"):
        parser.add_argument(axis, type=float, default=0.0)
    # without effect
    for option in ("-gazebo_namespace", "-robot_namespace", "-wait"):
        parser.add_argument(option)
    parser.add_argument("-J", nargs=2, action="append")
    for option in ("-package_to_model", "-b", "-gazebo"):
        parser.add_argument(option, action="store_true")
    return parser.parse_args(rospy.myargv()[1:])


def read_xml(given: argparse.Namespace) -> str:
    """The text of the model."""
    if given.file:
        return Path(given.file).read_text()
    if given.param:
        return str(rospy.get_param(given.param))
    if given.stdin:
        return sys.stdin.read()
    return f'<sdf version="1.6"><model><include><uri>model://{given.database}</uri></include></model></sdf>'


def find_service(name: str) -> str:
    """Wait for a simulator, and return the full name of its service gazebo/NAME."""
    start, told = time.monotonic(), False
    while not rospy.is_shutdown():
        names = [each for each in rosservice.get_service_list() if each.endswith(f"/gazebo/{name}")]
        if names:
            return names[0]
        if not told and time.monotonic() > start + QUIET:
            told = True
            rospy.logwarn("waiting for a robot: husky_gazebo/launch/spawn_husky.launch starts the simulator")
        time.sleep(0.2)
    raise SystemExit(0)


def main() -> None:
    """Spawn the model; exit with 1 and the reason if that fails."""
    given = parse()
    try:
        xml = read_xml(given)
        robot = robot_of(xml) if given.urdf else None
    except (OSError, KeyError, ValueError, HuskyError) as error:
        raise SystemExit(f"spawn_model: '{given.model}': {error}") from None
    if robot is not None:
        rospy.set_param(OWN, xml)
        os.environ.update({VARIABLE: OWN, MODEL_VARIABLE: given.model})
        pose = [f"x:={given.x}", f"y:={given.y}", f"z:={given.z}", f"yaw:={given.Y}"]
        # the SMB's /scan is made of its cloud, by a node of its launch files
        scans = ["laser_topic:=husky_simulator/plane_scan"] * (robot == "smb")
        if given.unpause:  # the simulator begins with the robot, so it begins without a pause
            os.environ[ARGUMENTS] = f"{os.environ.get(ARGUMENTS, '')} paused:=false"
        os.execv(SPAWN_HUSKY, ["spawn_husky", f"robot:={robot}", *pose, *scans])
    rospy.init_node("spawn_model", anonymous=True)
    pose = Pose(Point(given.x, given.y, given.z), Quaternion(*quat_from_rpy(given.R, given.P, given.Y)))
    spawn = rospy.ServiceProxy(
        find_service("spawn_sdf_model" if given.sdf else "spawn_urdf_model"), SpawnModel
    )
    response = spawn(
        model_name=given.model, model_xml=xml, initial_pose=pose, reference_frame=given.reference_frame
    )
    if not response.success:
        raise SystemExit(f"spawn_model: {response.status_message}")
    rospy.loginfo(response.status_message)
    if given.unpause:
        rospy.ServiceProxy(find_service("unpause_physics"), Empty)()


if __name__ == "__main__":
    main()
