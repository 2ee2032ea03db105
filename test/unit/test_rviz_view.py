"""rviz/controller.rviz, the view of RViz: what the exercise sheets ask for can be seen in it."""

import pytest
import yaml

from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.ros.controller.display import COLORS

PIXELS = 850 / 0.785  # of RViz's window, per radian, with its field of view
FAR = 20.0  # [m], from the start to the pillar
AXIS, LETTER = 0.2, 0.1  # [m], length of a frame's axis and height of its name, for a scale of 1


@pytest.fixture(scope="module")
def displays():
    view = yaml.safe_load((share_folder() / "rviz" / "controller.rviz").read_text())
    return {each["Class"]: each for each in view["Visualization Manager"]["Displays"]}


def test_the_frames_of_odometry_robot_and_lidar_have_names_and_axes_that_are_seen_from_afar(displays):
    tf = displays["rviz/TF"]
    frames = {name for name, frame in tf["Frames"].items() if isinstance(frame, dict) and frame["Value"]}
    assert frames == {"odom", "base_link", "front_laser", "base_laser", "rslidar"}, (
        "of every robot, no others"
    )
    assert tf["Show Axes"], "or there is nothing to see"
    assert tf["Show Names"], "or nobody knows which is which"
    assert tf["Marker Scale"] * AXIS / FAR * PIXELS > 20.0, "an axis has so many pixels"
    assert tf["Marker Scale"] * LETTER < 0.25, "a larger name of base_link would be under the ground"
    assert displays["rviz/RobotModel"]["Alpha"] < 0.9, "the robot would hide the names of its frames"


def test_one_display_shows_each_namespace_once_so_that_it_can_be_switched_off(displays):
    assert "rviz/MarkerArray" not in displays, "rviz/Marker listens to TOPIC_array, too"
    assert displays["rviz/Marker"]["Namespaces"] == dict.fromkeys(COLORS, True)


def test_the_points_of_a_scan_are_large(displays):
    scan = displays["rviz/LaserScan"]
    assert (scan["Style"], scan["Alpha"]) == ("Points", 1)
    assert scan["Size (Pixels)"] >= 10, "at the start three points are on the pillar"
