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

# room: prefixes of what its modules may import of this package; folders say who belongs to whom
SHARED = sorted(name for name in SOURCES if "/" not in name)
MAY_IMPORT = {
    "simulator": {"simulator"},
    "controller": {"controller"},
    "tasks": {"tasks"},
    "evaluation": {"evaluation", "simulator", "controller", "tasks"},
    "grading": {"grading", "tasks"},
    "grading/hand_in": {"grading/hand_in", "grading/drive/plan", "grading/isolation", "grading/records"},
    "grading/drive": {"grading/drive", "grading/isolation", "grading/records"},
    "grading/rubrics": {
        "grading/rubrics",
        "grading/drive/recording",
        "grading/drive/ros_graph",
        "grading/records",
    },
    "grading/reports": {"grading/reports", "grading/drive/recording", "grading/isolation", "grading/records"},
    "grading/isolation": {"grading/isolation"},
    "comparison": {"comparison", "evaluation", "grading", "simulator", "controller", "tasks"},
    "ros": {"ros"},
    **{f"ros/{room}": {f"ros/{room}", room} for room in ("simulator", "controller", "grading")},
    "ros/safety": {"ros/safety", "controller"},
    "ros/web": {"ros/web"},
}
ROS = {"rospy", "tf2_ros", "roslib", "roslaunch", "rosgraph", "genpy", "rospkg", "dynamic_reconfigure"}
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


def room(name):
    """The longest folder of a module that has a rule of its own; empty for the shared words."""
    folders = name.split("/")[:-1]
    prefixes = ["/".join(folders[:n]) for n in range(len(folders), 0, -1)]
    return next((prefix for prefix in prefixes if prefix in MAY_IMPORT), prefixes[-1] if prefixes else "")


def within(name, folders):
    return any(name == folder or name.startswith(f"{folder}/") for folder in folders)


every = pytest.mark.parametrize("name", list(SOURCES))
core = pytest.mark.parametrize("name", [name for name in SOURCES if not name.startswith("ros/")])


@every
def test_a_module_imports_only_what_its_room_may(name):
    own = room(name)
    assert not own or own in MAY_IMPORT, f"{name}: a folder without a rule; give it one here"
    allowed = {"__init__", *SHARED}
    folders = MAY_IMPORT.get(own, set())
    for other in neighbours(name):
        if other.endswith("__init__"):
            continue
        direct_ros = own.startswith("ros") and other.startswith("ros/") and other.count("/") == 1
        assert other in allowed or within(other, folders) or direct_ros, f"{name} may not import {other}"


@every
def test_only_its_own_folder_talks_to_pybullet(name):
    assert within(name, {"simulator/bullet"}) or not {"pybullet", "pybullet_data"} & libraries(name)


@every
def test_only_plots_load_matplotlib(name):
    assert name.endswith("/plots") or "matplotlib" not in libraries(name)


@every
def test_only_one_module_loads_dask(name):
    assert name == "tasks/cluster" or not {"dask", "distributed", "cloudpickle"} & libraries(name)


def test_what_runs_beside_a_submission_imports_nothing_of_this_package():
    # a package of the submission may have the same name
    assert not neighbours("ros/grading/submission")


@core
def test_only_the_ros_room_talks_to_ros(name):
    assert not ROS & libraries(name)
    assert not {library for library in libraries(name) if library.endswith(("_msgs", "_srvs"))}


@core
def test_only_grading_tasks_and_ros_keep_time(name):
    assert within(name, {"grading", "tasks"}) or not CLOCKS & libraries(name)


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
    by_path = path.name in ("other_simulator", "robot_description")  # a hand-in does not see our modules
    assert len(path.read_text().splitlines()) <= (11 if by_path else 8)
    assert path.read_text().startswith("#!/usr/bin/env python3\n")
    assert path.name != PACKAGE
    assert path.suffix == ""
    assert f"scripts/{path.name}\n" in (ROOT / "CMakeLists.txt").read_text()  # or rosrun finds nothing
    before = {"signal", "sys"} if by_path else {"signal"}  # set before the imports
    (imported,) = imports(path) - before
    module, _, function = imported[len(PACKAGE) + 1 :].rpartition(".")
    assert function == "main"
    assert module.replace(".", "/") in SOURCES
