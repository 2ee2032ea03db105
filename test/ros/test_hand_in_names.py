"""A class whose folders and archives are called in any way gets the marks of one with plain names."""

import csv
import os
import shutil
import subprocess
import unicodedata
import zipfile

import pytest
from defusedxml import ElementTree
from packages import make_package, put

GRADE = ["rosrun", "husky_highlevel_controller", "grade"]
QUICK = ["--trials", "1", "--deadline", "25", "--pace", "8", "--seed", "0", "--jobs", "2"]
ALL_AT_ONCE = "-O'Br\"ien $(x);%s\\b#&(:<b>`\u202e\u00fc, \u738b\n"
NAMES = (
    "Ann Lee_4711_assignsubmission_file_", "O'Brien", 'a"b', "a..b", "-rf", "line\nfeed", "M\u00fcller",
    unicodedata.normalize("NFD", "J\u00f6rg"), os.fsdecode(b"Ren\xe9"), "n" * 251, "$(x)", "$(find rospy)",
    "%s", "<b>", "a;b", "a\\b", "a#b", "a&b", "hand_in (1)", "a:b", "abc\u202ecba", "`x`", "\u738b\u4f1f",
)  # fmt: skip
MESSAGE = "add_message_files(FILES Own.msg)\ngenerate_messages(DEPENDENCIES std_msgs)\n"


def hand_in(kind, folder, name):
    """A hand-in in C++ with a message of its own, or an archive of one in Python; below a student's name."""
    place = folder / name
    if kind == "cpp":
        package = make_package("drives_in_cpp", place)
        put(package / "msg" / "Own.msg", "std_msgs/Header header\nfloat64 distance\n")
        cmake = package / "CMakeLists.txt"
        text = cmake.read_text().replace("COMPONENTS", "COMPONENTS message_generation")
        cmake.write_text(text.replace("catkin_package(", f"{MESSAGE}catkin_package("))
        manifest = package / "package.xml"
        needs = "<depend>message_generation</depend></package>"
        manifest.write_text(manifest.read_text().replace("</package>", needs))
    else:
        package = make_package("stops_short", place)
        with zipfile.ZipFile(folder / f"{name}.zip", "w") as archive:
            for path in package.rglob("*"):
                archive.write(path, path.relative_to(place))
        shutil.rmtree(place)


def grade(folder, out):
    """Rows of the table of a class, by the student's name."""
    command = [*GRADE, "--all", str(folder), "--out", str(out), *QUICK]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    with (out / "results.csv").open(newline="", encoding="utf-8") as table:
        return {row.pop("submission"): row for row in csv.DictReader(table)}


def points(row):
    return [value for key, value in row.items() if key not in ("state", "notes")]


def test_a_name_with_everything_in_it_costs_no_point_in_cpp_and_python_whatever_out_is_called(tmp_path):
    folder, out = tmp_path / "o'9 $(x) class", tmp_path / "o'9 \"%\\;: out"
    folder.mkdir()
    hand_in("cpp", folder, ALL_AT_ONCE)
    hand_in("python", folder, f"{ALL_AT_ONCE} 2")
    rows = grade(folder, out)
    shown = ALL_AT_ONCE.replace("\n", "\\n").replace("\u202e", "\\u202e")
    cpp, python = rows[f"'{shown}"], rows[f"'{shown} 2"]  # no spreadsheet takes them for a formula
    assert points(cpp)[-2:] == ["70", "70"], cpp
    assert points(python)[:2] == ["20", "0"], python
    suites = {suite.get("name") for suite in ElementTree.parse(out / "junit.xml").getroot()}
    assert suites == {shown, f"{shown} 2"}
    page = (out / "index.html").read_text(encoding="utf-8")
    assert shown.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;") in page.replace(
        "&#39;", "'"
    ).replace("&#34;", '"')
    for place in (out / "hand_ins").iterdir():
        assert str(tmp_path) not in (place / "feedback.html").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["python", "cpp"])
def test_a_class_with_odd_names_gets_the_marks_of_the_same_class_with_plain_names(kind, tmp_path):
    for number, name in enumerate(NAMES):
        hand_in(kind, tmp_path / "odd class", name)
        hand_in(kind, tmp_path / "plain", f"s{number}")
    odd, plain = grade(tmp_path / "odd class", tmp_path / "o'dd"), grade(tmp_path / "plain", tmp_path / "out")
    assert len(odd) == len(plain) == len(NAMES)
    assert [points(row) for row in odd.values()] == [points(row) for row in plain.values()]
