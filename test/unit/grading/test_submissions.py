"""Marks of the submissions in test/submissions, judged by kept recordings of their drives."""

import lzma
import re

import pytest
from markings import FILES, KEPT, check, judge_kept

from husky_highlevel_controller.grading.reports.files import write_class

OTHER_WORDS = "it raises, floods, does not answer, stood still, ends during the drive, then none"


@pytest.mark.parametrize("name", KEPT)
def test_everybody_gets_what_they_deserve_and_is_told_why_in_whatever_words(name, tmp_path):
    result = judge_kept(name, tmp_path)
    check(name, result)
    reworded = judge_kept(name, tmp_path, OTHER_WORDS)
    marks, others = ([(each.points, each.hint) for each in judged.items] for judged in (result, reworded))
    assert others == marks


def test_what_it_forges_is_text_on_every_page(tmp_path):
    write_class([judge_kept("forges_events", tmp_path)], tmp_path)
    pages = [path.read_text() for path in tmp_path.glob("*.*") if path.suffix not in (".json", ".png")]
    assert any("SIGSEGV" in page for page in pages)
    for page in pages:
        assert not [letter for letter in page if not letter.isprintable() and letter not in "\n\r\t"]
        assert "<script>alert" not in page or "<html" not in page


def test_recordings_are_small_and_say_nothing_of_the_machine_they_were_made_on():
    kept = {path.name.partition(".")[0]: path.read_bytes() for path in FILES.iterdir()}
    assert sorted(kept) == sorted(KEPT)
    assert sum(map(len, kept.values())) < 400_000
    text = "".join(lzma.decompress(content).decode() for content in kept.values())
    assert not re.findall(r"/tmp/|/home/|/root/|/work|localhost|127\.0|\[\d{10}\.", text)
