"""Turning of the simulated `profile:=robot` with a real Husky's wheel speeds, against the real one's gyro.

./dev run python tools/recordings/real_turns.py FOLDER

FOLDER is the folder of borealtc.py. The simulated wheels turn as the recorded wheels did. The yaw rates of
the simulated and of the real robot are compared as means over half a second, in which the real robot turns at
0.05 rad/s or more. If the real robot turns at less than a tenth of the simulated rate, it is stuck; this time
is printed, but not compared. The row of a run has the median and the 90 % quantile of its absolute errors,
and the row of a ground has the medians over its runs.

Only runs with an odd number are compared, because `lateral_grip` is to be fitted to the runs with an even
number. The effective track of both halves is printed. It is the wheel separation with which a robot that does
not skid would have the same yaw rate.
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
MEAN_TIME = 0.5  # [s] time over which the yaw rates are averaged
TURNING = 0.05  # [rad/s] smallest yaw rate at which a robot counts as turning
TURNING_FAST = 0.15  # [rad/s] yaw rate above which the effective track is measured
STUCK = 0.1  # share of the simulated yaw rate; below it, the real robot is stuck
PLANE = Body("ground", Pose(), (Geometry(Plane((0.0, 0.0, 1.0), (1e3, 1e3))),), (), 0.0)


def means(run: Run, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the mean of values in each MEAN_TIME of a run; `stamps` [s] are the equally spaced stamps."""
    edges = np.arange(run.imu[0, 0], run.imu[-1, 0], MEAN_TIME)  # [s] begin and end of each MEAN_TIME
    # the mean between two edges is the difference of the integral at the edges, divided by the time
    integral = np.cumsum(values) * (stamps[1] - stamps[0])
    mean: np.ndarray = np.diff(np.interp(edges, stamps, integral)) / MEAN_TIME
    return mean


def real_means(run: Run) -> np.ndarray:
    """Return the mean yaw rate [rad/s] of the real robot in each MEAN_TIME, by its gyro."""
    return means(run, run.imu[:, 0], run.imu[:, 3])


def simulated_yaw_rate(run: Run) -> Tuple[np.ndarray, np.ndarray]:
    """Return stamps [s] and yaw rates [rad/s] of the simulated robot with the wheel speeds of a run."""
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
        # [rad/s] recorded speeds of the left and of the right wheels, at the stamps of the physics steps
        left, right = (
            np.interp(stamps, run.wheels[:, 0], side) / robot.wheels[0].radius for side in run.wheels[:, 1:].T
        )
        rates = []
        for speeds in np.column_stack([left, right, left, right]).tolist():  # front wheels, then rear wheels
            chassis.drive(speeds)
            bullet.step()
            rates.append(chassis.observe().angular_velocity_in_base[2])
            chassis.update_contacts()
    finally:
        bullet.close()
    return stamps, np.array(rates)


def track(run: Run) -> float:
    """Return the effective track of the real robot [m]; nan if it hardly turned.

    It is the difference of the speeds of both sides, divided by the yaw rate.
    """
    real = real_means(run)
    stamps = np.arange(run.imu[0, 0], run.imu[-1, 0], 0.01)
    left, right = run.wheels[:, 1], run.wheels[:, 2]
    difference = np.interp(stamps, run.wheels[:, 0], right - left)
    turning = np.abs(real) > TURNING_FAST
    if turning.sum() <= 4:  # too few means
        return np.nan
    return float(np.median(means(run, stamps, difference)[turning] / real[turning]))


class Turning(NamedTuple):
    """Turning of a run, and the errors of the simulated robot."""

    time: float  # [s] time in which the real robot turns
    stuck: float  # [s] time in which only the simulated robot turns
    rate: float = np.nan  # [rad/s] mean rate of the real robot
    median: float = np.nan  # [rad/s] median of the error
    most: float = np.nan  # [rad/s] error that 90 % of the errors do not reach


def compare(run: Run) -> Turning:
    """Compare the yaw rates of the simulated robot and of the real robot on a run."""
    real = real_means(run)
    simulated = means(run, *simulated_yaw_rate(run))
    stuck = (np.abs(simulated) >= TURNING) & (np.abs(real) < STUCK * np.abs(simulated))
    turning = (np.abs(real) >= TURNING) & ~stuck
    times = turning.sum() * MEAN_TIME, stuck.sum() * MEAN_TIME
    if turning.sum() < 4:  # too few means
        return Turning(*times)
    errors = np.abs(simulated - real)[turning]
    return Turning(*times, np.abs(real[turning]).mean(), np.median(errors), np.quantile(errors, 0.9))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    runs = read_runs(parser.parse_args().folder)
    for ground in (*HARD, *SOFT):
        runs_there = [run for run in runs if run.ground == ground]
        # the name of a run ends with its number of two digits
        even = [run for run in runs_there if int(run.name[-2:]) % 2 == 0]
        odd = [run for run in runs_there if int(run.name[-2:]) % 2 == 1]
        even_track, odd_track = (np.nanmedian([track(run) for run in half]) for half in (even, odd))
        rows = [compare(run) for run in odd]
        for run, row in zip(odd, rows):
            show(f"  {run.name}", row)
        time, stuck = sum(row.time for row in rows), sum(row.stuck for row in rows)
        _, _, *medians = np.nanmedian(rows, axis=0)  # the times are summed, so their medians are not needed
        show(f"{ground}, {len(odd)} runs", Turning(time, stuck, *medians))
        print(f"  effective track {even_track:.2f} m (even runs), {odd_track:.2f} m (odd)", flush=True)


def show(name: str, row: Turning) -> None:
    """Print one line."""
    print(
        f"{name:22} turns {row.time:5.1f} s at {row.rate:.2f} rad/s, stuck {row.stuck:5.1f} s; "
        f"error {row.median:.3f}, 90 % {row.most:.3f} rad/s",
        flush=True,
    )


if __name__ == "__main__":
    main()
