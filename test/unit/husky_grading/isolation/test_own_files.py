"""Files of this package that a hand-in sees: launch files, worlds and messages, and nothing of the clone."""

import ast
import os
import sys
from pathlib import Path

import pytest
from packages import manifest, put

from husky_grading.hand_in.plan import plan, with_stand_ins
from husky_grading.isolation.own_files import NAME, VisibleCode
from husky_grading.isolation.process import Process, end_all, wait
from husky_grading.isolation.sandbox import (
    BUBBLEWRAP,
    SYSTEM,
    Workspace,
    kind_of_sandbox,
)
from husky_grading.notes import Kind
from husky_grading.records import Launchable

CLONE = Path(__file__).resolve().parents[4]
WORKSPACE = CLONE / ".dev" / "ws"
needs_dev = pytest.mark.skipif(
    kind_of_sandbox() != BUBBLEWRAP or f"{WORKSPACE}/devel" not in os.environ.get("CMAKE_PREFIX_PATH", ""),
    reason="no bubblewrap here, or another workspace than that of ./dev",
)
# every file that can be read, outside of the folders of the system and of Python
WALK = """
import os
found = []
for folder, names, files in os.walk("/"):
    names[:] = [name for name in names if os.path.join(folder, name) not in {skipped}]
    for file in files:
        path = os.path.join(folder, file)
        if os.path.isfile(path) and os.access(path, os.R_OK):
            found.append(path)
print(found)
"""
# of the clone; folders with all that is in them
READ = (
    "package.xml", "compat", "config", "launch", "msg", "rviz", "srv", "urdf", "worlds",
    "src/husky_highlevel_controller/__init__.py",
    "src/husky_grading/nodes/submission.py",
    "tools/in_workspace.bash",
    ".dev/ws/src", ".dev/ws/devel",
)  # fmt: skip
NO_PROGRAM = CLONE / ".dev" / "ws" / "devel" / "lib" / NAME


def printed(folder, own, code):
    """What a program in Python prints."""
    folder.mkdir(exist_ok=True)
    command = [sys.executable, "-c", code]
    process = Process(command, folder / "log", dict(os.environ), folder, Workspace(own=own))
    try:
        assert wait(lambda: not process.running, 120.0)
    finally:
        end_all([process])
    return process.output


def readable(folder, own):
    """Every file outside of the system that a program can read, sorted."""
    skipped = {sys.prefix, *(f"/{name}" for name in (*SYSTEM, "proc", "dev"))}
    return [Path(path) for path in ast.literal_eval(printed(folder, own, WALK.format(skipped=skipped)))]


def test_a_hand_in_imports_gazebo_s_messages_and_not_this_package(tmp_path):
    imports = "import gazebo_msgs.srv as gazebo; print(gazebo.SetModelState.__name__)"
    assert printed(tmp_path / "mine", VisibleCode.NOTHING, imports) == "SetModelState\n"
    assert "No module named" in printed(tmp_path / "mine", VisibleCode.NOTHING, f"import {NAME}.msg")


@needs_dev
def test_a_hand_in_reads_launch_files_worlds_and_messages_of_this_package_and_nothing_else_of_the_clone(
    tmp_path,
):
    files = readable(tmp_path / "mine", VisibleCode.NOTHING)
    assert CLONE / "launch" / "simulator.launch" in files
    assert WORKSPACE / "devel" / "include" / NAME / "HuskyStatus.h" in files
    # beside the clone: what the search path for programs names
    programs = map(Path, os.environ["PATH"].split(os.pathsep))
    allowed = {*(CLONE / place for place in READ), *programs, tmp_path / "mine"} - {CLONE, *CLONE.parents}
    assert [path for path in files if not {path, *path.parents} & allowed] == []
    assert [path for path in files if NO_PROGRAM in path.parents] == []


@needs_dev
def test_a_filter_s_hand_in_reads_the_filter_and_no_controller(tmp_path):
    files = {
        path.relative_to(CLONE).as_posix()
        for path in readable(tmp_path / "mine", VisibleCode.FILTER)
        if CLONE in path.parents
    }
    code = {
        path for path in files if path.startswith("src/") or path.startswith(f".dev/ws/devel/lib/{NAME}/")
    }
    assert {f"src/{NAME}/ros/estimation/node.py", f".dev/ws/devel/lib/{NAME}/planar_ekf"} <= code
    assert not [path for path in files if "controller/behaviour" in path or path.endswith("naive_controller")]
    assert not [path for path in files if path.startswith(("test/", "docs/", "examples/", ".git/"))]


def starts(folder, node, name="stud"):
    """A package whose launch file starts its own node, and one of husky_highlevel_controller."""
    package = put(folder / "class" / name / "package.xml", manifest(name)).parent
    put(package / "scripts" / "controller", "#!/bin/sh").chmod(0o755)
    nodes = f'<node name="a" pkg="{name}" type="controller"/><node name="b" pkg="{NAME}" type="{node}"/>'
    return put(package / "launch" / "a.launch", f"<launch>{nodes}</launch>")


def planned(file, own):
    name = file.parents[1].name
    workspace = Workspace(packages=(file.parents[2],), own=own)
    return plan(Launchable("launch", name, str(file)), workspace, file.parents[3] / "plan")


@pytest.mark.parametrize("node", ["naive_controller", "husky_controller", "proximity_stop"])
def test_a_node_of_this_package_is_left_out_of_a_hand_in_with_a_note(node, tmp_path):
    file = starts(tmp_path, node)
    hand_in = planned(file, VisibleCode.NOTHING)
    assert hand_in.nodes == ("stud/controller",)
    assert [note.kind for note in hand_in.notes] == [Kind.OWN_NODE]
    assert f"{NAME}/{node} is left out" in hand_in.notes[0].text
    assert planned(file, VisibleCode.ALL).nodes == ("stud/controller", f"{NAME}/{node}"), (
        "a teacher may start it"
    )


def test_a_hand_in_s_own_package_of_this_name_starts_its_nodes(tmp_path):
    file = starts(tmp_path, "controller", NAME)
    hand_in = planned(file, VisibleCode.NOTHING)
    assert hand_in.nodes == (f"{NAME}/controller", f"{NAME}/controller")
    assert hand_in.notes == ()
    # but not ours that its package lacks: there is no such program, or it is left out
    file = starts(tmp_path / "other", "naive_controller", NAME)
    hand_in = planned(file, VisibleCode.NOTHING)
    assert kind_of_sandbox() == BUBBLEWRAP or Kind.OWN_NODE in {note.kind for note in hand_in.notes}


def test_the_simulator_of_this_package_is_left_out_without_a_note(tmp_path):
    package = put(tmp_path / "class" / "stud" / "package.xml", manifest("stud")).parent
    put(package / "scripts" / "controller", "#!/bin/sh").chmod(0o755)
    include = f'<include file="$(find {NAME})/launch/simulator.launch"/>'
    node = '<node name="a" pkg="stud" type="controller"/>'
    file = put(package / "launch" / "a.launch", f"<launch>{include}{node}</launch>")
    hand_in = planned(file, VisibleCode.NOTHING)
    assert (hand_in.nodes, hand_in.notes) == (("stud/controller",), ())


def test_the_stand_in_of_a_filter_uses_no_more_than_the_filter():
    assert with_stand_ins(Workspace(own=VisibleCode.NOTHING), VisibleCode.FILTER).own is VisibleCode.FILTER
