"""Hand-ins of a class: what is one, which packages and launch file it has, and what a teacher sets for it."""

import gzip
import io
import os
import pickle
import re
import shutil
import stat
import subprocess
import sys
import tarfile
import zipfile
from dataclasses import replace
from pathlib import Path, PurePosixPath
from types import SimpleNamespace

import pytest
from packages import manifest, put

from husky_evaluation.tasks.workers import Workers
from husky_grading import batch as batch_module
from husky_grading import mark as mark_module
from husky_grading.batch import Batch, job_of, mark_all, run_program, run_there
from husky_grading.drive import observe as observe_module
from husky_grading.exercises.catalogue import EXERCISES
from husky_grading.hand_in import archives, launch_choice
from husky_grading.hand_in import build as build_module
from husky_grading.hand_in import packages as packages_module
from husky_grading.hand_in import prepare as prepare_module
from husky_grading.hand_in.archives import Allowance, ArchiveError, PackedPath, unpack
from husky_grading.hand_in.build import Folders, copy_packages
from husky_grading.hand_in.class_folder import HandIn
from husky_grading.hand_in.packages import NotMarkableError, open_hand_in
from husky_grading.isolation import files as files_module
from husky_grading.isolation import process as process_module
from husky_grading.isolation.sandbox import Workspace
from husky_grading.judge import judge_again
from husky_grading.mark import mark
from husky_grading.notes import Kind, Note
from husky_grading.recording import Recording, recording_to_json
from husky_grading.records import (
    GivenPoints,
    Item,
    Job,
    Launchable,
    MarkingConfig,
    MarkingResult,
    Override,
    Rules,
)
from husky_grading.reports.files import FINGERPRINT, write_result
from husky_grading.review import open_items
from husky_grading.settings import read_overrides, with_override
from husky_grading.submission import WORKSPACE, NamedRobot, Submission
from husky_highlevel_controller.config import ConfigError, load, to_json
from husky_highlevel_controller.datatypes import Pose2D

pytestmark = pytest.mark.usefixtures("launch_files_read_here")

NODE = '<node name="n" pkg="{}" type="controller"/>'
RVIZ = '<node name="rviz" pkg="rviz" type="rviz"/>'
WORLD = (
    '<include file="$(find husky_gazebo)/launch/husky_empty_world.launch">'
    '<arg name="world_name" value="$(find {})/worlds/singlePillar.world"/></include>'
)


def package(folder, name, *depends, **more):
    put(folder / "package.xml", manifest(name, *depends, **more))
    return folder


def launch(path, *content):
    return put(path, f"<launch>{''.join(content)}</launch>")


def archive(path, files):
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w") as opened:
        for name, content in files.items():
            opened.writestr(name, content)
    return path


def opened(ann):
    return open_hand_in(ann, ann.parents[1])


def chosen(ann, exercise=3):
    contents = opened(ann)
    packages, notes = packages_module.choose_packages(contents.packages, exercise)
    return contents, packages, [*contents.notes, *notes]


def launch_files(ann, exercise=3, **more):
    """Launch files that start something, the chosen one first, in copies of the packages."""
    contents, packages, _ = chosen(ann, exercise)
    facts = EXERCISES[exercise].facts
    out, known = ann.parents[1] / "out", packages_module.copies_of_known(contents.packages)
    folders, _ = copy_packages(packages, out / "ws")
    copies, _ = copy_packages(known, out / "copies")
    workspace = Workspace(packages=(folders.root / "src", *copies.packages.values()))
    override = Override(**more)
    files = launch_choice.read_launch_files(
        contents, [*packages, *known], folders, copies, workspace, override, facts.parts
    )
    return launch_choice.choose_launch_files(files, exercise, facts)


def prepared(ann):
    """Submission and notes of a hand-in."""
    out = ann.parents[1] / "out"
    shutil.rmtree(out, ignore_errors=True)
    job = Job("ann", str(out), MarkingConfig(), hand_in=str(ann))
    submission, _ = prepare_module.prepare_hand_in(job, Workspace(), EXERCISES[3].facts)
    return submission, [note.text for note in submission.notes]


def copied(ann, tmp_path):
    """Folders of the copy that is built, and notes on it."""
    _, packages, _ = chosen(ann)
    return copy_packages(packages, tmp_path / "ws")


def unpacked(path, **allowance):
    """Notes on an archive, and its files, in a folder beside it."""
    to = path.parent / f"{path.name}_unpacked"
    to.mkdir()
    notes = unpack(path, to, Allowance(**allowance))
    return notes, {str(file.relative_to(to)) for file in to.rglob("*") if file.is_file()}


@pytest.fixture
def ann(tmp_path):
    """The hand-in of the only student of a class."""
    folder = tmp_path / "class" / "ann"
    folder.mkdir(parents=True)
    return folder


@pytest.fixture
def husky(ann):
    """Her package, which is all that she hands in."""
    return package(ann / "husky", "husky")


@pytest.fixture
def batch(ann, tmp_path):
    """The class of a student who hands in no package."""
    put(ann / "readme.txt", "no package")
    return Batch(ann.parent, tmp_path / "out")


# ---------------------------------------------------------------------------- what is in one


def test_an_archive_of_another_kind_is_refused(tmp_path):
    put(tmp_path / "dan.7z")
    with pytest.raises(NotMarkableError, match=r"dan\.7z is not opened: only \.zip, "):
        open_hand_in(tmp_path / "dan.7z", tmp_path)


def test_packages_are_found_by_manifests_that_are_files_in_folders_and_in_archives_inside(ann):
    for place in ("build/a", "devel/b", "src/c/inner", "src/c", "src/d"):
        package(ann / place, place.split("/")[-1])
    for name, make in (("i", os.mkfifo), ("j", Path.mkdir), ("k", lambda path: path.symlink_to("/dev/zero"))):
        (ann / name).mkdir()
        make(ann / name / "package.xml")
    inner = archive(ann.parent / "inner.zip", {"g/package.xml": manifest("g")})
    archive(ann / "e.zip", {"e/package.xml": manifest("e"), "g.zip": inner.read_bytes()})
    put(ann / "f.zip", "no archive")
    put(ann / "h.rar")
    contents = opened(ann)
    assert [str(each.place) for each in contents.packages] == ["src/c", "src/d", "e.zip/e", "e.zip/g.zip/g"]
    assert contents.notes[0] == "f.zip is broken: File is not a zip file"
    assert contents.notes[1].startswith("h.rar is not opened: only .zip, ")


def test_names_in_a_zip_are_those_that_its_program_meant(tmp_path):
    """Of a folder with a colon; by backslashes, of folders too; in UTF-8 without the flag that says so."""
    made = archive(tmp_path / "a.zip", {"Lab: 3/a": "", "b\\": "", "b\\c": "", "\u00dcbung/d": ""})
    made.write_bytes(made.read_bytes().replace(b"\x14\0\0\x08", b"\x14\0\0\0"))
    assert unpacked(made) == ([], {"Lab: 3/a", "b/c", "\u00dcbung/d"})


@pytest.mark.parametrize(
    "name", ["", "/tmp/elsewhere", "../up", "a b", "a;rm", "-flag", "a/b", "n" * 101], ids=repr
)
def test_the_name_of_a_package_is_a_name(name, ann):
    put(ann / "package.xml", f"<package><name>{name}</name></package>")
    contents = opened(ann)
    assert contents.packages == ()
    assert "which is not a valid name of a package" in contents.notes[0]


# ---------------------------------------------------------------------------- archives


@pytest.mark.parametrize("name", ["../x", "/etc/x", "a/../../x", "..\\x", "C:/x"])
def test_no_member_of_an_archive_leaves_its_folder(name, tmp_path):
    with pytest.raises(ArchiveError, match="leads out of its folder"):
        unpacked(archive(tmp_path / "a" / "a.zip", {name: "x"}))
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a", "a.zip", "a.zip_unpacked"]


def test_links_and_devices_in_archives_are_left_out(tmp_path):
    with tarfile.open(tmp_path / "a.tar.gz", "w:gz") as made:
        for kind in (tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE, tarfile.CHRTYPE):
            member = tarfile.TarInfo(f"special_{kind.decode()}")
            member.type, member.linkname = kind, "/etc/passwd"
            made.addfile(member)
        member = tarfile.TarInfo("run")
        member.size, member.mode = 1, 0o755
        made.addfile(member, io.BytesIO(b"x"))
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as made:
        link = zipfile.ZipInfo("link")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        made.writestr(link, "/etc/passwd")
    for name, files in (("a.tar.gz", {"run"}), ("a.zip", set())):
        assert unpacked(tmp_path / name) == ([f"{name} holds links, which are left out"], files)
    assert os.access(tmp_path / "a.tar.gz_unpacked" / "run", os.X_OK)


def test_an_archive_that_grows_too_large_is_refused(tmp_path):
    bomb = tmp_path / "a.zip"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as made:
        made.writestr("zeros", bytes(10_000_000))
    many = archive(tmp_path / "many.zip", {str(n): "" for n in range(30)})
    for path, allowance in ((bomb, {"size": 1_000_000}), (many, {"files": 20})):
        with pytest.raises(ArchiveError, match="too large"):
            unpacked(path, **allowance)
    assert (tmp_path / "a.zip_unpacked" / "zeros").stat().st_size <= 1_000_000


@pytest.mark.parametrize("kind", ["zip", "xztar", "bztar", "gztar"])
def test_a_damaged_archive_costs_itself_only(kind, tmp_path):
    """Each module of Python's library has errors of its own, such as LZMAError and struct.error."""
    made = Path(shutil.make_archive(str(tmp_path / "a"), kind, Path(__file__).parent))
    whole, refused = made.read_bytes(), []
    for position in range(0, len(whole), max(len(whole) // 6, 1)):
        made.write_bytes(whole[:position] + bytes(64) + whole[position + 64 :])
        try:
            unpacked(made)
        except ArchiveError as error:
            refused.append(str(error))
        shutil.rmtree(made.with_name(f"{made.name}_unpacked"))
    assert refused
    assert all(re.match(rf"{made.name} (is broken|cannot be unpacked): ", words) for words in refused)


def test_a_header_of_gigabytes_is_not_read_into_memory(tmp_path):
    bomb = tmp_path / "a.tar.gz"
    header = tarfile.TarInfo("x")
    header.type, header.size = tarfile.GNUTYPE_LONGNAME, 1_200_000_000
    with gzip.open(bomb, "wb", compresslevel=1) as file:
        file.write(header.tobuf(tarfile.GNU_FORMAT))
        for _ in range(120):
            file.write(bytes(10_000_000))
    with pytest.raises(ArchiveError, match=r"a\.tar\.gz cannot be unpacked within 1 GB of memory"):
        unpacked(bomb)


# ---------------------------------------------------------------------------- which exercise


NUMBERS = {
    3: "ex3.launch Ex3.launch EX_3 exercise3 Exercise-03 exercise_three exo3 exercice_3 course_03 "
    "course3 lab3 Lab_3 tp3 TP03 task3 hw3 HW_3 homework3 sheet3 uebung3 session3 husky_ex3_cpp "
    "MyEx3.launch HuskyExercise3 3rd_exercise ex_3_husky.zip 3 03 ex_no3 exercises3",
    5: "husky_5th_ex.launch session_5 ex05.launch",
    1: "exercise_one 1 lab1_v2",
    None: "tb3_autonomy turtlebot3_gazebo ur3_moveit pioneer3dx ps3joy rplidar_a3 robot3 "
    "5ro14_husky_controller session_2 session2 MyHusky3.launch husky3 husky_highlevel_controller_v2 "
    "ros1_ws tf2_demo 2020 laser_2d group_4 python3 example_3d next3 http3 team3 velodyne_16 "
    "melodic18 complex3",
}


def test_numbers_of_exercises_in_names():
    table = {
        name: {number} if number else set() for number, names in NUMBERS.items() for name in names.split()
    }
    assert len(table) >= 50
    assert {name: packages_module.exercise_numbers(name) for name in table} == table
    innermost = {
        "exercise5/ex3.launch": 2, "exercise3/husky.launch": 2, "exercise3/ex5.launch": 0,
        "U\u0308bung 3/a.launch": 2, "src/a": 1,
    }  # fmt: skip
    assert {place: packages_module.fits_exercise(PurePosixPath(place), 3) for place in innermost} == innermost


@pytest.mark.parametrize(("exercise", "taken"), [(3, "ex3_husky.zip/husky"), (5, "course5/husky")])
def test_of_packages_with_one_name_the_exercise_s_is_taken(exercise, taken, ann):
    for folder in ("course2", "src", "course5"):
        package(ann / folder / "husky", "husky")
    archive(ann / "ex3_husky.zip", {"husky/package.xml": manifest("husky")})
    _, (found,), notes = chosen(ann, exercise)
    assert str(found.place) == taken
    assert f"package husky is taken from {taken}" in notes[0]


@pytest.mark.parametrize("name", ["any.launch", "any.launch.xml"])
def test_of_equal_copies_the_one_with_a_launch_file_that_starts_its_node_is_taken(name, ann):
    full, solved = package(ann / "Input" / "husky", "husky"), package(ann / "Solution" / "husky", "husky")
    put(full / "src" / "many.cpp")
    launch(solved / "launch" / name, NODE.format("husky"))
    _, (taken,), notes = chosen(ann)
    assert taken.path == solved
    assert "package husky is taken from Solution/husky; left aside: Input/husky" in notes
    put(solved / "launch" / name, f"<launch><!-- {NODE.format('husky')} --></launch>")
    _, (taken,), _ = chosen(ann)
    assert taken.path == full, "it has more files"


def built(problem):
    return build_module.Build(Workspace(), (Note(Kind.BUILD, problem),) * bool(problem))


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
    with pytest.raises(NotMarkableError, match=r"no launch file starts .*taken from first/husky; left aside"):
        prepared(ann)


def test_what_does_not_build_gives_way_to_no_copy_of_another_exercise_and_is_built_once(ann, monkeypatch):
    make_copies(ann, "ex3", "ex5")
    for place in ("a", "b"):
        package(ann / place / "husky_gazebo", "husky_gazebo")
    builds = []
    monkeypatch.setattr(prepare_module, "build", lambda *_: builds.append(1) or built("it does not build"))
    submission, notes = prepared(ann)
    assert submission.problem == (Note(Kind.BUILD, "it does not build"),)
    assert "package husky is taken from ex3/husky; left aside: ex5/husky" in notes
    assert len(builds) == 1


def test_other_exercises_and_known_packages_are_left_aside_unless_needed(ann):
    package(ann / "ex3" / "husky", "husky", "messages")
    package(ann / "ex2" / "messages", "messages")
    package(ann / "ex4" / "slam", "slam")
    package(ann / "teleop", "teleop_twist_keyboard")
    _, packages, notes = chosen(ann)
    assert [each.name for each in packages] == ["husky", "messages"]
    assert "left aside, because not the student's own: teleop_twist_keyboard" in notes
    assert "left aside, because of other exercises: slam" in notes


# ---------------------------------------------------------------------------- the launch file


EKF = '<node name="e" pkg="robot_localization" type="ekf_localization_node"/>'
BAG = '<node name="p" pkg="rosbag" type="play"/>'
INCLUDES = '<include file="$(find husky)/parts/b.launch"/>'


@pytest.mark.parametrize(
    ("exercise", "files", "taken"),
    [
        (3, {"a": [NODE], "b": [RVIZ]}, "a"),
        (3, {"ex2": [NODE], "ex3": [NODE]}, "ex3"),
        (3, {"ex3_cpp": ["<!--", NODE, "-->"], "any": [NODE]}, "any"),
        (3, {"a": [NODE], "b": [NODE, WORLD]}, "b"),
        (3, {"a": [NODE], "b": [NODE, RVIZ]}, "b"),
        (3, {"ex3": [NODE], "husky": [NODE, WORLD]}, "husky"),
        (3, {"ex5": [NODE, WORLD], "husky": [NODE]}, "husky"),
        (3, {"a": [NODE, RVIZ], "high_level": [NODE]}, "high_level"),
        (3, {"a_test": [NODE, RVIZ], "b": [NODE]}, "b"),
        (3, {"a_ekf": [NODE, WORLD, RVIZ], "b": [NODE]}, "b"),
        (3, {"pillar/a": [NODE, WORLD], "pillar/single_pillar": [NODE, WORLD]}, "pillar/single_pillar"),
        (3, {"a": ['<group if="false">', NODE, "</group>"], "b": [NODE]}, "b"),
        (3, {"a": [INCLUDES, WORLD, RVIZ], "parts/b": [NODE]}, "a"),
        (4, {"a": [NODE, WORLD], "ekf": [EKF, RVIZ], "z": [BAG]}, "ekf"),
        (4, {"a": [NODE, WORLD], "z": [BAG]}, "z"),  # without a filter
        (4, {"ex5": [EKF, NODE], "x": [EKF]}, "x"),
        (4, {"x": [EKF], "ex4": [EKF]}, "ex4"),
    ],
)
def test_the_launch_file_is_found_by_what_is_in_it(exercise, files, taken, ann, husky, tmp_path):
    for name, content in files.items():
        launch(husky / f"{name}.launch", *(each.replace("{}", "husky") for each in content))
    candidates = launch_files(ann, exercise)
    assert str(candidates[0].place) == f"husky/{taken}.launch"
    assert candidates[0].package == "husky"
    kind = "husky/controller" if exercise == 3 else "ro"  # robot_localization's filter, or rosbag's player
    assert f": starts {kind}" in launch_choice.reasons(candidates[0], candidates, exercise)
    is_built = build_module.is_built(candidates[0].nodes[0], copied(ann, tmp_path)[0])
    assert is_built is (exercise == 4), "it needs no build"


INCLUDES_ITSELF = '<include file="$(find husky)/ex3.launch"/>'
LONG_ARGUMENT = (
    f'<include file="$(find husky)/ex3.launch"><arg name="x" value="{"$(arg x)x" * 1000}"/></include>'
)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (INCLUDES_ITSELF, "the launch file cannot be loaded: "),
        (INCLUDES_ITSELF * 50, "the launch file cannot be loaded: "),
        (LONG_ARGUMENT, ""),
        ("<group>" * 5000 + "</group>" * 5000, ""),
    ],
    ids=["includes itself", "50 times", "long", "deep"],
)
def test_a_launch_file_of_any_depth_or_length_is_read(content, problem, ann, husky):
    launch(husky / "ex3.launch", NODE.format("husky"), content)
    (only,) = launch_files(ann)
    assert only.nodes == ("husky/controller",)
    assert not problem or problem in only.plan.notes[0].text


def test_a_launch_file_may_lie_beside_its_package_and_a_teacher_may_name_it(ann):
    package(ann / "exercise3" / "husky", "husky")
    for name in ("ex3.launch", "launch/ex3.launch", "launch/other.launch.xml", "copy.launch.bak"):
        launch(ann / "exercise3" / name, NODE.format("husky"))
    candidates = launch_files(ann)
    assert (str(candidates[0].place), candidates[0].package) == ("exercise3/ex3.launch", "husky")
    assert candidates[0].path.read_text() == (ann / candidates[0].place).read_text()
    assert {file.place.name for file in candidates} == {"ex3.launch", "other.launch.xml"}
    assert "is named for exercise 3" in launch_choice.reasons(candidates[0], candidates, 3)
    (only,) = launch_files(ann, launch="launch/ex3.launch")
    assert str(only.place) == "exercise3/launch/ex3.launch"
    with pytest.raises(NotMarkableError, match="2 fit it"):
        launch_files(ann, launch="ex3.launch")


def test_a_copy_of_a_known_package_may_have_the_launch_file(ann):
    package(ann / "src" / "husky", "husky")
    copy = package(ann / "src" / "husky_gazebo", "husky_gazebo")
    package(ann / "src" / "old" / "husky_gazebo", "husky_gazebo")
    launch(copy / "launch" / "spawn_husky.launch", NODE.format("gazebo_ros"))
    launch(copy / "launch" / "mine.launch", NODE.format("husky"))
    launch(copy / "launch" / "all.launch.xml", '<include file="$(find husky_gazebo)/launch/mine.launch"/>')
    assert chosen(ann)[2] == ["left aside, because not the student's own: husky_gazebo"]
    candidates = launch_files(ann)
    assert {file.path.name for file in candidates} == {"mine.launch", "all.launch.xml"}
    assert {file.package for file in candidates} == {"husky"}


def test_no_launch_file_is_read_through_a_link(ann, husky, tmp_path):
    launch(tmp_path / "bob" / "launch" / "ex3.launch", NODE.format("husky"))
    for link in (ann / "launch", husky / "inner"):
        link.symlink_to(tmp_path / "bob" / "launch")
    launch(husky / "launch" / "a.launch", '<include file="$(find husky)/inner/ex3.launch"/>')
    with pytest.raises(NotMarkableError, match=r"launch files: husky/launch/a\.launch$"):
        launch_files(ann)


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


def test_a_build_that_lays_links_in_place_of_files_writes_nothing_outside_and_is_refused(
    tmp_path, monkeypatch
):
    folders = Folders(tmp_path / "ws", {"husky": tmp_path / "ws" / "src" / "husky"})
    (tmp_path / "home").mkdir()
    (tmp_path / "ws" / "src").mkdir(parents=True)
    remove = "rm -rf stand_ins build.log src/husky"
    links = "ln -s ../home stand_ins; ln -s ../home/log build.log; ln -s ../../home src/husky"
    command = ["sh", "-c", f"{remove}; {links}; echo '{MISSES.format('stand_in')}'; exit 1"]
    monkeypatch.setattr(process_module, "sandboxed", lambda *_: command)
    monkeypatch.setattr(build_module, "_check_builds", lambda *_: None)
    with pytest.raises(NotMarkableError, match="links in place of src"):
        build_module.build(folders, frozenset({"husky"}), Workspace())
    assert [path.name for path in folders.stand_ins.glob("share/*")] == ["no_such_stand_in"]
    assert folders.log.read_text().startswith("Could not find")
    assert not list((tmp_path / "home").iterdir())


@pytest.mark.parametrize(
    ("exercise", "words"),
    [
        (3, r"hand-in; husky/controller is commented out in husky/off\.launch; launch files: husky/broken"),
        (4, r"ekf_localization_node; husky/controller is commented out in husky/off\.launch; launch files: "),
    ],
)
def test_without_a_launch_file_that_fits_there_is_no_mark(exercise, words, ann, husky):
    launch(husky / "rviz.launch", RVIZ)
    put(husky / "broken.launch", "<launch>")
    launch(husky / "off.launch", "<!--", NODE.format("husky"), "-->")
    os.mkfifo(husky / "fifo.launch")
    with pytest.raises(NotMarkableError, match=words):
        launch_files(ann, exercise)


# ---------------------------------------------------------------------------- builds


@pytest.mark.parametrize(
    ("line", "is_other"),
    [
        ("#!/usr/bin/python", True),
        ("#!/usr/bin/env python2.7", True),
        ("#!/usr/bin/env python3\r", True),
        ("#!/usr/bin/env python3", False),
        ("#!/usr/bin/python3.8", False),
        ("#!/bin/sh", False),
    ],
)
def test_a_script_of_another_python_is_run_by_python_3(line, is_other, ann, tmp_path):
    folder = package(ann / "husky", "husky")
    (folder / "node").write_bytes(f"{line}\npass\n".encode())
    folders, notes = copied(ann, tmp_path)
    first = "#!/usr/bin/env python3" if is_other else line
    assert (folders.packages["husky"] / "node").read_bytes().decode() == f"{first}\npass\n"
    assert ("run by Python 3, in place of what their first lines name: node" in notes) is is_other


def test_a_copy_has_no_links_and_nothing_built_and_scripts_that_run(ann, tmp_path):
    folder = package(ann / "husky", "husky", email="")
    put(folder / "scripts" / "node.py", "#!/usr/bin/env python3\n").chmod(0o644)
    put(folder / "build" / "old")
    (folder / "link").symlink_to("/etc/passwd")
    os.mkfifo(folder / "fifo")
    folders, notes = copied(ann, tmp_path)
    copy = folders.packages["husky"]
    assert sorted(path.name for path in copy.rglob("*") if path.is_file()) == ["node.py", "package.xml"]
    assert os.access(copy / "scripts" / "node.py", os.X_OK)
    assert "made executable, which a copy through an archive may undo: node.py" in notes
    assert "catkin refuses the package.xml of husky" in notes[1], "it has no e-mail address"
    assert 'email="a@b.org"' in (copy / "package.xml").read_text()


LARGE = "left out, because larger than 100 MB, or 500 MB together: "


def test_large_and_sparse_files_cost_a_note(ann, husky, tmp_path, monkeypatch):
    made = archive(tmp_path / "a.zip", {"a.bag": bytes(100_000_001), "readme.txt": "x"})
    assert unpacked(made) == ([f"{LARGE}a.bag"], {"readme.txt"})
    monkeypatch.setattr(build_module, "MAX_FILE", 1000)
    monkeypatch.setattr(build_module, "MAX_BYTES", 2000)
    with put(husky / "a.bag").open("wb") as bag:
        bag.truncate(3_000_000_000)
    for name in ("b", "c", "d"):
        put(husky / name, "x" * 900)
    folders, notes = copied(ann, tmp_path)
    assert {path.name for path in folders.packages["husky"].iterdir()} == {"package.xml", "b", "c"}
    assert notes == [f"{LARGE}d, a.bag"]


def test_paths_of_another_computer_are_read_in_the_hand_in(ann, husky, tmp_path):
    put(husky / "config" / "a.yaml")
    home = "/home/ann/catkin_ws/src/husky"
    launch(husky / "a.launch", f'<arg name="f" default="{home}/config/a.yaml"/><!-- {home}/b.yaml -->')
    folders, notes = copied(ann, tmp_path)
    text = (folders.packages["husky"] / "a.launch").read_text()
    assert 'default="$(find husky)/config/a.yaml"' in text
    assert f"{home}/b.yaml" in text, "there is no such file"
    assert notes == [f"paths of another computer, read in the hand-in: {home}/config/a.yaml"]


@pytest.mark.parametrize(
    ("output", "words"),
    [
        ("x\nCMake Error at a:1 (find_package):\n  No\n", "CMake Error at a:1 (find_package): No"),
        ("a\n/ws/src/a.cpp:3:1: error: 'x' was not declared\nb", "a.cpp:3:1: 'x' was not declared"),
        ("/ws/src/a.h:3:1: fatal error: no_such/x.h: No such file\n", "a.h:3:1: no_such/x.h: No such file"),
        (
            'Traceback (most recent call last):\n  File "/usr/a.py", line 9, in <module>\n'
            '  File "/ws/src/husky/setup.py", line 3, in <module>\n    import x\nImportError: x\n'
            "CMake Error at /usr/share/catkin/cmake/safe_execute_process.cmake:11 (message):\n",
            "husky/setup.py:3: ImportError: x",
        ),
        ("one\ntwo", "one two"),
        ("", ""),
    ],
)
def test_a_build_that_fails_is_one_line(output, words, tmp_path):
    assert build_module.build_error(output, PurePosixPath("/ws")) == words


NO_HEADER = "a.cpp:1:10: fatal error: a/b.h: No such file or directory"
OLD_CODE = "error: _1 was not declared"
MISSES = 'Could not find a package configuration file provided by\n  "no_such_{}" with any'


@pytest.mark.parametrize(
    ("outputs", "flags", "words"),
    [
        ([NO_HEADER, OLD_CODE, ""], ["", "", build_module.OLD_BOOST], "_1 of boost::bind is made to compile"),
        ([OLD_CODE, ""], ["", build_module.OLD_BOOST], "_1 of boost::bind is made to compile"),
        ([NO_HEADER, ""], ["", ""], ""),
        ([NO_HEADER, NO_HEADER], ["", ""], "does not build: a.cpp:1:10: a/b.h: No such file"),
        (["a.cpp:1:2: error: 5"], [""], "does not build: a.cpp:1:2: 5"),
        ([""], [""], ""),
        (
            [MISSES.format("one"), MISSES.format("two"), ""],
            ["", "", ""],
            "not installed: no_such_one (not in Debian), no_such_two (not in Debian)",
        ),
    ],
)
def test_a_build_is_tried_again_for_late_headers_old_placeholders_and_missing_packages(
    outputs, flags, words, tmp_path, monkeypatch
):
    tried = []

    def make(folders, needed, underlay, flags):
        tried.append(flags)
        return outputs[len(tried) - 1], 2 * bool(outputs[len(tried) - 1])

    monkeypatch.setattr(build_module, "_catkin_make", make)
    folders, notes = copy_packages([], tmp_path / "ws")  # it may be empty
    assert (folders, notes) == (Folders(tmp_path / "ws"), [])
    built = build_module.build(folders, frozenset(), Workspace())
    assert tried == flags
    assert words in "".join(note.text for note in built.notes)
    assert any(note.kind is Kind.BUILD for note in built.notes) == bool(outputs[-1])


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


# ---------------------------------------------------------------------------- what a teacher sets

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
DRIVEN = MarkingResult("ann", "w", {}, (Item("drive", 35.0, 50.0, ""), Item("marker", None, 20.0, "?")))


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


# ---------------------------------------------------------------------------- every hand-in has a result


@pytest.mark.parametrize(
    ("error", "problem"),
    [
        (ZeroDivisionError("odd"), "marking has failed: ZeroDivisionError: odd"),
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


def test_what_does_not_build_is_told_in_every_item_that_needs_it_and_is_not_driven(tmp_path, monkeypatch):
    error = "it does not build: controller.cpp:3:1: error: expected ';'"
    launchable = Launchable("launch", "husky", str(launch(tmp_path / "a.launch", NODE.format("husky"))))
    problem = (Note(Kind.BUILD, error),)
    submission = Submission(
        launchable, Workspace(packages=(tmp_path,)), problem=problem, robot=NamedRobot("husky")
    )
    monkeypatch.setattr(mark_module, "prepare", lambda *_: submission)
    monkeypatch.setattr(observe_module, "drive_submission", None)
    result = mark(Job("ann", str(tmp_path / "ann"), MarkingConfig(), hand_in=str(tmp_path)))
    assert not result.problem
    approach, arrival, _, place, _ = result.items
    for item in (approach, arrival, place):
        assert error in item.evidence
    assert "mend this error first" in approach.hint
    assert arrival.hint == place.hint == "the same as for 'drives towards the pillar'"
    assert result.cause == approach


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
    monkeypatch.setattr(batch_module, "run_program", mark)
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


def test_a_result_folder_with_a_workspace_of_its_own_keeps_it(tmp_path):
    source = put(tmp_path / "ws" / "src" / "node.py")
    path = str(launch(tmp_path / "a.launch", NODE.format("husky")))
    job = Job("a", str(tmp_path), MarkingConfig(), Launchable("launch", "husky", path))
    prepare_module.prepare(job, EXERCISES[3].facts)
    assert source.exists()


def test_a_hand_in_that_cannot_be_marked_shows_no_drive_of_an_earlier_one_and_is_not_tried_again(batch):
    out = batch.out / "hand_ins" / "ann"
    replay = put(out / "drive_1" / "replay.html", "the drive of yesterday")
    (result,) = mark_all(MarkingConfig(), batch)
    assert "no catkin package in it" in result.problem
    assert not replay.exists()
    assert "of yesterday" not in (out / "feedback.html").read_text()
    (out / "mark.log").unlink()
    assert mark_all(MarkingConfig(), batch) == [result]
    assert not (out / "mark.log").exists()


@pytest.fixture
def marked(batch, ann, monkeypatch):
    """A class whose only hand-in was driven before, and the folder of its result; nothing can be started."""
    monkeypatch.setattr(batch_module, "run_program", None)
    job = job_of(HandIn("ann", ann, "ann"), Override(), MarkingConfig(), batch)
    out = Path(job.out)
    notes = (Note(Kind.LAUNCH_FILE, "it starts no node of its own"),)
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
    monkeypatch.setattr(batch_module, "run_program", mark_or_fail)
    (out / "table.txt").unlink()
    (out / "table.txt").mkdir()
    put(batch.folder / "bob" / "readme.txt", "no package")
    put(batch.folder / "marking.yaml", "students: {ann: {late: {percent: 50, word: a day late}}}")
    ann, bob = mark_all(MarkingConfig(), batch)
    assert "table.txt" in ann.problem
    assert "no catkin package in it" in bob.problem


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
    monkeypatch.setattr(batch_module, "run_program", mark_or_fail)
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
    assert problems["Eve"] == "marking has failed: RecursionError: too deep"
    assert "more than 10 files and folders" in problems["bob"]
    assert "; caf\\xe9/package.xml: it is no XML" in problems["ann"], "no path of this machine"
    assert "no catkin package in it" in problems["results.csv"]
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
    monkeypatch.setattr(batch_module, "run_program", run_program)
    monkeypatch.setattr(batch_module, "DEADLINE", -1e6)
    (first,) = mark_all(MarkingConfig(), batch)
    assert first.problem.startswith("it did not end within -")
    monkeypatch.setattr(batch_module, "run_program", None)
    assert mark_all(MarkingConfig(rules=Rules(reached=1.0)), replace(batch, time_limit=7.0)) == [first]
    monkeypatch.setattr(batch_module, "run_program", run_program)
    (result,) = mark_all(MarkingConfig(), replace(batch, only=("ann",), time_limit=0.001))
    assert result.problem == "it did not end within 0.001 s", "as a teacher sets it"


def test_without_network_namespaces_hand_ins_are_marked_one_at_a_time(batch, monkeypatch, capsys):
    numbers = []
    monkeypatch.setattr(batch_module.private_network, "can_be_made", lambda: False)
    monkeypatch.setattr(batch_module, "Workers", lambda jobs, cluster: numbers.append(jobs) or Workers(jobs))
    mark_all(MarkingConfig(), replace(batch, jobs=4))
    assert numbers == [1]
    assert "one hand-in at a time" in capsys.readouterr().err


def test_a_hand_in_of_thousands_of_packages_is_refused(ann):
    for number in range(packages_module.MAX_PACKAGES + 1):
        package(ann / f"p{number}", f"p{number}")
    with pytest.raises(NotMarkableError, match="it holds 201 packages, more than 200"):
        opened(ann)


# ---------------------------------------------------------------------------- on another machine


def test_a_hand_in_travels_with_its_permissions_without_links_and_large_files(ann, tmp_path, monkeypatch):
    put(ann / "src" / "node", "#!/usr/bin/env python3").chmod(0o755)
    (ann / "link").symlink_to("/etc/passwd")
    put(ann / "a.bag", "b" * 2000)
    monkeypatch.setattr(archives, "MAX_FILE", 1000)
    sent = pickle.loads(pickle.dumps(PackedPath(ann)))
    shutil.rmtree(ann)
    (tmp_path / "there").mkdir()
    path = sent.unpack(tmp_path / "there")
    assert path == tmp_path / "there" / "ann"
    assert (path / "src" / "node").stat().st_mode & 0o777 == 0o755
    assert [each.name for each in path.iterdir()] == ["src"]


def test_a_hand_in_is_marked_where_it_was_sent_and_its_results_come_back_but_not_what_it_made(
    ann, batch, monkeypatch
):
    job = job_of(HandIn("ann", ann, "ann"), Override(), MarkingConfig(), batch)

    def marked(job):
        run_program(job)
        for place in ("unpacked", "ws", "drive_1/submission"):  # as if made by it
            for number in range(60):
                put(Path(job.out, place, str(number)))

    monkeypatch.setattr(batch_module, "run_program", marked)
    monkeypatch.setattr(files_module, "MAX_ENTRIES", 50)
    files = run_there(pickle.loads(pickle.dumps((job, PackedPath(ann)))))
    assert not [place for place in files if place.startswith(("unpacked", "ws", "drive_1"))]
    result = batch_module.write_outputs(files, job)
    assert "no catkin package in it" in result.problem
    assert result.settings["exercise"] == 3
    assert open_items(batch.out)[1] == batch.folder
    assert (Path(job.out) / FINGERPRINT).read_text() == job.fingerprint


@pytest.fixture
def job(ann, batch):
    """The job of a hand-in that holds no package."""
    return Job("ann", str(batch.out), MarkingConfig(), hand_in=str(ann))


@pytest.mark.parametrize(
    ("shows_errors", "words"), [(False, "no_such_module"), (True, "(exit code 1): its errors are above")]
)
def test_a_marking_that_dies_is_a_problem_of_its_hand_in(job, monkeypatch, shows_errors, words):
    monkeypatch.setattr(batch_module, "PROGRAM", "no_such_module")
    result = run_program(job, shows_errors)
    assert result.problem.startswith("marking has failed on ")
    assert words in result.problem
    assert not Path(job.out, FINGERPRINT).exists()


@pytest.mark.parametrize(
    "setting", [{"trials": -3}, {"pace": 0.0}, {"robot": "xy"}, {"deadline": float("nan")}, {"seed": -1}]
)
def test_a_setting_of_a_job_that_is_out_of_range_is_named(job, setting, tmp_path):
    wrong = put(tmp_path / "job.json", to_json(replace(job, config=replace(job.config, **setting))))
    with pytest.raises(ConfigError, match=f"config/{next(iter(setting))} = "):
        load(Job, wrong)


def test_marking_and_reviewing_import_nothing_of_the_folder_they_are_called_in_or_write_to(
    job, tmp_path, monkeypatch
):
    for folder in (tmp_path, Path(job.out)):
        put(folder / "yaml.py", "raise SystemExit('imported')")
    monkeypatch.chdir(tmp_path)
    assert "no catkin package in it" in run_program(job).problem
    command = [sys.executable, Path(__file__).parents[3] / "scripts" / "grade", "--review", "nothing"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert str(tmp_path / "nothing") in done.stderr
    assert "imported" not in done.stderr


def test_a_marking_that_is_stopped_may_clean_up(job, tmp_path, monkeypatch):
    put(
        tmp_path / "module" / "slow_marking.py",
        # a suite that runs in the background of a script inherits an ignored SIGINT
        "import pathlib, signal, sys, time\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "up = pathlib.Path(sys.argv[1]).with_name('up')\n"
        "try:\n    up.touch()\n    time.sleep(1000.0)\nfinally:\n    up.unlink()\n",
    )
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path / 'module'}:{os.environ['PYTHONPATH']}")
    monkeypatch.setattr(batch_module, "PROGRAM", "slow_marking")
    up = Path(job.out, "up")
    monkeypatch.setattr(process_module, "STOP_REQUESTED", SimpleNamespace(is_set=up.exists))
    with pytest.raises(process_module.StoppedError):
        run_program(job)
    assert not up.exists()
