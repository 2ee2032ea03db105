"""Reader of BorealTC, recordings of a real Husky A200 on five grounds (norlab-ulaval/BorealTC, CC0 1.0).

Its folder data/borealtc has GROUND/imu_NN.csv at 100 Hz and GROUND/pro_NN.csv (currents, wheels' speeds) at
6.5 Hz. The wheels' messages have no stamps, and some messages are missing. So `wheel_stamps` searches stamps
with which yaw rate and acceleration of the wheels agree best with the IMU.
"""

from __future__ import annotations

from pathlib import Path
from typing import List, NamedTuple

import numpy as np

HARD, SOFT = ("FLOORING", "ICE", "ASPHALT"), ("SANDY_LOAM", "SNOW")
# factor to m/s; the recorded wheel speeds are too small, because they are 0.13/0.1651 of the speeds that the
# Husky's driver measured
SPEED_SCALE = 1.27
IMU_RATE = 100  # [Hz]
WHEELS_PERIOD = 1.0 / 6.5  # [s]
TRACK = 1.05  # [m] effective track, used only to compare the wheels with the gyro in `wheel_stamps`
PIECE = 4 * IMU_RATE  # number of rows of the IMU for which the clock of the wheels' messages has one offset


class Run(NamedTuple):
    """Recording of IMU and wheels."""

    name: str
    imu: np.ndarray  # (N, 7): stamp [s], angular velocity [rad/s], specific force [m/s^2], in base_link
    wheels: np.ndarray  # (M, 3): stamp by the IMU's clock [s], speed of the left and right side [m/s]

    @property
    def ground(self) -> str:
        """Return the name of the ground."""
        return self.name.rpartition("_")[0]

    @property
    def hours(self) -> float:
        """Return the duration [h]."""
        return float(self.imu[-1, 0] - self.imu[0, 0]) / 3600.0


def read_runs(folder: Path) -> List[Run]:
    """Return the runs on a single ground that have an IMU file."""
    runs = []
    for path in sorted(folder.glob("*/imu_*.csv")):
        name = f"{path.parent.name}_{path.stem[-2:]}"
        wheels_path = path.with_name(path.name.replace("imu", "pro"))
        if name.startswith("MIXED"):
            continue
        imu, wheels = (np.loadtxt(file, delimiter=",", skiprows=1) for file in (path, wheels_path))
        speeds = SPEED_SCALE * wheels[:, 3:5]  # of the left and of the right side
        runs.append(Run(name, imu, np.column_stack([wheel_stamps(imu, speeds), speeds])))
    if not runs:
        raise SystemExit(
            f"{folder}: no GROUND/imu_NN.csv in this folder. Pass the folder data/borealtc of BorealTC"
        )
    return runs


def _mean(values: np.ndarray, count: int) -> np.ndarray:
    """Return the moving mean over `count` values."""
    mean: np.ndarray = np.convolve(values, np.ones(count) / count, "same")
    return mean


def wheel_stamps(imu: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """Return the stamps of the wheels' messages by the IMU's clock [s], (M,).

    The messages come at WHEELS_PERIOD, but their clock is shifted by an offset for each piece of the run. The
    offsets are chosen so that the wheels agree best with the IMU, and change little from piece to piece.

    Args:
        imu: (N, 7) at 100 Hz, as in `Run`.
        speeds: (M, 2) [m/s].
    """
    stamps = WHEELS_PERIOD * np.arange(len(speeds))  # (M,) [s] stamps without an offset
    offsets = np.arange(-2.0, 2.001, 0.04)  # [s] offsets that are tried

    def acceleration(values: np.ndarray) -> np.ndarray:
        """Return smoothed accelerations, from which the mean of each few seconds is subtracted."""
        smooth = _mean(values, 31)
        return smooth - _mean(smooth, PIECE)  # without the mean, which is gravity on a robot that is tilted

    yaw_rate, forward_of_imu = _mean(imu[:, 3], 15), acceleration(imu[:, 4])
    pieces = np.arange(0, len(imu), PIECE)  # first row of each piece
    costs = np.empty((len(pieces), len(offsets)))  # cost of each offset in each piece
    for column, offset in enumerate(offsets):
        left, right = (np.interp(imu[:, 0], stamps + offset, side) for side in speeds.T)
        forward_of_wheels = acceleration(np.gradient(_mean(0.5 * (left + right), 15), 1.0 / IMU_RATE))
        # squared errors, in units of 0.08 rad/s and of 0.3 m/s^2; the limit 9.0 keeps outliers from deciding
        errors = np.minimum(((right - left) / TRACK - yaw_rate) ** 2 / 0.08**2, 9.0)
        errors += np.minimum((forward_of_wheels - forward_of_imu) ** 2 / 0.3**2, 9.0)
        # sum of the errors in each piece; of two offsets with equal errors, the smaller one costs less
        costs[:, column] = np.add.reduceat(errors, pieces) / 25.0 + abs(offset)
    costs[0] += 3.0 * np.abs(offsets)  # an offset costs more in the first piece than in a later one
    path = _cheapest_path(costs, cost_of_change=40.0 * np.abs(offsets[:, None] - offsets))
    middles = (pieces + PIECE / 2) / IMU_RATE  # [s]
    shifted: np.ndarray = stamps + np.interp(stamps, middles, offsets[path])
    return shifted


def _cheapest_path(costs: np.ndarray, cost_of_change: np.ndarray) -> List[int]:
    """Choose a column in each row so that the sum of all costs is smallest, by dynamic programming.

    Args:
        costs: (R, C), cost of each column in each row.
        cost_of_change: (C, C), cost if a row has the first column, and the next row has the second one.
    """
    total = costs[0]  # (C,) smallest cost of a path from the first row to each column of the present row
    came_from = []  # for each row after the first, (C,) column of the row before on the cheapest path
    for cost in costs[1:]:
        # (C, C) cost of a path to each column (second axis) by each column of the row before (first axis)
        total_by_column = total[:, None] + cost_of_change
        came_from.append(total_by_column.argmin(axis=0))
        total = total_by_column.min(axis=0) + cost
    path = [int(total.argmin())]  # from the last row to the first
    for columns in reversed(came_from):
        path.append(int(columns[path[-1]]))
    return path[::-1]
