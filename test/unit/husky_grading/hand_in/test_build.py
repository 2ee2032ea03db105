"""Build of a hand-in: what is mended in its copy, what is tried again, and what its output costs."""

import os
from pathlib import PurePosixPath

import pytest
from hand_ins import LARGE, copied, launch, package
from packages import put

from husky_grading.hand_in import build as build_module
from husky_grading.hand_in.build import MAX_STAND_INS, BuildOutcome, Folders, build, copy_packages
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
    assert ("scripts run by Python 3 instead of the program in their first line: node" in notes) is is_other


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
    assert "scripts were made executable, because an archive may lose this: node.py" in notes
    assert "catkin rejects the package.xml of husky" in notes[1], "it has no e-mail address"
    assert 'email="a@b.org"' in (copy / "package.xml").read_text()


def test_large_and_sparse_files_cost_a_note(ann, husky, tmp_path, monkeypatch):
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
    assert notes == [
        f"paths of another computer were replaced by files of the submission: {home}/config/a.yaml"
    ]


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
