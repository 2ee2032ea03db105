"""Fault of a marker: it is named as it is in the code of the student."""

from dataclasses import replace
from math import nan

import numpy as np
from drives import TO_PILLAR, drive, markers, place

from husky_highlevel_controller.course import PILLARS


def turning(place_of, frame="odom", **more):
    """A drive that turns 25 degrees to the pillar in 4 s and drives there; markers by base_link."""
    straight = drive((4.0, 0.0), (TO_PILLAR, 0.5))
    yaw = np.clip(-0.44 + 0.44 * straight.times / 4.0, -0.44, 0.0)
    poses = np.column_stack([straight.poses[:, :2], yaw])

    def place(row):
        x, y, yaw = poses[row]
        c, s, dx, dy = np.cos(yaw), np.sin(yaw), 10.0 - x, -y
        ahead, left = place_of(dx * c + dy * s, dy * c - dx * s)
        return x + ahead * c - left * s, y + ahead * s + left * c, 0.0

    marked = markers(replace(straight, poses=poses), place)
    return replace(marked, markers=tuple(replace(each, frame=frame, **more) for each in marked.markers))


def mirrored(x, y):
    return x, -y


def test_a_mirrored_marker_gets_half_at_most_and_is_named():
    assert place(turning(lambda x, y: (x, y))).points == 20.0
    item = place(turning(mirrored))
    assert 9.0 <= item.points <= 10.0
    assert item.evidence.startswith(
        "mirrored: y has the wrong sign, because this lidar is mounted upside down; "
    )
    assert "0 % with the pillar to the side, 100 % with it ahead" in item.evidence
    assert "upside down" not in place(replace(turning(mirrored), robot="smb")).evidence


def test_the_fault_of_a_marker_is_named_as_it_is_in_the_code():
    """Those of test/submissions are named in their recordings."""
    whole_metres = place(turning(lambda x, y: (np.trunc(x), np.trunc(y)), "base_link"))
    assert "whole metres" in whole_metres.evidence
    near = place(turning(lambda x, y: (x - 1.5, y), "front_laser"))
    assert "m in front of the pillar, seen" in near.evidence
    assert near.hint.startswith("check header.frame_id")
    assert "base_link" not in near.hint
    assert "NaN" not in place(turning(lambda x, y: (nan, y), problem="its alpha is 0")).hint


def beside(x, y, angle):
    """A place on the near side of the SMB's pillar, by the nearest beam or by one at an angle from it."""
    distance = np.hypot(x, y) - PILLARS["smb"].radius
    bearing = np.arctan2(y, x) + angle
    return distance * np.cos(bearing), distance * np.sin(bearing)


def test_a_marker_by_another_beam_is_named_beside_a_thick_pillar_and_one_by_the_nearest_beam_is_not():
    wrong = place(replace(turning(lambda x, y: beside(x, y, 0.2)), robot="smb"))
    assert wrong.evidence.startswith("its distance is right, its angle is not; ")
    right = place(replace(turning(lambda x, y: beside(x, y, 0.0)), robot="smb"))
    assert right.points == 20.0
    late = place(replace(turning(lambda x, y: beside(x, y, 0.2 if y > 3.0 else 0.0)), robot="smb"))
    assert "its angle is not" not in late.evidence
    assert late.hint.startswith("check header.frame_id and header.stamp")
