"""Packages of a person's own: `./dev launch` and `./dev run` find them in the same places."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from husky_highlevel_controller.paths import share_folder

ROOT = share_folder()
sys.path.append(str(ROOT / "tools"))
import find_packages  # noqa: E402
import run  # noqa: E402

# program that does what tools/run.py does, but finds no packages next to this clone
RUN_WITHOUT_NEIGHBOURS = f"""
import sys
from pathlib import Path
sys.path.insert(0, {str(ROOT / "tools")!r})
import find_packages, run
find_packages.NEIGHBOURHOOD = Path({str(ROOT / "nothing")!r})
run.main()
"""
MANIFEST = "<package><name>{}</name><version>0.0.0</version></package>"


def package(folder: Path, *files: str, name: str = "") -> Path:
    for file in ("package.xml", *files):
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_text(MANIFEST.format(name or folder.name))
    return folder


@pytest.fixture(autouse=True)
def no_packages_of_this_machine(monkeypatch, tmp_path):
    """Hide the packages of the shell that runs the tests, and those next to this clone.

    One of them may have a name that a test uses.
    """
    monkeypatch.setenv("ROS_PACKAGE_PATH", "")
    monkeypatch.setattr(find_packages, "NEIGHBOURHOOD", tmp_path / "nothing")


@pytest.fixture
def workspace(tmp_path, monkeypatch):
    """A built workspace with a repository of several packages, in a home folder with other things in it."""
    home = tmp_path / "home"
    monkeypatch.setenv("HOME", str(home))
    workspace = home / "catkin_ws"
    (workspace / "devel").mkdir(parents=True)
    package(workspace / "src" / "lab_repo" / "lab_robot", "launch/drive.launch")
    package(workspace / "src" / "it's a repo" / "quoted", "launch/quoted.launch")
    package(workspace / "build" / "stale", "launch/drive.launch")
    package(workspace / "src" / "left_out" / "ignored")
    (workspace / "src" / "left_out" / "CATKIN_IGNORE").touch()
    (workspace / "src" / "broken").mkdir()
    (workspace / "src" / "broken" / "package.xml").write_text("<a")
    return workspace


def test_a_link_that_leads_nowhere_hides_no_package(tmp_path):
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "gone").symlink_to(tmp_path / "nothing")
    package(tmp_path / "lab_robot")
    assert [name for name, _ in find_packages.packages_below(tmp_path)] == ["lab_robot"]


@pytest.mark.parametrize(
    "place", [".", "..", "src", "devel", "src/lab_repo", "src/lab_repo/lab_robot/launch"]
)
def test_packages_are_found_from_anywhere_in_a_workspace(place, workspace):
    caller = (workspace / place).resolve()
    lab_robot = workspace / "src" / "lab_repo" / "lab_robot"
    found = find_packages.find_file("lab_robot", "drive.launch", caller)
    assert found == lab_robot / "launch" / "drive.launch"
    paths = find_packages.add_packages([], caller)
    assert {str(lab_robot), str(workspace / "src" / "it's a repo" / "quoted")} <= set(paths)
    assert not [path for path in paths if path.endswith(("stale", "ignored", "broken"))]


def test_what_roslaunch_would_find_by_itself_stays_in_front(workspace):
    other = package(workspace.parent / "elsewhere" / "deep" / "er" / "lab_robot", "launch/drive.launch")
    paths = find_packages.add_packages([str(other)], workspace)
    assert paths[0] == str(other)
    assert str(workspace / "src" / "lab_repo" / "lab_robot") not in paths


def test_a_hand_in_that_stands_around_does_not_hide_the_simulator(workspace):
    package(workspace / "src" / "hand_in", name=find_packages.PACKAGE)
    assert not [path for path in find_packages.add_packages([], workspace) if path.endswith("hand_in")]
    own = find_packages.find_file(find_packages.PACKAGE, "controller.launch", workspace)
    assert own == ROOT / "launch" / "controller.launch"


def test_a_launch_file_of_a_stand_in_is_found(workspace):
    file = find_packages.find_file("husky_gazebo", "husky_empty_world.launch", workspace)
    assert file == ROOT / "compat" / "husky_gazebo" / "launch" / "husky_empty_world.launch"
    copy = package(workspace / "src" / "husky_gazebo", "launch/husky_empty_world.launch")
    file = find_packages.find_file("husky_gazebo", "husky_empty_world.launch", workspace)
    assert file == copy / "launch" / "husky_empty_world.launch"
    assert find_packages.find_file("husky_gazebo", "other.launch", workspace) is None


def test_the_words_of_a_command_keep_their_blanks_and_quotes(workspace):
    words = ["-p", "1", "quoted", "quoted.launch", "name:=it's a b", "theirs", "a.launch"]
    path = workspace / "src" / "it's a repo" / "quoted" / "launch" / "quoted.launch"
    assert run.with_path(words, workspace) == ["-p", "1", str(path), *words[4:]]


def test_a_class_in_a_package_does_not_hide_its_launch_files(tmp_path):
    repository = package(tmp_path / "lab", "launch/drive.launch", "class/ann/launch/drive.launch")
    found = find_packages.find_file("lab", "drive.launch", repository)
    assert found == repository / "launch" / "drive.launch"


def test_the_workspace_of_a_compiled_package_next_to_the_clone_is_sourced(tmp_path, monkeypatch):
    workspace = tmp_path / "my_husky_ws"
    package(workspace / "src" / "my_husky")
    (workspace / "devel").mkdir()
    (workspace / "devel" / "setup.bash").write_text("export SOURCED=yes\n")
    monkeypatch.setattr(find_packages, "PACKAGE_FOLDER", tmp_path / "clone")
    monkeypatch.setattr(find_packages, "NEIGHBOURHOOD", tmp_path)
    monkeypatch.setattr(run.os, "execvp", lambda *_: None)
    monkeypatch.setattr(sys, "argv", ["run.py", "rosrun", "my_husky", "drive"])
    monkeypatch.delenv("SOURCED", raising=False)
    (tmp_path / "clone").mkdir()
    monkeypatch.chdir(tmp_path / "clone")
    old = dict(os.environ)
    try:
        run.main()
        assert os.environ.get("SOURCED") == "yes"
    finally:
        os.environ.clear()
        os.environ.update(old)


def test_marking_does_not_see_what_lies_beside_it():
    grade = ["rosrun", find_packages.PACKAGE, "grade"]
    assert not run.sees_neighbours([*grade, "--all", "."])
    assert run.sees_neighbours([*grade, "--launch", "their_package", "x.launch"])
    assert run.sees_neighbours(["rosrun", "their_package", find_packages.PACKAGE])
    assert run.sees_neighbours(["roslaunch", find_packages.PACKAGE, "x.launch"])


def test_a_script_without_its_first_line_gets_one_line_of_advice(tmp_path, monkeypatch):
    script = tmp_path / "drive.py"
    script.write_text("import rospy\n")
    script.chmod(0o755)
    monkeypatch.setattr(sys, "argv", ["run.py", str(script)])
    monkeypatch.setattr(os, "environ", dict(os.environ))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match=f"type: ./dev run python3 {script}"):
        run.main()


def test_the_environment_of_a_command_has_packages_and_stand_ins(workspace):
    (workspace / "devel" / "setup.bash").write_text('export SOURCED="$1 it\'s\nhere"')
    command = [
        sys.executable,
        "-c",
        RUN_WITHOUT_NEIGHBOURS,
        "bash",
        "-c",
        'echo "$SOURCED"; echo "$ROS_PACKAGE_PATH"',
    ]
    env = {**os.environ, "ROS_HOME": str(workspace / "ros")}
    done = subprocess.run(command, cwd=workspace / "src", env=env, capture_output=True, text=True, check=True)
    *sourced, paths = done.stdout.splitlines()
    assert sourced == ["--extend it's", "here"]
    assert str(workspace / "src" / "lab_repo" / "lab_robot") in paths.split(os.pathsep)
    assert str(ROOT / "compat" / "gazebo_ros") in paths.split(os.pathsep)


def test_each_launch_file_of_this_package_is_the_only_one_of_its_name():
    """Plain roslaunch refuses `roslaunch PACKAGE FILE` where a package has two files of that name."""
    own = {file.name for file in (ROOT / "launch").iterdir()}
    others = [file for place in ("compat", "test", "examples") for file in (ROOT / place).rglob("*.launch")]
    assert [file for file in others if file.name in own] == []


def test_a_misspelt_dependency_of_a_person_s_package_is_told_and_none_of_ours(tmp_path):
    mine, course = package(tmp_path / "mine"), package(tmp_path / "husky_gazebo")
    for folder in (mine, course):
        depends = "<depend>rospy</depend><depend>sensor_msg</depend><depend>husky_gazebo</depend>"
        text = MANIFEST.format(folder.name).replace("</name>", f"</name>{depends}")
        (folder / "package.xml").write_text(text)
    (told,) = find_packages.dependency_sentences([mine, mine, course, ROOT, ROOT / "compat" / "husky_gazebo"])
    assert "'mine' depends on 'sensor_msg'" in told
    assert "'sensor_msgs'?" in told
    (mine / "package.xml").write_text("<package>")
    assert find_packages.dependency_sentences([mine]) == []
