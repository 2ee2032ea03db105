"""Build of a hand-in: what fails because of this machine is not the student's fault."""

import pytest

from husky_highlevel_controller.grading.hand_in import build as build_module
from husky_highlevel_controller.grading.hand_in import prepare as prepare_module
from husky_highlevel_controller.grading.hand_in.build import Folders, build
from husky_highlevel_controller.grading.isolation.ros_network import MarkingError
from husky_highlevel_controller.grading.isolation.sandbox import Workspace
from husky_highlevel_controller.grading.mark import mark
from husky_highlevel_controller.grading.notes import Kind
from husky_highlevel_controller.grading.records import Job, Launchable, MarkingConfig

NO_CMAKE = "CMake Error: The source directory does not exist"
COMPILER = "husky/a.cpp:3:1: error: expected ;"


@pytest.mark.parametrize(
    ("said", "builds_empty", "is_ours"),
    [(NO_CMAKE, False, True), (NO_CMAKE, True, False), (COMPILER, False, False)],
    ids=["nothing builds here", "only this one does not", "the compiler ran"],
)
def test_a_build_that_fails_here_for_everybody_is_no_fault_of_the_hand_in(
    said, builds_empty, is_ours, tmp_path, monkeypatch
):
    def catkin_make(folders, needed, *_):
        return (said, 1) if needed or not builds_empty else ("", 0)

    monkeypatch.setattr(build_module, "_catkin_make", catkin_make)
    folders = Folders(tmp_path / "ws", {"husky": tmp_path / "ws" / "src" / "husky"})
    folders.packages["husky"].mkdir(parents=True)
    if is_ours:
        with pytest.raises(MarkingError, match="does not even build an empty workspace: CMake Error"):
            build(folders, frozenset({"husky"}), Workspace())
    else:
        (note,) = build(folders, frozenset({"husky"}), Workspace()).notes
        assert note.kind is Kind.BUILD
    assert [path.name for path in tmp_path.iterdir()] == ["ws"]


def test_a_workspace_below_that_cannot_be_sourced_is_not_held_against_a_hand_in(tmp_path):
    setup = tmp_path / "below" / "devel" / "setup.bash"
    setup.parent.mkdir(parents=True)
    setup.write_text("echo broken below >&2\nreturn 1\n")
    job = Job(
        "ann", str(tmp_path / "out"), MarkingConfig(), Launchable("node", "a", "b"), setups=(str(setup),)
    )
    with pytest.raises(MarkingError, match="cannot be sourced: broken below"):
        prepare_module.prepare(job)
    result = mark(job)
    assert (result.items, "cannot be sourced" in result.problem) == ((), True)
    assert not (tmp_path / "out" / "fingerprint").exists(), "it is marked again"
