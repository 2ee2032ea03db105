"""Plan of a launch file: what it starts, as roslaunch reads it, and what is left out."""

from pathlib import Path

import pytest
from packages import put

from husky_grading.hand_in.plan import misspelt_dependencies, package_path, plan
from husky_grading.isolation.sandbox import Workspace
from husky_grading.records import Launchable
from husky_grading.rubrics.causes import hint_on
from husky_grading.submission import Event


@pytest.mark.parametrize(
    ("path", "read"),
    [
        ("/ws/src/husky", True),
        ("/more/husky", True),
        ("/ws/src/../../home", False),
        ("/", False),
        ("", False),
        ("../../home", False),
    ],
)
@pytest.mark.parametrize("searched", ["/ros", "/ros:", ""])
def test_no_folder_that_a_submission_invents_is_read(searched, path, read, monkeypatch):
    monkeypatch.setenv("ROS_PACKAGE_PATH", searched)
    workspace = Workspace((Path("/ws/devel/setup.bash"),), (Path("/more"),))
    found = package_path([Event("started"), Event("package", path=path)], workspace)
    assert found == (Path(path) if read else None)


def planned(folder, files, tmp_path):
    """The plan of a.launch of a package of these files."""
    for path, text in files.items():
        put(folder / path, text)
    launchable = Launchable("launch", "a", str(folder / "a.launch"))
    return plan(launchable, Workspace(packages=(folder,)), tmp_path / "plan")


NODE = '<node name="n" pkg="p" type="t"/>'


def test_a_launch_file_gets_its_arguments(tmp_path):
    for arguments, node in (((), "husky_controller"), (("naive:=true",), "naive_controller")):
        what = Launchable("launch", "husky_highlevel_controller", "controller.launch", arguments)
        assert plan(what, Workspace(), tmp_path / node).nodes == (f"husky_highlevel_controller/{node}",)


def test_aliases_in_a_parameter_file_are_refused(tmp_path):
    load = '<rosparam command="load" file="$(dirname)/a.yaml"/>'
    files = {"a.yaml": "a: &a [1, 2]\nb: [*a, *a]\n", "a.launch": f"<launch>{load}{NODE}</launch>"}
    made = planned(tmp_path / "aliases", files, tmp_path)
    assert not made.nodes
    assert "YAML aliases are not allowed" in made.notes[0].text


def test_files_of_a_copy_are_found_but_what_starts_a_simulator_is_left_out(tmp_path):
    files = {
        "package.xml": "<package><name>husky_gazebo</name></package>",
        "config/mine.yaml": "gain: 1",
        "launch/spawn_husky.launch": "<launch/>",  # without arguments
        "launch/mine.launch": f"<launch>{NODE}</launch>",
        "a.launch": """<launch>
          <node name="gazebo" pkg="gazebo_ros" type="gzserver" args="$(find husky_gazebo)/a.world"/>
          <node name="post" pkg="gazebo_ros" type="spawn_model" args="-sdf -file post.sdf -model post"/>
          <include file="$(find husky_gazebo)/launch/spawn_husky.launch"><arg name="x" value="1"/></include>
          <include file="$(find husky_gazebo)/launch/mine.launch"/>
          <rosparam command="load" file="$(find husky_gazebo)/config/mine.yaml"/>
        </launch>""",
    }
    made = planned(tmp_path / "husky_gazebo", files, tmp_path)
    assert made.nodes == ("p/t",), made
    assert made.left_out == ("gazebo_ros/gzserver", "gazebo_ros/spawn_model")
    assert made.notes == ()


def test_a_launch_file_without_a_node_is_told_to_start_one(tmp_path):
    made = planned(tmp_path / "empty", {"a.launch": "<launch/>"}, tmp_path)
    (note,) = made.notes
    assert made.is_read
    assert "add <node pkg=" in hint_on(note)
    broken = planned(tmp_path / "broken", {"a.launch": "<launch>"}, tmp_path)
    assert "prints the same error" in hint_on(broken.notes[0])


@pytest.mark.parametrize(
    ("dependency", "is_told"), [("sensor_msg", True), ("sensor_msgs", False), ("no_such_package", False)]
)
def test_a_misspelt_dependency_is_told_with_the_package_that_is_meant(dependency, is_told, tmp_path):
    put(tmp_path / "a" / "package.xml", f"<package><name>a</name><depend>{dependency}</depend></package>")
    told = misspelt_dependencies(tmp_path / "a", Workspace(packages=(tmp_path,)))
    assert len(told) == is_told
    assert all("did you mean 'sensor_msgs'?" in sentence for sentence in told)
    assert misspelt_dependencies(tmp_path / "none", Workspace()) == []
