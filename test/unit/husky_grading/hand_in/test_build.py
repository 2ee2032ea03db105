"""Build of a hand-in: what is tried again, what stands in for missing packages, and what its output costs."""

import pytest

from husky_grading.hand_in import build as build_module
from husky_grading.hand_in.build import MAX_STAND_INS, BuildOutcome, build
from husky_grading.hand_in.copies import Folders, copy_packages
from husky_grading.hand_in.packages import NotMarkableError
from husky_grading.isolation import process as process_module
from husky_grading.isolation.sandbox import Workspace
from husky_grading.notes import Kind

MISSES = 'Could not find a package configuration file provided by "{}" with\n'


@pytest.fixture
def missed(tmp_path, monkeypatch):
    """A function that builds, each attempt printing other names; the stand-ins that were made, and notes."""
    for name in ("import_early", "_check_machine_builds"):
        monkeypatch.setattr(build_module, name, lambda *_: None)
    (tmp_path / "ws" / "src").mkdir(parents=True)

    def run(names_of):
        attempts = []

        def catkin_make(*_, repair):
            attempts.append(1)
            return BuildOutcome("".join(map(MISSES.format, names_of(len(attempts)))), 1)

        monkeypatch.setattr(build_module, "_catkin_make", catkin_make)
        folders = Folders(tmp_path / "ws")
        notes = " ".join(note.text for note in build(folders, frozenset(), Workspace()).notes)
        return sorted(path.name for path in folders.stand_ins.glob("share/*")), notes

    return run


def test_a_build_that_prints_any_number_of_missing_packages_gets_50_stand_ins(missed):
    made, notes = missed(lambda attempt: [f"p{attempt}_{number}" for number in range(300)])
    assert len(made) == MAX_STAND_INS
    assert "50 packages or more are missing" in notes


def test_names_that_no_package_has_get_no_stand_in(missed):
    made, notes = missed(lambda attempt: ["x" * 101, "husky_msgs", "a" * 100])
    assert made == ["a" * 100, "husky_msgs"]
    assert "or more are missing" not in notes


def test_a_build_that_lays_links_in_place_of_files_writes_nothing_outside_and_is_refused(
    tmp_path, monkeypatch
):
    folders = Folders(tmp_path / "ws", {"husky": tmp_path / "ws" / "src" / "husky"})
    (tmp_path / "home").mkdir()
    (tmp_path / "ws" / "src").mkdir(parents=True)
    remove = "rm -rf stand_ins build.log src/husky"
    links = "ln -s ../home stand_ins; ln -s ../home/log build.log; ln -s ../../home src/husky"
    command = ["sh", "-c", f"{remove}; {links}; echo '{NO_SUCH.format('stand_in')}'; exit 1"]
    monkeypatch.setattr(process_module, "sandboxed", lambda *_: command)
    monkeypatch.setattr(build_module, "_check_machine_builds", lambda *_: None)
    with pytest.raises(NotMarkableError, match="by a link; remove that step"):
        build_module.build(folders, frozenset({"husky"}), Workspace())
    assert [path.name for path in folders.stand_ins.glob("share/*")] == ["no_such_stand_in"]
    assert folders.log.read_text().startswith("Could not find")
    assert not list((tmp_path / "home").iterdir())


NO_HEADER = "a.cpp:1:10: fatal error: a/b.h: No such file or directory"
OLD_CODE = "error: _1 was not declared"
NO_SUCH = 'Could not find a package configuration file provided by\n  "no_such_{}" with any'


@pytest.mark.parametrize(
    ("outputs", "flags", "words"),
    [
        (
            [NO_HEADER, OLD_CODE, ""],
            ["", "", build_module.OLD_BOOST],
            "_1 of boost::bind was made to compile",
        ),
        ([OLD_CODE, ""], ["", build_module.OLD_BOOST], "_1 of boost::bind was made to compile"),
        ([NO_HEADER, ""], ["", ""], ""),
        ([NO_HEADER, NO_HEADER], ["", ""], "does not build: a.cpp:1:10: a/b.h: No such file"),
        (["a.cpp:1:2: error: 5"], [""], "does not build: a.cpp:1:2: 5"),
        ([""], [""], ""),
        (
            [NO_SUCH.format("one"), NO_SUCH.format("two"), ""],
            ["", "", ""],
            "not installed: no_such_one (not in Debian), no_such_two (not in Debian)",
        ),
    ],
)
def test_a_build_is_tried_again_for_late_headers_old_placeholders_and_missing_packages(
    outputs, flags, words, tmp_path, monkeypatch
):
    tried = []

    def make(folders, needed, underlay, repair):
        tried.append(repair)
        return BuildOutcome(outputs[len(tried) - 1], 2 * bool(outputs[len(tried) - 1]))

    monkeypatch.setattr(build_module, "_catkin_make", make)
    folders, notes = copy_packages([], tmp_path / "ws")  # it may be empty
    assert (folders, notes) == (Folders(tmp_path / "ws"), [])
    built = build_module.build(folders, frozenset(), Workspace())
    assert tried == flags
    assert words in "".join(note.text for note in built.notes)
    assert any(note.kind is Kind.BUILD for note in built.notes) == bool(outputs[-1])


def test_a_package_of_the_submission_that_package_xml_forgets_is_built_too(tmp_path, monkeypatch):
    tried = []

    def make(folders, needed, underlay, repair):
        tried.append(set(needed))
        output = "" if "helpers" in needed else MISSES.format("helpers")
        return BuildOutcome(output, bool(output))

    monkeypatch.setattr(build_module, "_catkin_make", make)
    monkeypatch.setattr(build_module, "_check_machine_builds", lambda *_: None)
    packages = {name: tmp_path / "ws" / "src" / name for name in ("husky", "helpers", "other")}
    for folder in packages.values():
        folder.mkdir(parents=True)
    folders = Folders(tmp_path / "ws", packages)
    assert build(folders, frozenset({"husky"}), Workspace()).notes == ()
    assert tried == [{"husky"}, {"husky", "helpers"}]
    assert not folders.stand_ins.exists()
