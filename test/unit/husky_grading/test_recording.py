"""Recording of a drive: which commands are nothing, and which notes go into it."""

import struct
from math import inf, nan

import pytest

from husky_grading.notes import Kind, Note
from husky_grading.recording import Closing, Recording, closed, is_zero
from husky_highlevel_controller.datatypes import Pose2D


@pytest.mark.parametrize(
    ("numbers", "zero"),
    [
        ((0.0,) * 6, True),
        ((0.0, 0.0, 0.0, 0.0, 0.0, -0.0), True),  # 0.0 * -0.3, a gain of 0 with the pillar on the right
        ((0.0, 0.0, 0.0, 0.0, 0.0, 1e-8), True),
        ((0.0, 0.0, 0.0, 0.0, 0.0, -0.001), False),
        ((nan, 0.0, 0.0, 0.0, 0.0, 0.0), False),
        ((inf, 0.0, 0.0, 0.0, 0.0, 0.0), False),
    ],
)
def test_a_command_is_zero_by_its_numbers(numbers, zero):
    assert is_zero(struct.pack("<6d", *numbers)) is zero


@pytest.mark.parametrize(("content", "zero"), [(b"", True), (b"\0\0\0", True), (b"\0\0\1", False)])
def test_what_is_no_twist_is_zero_by_its_bytes(content, zero):
    assert is_zero(content) is zero


def test_after_a_node_has_ended_its_silence_is_no_finding_but_what_it_sent_is():
    silent = Note(Kind.UNANSWERED_SCANS, "it does not answer every scan")
    unreadable = Note(Kind.UNREADABLE, "2 messages on /viz are not of its type")
    recording = Recording(Pose2D(), (20.0, 5.0), 60.0, notes=(silent, unreadable))
    died = Note(Kind.NODE_FAILED, "node n ends")
    assert closed(recording, Closing((died,))).notes == (died, unreadable)
    assert closed(recording, Closing()).notes == (silent, unreadable)
