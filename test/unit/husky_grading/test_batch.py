"""Marking of a class: what a teacher sets and a student cannot, what is marked again, and what one costs."""

import os
from dataclasses import replace
from pathlib import Path

import pytest
from hand_ins import NODE, launch
from packages import make_package, put

from husky_evaluation.tasks.workers import Workers
from husky_grading import batch as batch_module
from husky_grading import cli
from husky_grading import mark as mark_module
from husky_grading import run_jobs as run_jobs_module
from husky_grading.batch import Batch, class_seed, job_of, mark_all
from husky_grading.drive.trials import draw_trials
from husky_grading.hand_in import build as build_module
from husky_grading.hand_in import prepare as prepare_module
from husky_grading.hand_in.class_folder import HandIn
from husky_grading.isolation import files as files_module
from husky_grading.judge import judge_again, unmarked
from husky_grading.mark import mark
from husky_grading.notes import Kind, Note
from husky_grading.recording import Recording, recording_to_json
from husky_grading.records import GivenPoints, Launchable, MarkingConfig, Override, Rules
from husky_grading.reports.files import FINGERPRINT, write_result
from husky_grading.review import open_items
from husky_grading.run_jobs import run_program
from husky_grading.submission import WORKSPACE, Submission
from husky_highlevel_controller.config import ConfigError, load, to_json
from husky_highlevel_controller.datatypes import HuskyError, Pose2D

pytestmark = pytest.mark.usefixtures("launch_files_read_here")

GIVEN = "students: {NAME: {points: {reaches the pillar: {points: 30, word: x}}, hold: true}}"


@pytest.fixture
def jobs(monkeypatch):
    """The jobs that a class makes; none is run."""
    made = []

    def remember(job):
        made.append(job)
        return unmarked(job, "it was not run")

    monkeypatch.setattr(run_jobs_module, "run_program", remember)
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
    with pytest.raises(HuskyError, match=r"seed: .* is not a valid seed. Remove the file"):
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
    monkeypatch.setattr(run_jobs_module, "run_program", mark)
    (package / "package.xml").write_text("<package/>")
    mark_all(MarkingConfig(), batch)
    put(Path(jobs[0].out, "job.json"), batch_module.to_json(jobs[0]))
    with pytest.raises(HuskyError, match=r"stud is itself a package, so its marking\.yaml does not count"):
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
    assert bob.problem == "bob and bob.zip are both the submission of bob; leave one of them in the folder"
    assert not picture.exists()
    assert bob.problem in (tmp_path / "out" / "index.html").read_text()
    (tmp_path / "class" / "bob.zip").unlink()
    del jobs[:]
    mark_all(MarkingConfig(), batch)
    assert [job.name for job in jobs] == ["ann", "bob"]


def test_another_deadline_or_robot_drives_again_and_what_changed_or_was_missing_is_built(
    batch, husky, tmp_path, monkeypatch
):
    launch(husky / "a.launch", NODE.format("husky"))
    builds, driven, notes, failures = [], [], [], []

    def observe(submission, trials, config, bring_up, out):
        driven.append(config.deadline)
        recording = Recording(Pose2D(), (20.0, 5.0), config.deadline, notes=tuple(failures))
        put(out / "drive_1" / "recording.json", recording_to_json(recording))

    def build(_folders, _names, underlay):
        builds.append(1)
        return build_module.Build(underlay, tuple(notes))

    monkeypatch.setattr(prepare_module, "build", build)
    monkeypatch.setattr(mark_module, "observe", observe)
    monkeypatch.setattr(run_jobs_module, "run_program", mark)
    first, second = (mark_all(MarkingConfig(deadline=each), batch) for each in (60.0, 40.0))
    assert (first[0].what, second[0].what) == ("husky/a.launch",) * 2
    assert (len(builds), driven) == (1, [60.0, 40.0])
    config = MarkingConfig(deadline=40.0)
    put(batch.folder / "marking.yaml", "students: {ann: {robot: husky_melodic}}")
    mark_all(config, batch)
    assert (len(builds), len(driven)) == (1, 3)
    mark_all(config, replace(batch, only=("ann",)))
    assert (len(builds), len(driven)) == (2, 4), "all of it again"
    put(husky / "new.txt", "x")
    mark_all(config, batch)
    put(husky / "new.txt", "12")
    mark_all(config, batch)
    assert (len(builds), len(driven)) == (4, 6)
    monkeypatch.setattr(batch_module, "code_version", lambda: "another")
    mark_all(config, batch)
    assert (len(builds), len(driven)) == (5, 7)

    def marked_with(installed=None):
        if installed:
            put(tmp_path / installed, "")
        mark_all(config, batch)
        return len(builds), len(driven)

    monkeypatch.setenv("CMAKE_PREFIX_PATH", str(tmp_path / "prefix"))
    monkeypatch.setattr(batch_module, "DPKG", str(tmp_path / "dpkg"))
    monkeypatch.syspath_prepend(tmp_path / "python")
    assert marked_with("prefix/share/other/package.xml") == (5, 7), "nothing was missing"
    for place, kind, installed in (
        (notes, Kind.MISSING_PACKAGE, "prefix/share/missing/package.xml"),
        (notes, Kind.BUILD, "dpkg/missing.list"),
        (notes, Kind.LAUNCH_FILE, "python/missing.dist-info/METADATA"),
        (failures, Kind.NODE_FAILED, "python/module.dist-info/METADATA"),
        (failures, Kind.NOT_STARTED, "dpkg/module.list"),
    ):
        notes.clear()
        failures.clear()
        place.append(Note(kind, "not installed: missing"))
        put(husky / "new.txt", kind.value)
        built, drives = marked_with()
        assert marked_with() == (built, drives), "nothing was installed"
        is_whole = place is failures  # what was built
        assert marked_with(installed) == (built if is_whole else built + 1, drives + 1), kind


def test_a_hand_in_that_cannot_be_marked_shows_no_drive_of_an_earlier_one_and_is_not_tried_again(batch):
    out = batch.out / "hand_ins" / "ann"
    replay = put(out / "drive_1" / "replay.html", "the drive of yesterday")
    (result,) = mark_all(MarkingConfig(), batch)
    assert "has no catkin package" in result.problem
    assert not replay.exists()
    assert "of yesterday" not in (out / "feedback.html").read_text()
    (out / "mark.log").unlink()
    assert mark_all(MarkingConfig(), batch) == [result]
    assert not (out / "mark.log").exists()


@pytest.fixture
def marked(batch, ann, monkeypatch):
    """A class whose only hand-in was driven before, and the folder of its result; nothing can be started."""
    monkeypatch.setattr(run_jobs_module, "run_program", None)
    job = job_of(HandIn("ann", ann, "ann"), Override(), MarkingConfig(), batch)
    out = Path(job.out)
    notes = (Note(Kind.NO_NODE, "it starts no node of its own"),)
    recording = Recording(Pose2D(), (20.0, 5.0), 120.0, notes=notes)
    put(out / "drive_1" / "recording.json", recording_to_json(recording))
    notes = (Note(Kind.HAND_IN, "a note"),)
    put(out / WORKSPACE, to_json(Submission(Launchable("launch", "a", "a.launch"), notes=notes)))
    write_result(judge_again(job), out)
    put(out / FINGERPRINT, job.fingerprint)
    return batch, out


def test_a_typo_in_marking_yaml_is_told_and_costs_no_drive_also_where_it_comes_before_them(
    marked, monkeypatch
):
    batch, out = marked
    text = "students: {ann: {points: {mraker: {points: 7, word: seen}}}}"
    points = put(batch.folder / "marking.yaml", text)
    with pytest.raises(ConfigError, match=r"marking.yaml: students/ann/points/mraker is not an item"):
        mark_all(MarkingConfig(), batch)
    points.unlink()
    (result,) = mark_all(MarkingConfig(), batch)
    assert not result.problem
    monkeypatch.setattr(mark_module, "prepare", lambda *_: load(Submission, out / WORKSPACE))
    monkeypatch.setattr(mark_module, "observe", lambda *_: None)
    override = Override(points={"mraker": GivenPoints(7.0, "seen")})
    job = job_of(HandIn("ann", batch.folder / "ann", "ann"), override, MarkingConfig(), batch)
    put(out / "job.json", to_json(job))
    assert "mraker is not an item" in mark(job).problem
    (result,) = mark_all(MarkingConfig(), batch)
    assert not result.problem


def test_a_result_that_cannot_be_written_again_is_that_of_its_hand_in(marked, monkeypatch):
    batch, out = marked
    monkeypatch.setattr(run_jobs_module, "run_program", mark_or_fail)
    (out / "table.txt").unlink()
    (out / "table.txt").mkdir()
    put(batch.folder / "bob" / "readme.txt", "no package")
    put(batch.folder / "marking.yaml", "students: {ann: {late: {percent: 50, word: a day late}}}")
    ann, bob = mark_all(MarkingConfig(), batch)
    assert "table.txt" in ann.problem
    assert "has no catkin package" in bob.problem


def test_another_rubric_or_points_by_hand_judge_again_without_a_drive_and_what_has_not_changed_is_kept(
    marked, tmp_path, monkeypatch
):
    config, (batch, out) = MarkingConfig(), marked
    (before,) = mark_all(config, batch)
    assert (before.points, before.max_points, before.problem) == (0.0, 80.0, "")
    with monkeypatch.context() as context:
        context.setattr(batch_module, "judge_again", None)
        (out / "drive.png").symlink_to("/proc/self/mem")  # a picture that cannot be read
        assert mark_all(config, batch) == [before]
    given = "students: {ann: {points: {reaches the pillar: {points: 7, word: seen}}}}"
    put(batch.folder / "marking.yaml", given)
    batch.folder.rename(tmp_path / "moved")
    weighed = replace(config, rules=Rules(weights={"drives towards the pillar": 50.0}))
    (after,) = mark_all(weighed, replace(batch, folder=tmp_path / "moved"))
    assert (after.points, after.max_points) == (7.0, 110.0)
    assert "by hand: seen" in (out / "feedback.html").read_text()
    assert "ann" in (batch.out / "results.csv").read_text()
    assert open_items(batch.out)[1] == tmp_path / "moved"


def mark_or_fail(job):
    """Marking in this process; of the student Eve it fails."""
    if job.name == "Eve":
        raise RecursionError("too deep")
    return mark(job)


def test_a_class_is_marked_whatever_its_files_are_called_or_however_many_and_whatever_fails(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(files_module, "MAX_ENTRIES", 10)
    monkeypatch.setattr(run_jobs_module, "run_program", mark_or_fail)
    names = (b"M\xfcller", b"index.html", b"results.csv", b"bell\x1b[31m\x07")
    for name in (*names, b"Eve"):
        (tmp_path / "class" / os.fsdecode(name)).mkdir(parents=True)
    for number in range(20):
        put(tmp_path / "class" / "bob" / str(number))
    put(tmp_path / "class" / "ann" / os.fsdecode(b"caf\xe9") / "package.xml", "<package")
    results = mark_all(MarkingConfig(), Batch(tmp_path / "class", tmp_path / "out"))
    problems = {each.name: each.problem for each in results}
    assert list(problems) == [
        "Eve", "M\u00fcller", "ann", "bell\\x1b[31m\\x07", "bob", "index.html", "results.csv"
    ]  # fmt: skip
    assert problems["Eve"] == "the grader failed: RecursionError: too deep"
    assert "more than 10 files and folders" in problems["bob"]
    assert "; caf\\xe9/package.xml: not XML" in problems["ann"], "no path of this machine"
    assert "has no catkin package" in problems["results.csv"]
    assert len((tmp_path / "out" / "results.csv").read_text(encoding="utf-8").splitlines()) == len(names) + 4
    printed = capsys.readouterr()
    told = [line.partition(": ")[0] for line in printed.err.splitlines() if " of 7: " in line]
    assert told == [f"{number} of 7" for number in range(1, 8)]
    for text in (printed.out, printed.err, *(path.read_text() for path in (tmp_path / "out").glob("*.*"))):
        assert not [letter for letter in text if not letter.isprintable() and letter != "\n"]


def test_what_does_not_end_in_time_is_neither_tried_again_nor_judged_by_some_of_its_drives(
    marked, monkeypatch
):
    batch, out = marked
    (out / FINGERPRINT).unlink()
    monkeypatch.setattr(run_jobs_module, "run_program", run_program)
    monkeypatch.setattr(run_jobs_module, "DEADLINE", -1e6)
    (first,) = mark_all(MarkingConfig(), batch)
    assert first.problem.startswith("it was not graded within -")
    monkeypatch.setattr(run_jobs_module, "run_program", None)
    assert mark_all(MarkingConfig(rules=Rules(reached=1.0)), batch) == [first]
    monkeypatch.setattr(run_jobs_module, "run_program", run_program)
    (result,) = mark_all(MarkingConfig(), replace(batch, time_limit=0.001))
    assert result.problem == "it was not graded within 0.001 s; --time-limit sets this limit", (
        "as a teacher sets it"
    )


def test_entries_of_a_class_that_are_not_graded_are_named(marked, capsys):
    batch, _ = marked
    for name in ("eve.py", "marking.yaml", ".hidden"):
        put(batch.folder / name, "")
    mark_all(MarkingConfig(), batch)
    assert "a folder or an archive, and no link: eve.py\n" in capsys.readouterr().err


def test_without_network_namespaces_hand_ins_are_marked_one_at_a_time(batch, monkeypatch, capsys):
    numbers = []
    monkeypatch.setattr(batch_module.private_network, "can_be_made", lambda: False)
    monkeypatch.setattr(batch_module, "Workers", lambda jobs, cluster: numbers.append(jobs) or Workers(jobs))
    mark_all(MarkingConfig(), replace(batch, jobs=4))
    assert numbers == [1]
    assert "grading one submission at a time" in capsys.readouterr().err
