"""Copies of submitted packages: what is left out, and what is repaired."""

import os

import pytest
from hand_ins import LARGE, copied, launch, package
from packages import put

from husky_grading.hand_in import copies


@pytest.mark.parametrize(
    ("line", "is_other"),
    [
        ("#!/usr/bin/python", True),
        ("#!/usr/bin/env python2.7", True),
        ("#!/usr/bin/env python3\r", True),
        ("#!/usr/bin/env python3", False),
        ("#!/usr/bin/env python3.8", True),
        ("#!/usr/bin/python2 -u", True),
        ("#!/home/anna/anaconda3/envs/ros/bin/python3", True),
        ("#! /usr/bin/python3", False),
        ("#!/usr/bin/env ipython3", False),
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
    monkeypatch.setattr(copies, "MAX_FILE", 1000)
    monkeypatch.setattr(copies, "MAX_BYTES", 2000)
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
