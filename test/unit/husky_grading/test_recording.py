"""Recording of a drive: its commands, notes, gaps and jumps, and its text."""

import json
import struct
from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest
from drives import GOOD, NOSE, PILLAR, WAY, markers

from husky_grading.exercises.exercise_3 import judge_arrival
from husky_grading.notes import Kind, Note
from husky_grading.recording import (
    CUT_OFF,
    Closing,
    Recording,
    closed,
    hull_gaps,
    is_zero,
    pose_jumps,
    recording_to_json,
)
from husky_highlevel_controller.config import from_plain
from husky_highlevel_controller.course import PILLARS
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


def test_a_run_that_is_cut_off_in_its_first_second_has_its_true_length():
    recording = Recording(Pose2D(), (20.0, 5.0), 60.0, times=np.array([0.0, 0.3]), ended=CUT_OFF)
    (note,) = closed(recording, Closing()).notes
    assert (note.kind, note.at) == (Kind.CUT_OFF, 0.3)
    assert "cut off at 0.30 s" in note.text


@pytest.mark.parametrize(
    ("robot", "pose", "gap"),
    [
        ("husky", (0.0, 0.0, 0.0), WAY),
        ("husky", (0.0, 0.0, np.pi / 2), 10.0 - 0.2 - 0.34255),  # its wheels stick out sideways
        ("husky", (10.0, -1.0, np.pi / 2), 1.0 - 0.2 - NOSE),
        ("husky", (10.0, 0.0, 0.0), -0.2),
        ("smb", (0.0, 0.0, 0.0), np.hypot(10.0 - 0.4059, 0.235) - 1.0),  # whose pillar is thicker
    ],
)
def test_the_gap_is_from_the_outline_of_the_robot_that_drove_to_the_surface_of_its_pillar(robot, pose, gap):
    assert hull_gaps(np.array([pose]), PILLAR, robot)[0] == pytest.approx(gap, abs=1e-4)


def test_a_recording_comes_back_from_its_text():
    notes = (Note(Kind.NODE_ENDED, "node n ends during the run (exit code 0)"),)
    made = replace(markers(GOOD, (10.0, 0.0, nan)), robot="smb", notes=notes)
    again = from_plain(Recording, json.loads(recording_to_json(made)), "")
    assert np.array_equal(again.poses, np.round(made.poses, 4))
    assert again.markers[3].topic == "/marker"
    assert (again.start, again.notes, again.pillar_size) == (made.start, notes, PILLARS["smb"])
    assert judge_arrival(again) == judge_arrival(made)


def test_a_pose_that_jumps_is_named():
    assert pose_jumps(GOOD.times, GOOD.poses) == []
    moved = GOOD.poses.copy()
    moved[100:, 0] += 5.0
    assert pose_jumps(GOOD.times, moved) == ["the robot jumps 5.01 m at 2.02 s"]
