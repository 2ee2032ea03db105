"""What a submission writes while it runs: its events and its output cost marking a bounded time."""

import re
from types import SimpleNamespace

import pytest

from husky_grading import submission
from husky_grading.notes import Kind, Note
from husky_grading.submission import MAX_EVENTS, Event, notes_on, read_events

DIED = '{"event": "died", "node": "n%d", "exit_code": 1}\n'


def test_the_output_is_searched_once_however_many_nodes_died(monkeypatch):
    searched = []

    def findall(output):
        searched.append(len(output))
        return [("a.py", "7")]

    monkeypatch.setattr(submission, "_LINE", SimpleNamespace(findall=findall))
    events = [Event("died", node=f"n{number}", exit_code=1) for number in range(50)]
    notes = notes_on(events, "KeyError: 'x'\n")
    assert len(notes) == 50
    assert notes[0].text == "node n0 ends during the run (exit code 1): KeyError: 'x' (a.py:7)"
    assert len(searched) == 1


def test_events_that_a_submission_forges_are_bounded_and_that_there_were_more_is_told(tmp_path):
    file = tmp_path / "events.jsonl"
    file.write_text("".join(DIED % number for number in range(MAX_EVENTS + 30)))
    events = read_events(file)
    assert len(events) == MAX_EVENTS
    told = [note.text for note in notes_on(events, "") if note.kind is Kind.LIMIT]
    assert told == [f"it wrote more than {MAX_EVENTS} events; the first {MAX_EVENTS - 1} of them count"]
    file.write_text("".join(DIED % number for number in range(MAX_EVENTS)))
    notes = notes_on(read_events(file), "")
    assert len(notes) == MAX_EVENTS
    assert {note.kind for note in notes} == {Kind.NODE_FAILED}
    assert re.fullmatch(r"node n0 ends .*", notes[0].text)


RAISES = """[ERROR] [1700000000.12, 0.340000]: bad callback: <function on_scan at 0x7f00>
Traceback (most recent call last):
  File "/usr/lib/python3/dist-packages/rospy/topics.py", line 750, in _invoke_callback
    cb(msg)
  File "/ws/src/husky/scripts/controller", line 23, in on_scan
    nearest = minimum(scan.ranges)
NameError: name 'minimum' is not defined
"""


@pytest.mark.parametrize(
    ("error", "is_python_2"),
    [
        ("SyntaxError: Missing parentheses in call to 'print'. Did you mean print(...)?", True),
        ("SyntaxError: multiple exception types must be parenthesized", True),
        ("NameError: name 'xrange' is not defined. Did you mean: 'range'?", True),
        ("SyntaxError: invalid syntax", False),
        ("NameError: name 'ranges' is not defined", False),
    ],
)
def test_code_for_python_2_is_told_from_other_errors(error, is_python_2):
    output = f'  File "/ws/src/husky/scripts/controller", line 7\n{error}\n'
    first, *_ = notes_on([Event("died", node="n", exit_code=1)], output)
    assert (first.kind is Kind.PYTHON_2) is is_python_2
    assert error in first.text


def test_an_exception_in_a_callback_is_named_with_its_line():
    (note,) = notes_on([], RAISES * 7)
    said = "callback on_scan raises NameError: name 'minimum' is not defined (controller:23), "
    said += "first at 0.34 s, 7 times"
    assert note == Note(Kind.EXCEPTION, said, 0.34)
    assert notes_on([], "all is well\nTraceback of a path\n") == []
