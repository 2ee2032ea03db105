"""Reader of BorealTC, recordings of a real Husky A200 on five grounds (norlab-ulaval/BorealTC, CC0 1.0).

Its folder data/borealtc has GROUND/imu_NN.csv at 100 Hz and pro_NN.csv (currents, wheels' speeds) at 6.5. The
wheels' messages have no stamps of their own and some are missing. So every 4 s their clock is laid again,
where yaw rate and acceleration agree best with the IMU's.
"""

from __future__ import annotations

from pathlib import Path
from typing import List, NamedTuple

import numpy as np

HARD, SOFT = ("FLOORING", "ICE", "ASPHALT"), ("SANDY_LOAM", "SNOW")
SPEED_SCALE = 1.27  # factor on the recorded wheel speeds, whose unit is 0.13/0.1651 of the driver's
WHEELS_PERIOD = 1.0 / 6.5  # [s]
TRACK = 1.05  # [m] effective track, used only to lay the clocks


class Run(NamedTuple):
    """Recording of IMU and wheels."""

    name: str
    imu: np.ndarray  # (N, 7): stamp [s], angular velocity [rad/s], specific force [m/s^2], in base_link
    wheels: np.ndarray  # (M, 3): stamp by the IMU's clock [s], speed of the left and right side [m/s]

    @property
    def ground(self) -> str:
        """Name of the ground."""
        return self.name.rpartition("_")[0]

    @property
    def hours(self) -> float:
        """Duration [h]."""
        return float(self.imu[-1, 0] - self.imu[0, 0]) / 3600.0


def read_runs(folder: Path) -> List[Run]:
    """The runs on one ground each, without the runs that have no IMU file."""
    runs = []
    for path in sorted(folder.glob("*/imu_*.csv")):
        name = f"{path.parent.name}_{path.stem[-2:]}"
        wheels_path = path.with_name(path.name.replace("imu", "pro"))
        if name.startswith("MIXED"):
            continue
        imu, wheels = (np.loadtxt(file, delimiter=",", skiprows=1) for file in (path, wheels_path))
        speeds = SPEED_SCALE * wheels[:, 3:5]
        runs.append(Run(name, imu, np.column_stack([wheel_stamps(imu, speeds), speeds])))
    if not runs:
        raise SystemExit(
            f"{folder}: no GROUND/imu_NN.csv in this folder. Pass the folder data/borealtc of BorealTC"
        )
    return runs


def _mean(values: np.ndarray, count: int) -> np.ndarray:
    mean: np.ndarray = np.convolve(values, np.ones(count) / count, "same")
    return mean


def wheel_stamps(imu: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """Stamps of the wheels' messages by the IMU's clock [s], (M,).

    Args:
        imu: (N, 7) at 100 Hz, as in `Run`.
        speeds: (M, 2) [m/s].
    """
    stamps, piece, offsets = WHEELS_PERIOD * np.arange(len(speeds)), 400, np.arange(-2.0, 2.001, 0.04)

    def acceleration(values: np.ndarray) -> np.ndarray:
        smooth = _mean(values, 31)
        return smooth - _mean(smooth, piece)  # the mean is the tilt

    yaw_rate, ahead = _mean(imu[:, 3], 15), acceleration(imu[:, 4])
    pieces = np.arange(0, len(imu), piece)
    costs = np.empty((len(pieces), len(offsets)))
    for column, offset in enumerate(offsets):
        left, right = (np.interp(imu[:, 0], stamps + offset, side) for side in speeds.T)
        gained = acceleration(np.gradient(_mean(0.5 * (left + right), 15), 0.01))
        errors = np.minimum(((right - left) / TRACK - yaw_rate) ** 2 / 0.08**2, 9.0)
        errors += np.minimum((gained - ahead) ** 2 / 0.3**2, 9.0)
        costs[:, column] = np.add.reduceat(errors, pieces) / 25.0 + abs(offset)
    jumps = 40.0 * np.abs(offsets[:, None] - offsets)
    total, best = costs[0] + 3.0 * np.abs(offsets), []
    for cost in costs[1:]:
        best.append((total[:, None] + jumps).argmin(axis=0))
        total = (total[:, None] + jumps).min(axis=0) + cost
    path = [int(total.argmin())]
    for choice in reversed(best):
        path.append(int(choice[path[-1]]))
    laid: np.ndarray = stamps + np.interp(stamps, (pieces + piece / 2) / 100.0, offsets[path[::-1]])
    return laid
