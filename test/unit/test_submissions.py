"""Marks of the submissions in test/submissions, judged by kept recordings of their drives."""

import lzma
import re
import sys
from pathlib import Path

import pytest
from markings import FILES, KEPT, check, judge_kept

from husky_grading.reports.files import write_result
from husky_highlevel_controller.paths import share_folder

OTHER_WORDS = "it raises, floods, does not answer, stood still, ends during the run, then none"


@pytest.mark.parametrize("name", KEPT)
def test_everybody_gets_what_they_deserve_and_is_told_why_in_whatever_words(name, tmp_path):
    result = judge_kept(name, tmp_path)
    check(name, result)
    reworded = judge_kept(name, tmp_path, OTHER_WORDS)
    marks, others = ([(each.points, each.hint) for each in judged.items] for judged in (result, reworded))
    assert others == marks


@pytest.mark.parametrize("name", ["does_not_build", "crashes_by_import", "needs_more"])
def test_no_page_for_a_student_names_a_folder_of_this_machine(name, tmp_path):
    """Those of the driven ones are read in test/ros/test_grade.py."""
    out = tmp_path / "out"
    out.mkdir()
    folders = [out, Path(sys.prefix), share_folder(), Path.home()]
    said = " and ".join(f"{folder}/ws/src/a.cpp:3" for folder in folders)
    (out / "build.log").write_text(f"In file included from {said}")
    kept = {"crashes_by_import": "imports_what_is_missing", "needs_more": "raises_in_callback"}
    result = judge_kept(kept.get(name, name), out, said)
    write_result(result, out)
    pages = [path.read_text() for path in (out / "feedback.html", out / "table.txt", out / "junit.xml")]
    for page in pages:
        assert "ws/src/a.cpp:3" in page
        assert not [folder for folder in folders if f"{folder}/" in page]


def test_recordings_are_small_and_say_nothing_of_the_machine_they_were_made_on():
    kept = {path.name.partition(".")[0]: path.read_bytes() for path in FILES.iterdir()}
    assert sorted(kept) == sorted(KEPT)
    assert sum(map(len, kept.values())) < 400_000
    text = "".join(lzma.decompress(content).decode() for content in kept.values())
    assert not re.findall(r"/tmp/|/home/|/root/|/work|localhost|127\.0|\[\d{10}\.", text)
