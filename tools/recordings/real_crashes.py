"""Collision detection on a real Husky's recordings: false stops, and the share of added losses that is felt.

./dev run python tools/recordings/real_crashes.py FOLDER [--rate 50|100|400] [--picture docs/crash_curve.png]

FOLDER is the folder of borealtc.py. No run has a collision, so every stop is a false stop. At 18 places of
each run, a loss of 0.4 m/s within 80 ms is added to the IMU's data; the recorded wheel speeds stay. The loss
is felt if a stop comes within 0.3 s. Stops less than a second apart count as one stop.

`max_loss_rough` and `vibration_factor` are judged by cross-validation: they are fitted to some of the runs
(`fitted`), and tested on the other runs. "Folds by run" are five parts of the runs; "folds by ground" are the
runs of each ground. Each fold is tested with the values that are fitted to all other folds. The last rows are
for the values of config/crash_stop.yaml on all runs.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Callable, Dict, Iterator, List, NamedTuple, Sequence, Tuple

import numpy as np
import yaml
from borealtc import HARD, IMU_RATE, SOFT, Run, read_runs

from husky_highlevel_controller.controller.crash_detection import Change, CrashConfig, CrashDetector
from husky_highlevel_controller.datatypes import ImuSample, Twist2D

LOSS, LOSS_TIME = 0.4, 0.08  # [m/s] speed that is lost in an added loss; [s] its duration
FELT_WITHIN = 0.3  # [s] longest time from an added loss to the stop
ONE_STOP = 1.0  # [s] stops with less time between them count as one
PLACES = 18  # number of losses that are added to a run
FOLDS = 5  # number of parts of the runs, in the folds by run
ENOUGH = 0.96  # share of the losses on hard ground that fitted values must feel
# values of `max_loss_rough` and of `vibration_factor` that are tried
ROUGH_LOSSES, FACTORS = np.arange(0.14, 0.45, 0.02).round(2).tolist(), (0.0, 0.5, 1.0, 1.5, 2.0)
# goals on hard ground, see docs/robot_data.md
MOST_FALSE_STOPS_AN_HOUR, LEAST_PERCENT_FELT = 6.0, 95.0
LEVEL = (0.0, 0.0, 0.0, 1.0)  # quaternion of an IMU that is level
Changes = List[Tuple[float, Change]]  # stamps [s] and changes of velocity


class Evidence(NamedTuple):
    """Changes of velocity in a run that a configuration may take for a crash."""

    recording: Run
    free: Changes  # changes in the run as recorded
    losses: List[Changes]  # for each added loss, the changes after it


class Outcome(NamedTuple):
    """Results of some runs."""

    hours: float
    false_stops: int
    losses: int  # number of added losses
    felt: int  # number of added losses that are felt

    @property
    def an_hour(self) -> float:
        """Return the number of false stops per hour."""
        return self.false_stops / self.hours

    @property
    def share(self) -> float:
        """Return the share of the added losses that is felt."""
        return self.felt / max(self.losses, 1)


def at_rate(imu: np.ndarray, rate: int) -> np.ndarray:
    """Return the IMU's rows (N, 7) at another rate [Hz], as means of neighbours or by interpolation."""
    if rate < IMU_RATE:
        count = IMU_RATE // rate  # number of rows that become one row
        whole = len(imu) // count * count  # without the last rows, which are too few for a mean
        return imu[:whole].reshape(-1, count, 7).mean(axis=1)
    if rate == IMU_RATE:
        return imu
    stamps = np.arange(imu[0, 0], imu[-1, 0], 1.0 / rate)
    return np.column_stack([stamps, *(np.interp(stamps, imu[:, 0], column) for column in imu[:, 1:].T)])


def changes(imu: np.ndarray, wheels: np.ndarray, config: CrashConfig) -> Changes:
    """Return the changes of velocity that the detector with this configuration takes for a crash."""
    detector, found = CrashDetector(config), []
    k = 0  # row of the next message of the wheels
    stamps, speeds = wheels[:, 0].tolist(), wheels[:, 1:].mean(axis=1).tolist()
    while k < len(stamps) and stamps[k] < imu[0, 0] - 1.0:  # odometry long before the IMU's first sample
        k += 1
    for stamp, wx, wy, wz, ax, ay, az in imu.tolist():
        while k < len(stamps) and stamps[k] <= stamp:
            detector.add_odometry(stamps[k], Twist2D(speeds[k], 0.0))
            k += 1
        felt = detector.add_sample(ImuSample(stamp, LEVEL, (wx, wy, wz), (ax, ay, az)))
        if felt is not None and detector.change is not None:
            found.append((stamp, detector.change))
    return found


def pieces_with_a_loss(run: Run, rate: int) -> Iterator[Tuple[float, np.ndarray]]:
    """Return the stamp of each added loss [s], and the IMU's rows from 3 s before it to FELT_WITHIN later."""
    count = len(run.imu)
    if count < 450:  # 4.5 s, which are too short for the places
        return
    seed = int.from_bytes(run.name.encode(), "little") % 2**32
    places = np.arange(310, count - 40)  # rows with at least 3.1 s before them and 0.4 s after them
    for place in np.sort(np.random.default_rng(seed).choice(places, PLACES)).tolist():
        begin = run.imu[place, 0]
        rows = run.imu[place - 3 * IMU_RATE : place + round(IMU_RATE * FELT_WITHIN)]
        piece = at_rate(rows, rate).copy()
        speed = np.interp(begin, run.wheels[:, 0], run.wheels[:, 1:].mean(axis=1))
        # samples during the loss; 1e-6 s are subtracted, so that rounding does not add the sample at its end
        struck = (piece[:, 0] >= begin) & (piece[:, 0] < begin + LOSS_TIME - 1e-6)
        piece[struck, 4] -= np.copysign(LOSS * rate / struck.sum(), speed)  # forward acceleration
        yield begin, piece


def evidence(run: Run, rate: int, config: CrashConfig) -> Evidence:
    """Return the changes of a run that may be crashes.

    Args:
        run: recording.
        rate: rate of the IMU [Hz].
        config: the most sensitive configuration; the changes that it finds contain those of all others.
    """
    losses = [
        [(stamp, change) for stamp, change in changes(piece, run.wheels, config) if stamp >= begin]
        for begin, piece in pieces_with_a_loss(run, rate)
    ]
    return Evidence(run, changes(at_rate(run.imu, rate), run.wheels, config), losses)


def outcome(runs: Sequence[Evidence], config: CrashConfig) -> Outcome:
    """Return the number of false stops and of felt losses in some runs, with a configuration."""
    false_stops = 0
    for run in runs:
        stopped_at = -1e9  # [s] stamp of the last stop
        for stamp, change in run.free:
            if change.excess(config) > config.max_loss:
                if stamp - stopped_at > ONE_STOP:
                    false_stops += 1
                stopped_at = stamp
    losses = [loss for run in runs for loss in run.losses]
    felt = sum(any(change.excess(config) > config.max_loss for _, change in loss) for loss in losses)
    return Outcome(sum(run.recording.hours for run in runs), false_stops, len(losses), felt)


def fitted(runs: Sequence[Evidence], config: CrashConfig) -> CrashConfig:
    """Return the configuration with the fewest false stops on hard ground that feels ENOUGH losses there.

    If several have equally few, the false stops on soft ground decide. If none feels ENOUGH, `config` is
    returned.
    """
    hard = [run for run in runs if run.recording.ground in HARD]
    soft = [run for run in runs if run.recording.ground in SOFT]
    # number of false stops on hard and on soft ground; it begins larger than any result
    best, fewest = config, (len(runs) * 10**6, 0)
    for rough, factor in product(ROUGH_LOSSES, FACTORS):
        tried = replace(config, max_loss_rough=rough, vibration_factor=factor)
        on_hard = outcome(hard, tried)
        if on_hard.share >= ENOUGH:
            # tuples are compared by their first numbers, and by the second ones only if these are equal
            false_stops = (on_hard.false_stops, outcome(soft, tried).false_stops)
            if false_stops < fewest:
                best, fewest = tried, false_stops
    return best


def held_out(
    runs: Sequence[Evidence], config: CrashConfig, fold: Callable[[Evidence], object]
) -> Dict[str, List[Outcome]]:
    """Return the outcomes on each ground; each run is tested with values that are fitted to the other folds.

    Args:
        runs: runs of all folds.
        config: configuration whose other values are used.
        fold: function that returns the fold of a run.
    """
    results: Dict[str, List[Outcome]] = {}
    for tested in sorted({fold(run) for run in runs}, key=str):
        chosen = fitted([run for run in runs if fold(run) != tested], config)
        print(f"  without {tested}: max_loss_rough {chosen.max_loss_rough}, factor {chosen.vibration_factor}")
        for run in runs:
            if fold(run) == tested:
                results.setdefault(run.recording.ground, []).append(outcome([run], chosen))
    return results


def show(title: str, results: Dict[str, List[Outcome]]) -> None:
    """Print a line for each ground, and for hard and soft ground."""
    print(title)
    groups = {ground: (ground,) for ground in (*HARD, *SOFT)}  # grounds of each line
    for name, grounds in {**groups, "hard": HARD, "soft": SOFT}.items():
        parts = [part for ground in grounds for part in results.get(ground, [])]
        if parts:
            total = Outcome(*map(sum, zip(*parts)))
            print(
                f"  {name:12} {60 * total.hours:6.1f} min {total.false_stops:4} false stops "
                f"({total.an_hour:5.1f} /h), felt {total.share:.1%}",
                flush=True,
            )


def draw(path: Path, runs: Sequence[Evidence], config: CrashConfig) -> None:
    """Draw the false stops per hour over the share of felt losses, with a point for each of ROUGH_LOSSES.

    A circle marks the given configuration, and dotted lines mark the goals.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.6), dpi=90)
    for name, grounds, color in (("hard ground", HARD, "tab:blue"), ("soft ground", SOFT, "tab:red")):
        chosen = [run for run in runs if run.recording.ground in grounds]
        tried = [outcome(chosen, replace(config, max_loss_rough=rough)) for rough in ROUGH_LOSSES]
        axis.plot(
            [100 * one.share for one in tried], [one.an_hour for one in tried], ".-", color=color, label=name
        )
        given = outcome(chosen, config)
        axis.plot(100 * given.share, given.an_hour, "o", color=color, fillstyle="none", markersize=10)
    axis.axhline(MOST_FALSE_STOPS_AN_HOUR, color="0.6", linestyle=":")
    axis.axvline(LEAST_PERCENT_FELT, color="0.6", linestyle=":")
    axis.set(xlabel="losses of 0.4 m/s in 80 ms felt within 0.3 s [%]", ylabel="false stops an hour")
    axis.set_yscale("symlog", linthresh=10.0)
    axis.set_ylim(bottom=0.0)
    axis.legend()
    figure.tight_layout()
    figure.savefig(path)


def main() -> None:
    """Print the tables, and draw the curve."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--rate", type=int, default=100, choices=(50, 100, 400), help="sampling rate of the IMU [Hz]"
    )
    parser.add_argument("--picture", type=Path, help="output file for the curve")
    options = parser.parse_args()
    values = yaml.safe_load((Path(__file__).parents[2] / "config" / "crash_stop.yaml").read_text())
    config = CrashConfig(**{name: values[name] for name in CrashConfig.__dataclass_fields__})
    most_sensitive = replace(config, max_loss_rough=min(ROUGH_LOSSES), vibration_factor=min(FACTORS))
    runs = [evidence(run, options.rate, most_sensitive) for run in read_runs(options.folder)]
    number = {run.recording.name: i for i, run in enumerate(runs)}
    show("folds by run", held_out(runs, config, lambda run: number[run.recording.name] % FOLDS))
    show("folds by ground", held_out(runs, config, lambda run: run.recording.ground))
    print(f"fitted to all runs: {fitted(runs, config)}")
    grounds = (*HARD, *SOFT)
    shipped = {g: [outcome([run for run in runs if run.recording.ground == g], config)] for g in grounds}
    show("config/crash_stop.yaml on all runs", shipped)
    if options.picture:
        draw(options.picture, runs, config)


if __name__ == "__main__":
    main()
