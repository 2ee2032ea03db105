"""Preparation of a hand-in: copies that give way to others, and what its folder gets."""

import shutil
from dataclasses import replace

import pytest
from hand_ins import NODE, built, launch, opened, package
from packages import put

from husky_grading.exercises.catalogue import EXERCISES
from husky_grading.hand_in import prepare as prepare_module
from husky_grading.hand_in.packages import NotMarkableError
from husky_grading.isolation.sandbox import Workspace
from husky_grading.notes import Kind, Note
from husky_grading.records import Job, Launchable, MarkingConfig

pytestmark = pytest.mark.usefixtures("launch_files_read_here")


def prepared(ann):
    """Submission and notes of a hand-in."""
    out = ann.parents[1] / "out"
    shutil.rmtree(out, ignore_errors=True)
    job = Job("ann", str(out), MarkingConfig(), hand_in=str(ann))
    submission, _ = prepare_module.prepare_hand_in(job, Workspace(), EXERCISES[3].facts)
    return submission, [note.text for note in submission.notes]


def make_copies(ann, *places):
    """Copies of a package that starts its node; the last one has the most files."""
    for place in places:
        folder = package(ann / place / "husky", "husky")
        launch(folder / "launch" / "a.launch", NODE.format("husky"))
    put(folder / "scripts" / "controller", "#!/bin/sh\n")


def test_a_copy_that_does_not_build_gives_way_to_the_next(ann, monkeypatch):
    make_copies(ann, "first", "second", "third")

    def build(folders, *_):
        works = (folders.packages["husky"] / "scripts").exists()
        return built("" if works else "it does not build: a.cpp:1: error: x")

    monkeypatch.setattr(prepare_module, "build", build)
    submission, notes = prepared(ann)
    assert not submission.problem
    assert any("package husky is taken from third/husky" in note for note in notes)
    shutil.rmtree(ann / "third")
    submission, notes = prepared(ann)
    assert submission.problem == (Note(Kind.BUILD, "it does not build: a.cpp:1: error: x"),)
    assert any("package husky is taken from first/husky" in note for note in notes)
    for each in ("first", "second"):
        (ann / each / "husky" / "launch" / "a.launch").unlink()
    with pytest.raises(
        NotMarkableError, match=r"no launch file starts .*taken from first/husky; these copies"
    ):
        prepared(ann)


@pytest.mark.parametrize("nodes", [["husky"], ["husky", "maths"]])
def test_the_best_launch_file_is_used_without_the_first_error_if_a_later_build_builds_it(
    nodes, ann, monkeypatch
):
    # the best launch file's package uses the other one's headers, but does not say that it depends on it
    for name, file in (("husky", "ex3.launch"), ("maths", "other.launch")):
        launch(package(ann / name, name) / "launch" / file, NODE.format(name))
    needed_packages = []

    def build(folders, needed, _underlay):
        needed_packages.append(set(needed))
        if "maths" not in needed:
            return built("it does not build: a.cpp:1: error: maths.h: No such file")
        for node in nodes:
            put(folders.root / "devel" / "lib" / node / "controller").chmod(0o755)
        return built("")

    monkeypatch.setattr(prepare_module, "build", build)
    submission, notes = prepared(ann)
    assert needed_packages == [{"husky"}, {"husky", "maths"}]
    assert not any("is not used" in note for note in notes)
    assert submission.launchable.package == "husky"
    assert not submission.problem
    assert not any("does not build" in note for note in notes)


def test_what_does_not_build_gives_way_to_no_copy_of_another_exercise_and_is_built_once(ann, monkeypatch):
    make_copies(ann, "ex3", "ex5")
    for place in ("a", "b"):
        package(ann / place / "husky_gazebo", "husky_gazebo")
    builds = []
    monkeypatch.setattr(prepare_module, "build", lambda *_: builds.append(1) or built("it does not build"))
    submission, notes = prepared(ann)
    assert submission.problem == (Note(Kind.BUILD, "it does not build"),)
    assert "package husky is taken from ex3/husky; these copies are left out: ex5/husky" in notes
    assert len(builds) == 1


def test_rviz_s_default_file_beside_a_package_is_its_configuration_and_no_link_is_followed(
    ann, husky, tmp_path
):
    put(ann / ".rviz" / "default.rviz", "shown")
    put(ann / "exercise2" / "other.rviz")
    put(package(ann / "other", "other") / "other.rviz")
    contents, copy = opened(ann), tmp_path / "copy"
    copy.mkdir()
    (copy / "default.rviz").symlink_to(put(tmp_path / "home" / "bashrc", "mine"))  # which the build laid
    assert prepare_module.add_rviz_files(contents, 3, copy)
    assert (tmp_path / "home" / "bashrc").read_text() == "mine"
    assert {path.name: path.read_text() for path in copy.iterdir()} == {"default.rviz": "shown"}
    put(husky / "own.rviz")
    assert not prepare_module.add_rviz_files(contents, 3, husky), "which has one of its own"


def test_a_neighbour_whose_manifest_cannot_be_read_ends_no_reading(husky, ann, tmp_path, monkeypatch):
    launch(husky / "launch" / "a.launch", '<include file="$(find husky)/b.launch"/>')
    launch(husky / "b.launch", NODE.format("husky"))
    put(tmp_path / "others" / "broken" / "package.xml", "<package")
    (tmp_path / "others" / "gone").mkdir()
    (tmp_path / "others" / "gone" / "package.xml").symlink_to(tmp_path / "nowhere")
    monkeypatch.setattr(prepare_module, "build", lambda *given: replace(built(""), workspace=given[-1]))
    job = Job("ann", str(tmp_path / "out"), MarkingConfig(), hand_in=str(ann))
    others = Workspace(packages=(tmp_path / "others",))
    _, planned = prepare_module.prepare_hand_in(job, others, EXERCISES[3].facts)
    assert planned.nodes == ("husky/controller",), planned.notes


def test_a_result_folder_with_a_workspace_of_its_own_keeps_it(tmp_path):
    source = put(tmp_path / "ws" / "src" / "node.py")
    launchable = Launchable("launch", "husky_highlevel_controller", "controller.launch")
    job = Job("a", str(tmp_path), MarkingConfig(), launchable)
    prepare_module.prepare(job, EXERCISES[3].facts)
    assert source.exists()
