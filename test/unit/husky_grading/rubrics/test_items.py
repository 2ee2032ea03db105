"""Items over all drives: what counts most, what is told once, and what is for a person."""

from dataclasses import replace

from drives import FULL_VIEW, GOOD, RIGHT, SCAN, TO_PILLAR, drive, markers

from husky_grading.exercises.exercise_3 import judge_arrival, judge_exercise_3
from husky_grading.records import total
from husky_grading.rubrics.items import (
    left_to_chance,
    left_to_choice,
    left_to_other_machine,
    over_trials,
    told_once,
)


def test_one_drive_that_interferes_costs_all_points_and_displays_are_no_chance():
    """Points of whole hand-ins are those of the kept recordings."""
    all_of_it = markers(GOOD, RIGHT)
    items = judge_exercise_3([all_of_it], FULL_VIEW, SCAN)
    assert total(items) == (100.0, 100.0)
    assert left_to_chance(items, "chance")[2].points == 20.0
    cheated = replace(all_of_it, violations=("the robot jumps 19.87 m at 1.48 s",))
    items = judge_exercise_3([all_of_it, cheated], FULL_VIEW, SCAN)
    assert total(items) == (0.0, 100.0)
    assert items[0].evidence == "no points: the robot jumps 19.87 m at 1.48 s"


def test_what_lost_points_by_one_of_equal_launch_files_is_for_a_person_and_full_marks_stand():
    full = judge_exercise_3([markers(GOOD, RIGHT)], FULL_VIEW, SCAN)
    assert left_to_choice(full, ("a.launch", "b.launch")) == full
    items = left_to_choice(judge_exercise_3([GOOD], FULL_VIEW, SCAN), ("a.launch", "b.launch"))
    assert [item.points for item in items] == [20.0, 30.0, 20.0, None, None]
    assert (
        "its launch files a.launch and b.launch fit equally well, and a.launch was started: no topic"
        in items[3].evidence
    )


def test_what_lost_points_by_python_2_is_for_a_person():
    items = left_to_other_machine(judge_exercise_3([GOOD], FULL_VIEW, SCAN))
    assert [item.points for item in items] == [20.0, 30.0, 20.0, None, None]
    assert "Python 2 is not installed here: no topic" in items[3].evidence


def test_a_cause_is_told_once_and_the_same_result_of_all_drives_has_no_sums():
    short = [drive((3.0, 0.0)), drive((3.0, 0.0))]
    items = told_once(judge_exercise_3(short, FULL_VIEW, SCAN))
    assert items[1].hint == "the same as for 'drives towards the pillar'"
    assert items[3].evidence.endswith("; the same points in another world")


def test_the_course_s_world_counts_most_and_the_worst_drive_is_told():
    short, third = drive((3.0, 0.0)), 1.0 / 3.0

    def over_arrivals(drives, other_worlds):
        return over_trials(list(map(judge_arrival, drives)), other_worlds)

    item = over_arrivals([GOOD, short, GOOD], third)
    assert item.points == 25.0
    assert item.evidence.endswith(
        "(run 2; of 30 points it has 30 in the course's world and 15 in 2 other worlds)"
    )
    assert item.drive == 2
    for drives, weight, points in (
        ([GOOD, short, short], third, 20.0),
        ([short, GOOD, GOOD], third, 10.0),
        ([GOOD, short, short], 0.0, 30.0),
        ([short], third, 0.0),
        ([drive((TO_PILLAR, 0.5)), drive((6.0, 0.1))], 0.3, None),  # one is graded by hand
    ):
        assert over_arrivals(drives, weight).points == points
