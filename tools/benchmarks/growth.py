"""Benchmark of a scan over the number of beams and of objects."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from statistics import median
from typing import Callable, Dict, List, Tuple

import numpy as np
from baselines import BulletRays
from rows import Effort, Row, compare, reaching

from husky_highlevel_controller.datatypes import Box, Cylinder, Pose, RobotState, Shape, Sphere
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_highlevel_controller.simulator.sensors.lidar import Lidar
from husky_highlevel_controller.simulator.sensors.raycast import cast_rays, make_scene
from husky_highlevel_controller.simulator.simulator_config import simulator_config


def growth(effort: Effort) -> List[Row]:
    """Measure the time of a scan by the number of beams and of objects, against Bullet's rays."""
    rows = []
    cases = [("mixed", 100, beams) for beams in (180, 720, 2880, 10000)]
    cases += [(kind, count, 720) for kind in KINDS for count in (1, 10, 100, 1000)]
    for kind, count, beams in cases:
        if count > effort.most_objects or beams > effort.most_beams:
            continue
        row = _scan_cost(kind, count, beams, effort.repeats)
        if (kind, count, beams) == ("mixed", 1000, 720):
            # the goal is 0.5 ms on a machine on which rayTestBatch takes 9 ms
            row = reaching(row, "<= 0.5 where rayTestBatch takes 9", row.ratio, maximum=0.5 / 9.0)
        rows.append(row)
    return rows


MOVING_EVERY = 20  # one of so many objects moves before each scan
KINDS: Dict[str, Tuple[Shape, ...]] = {
    "boxes": (Box((0.5, 0.8, 1.2)),),
    "cylinders": (Cylinder(0.3, 1.2),),
    "mixed": (Box((0.5, 0.8, 1.2)), Cylinder(0.3, 1.2), Sphere(0.6)),
}


def field_of(kind: str, count: int, seed: int = 0) -> List[Tuple[Shape, Pose]]:
    """Return objects at random poses on a square of 100 m, but not within 2 m of the robot in its middle."""
    rng = np.random.default_rng(seed)
    field: List[Tuple[Shape, Pose]] = []
    while len(field) < count:
        (x, y), yaw = rng.uniform(-50.0, 50.0, 2).tolist(), float(rng.uniform(-np.pi, np.pi))
        if np.hypot(x, y) > 2.0:
            shape = KINDS[kind][len(field) % len(KINDS[kind])]
            field.append((shape, Pose((x, y, 0.6), quat_from_rpy(0.0, 0.0, yaw))))
    return field


def _scan_cost(kind: str, count: int, beams: int, repeats: int) -> Row:
    """Return the row of a scan with so many beams in a field of so many objects, some of which move."""
    field, config = field_of(kind, count), replace(simulator_config().lidar, beams=beams)
    scene, bullet = make_scene(field), BulletRays(field)
    pose = Pose((0.0, 0.0, 0.44), quat_from_rpy(np.pi, 0.0, 0.0))  # the lidar is mounted upside down
    lidar = Lidar(config, partial(cast_rays, scene), "laser", Pose())
    lidar.reset(np.random.default_rng(1))
    state = RobotState(pose, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    angles = lidar.sample(state, 0.0).bearings

    def ours() -> None:
        for index in range(0, count, MOVING_EVERY):
            scene.move(index, field[index][1])
        lidar.sample(state, 0.0)

    def theirs() -> None:
        bullet.scan(pose, angles, config.range_max)

    runs = [(milliseconds(ours), milliseconds(theirs)) for _ in range(repeats)]
    bullet.close()
    what = f"scan of {beams} beams, {count} {kind}"
    return compare(what, "ms", runs, "rayTestBatch")


def milliseconds(call: Callable[[], object], clock: Callable[[], float] = time.perf_counter) -> float:
    """Return the median time of some calls [ms], by a clock of wall or CPU time; the first does not count."""
    call()
    times: List[float] = []
    end = time.perf_counter() + 0.05
    while len(times) < 5 or time.perf_counter() < end:
        begin = clock()
        call()
        times.append(clock() - begin)
    return 1e3 * median(times)
