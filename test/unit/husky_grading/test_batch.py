"""Marking of a class: what a teacher sets and a student cannot; what a student costs the others."""

from pathlib import Path

import pytest
from packages import make_package, put

from husky_grading import batch as batch_module
from husky_grading import cli
from husky_grading.batch import Batch, class_seed, mark_all
from husky_grading.drive.trials import draw_trials
from husky_grading.judge import unmarked
from husky_grading.mark import mark
from husky_grading.records import MarkingConfig
from husky_grading.review import open_items
from husky_highlevel_controller.datatypes import HuskyError

GIVEN = "students: {NAME: {points: {reaches the pillar: {points: 30, word: x}}, hold: true}}"


@pytest.fixture
def jobs(monkeypatch):
    """The jobs that a class makes; none is run."""
    made = []

    def remember(job):
        made.append(job)
        return unmarked(job, "it was not run")

    monkeypatch.setattr(batch_module, "run_program", remember)
    return made


def grade(*arguments):
    return cli.grade(cli.parse(list(map(str, arguments))))


def test_the_starts_of_a_class_are_drawn_once_and_the_teacher_s_own_seed_counts(tmp_path, jobs):
    for name in ("ann", "bob"):
        put(tmp_path / "class" / name / "readme.txt")
    for out in ("a", "b", "a", "c"):
        grade("--all", tmp_path / "class", "--out", tmp_path / out)
    seeds = [job.config.seed for job in jobs]
    assert seeds[0:2] == seeds[4:6] == [class_seed(tmp_path / "a")] * 2, "a class has the same starts again"
    assert len({seeds[0], seeds[2], seeds[6], 0}) == 4
    assert draw_trials(3, seeds[0])[1].start != draw_trials(3, seeds[2])[1].start
    page = (tmp_path / "a" / "index.html").read_text()
    assert f"<th>seed</th><td>{seeds[0]}</td>" in page
    grade("--all", tmp_path / "class", "--out", tmp_path / "a", "--seed", "7")
    assert jobs[-1].config.seed == 7
    assert class_seed(tmp_path / "a") == seeds[0]


@pytest.mark.parametrize("text", ["", "x", "-1", "1.5", str(2**40), "\u00b2"])
def test_a_file_that_holds_no_seed_is_named(text, tmp_path):
    put(tmp_path / "seed", text)
    with pytest.raises(HuskyError, match=r"seed: .* is not a seed; remove the file"):
        class_seed(tmp_path)


def test_a_launch_file_is_marked_with_the_same_starts_by_everybody(tmp_path, monkeypatch):
    jobs = []
    monkeypatch.setattr(cli, "run_program", lambda job, **_: jobs.append(job) or unmarked(job, "not run"))
    grade("--launch", "a", "a.launch", "--out", tmp_path)
    assert jobs[0].config.seed == 0
    assert not (tmp_path / "seed").exists()


def test_a_hand_in_s_own_marking_yaml_gives_no_points_and_is_not_what_a_review_writes(
    tmp_path, jobs, monkeypatch, capsys
):
    package = make_package("commands_zero", tmp_path, "stud")
    put(package / "marking.yaml", GIVEN.replace("NAME", "stud"))
    batch = Batch(package, tmp_path / "out")
    mark_all(MarkingConfig(), batch)
    assert (jobs[0].override.points, jobs[0].override.hold) == ({}, False)
    assert "its marking.yaml is the student's, and does not count" in capsys.readouterr().err
    monkeypatch.setattr(batch_module, "run_program", mark)
    (package / "package.xml").write_text("<package/>")
    mark_all(MarkingConfig(), batch)
    put(Path(jobs[0].out, "job.json"), batch_module.to_json(jobs[0]))
    with pytest.raises(HuskyError, match=r"stud is itself a package, so no marking\.yaml counts in it"):
        open_items(tmp_path / "out")


def test_an_entry_that_is_there_twice_costs_nobody_else_anything_and_is_named(tmp_path, jobs):
    for name in ("ann", "bob"):
        put(tmp_path / "class" / name / "readme.txt")
    batch = Batch(tmp_path / "class", tmp_path / "out")
    mark_all(MarkingConfig(), batch)
    picture = put(tmp_path / "out" / "hand_ins" / "bob" / "drive.png", "of one of them")
    put(tmp_path / "class" / "bob.zip")
    del jobs[:]
    _, bob = mark_all(MarkingConfig(), batch)
    assert [job.name for job in jobs] == ["ann"]
    assert bob.problem == "bob and bob.zip are both the hand-in of bob: leave one of them in the folder"
    assert not picture.exists()
    assert bob.problem in (tmp_path / "out" / "index.html").read_text()
    (tmp_path / "class" / "bob.zip").unlink()
    del jobs[:]
    mark_all(MarkingConfig(), batch)
    assert [job.name for job in jobs] == ["ann", "bob"]
