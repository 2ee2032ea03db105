"""Collision detection on a real Husky's recordings: false stops, and the share of added losses that is felt.

./dev run python tools/real_crashes.py FOLDER [--half fit|report] [--rate 50|100|400] [--curve]

FOLDER is data/borealtc of norlab-ulaval/BorealTC (CC0 1.0): GROUND/imu_NN.csv at 100 Hz, pro_NN.csv at 6.5.
No run holds a collision. A loss of 0.4 m/s within 80 ms is added at 18 places of each run, while the wheels
go on turning as recorded; it is felt if a stop comes within 0.3 s. Stops less than a second apart are one.

Runs with an even number and the eleven that earlier versions were fitted to are the half for fitting.
The wheels' messages have no stamps of their own and some are missing: their clock is laid where yaw rate and
acceleration agree best with the IMU's, anew each 4 s.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
import yaml

from husky_highlevel_controller.controller.crash_detection import CrashConfig, CrashDetector
from husky_highlevel_controller.datatypes import ImuSample, Twist2D

HARD, SOFT = ("FLOORING", "ICE", "ASPHALT"), ("SANDY_LOAM", "SNOW")
FITTED_BEFORE = ["ASPHALT_00", "ASPHALT_04", "FLOORING_01", "FLOORING_02", "FLOORING_08", "ICE_04", "ICE_07"]
FITTED_BEFORE += ["SANDY_LOAM_00", "SANDY_LOAM_09", "SNOW_00", "SNOW_04"]
SPEED_SCALE = 1.27  # of the recorded wheel speeds, in units of 0.13/0.1651 of the driver's
WHEELS_PERIOD = 1.0 / 6.5  # [s]
TRACK = 1.05  # [m], effective, between the sides; only to lay the clocks
LOSS, LOSS_TIME, FELT_WITHIN = 0.4, 0.08, 0.3  # [m/s], [s], [s]
PLACES = 18  # of added losses in a run
LEVEL = (0.0, 0.0, 0.0, 1.0)


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


def is_for_fitting(name: str) -> bool:
    """Whether a run, GROUND_NN, belongs to the half for fitting."""
    return name in FITTED_BEFORE or int(name[-2:]) % 2 == 0


def read_runs(folder: Path, half: Optional[str] = None) -> List[Run]:
    """The runs of the data set, or of one half; those without IMU file are left out."""
    runs = []
    for path in sorted(folder.glob("*/imu_*.csv")):
        name = f"{path.parent.name}_{path.stem[-2:]}"
        wheels_path = path.with_name(path.name.replace("imu", "pro"))
        if name.startswith("MIXED") or half not in (None, "fit" if is_for_fitting(name) else "report"):
            continue
        imu, wheels = (np.loadtxt(file, delimiter=",", skiprows=1) for file in (path, wheels_path))
        speeds = SPEED_SCALE * wheels[:, 3:5]
        runs.append(Run(name, imu, np.column_stack([wheel_stamps(imu, speeds), speeds])))
    if not runs:
        raise SystemExit(f"{folder}: no GROUND/imu_NN.csv in it; is it BorealTC's data/borealtc?")
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
        return smooth - _mean(smooth, piece)  # without tilt

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


def at_rate(imu: np.ndarray, rate: int) -> np.ndarray:
    """IMU rows at another rate [Hz]: means of neighbours, or interpolated."""
    if rate < 100:
        count = 100 // rate
        return imu[: len(imu) // count * count].reshape(-1, count, 7).mean(axis=1)
    if rate == 100:
        return imu
    stamps = np.arange(imu[0, 0], imu[-1, 0], 1.0 / rate)
    return np.column_stack([stamps, *(np.interp(stamps, imu[:, 0], column) for column in imu[:, 1:].T)])


def stops(imu: np.ndarray, wheels: np.ndarray, config: CrashConfig) -> List[float]:
    """Stamps of the samples at which a collision is felt [s]."""
    detector, felt, k = CrashDetector(config), [], 0
    stamps, speeds = wheels[:, 0].tolist(), wheels[:, 1:].mean(axis=1).tolist()
    while k < len(stamps) and stamps[k] < imu[0, 0] - 1.0:
        k += 1
    for stamp, wx, wy, wz, ax, ay, az in imu.tolist():
        while k < len(stamps) and stamps[k] <= stamp:
            detector.add_odometry(stamps[k], Twist2D(speeds[k], 0.0))
            k += 1
        if detector.add_sample(ImuSample(stamp, LEVEL, (wx, wy, wz), (ax, ay, az))) is not None:
            felt.append(stamp)
    return felt


def events(felt: Sequence[float]) -> int:
    """Stops, those less than a second after the last one not counted."""
    return sum(1 for i, stamp in enumerate(felt) if i == 0 or stamp - felt[i - 1] > 1.0)


def pieces_with_a_loss(run: Run, rate: int) -> Iterator[Tuple[float, np.ndarray]]:
    """Stamp of each added loss [s], and the IMU rows from 3 s before it to 0.3 s after."""
    count = len(run.imu)
    if count < 450:
        return
    seed = int.from_bytes(run.name.encode(), "little") % 2**32
    for place in np.sort(np.random.default_rng(seed).choice(np.arange(310, count - 40), PLACES)).tolist():
        begin = run.imu[place, 0]
        piece = at_rate(run.imu[place - 300 : place + round(100 * FELT_WITHIN)], rate).copy()
        speed = np.interp(begin, run.wheels[:, 0], run.wheels[:, 1:].mean(axis=1))
        struck = (piece[:, 0] >= begin) & (piece[:, 0] < begin + LOSS_TIME - 1e-6)
        piece[struck, 4] -= np.copysign(LOSS * rate / struck.sum(), speed)
        yield begin, piece


class Outcome(NamedTuple):
    """Results of some runs."""

    hours: float
    false_stops: int
    losses: int
    felt: int


def outcome(runs: Sequence[Run], config: CrashConfig, rate: int) -> Outcome:
    """False stops and felt losses of some runs."""
    false = [events(stops(at_rate(run.imu, rate), run.wheels, config)) for run in runs]
    hits = [
        any(stamp >= begin for stamp in stops(piece, run.wheels, config))
        for run in runs
        for begin, piece in pieces_with_a_loss(run, rate)
    ]
    return Outcome(sum(run.hours for run in runs), sum(false), len(hits), sum(hits))


def show(name: str, result: Outcome) -> None:
    """Print one line."""
    hours, false, losses, felt = result
    share = f"{felt / losses:.1%}" if losses else "-"
    print(
        f"{name:12} {60 * hours:6.1f} min {false:4} false stops ({false / hours:5.1f} /h), felt {share}",
        flush=True,
    )


def main() -> None:
    """Print a line for each ground, and for hard and soft ground."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--half", choices=("fit", "report"))
    parser.add_argument("--rate", type=int, default=100, choices=(50, 100, 400), help="of the IMU [Hz]")
    parser.add_argument("--curve", action="store_true", help="for several vibration factors")
    options = parser.parse_args()
    values = yaml.safe_load((Path(__file__).parents[1] / "config" / "crash_stop.yaml").read_text())
    config = CrashConfig(**{name: values[name] for name in CrashConfig.__dataclass_fields__})
    runs = read_runs(options.folder, options.half)
    factors = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0) if options.curve else (config.vibration_factor,)
    for factor in factors:
        print(f"vibration_factor {factor:g}, {options.rate} Hz")
        tuned, results = replace(config, vibration_factor=factor), {}  # type: CrashConfig, Dict[str, Outcome]
        for ground in (*HARD, *SOFT):
            chosen = [run for run in runs if run.ground == ground]
            if chosen:
                results[ground] = outcome(chosen, tuned, options.rate)
                show(ground, results[ground])
        for name, grounds in (("hard", HARD), ("soft", SOFT)):
            parts = [results[ground] for ground in grounds if ground in results]
            if parts:
                show(name, Outcome(*map(sum, zip(*parts))))


if __name__ == "__main__":
    main()
