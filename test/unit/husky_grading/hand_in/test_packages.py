"""Packages of a hand-in: how they are found, and which of them stand for an exercise."""

import os
from pathlib import Path, PurePosixPath

import pytest
from hand_ins import NODE, archive, chosen, launch, opened, package
from packages import manifest, put

from husky_grading.hand_in import packages as packages_module
from husky_grading.hand_in.packages import Fit, NotMarkableError, open_hand_in

pytestmark = pytest.mark.usefixtures("launch_files_read_here")


def test_an_archive_of_another_kind_is_refused(tmp_path):
    put(tmp_path / "dan.7z")
    with pytest.raises(NotMarkableError, match=r"dan\.7z cannot be opened; hand in one of \.zip, "):
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
    assert contents.notes[1].startswith("h.rar cannot be opened; hand in one of .zip, ")


@pytest.mark.parametrize(
    "name", ["", "/tmp/elsewhere", "../up", "a b", "a;rm", "-flag", "a/b", "n" * 101], ids=repr
)
def test_the_name_of_a_package_is_a_name(name, ann):
    put(ann / "package.xml", f"<package><name>{name}</name></package>")
    contents = opened(ann)
    assert contents.packages == ()
    assert "which is not a valid name of a package" in contents.notes[0]


def test_the_name_of_a_package_may_begin_with_a_digit_as_that_of_a_course_does(ann):
    package(ann / "controller", "5ro14_husky_controller")
    contents = opened(ann)
    assert [each.name for each in contents.packages] == ["5ro14_husky_controller"]
    assert contents.notes == ()


def test_a_hand_in_of_thousands_of_packages_is_refused(ann):
    for number in range(packages_module.MAX_PACKAGES + 1):
        package(ann / f"p{number}", f"p{number}")
    with pytest.raises(NotMarkableError, match="has 201 packages, at most 200 are read"):
        opened(ann)


@pytest.mark.parametrize("old", ["backup", "old", "a_copy", "Archiv", "alte Version", "archive-2"])
def test_an_old_copy_of_a_package_is_not_taken_even_if_it_has_more_files(old, ann):
    present = package(ann / "src" / "folder_of_gold" / "husky", "husky")
    put(package(ann / old / "husky", "husky") / "src" / "many.cpp")
    _, (taken,), _ = chosen(ann)
    assert taken.path == present


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
        "exercise5/ex3.launch": Fit.THIS_EXERCISE,
        "exercise3/husky.launch": Fit.THIS_EXERCISE,
        "exercise3/ex5.launch": Fit.OTHER_EXERCISE,
        "U\u0308bung 3/a.launch": Fit.THIS_EXERCISE,
        "src/a": Fit.NO_NUMBER,
    }
    assert {place: packages_module.fit_of_path(PurePosixPath(place), 3) for place in innermost} == innermost


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
    assert "package husky is taken from Solution/husky; these copies are left out: Input/husky" in notes
    put(solved / "launch" / name, f"<launch><!-- {NODE.format('husky')} --></launch>")
    _, (taken,), _ = chosen(ann)
    assert taken.path == full, "it has more files"


def test_other_exercises_and_known_packages_are_left_aside_unless_needed(ann):
    package(ann / "ex3" / "husky", "husky", "messages")
    package(ann / "ex2" / "messages", "messages")
    package(ann / "ex4" / "slam", "slam")
    package(ann / "teleop", "teleop_twist_keyboard")
    _, packages, notes = chosen(ann)
    assert [each.name for each in packages] == ["husky", "messages"]
    assert "packages that are not the student's own are left out: teleop_twist_keyboard" in notes
    assert "packages of other exercises are left out: slam" in notes


def test_a_package_is_needed_if_a_python_node_imports_it_and_package_xml_forgets_it(ann):
    package(ann / "ex3" / "husky", "husky")
    put(
        ann / "ex3" / "husky" / "scripts" / "drive", "#!/usr/bin/env python3\nfrom messages.msg import Goal\n"
    )
    package(ann / "ex2" / "messages", "messages")
    package(ann / "ex4" / "slam", "slam")
    _, packages, _ = chosen(ann)
    assert [each.name for each in packages] == ["husky", "messages"]
