"""Who may import what: the sources are parsed, nothing is run."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = "husky_highlevel_controller"
ROOT = Path(__file__).parents[2]
SOURCES = {
    path.relative_to(ROOT / "src" / PACKAGE).with_suffix("").as_posix(): path
    for path in sorted((ROOT / "src" / PACKAGE).rglob("*.py"))
}
SCRIPTS = sorted((ROOT / "scripts").iterdir())

BODY = {
    "world", "sdf", "shapes", "description", "urdf", "robot", "simulation", "engine", "robot_engine",
    "chassis", "traction", "drive", "odometry", "mux", "lidar", "raycast", "intersections", "imu", "gps",
    "camera", "renderer", "scenery", "objects",
}  # fmt: skip
BRAIN = {"pillar", "fitting", "control", "tracking", "searching", "behaviour", "safety"}
LABORATORY = {"rollout", "scenarios", "evaluate"}  # where body and brain meet without ROS
# starts strangers' programs, waits for them in wall time, draws; ROS it knows by its programs only
MARKING = {"processes", "reaper", "network", "marking", "rviz_view", "class_marking", "grade", "picture"}
ROS = {"rospy", "tf2_ros", "roslib", "rosgraph", "genpy", "rospkg", "dynamic_reconfigure"}
CLOCKS = {"time", "datetime", "threading", "random"}


def syntax(path):
    return ast.parse(path.read_text(), str(path), feature_version=(3, 8))


def imports(path):
    """Full names of all that a file imports, wherever in it."""
    names = set()
    for node in ast.walk(syntax(path)):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names


def libraries(name):
    return {imported.split(".")[0] for imported in imports(SOURCES[name])}


def neighbours(name):
    """The package's own modules that a module imports."""
    found = set()
    for imported in imports(SOURCES[name]):
        head, _, rest = imported.partition(".")
        if head == PACKAGE:
            parts = rest.split(".")
            found |= {"/".join(parts[:n]) for n in range(1, len(parts) + 1)} & set(SOURCES)
    return found


def reach(name):
    """All modules of the package that come along with one."""
    found, ahead = set(), {name}
    while ahead:
        found |= ahead
        ahead = set().union(*(neighbours(each) for each in ahead)) - found
    return found


core = pytest.mark.parametrize("name", [name for name in SOURCES if not name.startswith("nodes/")])
every = pytest.mark.parametrize("name", list(SOURCES))


def test_body_and_brain_are_where_this_test_looks_for_them():
    assert set(SOURCES) >= BODY | BRAIN | LABORATORY | MARKING


@every
def test_only_the_engines_talk_to_pybullet(name):
    assert name in {"engine", "robot_engine"} or not {"pybullet", "pybullet_data"} & libraries(name)


@every
def test_only_the_pictures_load_matplotlib(name):
    assert name == "picture" or "matplotlib" not in libraries(name)


def test_what_runs_beside_a_submission_imports_nothing_of_this_package():
    # a package of the submission may have the same name
    assert not neighbours("nodes/submission")


@core
def test_only_nodes_talk_to_ros(name):
    assert not {"rospy", "tf2_ros", "rosgraph_msgs"} & libraries(name)
    if name not in ("messages", "drawing"):
        assert not ROS & libraries(name)
        assert not {library for library in libraries(name) if library.endswith(("_msgs", "_srvs"))}


@core
def test_nothing_outside_nodes_imports_a_node_or_keeps_its_own_time(name):
    assert not {other for other in neighbours(name) if other.startswith("nodes")}
    assert name in MARKING or not CLOCKS & libraries(name)


@pytest.mark.parametrize("name", sorted(BODY))
def test_the_body_does_not_know_the_brain(name):
    assert not BRAIN & reach(name)


@pytest.mark.parametrize("name", sorted(BRAIN))
def test_the_brain_does_not_know_the_body(name):
    assert not BODY & reach(name)


@core
def test_body_and_brain_meet_only_in_the_laboratory(name):
    assert name in LABORATORY | MARKING or not (BODY & reach(name) and BRAIN & reach(name))


@every
def test_every_module_says_what_it_is_for_and_loads_on_python_3_8(name):
    module = syntax(SOURCES[name])
    assert ast.get_docstring(module)
    if len(module.body) > 1:
        assert "__future__.annotations" in imports(SOURCES[name])  # or `X | Y` in a hint is an error


@every
def test_no_type_is_built_by_what_python_3_8_cannot_subscript(name):
    # in hints __future__ lets it pass; in an alias or a cast it fails on 3.8
    module = syntax(SOURCES[name])
    hints = [getattr(node, hint, None) for node in ast.walk(module) for hint in ("annotation", "returns")]
    in_hints = {id(node) for hint in hints if hint is not None for node in ast.walk(hint)}
    for node in ast.walk(module):
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and id(node) not in in_hints:
            assert node.value.id not in {"tuple", "list", "dict", "set", "frozenset", "type"}, node.lineno


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_scripts_only_call_a_main_and_do_not_shadow_the_package(path):
    assert len(path.read_text().splitlines()) <= 5
    assert path.read_text().startswith("#!/usr/bin/env python3\n")
    assert path.name != PACKAGE
    assert path.suffix == ""
    assert f"scripts/{path.name}\n" in (ROOT / "CMakeLists.txt").read_text()  # or rosrun finds nothing
    (imported,) = imports(path)
    module, _, function = imported[len(PACKAGE) + 1 :].rpartition(".")
    assert function == "main"
    assert module.replace(".", "/") in SOURCES
