"""Choice of the launch file and package that stand for a hand-in, and what a launch file needs."""

import pytest
from packages import manifest, put

from husky_grading.exercises.catalogue import EXERCISES
from husky_grading.hand_in import prepare as prepare_module
from husky_grading.hand_in.build import Build
from husky_grading.hand_in.packages import NotMarkableError, exercise_numbers
from husky_grading.hand_in.prepare import prepare
from husky_grading.isolation.sandbox import Workspace
from husky_grading.notes import Kind, Note
from husky_grading.records import Job, MarkingConfig
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
