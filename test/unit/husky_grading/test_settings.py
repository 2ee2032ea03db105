"""Settings of a teacher: points by hand, a late penalty, and the weights of a rubric."""

import pytest
import yaml
from drives import FULL_VIEW, RIGHT, SCAN, drive, markers
from packages import put

from husky_grading.exercises import exercise_3
from husky_grading.exercises.exercise_3 import judge_exercise_3
from husky_grading.records import Item, Late, MarkingResult, Override, total
from husky_grading.reports.tables import to_result
from husky_grading.settings import load_rules, read_overrides, with_override
from husky_highlevel_controller.config import ConfigError


def test_a_late_penalty_of_nothing_is_0_and_not_minus_0():
    result = MarkingResult("ann", "a.launch", {}, (Item("drives", 0.0, 20.0, "stands"),))
    late = with_override(result, Override(late=Late(10.0, "a day late")))
    assert str(late.items[-1].points) == "0.0"
    assert "-0/0" not in str(to_result(late))


MARKING = """
students:
  ann:
    launch: ex3.launch
    arguments: ["a:=b"]
    robot: husky_melodic
    exercise: 3
    points: {marker: {points: 15, word: seen at the desk}}
    late: {percent: 10, word: two days}
"""
MARKER = Item("marker", None, 20.0, "?", hint="look at its frame")
DRIVEN = MarkingResult("ann", "w", {}, (Item("drive", 35.0, 50.0, ""), MARKER))


def test_points_by_hand_and_a_late_penalty(tmp_path):
    put(tmp_path / "marking.yaml", MARKING)
    override = read_overrides(tmp_path, ["ann", "bob"])["ann"]
    assert (override.launch, override.arguments, override.robot) == ("ex3.launch", ("a:=b",), "husky_melodic")
    marked = with_override(DRIVEN, override)
    _, marker, late = marked.items
    assert [(item.name, item.points) for item in (marker, late)] == [("marker", 15), ("late", -5)]
    assert marker.evidence == "by hand: seen at the desk"
    assert late.evidence == "10 % of 50 points: two days"
    assert (marked.points, marked.max_points) == (45.0, 70.0)
    assert not read_overrides(tmp_path / "ann", [])
    put(tmp_path / "marking.yaml", MARKING.replace("points: 15", "points: 20"))
    full = with_override(DRIVEN, read_overrides(tmp_path, ["ann", "bob"])["ann"]).items[1]
    assert (marker.hint, full.hint) == ("look at its frame", ""), "all points have no fault"


@pytest.mark.parametrize("name", ["1_2", "01234567", "no", "1e3", "2026-11-28", "0x1f", "~"])
def test_a_student_s_name_is_taken_as_it_is_written(name, tmp_path):
    put(tmp_path / "marking.yaml", f"students:\n  {name}: {{hold: true}}\n")
    # the other names are what YAML makes of these names
    assert set(read_overrides(tmp_path, [name, "12", "342391", "False", "1000.0", "31"])) == {name}


def test_a_mapping_may_include_another_one(tmp_path):
    text = "students:\n  ann: &late {late: {percent: 10, word: a day}}\n  bob: {<<: *late, hold: true}\n"
    put(tmp_path / "marking.yaml", text)
    bob = read_overrides(tmp_path, ["ann", "bob"])["bob"]
    assert (bob.hold, bob.late) == (True, Late(10.0, "a day"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("student: {}", "marking.yaml: 'student' is not known; there are: students"),
        ("students: {cid: {}}", "students: 'cid' is not known; there are: ann, bob"),
        ("students: {ann: {lunch: a}}", "students/ann/'lunch' is not known; there are: launch"),
        ("students: {ann: {launch: 3}}", "students/ann/launch = 3 is not a text"),
        ("students: {ann: {launch: a, node: p t}}", "has both launch and node"),
        ("students: {ann: {node: p}}", "node = 'p' is not a package and a type"),
        ("students: {ann: {robot: kinetic}}", "is not one of: husky, husky_melodic, smb"),
        ("students: {ann: {late: {percent: 200, word: x}}}", "is out of range 0.0..100.0"),
        ("students: {ann: {late: {percent: .nan, word: x}}}", "percent = nan is out of range 0.0..100.0"),
        ("students: {ann: {points: {a: {points: 1}}}}", "points/a/word is missing"),
        ("students: {ann: {points: {x: {points: 1, word: w}}}}", "points/x is not an item"),
        ("students: {ann: {points: {drive: {points: 51, word: w}}}}", "more"),
        ("students: [", "marking.yaml: while parsing"),
        ("- a", "is not a mapping"),
    ],
)
def test_a_mistake_in_marking_yaml_is_named(text, words, tmp_path):
    put(tmp_path / "marking.yaml", text)
    with pytest.raises(ConfigError) as refused:
        with_override(DRIVEN, read_overrides(tmp_path, ["ann", "bob"])["ann"])
    assert words in str(refused.value)


def rules_of(content, folder):
    path = folder / "rubric.yaml"
    path.write_text(yaml.safe_dump(content))
    return load_rules(path, exercise_3.ITEMS)


def test_a_teacher_may_weigh_items_and_leave_one_to_a_person(tmp_path):
    content = {"weights": {"reaches the pillar": 60}, "by_person": ["marker in RViz"], "ramming_costs": 10}
    rules = rules_of(content, tmp_path)
    items = judge_exercise_3([markers(drive((12.0, 1.0)), RIGHT)], FULL_VIEW, SCAN, rules)
    assert [item.points for item in items] == [20.0, 40.0, 20.0, 20.0, None]
    assert total(items) == (100.0, 120.0)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"wieghts": {}}, "rubric.yaml: 'wieghts' is not known; there are: reached"),
        ({"weights": {"reaches": 10}}, "'reaches' is not an item; there are: drives towards"),
        ({"weights": {"reaches the pillar": -1}}, "weights/reaches the pillar = -1 is out of range"),
        ({"reached": 9.0}, "reached = 9.0 is out of range"),
        ({"by_person": "all"}, "by_person = 'all' is not a list"),
    ],
)
def test_a_rubric_file_with_a_mistake_is_refused(content, words, tmp_path):
    with pytest.raises(ConfigError, match=words):
        rules_of(content, tmp_path)
