"""Random files of hand-ins: each is read, or refused with an error of ours, and in bounded time."""

import json

import yaml
from damage import WORDS, damaged, mutated
from packages import manifest, put

from husky_grading.displays import STANDING, view_of
from husky_grading.exercises.catalogue import EXERCISES
from husky_grading.hand_in.class_folder import find_hand_ins
from husky_grading.hand_in.copies import copy_packages
from husky_grading.hand_in.launch_choice import (
    choose_launch_files,
    read_launch_files,
    reasons,
)
from husky_grading.hand_in.package_files import find_rviz_config
from husky_grading.hand_in.packages import (
    NotMarkableError,
    choose_packages,
    exercise_numbers,
    open_hand_in,
    read_manifest,
)
from husky_grading.isolation.sandbox import Workspace
from husky_grading.notes import Note
from husky_grading.records import Override
from husky_grading.reports.files import load_result
from husky_grading.settings import read_overrides
from husky_grading.submission import Plan, RvizNode, notes_on, read_events
from husky_highlevel_controller.datatypes import HuskyError

MANIFEST = manifest("husky", "roscpp")
LAUNCH = (
    '<launch><arg name="x" default="1"/><include file="$(find husky)/launch/b.launch">'
    '<arg name="x" value="2"/></include><group if="$(arg x)">'
    '<node name="n" pkg="husky" type="controller" args="$(arg x)"/></group>'
    '<node name="rviz" pkg="rviz" type="rviz" args="-d $(find husky)/rviz/view.rviz"/></launch>'
)
RVIZ = """
Visualization Manager:
  Global Options: {Background Color: 48; 48; 48, Fixed Frame: odom, Frame Rate: 30}
  Displays:
    - {Class: rviz/TF, Enabled: true}
    - {Class: rviz/Group, Displays: [{Class: rviz/LaserScan, Topic: /scan}, {Class: rviz/RobotModel}]}
  Views: {Current: {Class: rviz/Orbit, Distance: 10}}
"""
RVIZ_NODE = {"name": "r", "args": "-d x", "remap": [["a", "b"]]}
EVENTS = [
    {"event": "plan", "nodes": ["a/b"], "left_out": [], "rviz": [RVIZ_NODE]},
    {"event": "died", "node": "n", "exit_code": -11},
    {"event": "missing", "package": "p", "tag": "include"},
    {"event": "unloadable", "error": "e"},
    {"event": "package", "path": "/tmp"},
]
MARKING = (
    "students: {ann: {launch: a, robot: husky_melodic, "
    "points: {b: {points: 1, word: w}}, late: {percent: 1, word: w}}}"
)
RESULT = {"name": "a", "what": "b", "settings": {}, "notes": [], "items": [], "problem": ""}


def test_hand_ins_are_packages_and_a_launch_file_or_not_markable(cases, tmp_path, launch_files_read_here):
    found = 0
    for number, rng in enumerate(cases):
        place = tmp_path / str(number)
        package = place / "class" / "ann" / "husky"
        put(package / "package.xml", damaged(rng, MANIFEST))
        for name in ("launch/a.launch", "launch/b.launch", "../ex3.launch"):
            put(package / name, damaged(rng, LAUNCH))
        (place / "scratch").mkdir()
        (hand_in,) = find_hand_ins(place / "class")
        try:
            contents = open_hand_in(hand_in.path, place / "scratch")
            packages, _ = choose_packages(contents.packages, 3)
            folders = copy_packages(packages, place / "ws")[0]
            workspace = Workspace(packages=(folders.root / "src",))
            none = copy_packages([], place / "copies")[0]
            files = read_launch_files(contents, packages, folders, none, workspace, Override())
            candidates = choose_launch_files(files, 3, EXERCISES[3].facts)
            why = reasons(candidates[0], candidates, 3)
            found += "starts husky/" in why
        except NotMarkableError:
            continue
    assert found, "some are still hand-ins"


def test_manifests_have_a_name_or_are_refused(cases, tmp_path):
    for rng in cases:
        try:
            name, _ = read_manifest(put(tmp_path / "package.xml", damaged(rng, MANIFEST)))
        except NotMarkableError:
            continue
        else:
            assert name.replace("_", "").replace("-", "").isalnum()
            assert "/" not in name


def test_rviz_files_and_arguments_are_read_as_far_as_they_go(cases, tmp_path):
    whole = yaml.safe_load(RVIZ)
    for rng in cases:
        text = damaged(rng, RVIZ) if rng.random() < 0.5 else yaml.safe_dump(mutated(rng, whole))
        path = put(tmp_path / "rviz" / "view.rviz", text)
        arguments = " ".join(rng.choice([*WORDS, "-d", str(path)]) for _ in range(rng.randint(0, 4)))
        node = RvizNode("rviz", arguments, ())
        setup = find_rviz_config(Plan(rviz=(node,), package_path=tmp_path))
        assert setup.source
        view_of(setup, STANDING, {})


def test_events_are_taken_only_as_they_are_written(cases, tmp_path):
    for rng in cases:
        lines = [json.dumps(mutated(rng, rng.choice(EVENTS))) for _ in range(rng.randint(0, 6))]
        text = "\n".join(lines)
        path = put(tmp_path / "events.jsonl", damaged(rng, text) if rng.random() < 0.3 else text)
        events = read_events(path)
        assert all(
            isinstance(note, Note) for note in notes_on(events, damaged(rng, "ERROR: cannot launch node of"))
        )


def test_marking_yaml_is_read_or_refused(cases, tmp_path):
    whole = yaml.safe_load(MARKING)
    for rng in cases:
        text = damaged(rng, MARKING) if rng.random() < 0.5 else yaml.safe_dump(mutated(rng, whole))
        put(tmp_path / "marking.yaml", text)
        try:
            overrides = read_overrides(tmp_path, ["ann"])
        except HuskyError:
            continue
        else:
            assert set(overrides) <= {"ann"}
            assert all(0.0 <= each.late.percent <= 100.0 for each in overrides.values() if each.late)


def test_results_of_an_earlier_marking_are_read_or_refused(cases, tmp_path):
    for rng in cases:
        text = json.dumps(mutated(rng, RESULT))
        put(tmp_path / "result.json", damaged(rng, text) if rng.random() < 0.3 else text)
        try:
            result = load_result(tmp_path / "result.json")
        except HuskyError:
            continue
        else:
            assert isinstance(result.full, bool)


def test_numbers_in_names_are_small(cases):
    for rng in cases:
        assert all(0 < number < 100 for number in exercise_numbers(damaged(rng, "exercise_3_husky5.launch")))
