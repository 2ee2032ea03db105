"""Trials of a marking: start poses and pillar places, drawn from a seed, the same for every submission."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin
from typing import List, Tuple

import numpy as np

from husky_highlevel_controller.course import PILLAR_POSITION, PILLARS, course_world
from husky_highlevel_controller.datatypes import Pose2D

# [m] smallest and largest distance between base_link and the pillar's centre at the start
NEAREST, FARTHEST = 8.0, 20.0
MAX_OFFSET = 5.0  # [m] largest distance of the start from the world's origin along x and along y
# [rad] at the start, the pillar is at most this angle to the side, so the robot need not search for it
SIDE = 1.0
# texts in the course's world file with the pose and the size of the pillar
_POSE, _SIZE = "<pose>20 5 0.5 0 0 0</pose>", "<radius>0.2</radius> <length>2</length>"


@dataclass(frozen=True)
class Trial:
    """Start, pillar and seed of one run."""

    number: int
    start: Pose2D  # pose of base_link in the world at the start
    pillar: Tuple[float, float]  # [m] x and y of the pillar's centre in the world
    seed: int  # random seed of the simulated noise


def draw_trials(count: int, seed: int) -> List[Trial]:
    """Return the course's own start and pillar, then random ones; trial n of a seed is always the same.

    A random pillar is in front of the robot, NEAREST to FARTHEST away, and at most SIDE to the side.
    """
    trials = [Trial(1, Pose2D(), PILLAR_POSITION, seed)]
    for number in range(2, count + 1):
        # each trial has a generator of its own, so it does not depend on the trials before it
        rng = np.random.default_rng([seed, number])
        limits = np.array((MAX_OFFSET, MAX_OFFSET, pi))
        x, y, yaw = rng.uniform(-limits, limits).round(2).tolist()
        start = Pose2D(x, y, yaw)
        distance = rng.uniform(NEAREST, FARTHEST)  # [m]
        bearing = start.yaw + rng.uniform(-SIDE, SIDE)  # [rad] direction of the pillar in the world
        pillar = (start.x + distance * cos(bearing), start.y + distance * sin(bearing))
        trials.append(Trial(number, start, (round(pillar[0], 2), round(pillar[1], 2)), seed + number))
    return trials[:count]


def trial_world(trial: Trial, robot: str) -> str:
    """Return the course's SDF world with the pillar at the trial's place, in the size for this robot.

    `robot` is one of ROBOTS.
    """
    text, size = course_world().read_text(), PILLARS[robot]
    assert _POSE in text  # otherwise `replace` would change nothing
    assert _SIZE in text
    text = text.replace(_SIZE, f"<radius>{size.radius:g}</radius> <length>{size.height:g}</length>")
    # only x and y change; the centre stays 0.5 m above the ground
    return text.replace(_POSE, f"<pose>{trial.pillar[0]} {trial.pillar[1]} 0.5 0 0 0</pose>")
