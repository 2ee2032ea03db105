"""Marking of one hand-in: it has a result whatever goes wrong."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from hand_ins import NODE, launch
from packages import put

from husky_grading import mark as mark_module
from husky_grading.batch import job_of
from husky_grading.drive import observe as observe_module
from husky_grading.hand_in.class_folder import HandIn
from husky_grading.isolation.sandbox import Workspace
from husky_grading.mark import mark
from husky_grading.notes import Kind, Note
from husky_grading.records import Job, Launchable, MarkingConfig, Override
from husky_grading.reports.files import FINGERPRINT
from husky_grading.submission import WORKSPACE, NamedRobot, Submission
from husky_highlevel_controller.config import to_json
from husky_highlevel_controller.datatypes import HuskyError

pytestmark = pytest.mark.usefixtures("launch_files_read_here")


NOT_BUILT = "it does not build: controller.cpp:3:1: error: expected ';'"


@pytest.fixture
def not_built(tmp_path, monkeypatch):
    """Job of a hand-in that does not build, so it is marked without a run."""
    launchable = Launchable("launch", "husky", str(launch(tmp_path / "a.launch", NODE.format("husky"))))
    problem = (Note(Kind.BUILD, NOT_BUILT),)
    submission = Submission(
        launchable, Workspace(packages=(tmp_path,)), problem=problem, robot=NamedRobot("husky")
    )
    monkeypatch.setattr(mark_module, "prepare", lambda *_: submission)
    monkeypatch.setattr(observe_module, "drive_submission", None)
    return Job("ann", str(tmp_path / "ann"), MarkingConfig(), hand_in=str(tmp_path), fingerprint="all")


@pytest.mark.parametrize(
    ("error", "problem"),
    [(TimeoutError(), "TimeoutError"), (HuskyError(), "HuskyError"), (OSError(), "OSError")],
    ids=["TimeoutError", "HuskyError", "OSError"],
)
def test_an_error_without_a_text_is_told_by_its_name(error, problem, tmp_path, monkeypatch):
    def fail(*_):
        raise error

    monkeypatch.setattr(mark_module, "prepare", fail)
    result = mark(Job("ann", str(tmp_path / "ann"), MarkingConfig(), hand_in=str(tmp_path)))
    assert result.problem == problem


@pytest.mark.parametrize(
    ("error", "problem"),
    [
        (ZeroDivisionError("odd"), "the grader failed: ZeroDivisionError: odd"),
        (OSError(28, "No space left on device"), "No space left on device"),
    ],
)
def test_a_hand_in_has_a_result_whatever_goes_wrong_and_is_marked_again(
    error, problem, tmp_path, monkeypatch
):
    def fail(*_):
        raise error

    monkeypatch.setattr(mark_module, "prepare", fail)
    result = mark(Job("ann", str(tmp_path / "ann"), MarkingConfig(), hand_in=str(tmp_path)))
    assert result.problem == problem
    assert not (tmp_path / "ann" / FINGERPRINT).exists(), "nothing that a resume takes for done"
    assert "could not be marked" in (tmp_path / "ann" / "feedback.html").read_text()


@pytest.mark.parametrize(
    ("stage", "error"),
    [("write_pictures", OSError(28, "No space left on device")), ("judge", ZeroDivisionError("odd"))],
)
def test_a_fault_of_the_machine_after_the_runs_is_not_kept(stage, error, not_built, tmp_path, monkeypatch):
    def fail(*_):
        raise error

    monkeypatch.setattr(mark_module, stage, fail)
    result = mark(not_built)
    assert str(error.args[-1]) in result.problem
    assert not (tmp_path / "ann" / FINGERPRINT).exists()


def test_what_does_not_build_is_told_in_every_item_that_needs_it_and_is_not_driven(not_built):
    result = mark(not_built)
    assert not result.problem
    assert Path(not_built.out, FINGERPRINT).exists()
    approach, arrival, _, place, _ = result.items
    for item in (approach, arrival, place):
        assert NOT_BUILT in item.evidence
    assert "fix this error first" in approach.hint
    assert arrival.hint == place.hint == "the same as for 'drives towards the pillar'"
    assert result.cause == approach


@pytest.mark.parametrize(
    "change",
    [
        lambda kept: replace(kept, root=kept.root.parents[1] / "copy" / "ws"),
        lambda kept: replace(kept, sandbox="another"),
        lambda kept: replace(kept, network="another"),
        lambda kept: replace(kept, workspace=replace(kept.workspace, hidden=())),
        lambda kept: replace(kept, made_of="another"),
    ],
)
def test_a_workspace_of_another_place_sandbox_class_or_hand_in_is_not_kept(change, batch, ann):
    job = job_of(HandIn("ann", ann, "ann"), Override(), MarkingConfig(), batch)
    (Path(job.out, "ws", "src")).mkdir(parents=True)
    shutil.copytree(job.out, Path(job.out).parent / "copy")
    kept = Submission(
        Launchable("launch", "a", "a.launch"), Workspace(hidden=tuple(map(Path, job.hidden))),
        Path(job.out, "ws"), sandbox=mark_module.kind_of_sandbox(), made_of=job.made_of,
        network=mark_module.private_network.reach(),
    )  # fmt: skip
    put(Path(job.out, WORKSPACE), to_json(kept))
    assert mark_module.kept_submission(job) == kept
    put(Path(job.out, WORKSPACE), to_json(change(kept)))
    assert mark_module.kept_submission(job) is None
