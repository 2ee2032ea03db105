"""Frames of the page, joined at a moment."""

import numpy as np
import pytest

from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_web.frames import Frames


def test_frames_are_joined_over_a_common_root_at_a_moment():
    frames = Frames()
    frames.update("odom", "base", 1.0, Pose((1.0, 0.0, 0.0)))
    frames.update("odom", "base", 2.0, Pose((2.0, 0.0, 0.0), quat_from_rpy(0.0, 0.0, np.pi / 2.0)))
    frames.update("base", "laser", 0.0, Pose((0.5, 0.0, 0.0)))
    frames.update("odom", "map", 0.0, Pose((0.0, 3.0, 0.0)))
    assert frames.pose("laser", "odom", 1.1).position == pytest.approx((1.5, 0.0, 0.0))
    assert frames.pose("laser", "odom").position == pytest.approx((2.0, 0.5, 0.0))
    assert frames.pose("laser", "map").position == pytest.approx((2.0, -2.5, 0.0))
    assert frames.pose("elsewhere", "odom") is None
    assert (frames.stamp("base"), frames.stamp("odom")) == (2.0, None)


def test_frames_survive_a_circle_and_a_clock_that_runs_backwards():
    frames = Frames()
    frames.update("a", "b", 5.0, Pose())
    frames.update("b", "a", 5.0, Pose())
    assert frames.pose("a", "c") is None
    frames.update("odom", "base", 9.0, Pose((9.0, 0.0, 0.0)))
    frames.update("odom", "base", 1.0, Pose((1.0, 0.0, 0.0)))
    assert frames.pose("base", "odom", 9.0).position == (1.0, 0.0, 0.0)
