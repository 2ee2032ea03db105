"""Turning of the simulated `profile:=robot` with a real Husky's wheel speeds, against the real one's gyro.

./dev run python tools/recordings/real_turns.py FOLDER

FOLDER is that of borealtc.py. The simulated wheels turn as the recorded ones did. Compared are means over
half a second in which the real robot turns by 0.05 rad/s or more. Where the simulated one does and the real
one turns by less than a tenth of that, it is stuck: that time is given apart. Each run has a median and a
90 % quantile of the error's size; a ground has the medians of its runs'. The errors are of runs of odd
number; `lateral_grip` is to be fitted to those of even number: the effective track of both halves is
printed.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, Tuple

import numpy as np
from borealtc import HARD, SOFT, Run, read_runs

from husky_evaluation.rollout import model_of
from husky_highlevel_controller.datatypes import Body, Geometry, Plane, Pose
from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.simulator.bullet.robot import RobotWorld
from husky_highlevel_controller.simulator.chassis import Chassis
from husky_highlevel_controller.simulator.profile import RobotProfile
from husky_highlevel_controller.simulator.simulator_config import simulator_config
from husky_highlevel_controller.simulator.world_objects import WorldObjects

GRAVITY = (0.0, 0.0, -9.8)  # [m/s^2]
MEAN_TIME, TURNING, STUCK = 0.5, 0.05, 0.1  # [s], [rad/s], share of the simulated rate
PLANE = Body("ground", Pose(), (Geometry(Plane((0.0, 0.0, 1.0), (1e3, 1e3))),), (), 0.0)


def means(run: Run, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Means over each MEAN_TIME of a run, of values at stamps [s]."""
    edges = np.arange(run.imu[0, 0], run.imu[-1, 0], MEAN_TIME)
    mean: np.ndarray = (
        np.diff(np.interp(edges, stamps, np.cumsum(values) * (stamps[1] - stamps[0]))) / MEAN_TIME
    )
    return mean


def simulated_yaw_rate(run: Run) -> Tuple[np.ndarray, np.ndarray]:
    """Stamps [s] and yaw rates [rad/s] of the simulated robot with the wheel speeds of a run."""
    config, robot = simulator_config(), model_of(load_robot(), "robot")
    ground = RobotProfile().on("hard" if run.ground in HARD else "soft").ground
    traction = replace(config.traction, friction=ground.friction, lateral_grip=ground.lateral_grip)
    dt = 1.0 / config.physics_rate
    bullet = RobotWorld(dt)
    try:
        bullet.clear(GRAVITY)
        WorldObjects(bullet).load([PLANE])
        chassis = Chassis(bullet, robot, traction, dt)
        chassis.place(chassis.on_ground(Pose()), GRAVITY)
        stamps = np.arange(run.imu[0, 0], run.imu[-1, 0], dt)
        left, right = (np.interp(stamps, run.wheels[:, 0], side) for side in run.wheels[:, 1:].T)
        rates = []
        for speeds in (np.column_stack([left, right, left, right]) / robot.wheels[0].radius).tolist():
            chassis.drive(speeds)
            bullet.step()
            rates.append(chassis.observe().angular_velocity_in_base[2])
            chassis.update_contacts()
    finally:
        bullet.close()
    return stamps, np.array(rates)


def track(run: Run) -> float:
    """Effective track of the real robot [m]; nan if it hardly turned."""
    true = means(run, run.imu[:, 0], run.imu[:, 3])
    stamps = np.arange(run.imu[0, 0], run.imu[-1, 0], 0.01)
    difference = np.interp(stamps, run.wheels[:, 0], run.wheels[:, 2] - run.wheels[:, 1])
    turning = np.abs(true) > 0.15
    return (
        float(np.median(means(run, stamps, difference)[turning] / true[turning]))
        if turning.sum() > 4
        else np.nan
    )


class Turning(NamedTuple):
    """Turning of a run, and the errors of the simulated robot."""

    time: float  # [s] time in which the real robot turns
    stuck: float  # [s] time in which only the simulated robot turns
    rate: float = np.nan  # [rad/s] mean rate of the real robot
    median: float = np.nan  # [rad/s] median of the error
    most: float = np.nan  # [rad/s] error that 90 % of the errors do not reach


def compare(run: Run) -> Turning:
    """The simulated robot's turning on a run against the real one's."""
    true = means(run, run.imu[:, 0], run.imu[:, 3])
    simulated = means(run, *simulated_yaw_rate(run))
    stuck = (np.abs(simulated) >= TURNING) & (np.abs(true) < STUCK * np.abs(simulated))
    turning = (np.abs(true) >= TURNING) & ~stuck
    times = turning.sum() * MEAN_TIME, stuck.sum() * MEAN_TIME
    if turning.sum() < 4:
        return Turning(*times)
    off = np.abs(simulated - true)[turning]
    return Turning(*times, np.abs(true[turning]).mean(), np.median(off), np.quantile(off, 0.9))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    runs = read_runs(parser.parse_args().folder)
    for ground in (*HARD, *SOFT):
        even, odd = ([r for r in runs if r.ground == ground and int(r.name[-2:]) % 2 == n] for n in (0, 1))
        tracks = [np.nanmedian([track(run) for run in half]) for half in (even, odd)]
        rows = [compare(run) for run in odd]
        for run, row in zip(odd, rows):
            show(f"  {run.name}", row)
        time, stuck = sum(row.time for row in rows), sum(row.stuck for row in rows)
        show(f"{ground}, {len(odd)} runs", Turning(time, stuck, *np.nanmedian(rows, axis=0)[2:]))
        print(f"  effective track {tracks[0]:.2f} m (even runs), {tracks[1]:.2f} m (odd)", flush=True)


def show(name: str, row: Turning) -> None:
    """Print one line."""
    print(
        f"{name:22} turns {row.time:5.1f} s at {row.rate:.2f} rad/s, stuck {row.stuck:5.1f} s; "
        f"error {row.median:.3f}, 90 % {row.most:.3f} rad/s",
        flush=True,
    )


if __name__ == "__main__":
    main()
