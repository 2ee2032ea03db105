"""Marks of the submissions in test/submissions, judged by kept recordings of their drives."""

import lzma
import re

import pytest
from markings import FILES, KEPT, check, judge_kept

OTHER_WORDS = "it raises, floods, does not answer, stood still, ends during the drive, then none"


@pytest.mark.parametrize("name", KEPT)
def test_everybody_gets_what_they_deserve_and_is_told_why_in_whatever_words(name, tmp_path):
    result = judge_kept(name, tmp_path)
    check(name, result)
    reworded = judge_kept(name, tmp_path, OTHER_WORDS)
    marks, others = ([(each.points, each.hint) for each in judged.items] for judged in (result, reworded))
    assert others == marks


def test_recordings_are_small_and_say_nothing_of_the_machine_they_were_made_on():
    kept = {path.name.partition(".")[0]: path.read_bytes() for path in FILES.iterdir()}
    assert sorted(kept) == sorted(KEPT)
    assert sum(map(len, kept.values())) < 400_000
    text = "".join(lzma.decompress(content).decode() for content in kept.values())
    assert not re.findall(r"/tmp/|/home/|/root/|/work|localhost|127\.0|\[\d{10}\.", text)
