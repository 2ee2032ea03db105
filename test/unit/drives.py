"""Recordings of drives made of numbers, for the tests of the rubrics."""

from dataclasses import replace

import numpy as np

from husky_grading.displays import RvizView
from husky_grading.exercises.exercise_3 import find_placements, judge_place
from husky_grading.recording import MarkerSample, Recording
from husky_grading.records import DEFAULT_RULES
from husky_highlevel_controller.datatypes import Pose2D

PILLAR = (10.0, 0.0)  # [m]
NOSE = 0.4937  # [m], from base_link to the front
PERIOD = 0.02  # [s]
SCAN = "/front/scan"
FULL_VIEW = RvizView("its rviz node", topics=(SCAN, "/marker"), tf=True, robot=True, scan=True)


def drive(*legs, **more):
    """A recording of legs along x: (to x [m], speed [m/s]) or (seconds, 0) to stand."""
    x, xs, speeds = 0.0, [], []
    for amount, speed in legs:
        steps = round((abs(amount - x) / abs(speed) if speed else amount) / PERIOD)
        xs += list(x + np.arange(1, steps + 1) * PERIOD * speed)
        speeds += [speed] * steps
        x = xs[-1] if xs else 0.0
    times = np.round(PERIOD * np.arange(1, len(xs) + 1), 2)
    poses = np.column_stack([xs, np.zeros((len(xs), 2))])
    twists = np.column_stack([speeds, np.zeros(len(xs))])
    given = dict(command_count=len(xs), subscribed=True)
    return Recording(Pose2D(), PILLAR, 60.0, times, poses, twists, times, **{**given, **more})


def sample(at, position, number=0, size=0.4, **more):
    """A marker as wide and high as `size` [m]."""
    reach = max(np.hypot(position[0] - PILLAR[0], position[1] - PILLAR[1]) - size / 2.0, 0.0)
    given = dict(
        reach=reach, low=position[2] - size / 2.0, high=position[2] + size / 2.0, stamp=at, frame="odom"
    )
    return MarkerSample("/marker", "pillar", number, at, position=position, **{**given, **more})


def markers(recording, position, stamp=None, problem="", every=5):
    """A marker in each fifth row; `position` is one, or a function of the row."""
    at = position if callable(position) else lambda row: position
    shown = tuple(
        sample(float(t), at(row), stamp=float(t) if stamp is None else stamp, problem=problem)
        for row, t in enumerate(recording.times)
        if row % every == 0
    )
    return replace(recording, markers=shown, marker_topics=("/marker",))


WAY = 10.0 - 0.2 - NOSE  # [m], to the pillar's surface
TO_PILLAR = WAY - 0.2  # [m], 0.2 m from the surface
GOOD = drive((TO_PILLAR, 0.5), (3.0, 0.0))
RIGHT, WRONG = (10.0, 0.0, 0.0), (3.0, 0.0, 0.0)


def with_samples(samples):
    return replace(GOOD, markers=tuple(samples), marker_topics=("/marker",))


def place(recording, rules=DEFAULT_RULES):
    """Item of the marker's place in a run."""
    return judge_place(recording, find_placements(recording, rules))
