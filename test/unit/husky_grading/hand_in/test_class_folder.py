"""Names of the hand-ins of a class: right for people, and safe wherever a path becomes part of a command."""

import os
import re
import unicodedata
import zipfile

import pytest
from packages import put

from husky_grading.hand_in.class_folder import MAX_FOLDER, find_hand_ins, left_out

# what students, browsers, Moodle and macOS call folders; and how people see it
SHOWN = {
    "Ann Lee_4711_assignsubmission_file_": "Ann Lee_4711_assignsubmission_file_",
    "O'Brien": "O'Brien",
    'a"b': 'a"b',
    "a..b": "a..b",
    "-rf": "-rf",
    "line\nfeed": "line\\nfeed",
    "M\u00fcller": "M\u00fcller",
    unicodedata.normalize("NFD", "J\u00f6rg"): "J\u00f6rg",
    os.fsdecode(b"Ren\xe9"): "Ren\u00e9",
    "n" * 255: "n" * 255,
    "$(x)": "$(x)",
    "$(find rospy)": "$(find rospy)",
    "%s": "%s",
    "<b>": "<b>",
    "a;b": "a;b",
    "a\\b": "a\\b",
    "a#b": "a#b",
    "a&b": "a&b",
    "hand_in (1)": "hand_in (1)",
    "a:b": "a:b",
    "abc\u202ecba": "abc\\u202ecba",
    "`x`": "`x`",
    "\u738b\u4f1f": "\u738b\u4f1f",
    "   ": "   ",
}
PLAIN = ("ann", "ann_lee", "4711", "a.b-c_D", "_ann", "n" * MAX_FOLDER)


def found(folder):
    """Hand-ins by the names of their files."""
    return {each.path.name: each for each in find_hand_ins(folder)}


def test_people_see_each_name_as_it_is_written_and_paths_have_letters_that_every_command_takes(tmp_path):
    for name in (*SHOWN, *PLAIN):
        (tmp_path / name).mkdir()
    hand_ins = found(tmp_path)
    assert {entry: each.name for entry, each in hand_ins.items()} == {**SHOWN, **{n: n for n in PLAIN}}
    folders = [each.folder for each in hand_ins.values()]
    assert len(set(folders)) == len(SHOWN) + len(PLAIN)
    for folder in folders:
        assert re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,199}", folder)
    assert [hand_ins[name].folder for name in PLAIN] == list(PLAIN), "as users know them"
    assert hand_ins["Ann Lee_4711_assignsubmission_file_"].folder == "Ann_Lee_4711_assignsubmission_file_"
    assert not any(each.problem for each in hand_ins.values())


def test_names_that_look_alike_or_meet_in_a_path_are_told_apart_and_the_plain_one_keeps_its_own(tmp_path):
    decomposed, latin = unicodedata.normalize("NFD", "M\u00fcller"), os.fsdecode(b"M\xfcller")
    names = ("M\u00fcller", decomposed, latin, "M\\xfcller", "Muller", "a b", "a+b", "a_b")
    for name in names:
        (tmp_path / name).mkdir()
    hand_ins = found(tmp_path)
    for different in ("name", "folder"):
        assert len({getattr(each, different) for each in hand_ins.values()}) == len(names)
    assert [hand_ins[name].name for name in (names[0], decomposed)] == [names[0], "Mu\\u0308ller"]
    assert hand_ins["M\\xfcller"].name == "M\\xfcller"
    assert hand_ins[latin].name.startswith("M\\xfcller~")
    assert (hand_ins["a_b"].folder, hand_ins["Muller"].folder) == ("a_b", "Muller")
    (tmp_path / hand_ins["a b"].folder).mkdir()  # of a fellow who knows how they are made
    (tmp_path / "a_b").rmdir()
    again = found(tmp_path)
    assert again[hand_ins["a b"].folder].folder == hand_ins["a b"].folder
    assert len({each.folder for each in again.values()}) == 8


def test_each_folder_and_archive_of_a_class_is_one_student(tmp_path):
    put(tmp_path / "ann" / "one" / "package.xml")
    for name in ("bob.ZIP", "cid.tar.gz", "dan.7z", "marking.yaml", ".hidden/package.xml", "zip"):
        put(tmp_path / name)
    (tmp_path / "link").symlink_to(tmp_path / "ann")
    (tmp_path / "__MACOSX").mkdir()
    os.mkfifo(tmp_path / "fifo.zip")
    assert [each.name for each in find_hand_ins(tmp_path)] == ["ann", "bob", "cid", "dan"]
    assert left_out(tmp_path) == ["fifo.zip", "link", "marking.yaml", "zip"]
    (one,) = find_hand_ins(tmp_path / "ann" / "one")
    assert (one.name, one.path) == ("one", tmp_path / "ann" / "one"), "a package is one, too"


@pytest.mark.parametrize("twin", ["bob.zip", "bob.tar.gz"])
def test_two_entries_of_one_student_are_named_and_cost_nobody_else_anything(twin, tmp_path):
    for name in ("ann", "bob"):
        (tmp_path / name).mkdir()
    zipfile.ZipFile(tmp_path / twin, "w").close()
    problems = {each.name: each.problem for each in find_hand_ins(tmp_path)}
    assert problems == {
        "ann": "",
        "bob": f"bob and {twin} are both the submission of bob; leave one of them in the folder",
    }
