"""Gazebo's window has a stand-in: an RViz with the world in its own frame, beside the file's own RViz."""

import pytest
import test_rviz
import yaml
from network import wait_until
from test_rviz import Screen

from husky_highlevel_controller.paths import share_folder

FIELD = """<launch>
  <include file="$(find gazebo_ros)/launch/empty_world.launch">
    <arg name="world_name" value="worlds/robocup14_spl_field.world"/>
  </include>
  <include file="$(find husky_gazebo)/launch/spawn_husky.launch"/>
  <node name="rviz" pkg="rviz" type="rviz"/>
</launch>"""
# of the field's grass and of the goals' posts, in the window alone
COLORS = {
    "the field's green": lambda r, g, b: (g > 80) & (r < 0.5 * g) & (b < 0.6 * g),
    "the goals' yellow": lambda r, g, b: (r > 180) & (g > 0.85 * r) & (b < 0.3 * r),
    "the Husky's yellow": test_rviz.COLORS["the Husky's yellow"],
}


def test_a_window_shows_field_goals_and_robot_beside_the_file_s_own_rviz(launch, ros, tmp_path, monkeypatch):
    monkeypatch.setattr(test_rviz, "COLORS", COLORS)
    (tmp_path / "field.launch").write_text(FIELD)
    screen = Screen(ros)
    launched = launch(tmp_path / "field.launch", DISPLAY=screen.display, GALLIUM_DRIVER="softpipe")
    launched.says("simulating")
    wait_until(lambda: "/tf" in ros.subscriptions("/rviz"), "the file's own RViz is there")
    wait_until(lambda: "/husky_simulator/world_tf" in ros.subscriptions("/gazebo_gui"), "the window is there")
    assert "/tf" not in ros.subscriptions("/gazebo_gui"), "whose frames end at odom"
    for color in COLORS:
        wait_until(lambda color=color: screen.shows(color) > 30, f"{color} is to be seen")
    tree = yaml.safe_load(ros.echo("/husky_simulator/world_tf"))["transforms"]
    heights = {each["child_frame_id"]: each["transform"]["translation"]["z"] for each in tree}
    assert {each["header"]["frame_id"] for each in tree} == {"world", "base_link"}
    # base_link is at z = 0 of odom, so odom is as high as base_link; otherwise the objects sink in
    assert heights["odom"] == pytest.approx(heights["base_link"], abs=0.02)


def test_the_window_shows_a_robot_that_has_a_namespace(launch, ros):
    file = share_folder() / "compat" / "husky_gazebo" / "launch" / "husky_empty_world.launch"
    screen = Screen(ros)
    launched = launch(file, "robot_namespace:=/a", DISPLAY=screen.display, GALLIUM_DRIVER="softpipe")
    launched.says("simulating")
    shown = {"/a/husky_simulator/world_tf", "/a/husky_simulator/world/update"}
    wait_until(lambda: shown <= set(ros.subscriptions("/a/gazebo_gui")), "the window shows its world")
    wait_until(lambda: screen.shows("the Husky's yellow") > 30, "the robot is to be seen")


def test_without_gui_there_is_no_window(launch, ros, tmp_path):
    (tmp_path / "field.launch").write_text(FIELD)
    display, nodes = Screen(ros).display, {}
    for argument, env in (
        ("gui:=true", display),
        ("gui:=false", display),
        ("headless:=true", display),
        ("gui:=true", ""),
    ):
        listed = launch(tmp_path / "field.launch", "--nodes", argument, DISPLAY=env)
        assert listed.wait() == 0, listed.output
        nodes[argument, env] = "/gazebo_gui" in listed.output
    assert [pair for pair, window in nodes.items() if window] == [("gui:=true", display)]
