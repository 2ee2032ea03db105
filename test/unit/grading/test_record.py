"""A record of a marking: the same drive has the same hash, and what differs is named."""

from dataclasses import replace

import numpy as np
import pytest

from husky_highlevel_controller.datatypes import HuskyError, Pose, Pose2D, TrueState
from husky_highlevel_controller.grading.drive.drive_end import NO_COMMAND, NODES_ENDED, DriveEnd
from husky_highlevel_controller.grading.drive.recording import Recording
from husky_highlevel_controller.grading.record import (
    SCHEMA,
    Record,
    differences,
    hash_of_poses,
    hashes_of_files,
    load_record,
)
from husky_highlevel_controller.grading.records import Launchable, MarkingConfig, to_json

RECORD = Record(
    SCHEMA, "ann", Launchable("launch", "ann", "a.launch"), (), ("/class",), MarkingConfig(),
    {"a.launch": "1", "a.py": "2"}, {"python": "3.11"}, ("aa", "bb"), {"drives": 20.0, "RViz": None},
)  # fmt: skip


def drive(seconds, pillar=(10.0, 0.0), ended="it stands at the pillar"):
    """Straight towards a pillar, standing at 9.2 m from 8 s on; recorded for so long."""
    times = np.round(np.arange(0.02, seconds, 0.02), 2)
    x = np.minimum(1.15 * times, 9.2)
    poses = np.column_stack([x, np.zeros_like(x), np.zeros_like(x)])
    speeds = np.column_stack([np.where(times < 8.0, 1.15, 0.0), np.zeros_like(x)])
    end = DriveEnd(pillar, "husky")
    for stamp, pose, (speed, yaw_rate) in zip(times, poses, speeds):
        end.update(TrueState(stamp, Pose((pose[0], 0.0, 0.13)), speed, yaw_rate))
    return Recording(
        Pose2D(), pillar, 60.0, times, poses, speeds, times, ended=ended, decided_at=end.decided_at(ended)
    )


def test_how_long_recording_went_on_after_the_end_does_not_count():
    assert hash_of_poses(drive(12.0)) == hash_of_poses(drive(14.0))
    moved = drive(12.0)
    poses = moved.poses.copy()
    poses[100, 1] += 0.001
    assert hash_of_poses(replace(moved, poses=poses)) != hash_of_poses(moved)


@pytest.mark.parametrize("seconds", [11.5, 12.0])
def test_nor_where_the_nodes_had_ended(seconds):
    far = ((20.0, 0.0), NODES_ENDED)
    assert hash_of_poses(drive(seconds, *far)) == hash_of_poses(drive(11.02, *far))
    assert hash_of_poses(drive(10.0, *far)) != hash_of_poses(drive(11.02, *far))


def test_nor_where_they_had_ended_without_a_command():
    never = ((20.0, 0.0), NO_COMMAND)
    assert hash_of_poses(drive(0.5, *never)) == hash_of_poses(drive(1.5, *never))


def test_a_record_comes_back_from_its_file(tmp_path):
    path = tmp_path / "record.json"
    path.write_text(to_json(RECORD))
    assert load_record(path) == RECORD


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"schema": "other"}'])
def test_what_is_no_record_is_an_error(text, tmp_path):
    path = tmp_path / "record.json"
    path.write_text(text)
    with pytest.raises(HuskyError, match="not a record"):
        load_record(path)


def test_what_differs_is_named():
    assert differences(RECORD, RECORD) == []
    assert differences(RECORD, replace(RECORD, versions={"python": "3.12"})) == []
    after = replace(
        RECORD, inputs={"a.launch": "1", "a.py": "3", "b.py": "4"}, drives=("aa", "cc"),
        points={"drives": 10.0, "RViz": None}, versions={"python": "3.12"},
    )  # fmt: skip
    assert differences(RECORD, after) == [
        "file a.py has changed",
        "file b.py is new",
        "drive 2 differs",
        "drives: 20.0 points before, 10.0 now",
        "python was 3.11, is 3.12",
    ]


def test_files_are_hashed_by_their_content(tmp_path):
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "a.py").write_text("x")
    (tmp_path / ".git").mkdir()
    (tmp_path / ".git" / "HEAD").write_text("y")
    first = hashes_of_files(tmp_path)
    (tmp_path / "src" / "a.py").write_text("z")
    assert list(first) == ["src/a.py"]
    assert hashes_of_files(tmp_path) != first
