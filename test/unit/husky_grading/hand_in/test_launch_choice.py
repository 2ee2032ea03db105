"""Choice of the launch file and package that stand for a hand-in, and what a launch file needs."""

import os

import pytest
from hand_ins import NODE, RVIZ, WORLD, chosen, copied, launch, package
from packages import manifest, put

from husky_grading.exercises.catalogue import EXERCISES
from husky_grading.hand_in import build as build_module
from husky_grading.hand_in import launch_choice
from husky_grading.hand_in import packages as packages_module
from husky_grading.hand_in import prepare as prepare_module
from husky_grading.hand_in.build import Build
from husky_grading.hand_in.copies import copy_packages
from husky_grading.hand_in.packages import NotMarkableError, exercise_numbers
from husky_grading.hand_in.prepare import prepare
from husky_grading.isolation.sandbox import Workspace
from husky_grading.notes import Kind, Note
from husky_grading.records import Job, MarkingConfig, Override
from husky_highlevel_controller.paths import share_folder

pytestmark = pytest.mark.usefixtures("launch_files_read_here")

EXAMPLES = share_folder() / "examples"
CONTROLLER = '<node name="c" pkg="{}" type="controller"/>'
VIEW = "Visualization Manager: {Displays: [{Class: rviz/TF}]}"
SHOWS = '<node name="rviz" pkg="rviz" type="rviz" args="-d $(find husky)/rviz/mine.rviz"/>'


def add_package(folder, name, code, *launched, programs=("controller",)):
    """A package with a source file, and a launch file of its name with this content."""
    put(folder / "package.xml", manifest(name))
    put(folder / "src" / "code.cpp", code)
    for program in programs:
        put(folder / "scripts" / program, "#!/usr/bin/env python3\n").chmod(0o755)
    if launched:
        put(folder / "launch" / f"{name}.launch", f"<launch>{''.join(launched)}</launch>")
    return folder


@pytest.fixture
def ann(tmp_path, monkeypatch):
    """A hand-in's folder; its packages are not built."""
    error = (Note(Kind.BUILD, "it does not build: code.cpp:1"),)
    monkeypatch.setattr(
        prepare_module, "build", lambda folders, *_: Build(Workspace(packages=(folders.root / "src",)), error)
    )
    return tmp_path / "class" / "ann"


def prepared(ann):
    job = Job("ann", str(ann.parents[1] / "out"), MarkingConfig(), hand_in=str(ann))
    submission = prepare(job, EXERCISES[3].facts)
    return submission, " | ".join(note.text for note in submission.notes)


@pytest.mark.parametrize("tutorial", ["a_talker", "z_talker"])
def test_a_tutorial_s_node_never_stands_in_for_a_controller_that_does_not_build(tutorial, ann):
    husky = add_package(ann / "husky", "husky", "LaserScan", CONTROLLER.format("husky"), SHOWS, programs=())
    put(husky / "rviz" / "mine.rviz", VIEW)
    add_package(ann / tutorial, tutorial, "std_msgs/String", CONTROLLER.format(tutorial))
    submission, _ = prepared(ann)
    assert submission.launchable.package == "husky"
    assert [note.text for note in submission.problem] == ["it does not build: code.cpp:1"]
    assert submission.rviz.source == "its rviz node, mine.rviz"


def test_a_tutorial_in_the_controller_s_launch_file_is_not_what_is_driven(ann):
    both = CONTROLLER.format("husky") + CONTROLLER.format("talker").replace('"c"', '"t"')
    add_package(ann / "husky", "husky", "geometry_msgs/Twist", both, programs=())
    add_package(ann / "talker", "talker", "std_msgs/String")
    assert prepared(ann)[0].problem


def test_a_controller_without_a_launch_file_is_named_and_no_tutorial_is_driven(ann):
    add_package(ann / "husky", "husky", "LaserScan")
    add_package(ann / "talker", "talker", "std_msgs/String", CONTROLLER.format("talker"))
    with pytest.raises(NotMarkableError, match=r"no launch file starts a node of husky; .*talker\.launch"):
        prepared(ann)


def test_messages_may_be_named_in_a_package_that_the_node_s_package_needs(ann):
    put(add_package(ann / "husky", "husky", "main()", CONTROLLER.format("husky")) / "package.xml").write_text(
        manifest("husky", "husky_library")
    )
    add_package(ann / "husky_library", "husky_library", "LaserScan")
    assert prepared(ann)[0].launchable.package == "husky"


def test_a_launch_file_in_a_copy_of_a_course_s_package_is_read(ann):
    add_package(ann / "husky", "husky", "LaserScan")
    add_package(ann / "keyboard", "teleop_twist_keyboard", "Twist", CONTROLLER.format("husky"))
    submission, notes = prepared(ann)
    assert (submission.launchable.package, submission.problem) == ("husky", ())
    assert "launch file keyboard/launch/teleop_twist_keyboard.launch: starts husky/controller" in notes


def test_a_launch_file_that_fits_as_well_is_named_unless_it_starts_the_same(ann):
    husky = add_package(ann / "husky", "husky", "LaserScan", CONTROLLER.format("husky"))
    gain = '<param name="gain" value="{}"/>'
    for name, value in (("b", 0.0), ("c", 1.0), ("d", 0.0)):
        put(
            husky / "launch" / f"{name}.launch",
            f"<launch>{CONTROLLER.format('husky')}{gain.format(value)}</launch>",
        )
    (husky / "launch" / "husky.launch").unlink()
    submission, notes = prepared(ann)
    assert submission.equals == ("husky/launch/b.launch", "husky/launch/c.launch")
    assert "write into marking.yaml: `launch: husky/launch/c.launch`" in notes
    for name in ("c", "d"):
        (husky / "launch" / f"{name}.launch").unlink()
    assert prepared(ann)[0].equals == ()


def test_an_include_that_a_copy_of_a_simulator_s_package_lacks_is_skipped(ann):
    include = '<include file="$(find smb_gazebo)/launch/other.launch"/>'
    add_package(ann / "husky", "husky", "LaserScan", include, CONTROLLER.format("husky"))
    add_package(ann / "smb_gazebo", "smb_gazebo", "")
    submission, notes = prepared(ann)
    assert submission.nodes == ("husky/controller",)
    assert "the <include> of smb_gazebo/launch/other.launch is skipped" in notes


@pytest.mark.parametrize(
    ("broken", "kind", "words"),
    [
        (
            '<include file="$(find husky)/launch/gone.launch"/>',
            Kind.MISSING_INCLUDE,
            "husky/launch/gone.launch",
        ),
        ('<param name="a" value="$(arg no_such)"/>', Kind.LAUNCH_FILE, "no_such"),
        ("<node>", Kind.LAUNCH_FILE, "cannot be loaded"),
    ],
)
def test_a_launch_file_that_cannot_be_loaded_is_read_as_text_for_its_rviz_and_its_fault_is_named(
    broken, kind, words, ann
):
    husky = add_package(ann / "husky", "husky", "LaserScan", CONTROLLER.format("husky"), SHOWS, broken)
    put(husky / "rviz" / "mine.rviz", VIEW)
    put(husky / "rviz" / "other.rviz", VIEW)
    submission, _ = prepared(ann)
    assert submission.rviz.source == "its rviz node, mine.rviz"
    assert submission.problem[0].kind is kind
    assert words in submission.problem[0].text


def test_a_configuration_that_is_named_and_not_handed_in_is_told(ann):
    shows = SHOWS.replace("$(find husky)", "/home/me/.rviz")
    husky = add_package(ann / "husky", "husky", "LaserScan", CONTROLLER.format("husky"), shows)
    put(husky / "launch" / "other.launch", f"<launch>{CONTROLLER.format('husky')}{shows}</launch>")
    submission, notes = prepared(ann)
    assert submission.rviz.missing == "/home/me/.rviz/rviz/mine.rviz"
    assert "belongs to" not in notes


@pytest.mark.parametrize("name", ["excercise3", "exe3", "aufgabe3", "Aufgabe_3", "exercice3", "excersise 3"])
def test_a_word_for_exercise_may_be_german_or_misspelt(name):
    assert exercise_numbers(name) == {3}


def new_package(folder, name):
    """A package as `./dev new` writes it, with a node and a launch file of the student's own beside."""
    for part in ("package.xml", "launch/drive.launch", "scripts/drive"):
        put(folder / part, (EXAMPLES / "first_node" / part).read_text().replace("first_node", name))
    put(
        folder / "scripts" / "pilot", "#!/usr/bin/env python3\nfrom sensor_msgs.msg import LaserScan\n"
    ).chmod(0o755)
    put(
        folder / "launch" / "pilot.launch", f'<launch><node name="pilot" pkg="{name}" type="pilot"/></launch>'
    )
    return folder


def test_the_template_of_a_new_package_that_nobody_touched_gives_way_to_the_student_s_own_file(ann):
    package = new_package(ann / "my_husky", "my_husky")
    submission, told = prepared(ann)
    assert submission.launchable.name.endswith("pilot.launch")
    assert "starts RViz" not in told
    put(package / "scripts" / "drive", (package / "scripts" / "drive").read_text() + "# mine\n")
    (package / "launch" / "pilot.launch").unlink()
    assert prepared(ann)[0].launchable.name.endswith("drive.launch"), "a node that is changed counts"


def test_the_template_counts_if_there_is_nothing_else(ann):
    (new_package(ann / "my_husky", "my_husky") / "launch" / "pilot.launch").unlink()
    assert prepared(ann)[0].launchable.name.endswith("drive.launch")


EKF = '<node name="e" pkg="robot_localization" type="ekf_localization_node"/>'
BAG = '<node name="p" pkg="rosbag" type="play"/>'
INCLUDES = '<include file="$(find husky)/parts/b.launch"/>'


def launch_files(ann, exercise=3, **more):
    """Launch files that start something, the chosen one first, in copies of the packages."""
    contents, packages, _ = chosen(ann, exercise)
    facts = EXERCISES[exercise].facts
    out, known = ann.parents[1] / "out", packages_module.copies_of_public(contents.packages)
    folders, _ = copy_packages(packages, out / "ws")
    copies, _ = copy_packages(known, out / "copies")
    workspace = Workspace(packages=(folders.root / "src", *copies.packages.values()))
    override = Override(**more)
    files = launch_choice.read_launch_files(
        contents, [*packages, *known], folders, copies, workspace, override, facts.robot_packages
    )
    return launch_choice.choose_launch_files(files, exercise, facts)


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
    assert "has the number of exercise 3 in its path" in launch_choice.reasons(candidates[0], candidates, 3)
    (only,) = launch_files(ann, launch="launch/ex3.launch")
    assert str(only.place) == "exercise3/launch/ex3.launch"
    with pytest.raises(NotMarkableError, match="which fits 2 files"):
        launch_files(ann, launch="ex3.launch")


def test_a_copy_of_a_known_package_may_have_the_launch_file(ann):
    package(ann / "src" / "husky", "husky")
    copy = package(ann / "src" / "husky_gazebo", "husky_gazebo")
    package(ann / "src" / "old" / "husky_gazebo", "husky_gazebo")
    launch(copy / "launch" / "spawn_husky.launch", NODE.format("gazebo_ros"))
    launch(copy / "launch" / "mine.launch", NODE.format("husky"))
    launch(copy / "launch" / "all.launch.xml", '<include file="$(find husky_gazebo)/launch/mine.launch"/>')
    assert chosen(ann)[2] == ["packages that are not the student's own are left out: husky_gazebo"]
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


@pytest.mark.parametrize(
    ("exercise", "words"),
    [
        (
            3,
            r"submission; husky/controller is commented out in husky/off\.launch; launch files: husky/broken",
        ),
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
