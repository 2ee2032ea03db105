"""Collision detection on a real Husky's recordings: false stops, and the share of added losses that is felt.

./dev run python tools/recordings/real_crashes.py FOLDER [--rate 50|100|400] [--picture docs/crash_curve.png]

FOLDER is that of borealtc.py. No run holds a collision. A loss of 0.4 m/s within 80 ms is added at 18
places of each run, while the wheels go on turning as recorded; it is felt if a stop comes within 0.3 s.
Stops less than a second apart are one.

Cross-validation decides `max_loss_rough` and `vibration_factor`: of the pairs that feel ENOUGH on the hard
ground of the runs for fitting the one of fewest false stops there, then on their soft ground. A row counts
only runs that its pair was not fitted to: by run, each fifth of the runs with the pair of the other four;
by ground, each ground with the pair of the other grounds. The last rows are those of config/crash_stop.yaml
on all runs.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Callable, Dict, Iterator, List, NamedTuple, Sequence, Tuple

import numpy as np
import yaml
from borealtc import HARD, SOFT, Run, read_runs

from husky_highlevel_controller.controller.crash_detection import Change, CrashConfig, CrashDetector
from husky_highlevel_controller.datatypes import ImuSample, Twist2D

LOSS, LOSS_TIME, FELT_WITHIN = 0.4, 0.08, 0.3  # [m/s], [s], [s]
PLACES, FOLDS, ENOUGH = 18, 5, 0.96  # added losses in a run; folds by run; share felt
ROUGH_LOSSES, FACTORS = np.arange(0.14, 0.45, 0.02).round(2).tolist(), (0.0, 0.5, 1.0, 1.5, 2.0)
LEVEL = (0.0, 0.0, 0.0, 1.0)
Changes = List[Tuple[float, Change]]  # stamps [s] and changes


class Evidence(NamedTuple):
    """Changes of a run that may be crashes, and the changes after each added loss."""

    run: Run
    free: Changes
    losses: List[Changes]


class Outcome(NamedTuple):
    """Results of some runs."""

    hours: float
    false_stops: int
    losses: int
    felt: int

    @property
    def an_hour(self) -> float:
        """False stops an hour."""
        return self.false_stops / self.hours

    @property
    def share(self) -> float:
        """Share of the added losses that is felt."""
        return self.felt / max(self.losses, 1)


def at_rate(imu: np.ndarray, rate: int) -> np.ndarray:
    """IMU rows at another rate [Hz]: means of neighbours, or interpolated."""
    if rate < 100:
        count = 100 // rate
        return imu[: len(imu) // count * count].reshape(-1, count, 7).mean(axis=1)
    if rate == 100:
        return imu
    stamps = np.arange(imu[0, 0], imu[-1, 0], 1.0 / rate)
    return np.column_stack([stamps, *(np.interp(stamps, imu[:, 0], column) for column in imu[:, 1:].T)])


def changes(imu: np.ndarray, wheels: np.ndarray, config: CrashConfig) -> Changes:
    """Changes of velocity that are a crash by this configuration."""
    detector, found, k = CrashDetector(config), [], 0
    stamps, speeds = wheels[:, 0].tolist(), wheels[:, 1:].mean(axis=1).tolist()
    while k < len(stamps) and stamps[k] < imu[0, 0] - 1.0:
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


def evidence(run: Run, rate: int, config: CrashConfig) -> Evidence:
    """Changes of a run at a rate [Hz], by the configuration that stops most often."""
    losses = [
        [(stamp, change) for stamp, change in changes(piece, run.wheels, config) if stamp >= begin]
        for begin, piece in pieces_with_a_loss(run, rate)
    ]
    return Evidence(run, changes(at_rate(run.imu, rate), run.wheels, config), losses)


def outcome(runs: Sequence[Evidence], config: CrashConfig) -> Outcome:
    """False stops and felt losses of some runs."""
    false = 0
    for run in runs:
        last = -1e9
        for stamp, change in run.free:
            if change.excess(config) > config.max_loss:
                false += stamp - last > 1.0
                last = stamp
    losses = [loss for run in runs for loss in run.losses]
    felt = sum(any(change.excess(config) > config.max_loss for _, change in loss) for loss in losses)
    return Outcome(sum(run.run.hours for run in runs), false, len(losses), felt)


def fitted(runs: Sequence[Evidence], config: CrashConfig) -> CrashConfig:
    """The configuration of fewest false stops, on hard ground first, that detects enough losses there."""
    hard, soft = ([run for run in runs if run.run.ground in grounds] for grounds in (HARD, SOFT))
    best, fewest = config, (len(runs) * 10**6, 0)
    for rough, factor in product(ROUGH_LOSSES, FACTORS):
        tried = replace(config, max_loss_rough=rough, vibration_factor=factor)
        on_hard = outcome(hard, tried)
        if on_hard.share >= ENOUGH:
            false_stops = on_hard.false_stops, outcome(soft, tried).false_stops
            if false_stops < fewest:
                best, fewest = tried, false_stops
    return best


def held_out(
    runs: Sequence[Evidence], config: CrashConfig, fold: Callable[[Evidence], object]
) -> Dict[str, List[Outcome]]:
    """Outcomes of each ground; each run uses the configuration fitted to the runs of the other folds."""
    results: Dict[str, List[Outcome]] = {}
    for out in sorted({fold(run) for run in runs}, key=str):
        chosen = fitted([run for run in runs if fold(run) != out], config)
        print(f"  without {out}: max_loss_rough {chosen.max_loss_rough}, factor {chosen.vibration_factor}")
        for run in runs:
            if fold(run) == out:
                results.setdefault(run.run.ground, []).append(outcome([run], chosen))
    return results


def show(title: str, results: Dict[str, List[Outcome]]) -> None:
    """Print a line for each ground, and for hard and soft ground."""
    print(title)
    for name, grounds in [
        *((ground, (ground,)) for ground in (*HARD, *SOFT)),
        ("hard", HARD),
        ("soft", SOFT),
    ]:
        parts = [part for ground in grounds for part in results.get(ground, [])]
        if parts:
            total = Outcome(*map(sum, zip(*parts)))
            print(
                f"  {name:12} {60 * total.hours:6.1f} min {total.false_stops:4} false stops "
                f"({total.an_hour:5.1f} /h), felt {total.share:.1%}",
                flush=True,
            )


def draw(path: Path, runs: Sequence[Evidence], config: CrashConfig) -> None:
    """Draw false stops an hour against the share felt, over `max_loss_rough`."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.6), dpi=90)
    for name, grounds, color in (("hard ground", HARD, "tab:blue"), ("soft ground", SOFT, "tab:red")):
        chosen = [run for run in runs if run.run.ground in grounds]
        tried = [outcome(chosen, replace(config, max_loss_rough=rough)) for rough in ROUGH_LOSSES]
        axis.plot(
            [100 * one.share for one in tried], [one.an_hour for one in tried], ".-", color=color, label=name
        )
        now = outcome(chosen, config)
        axis.plot(100 * now.share, now.an_hour, "o", color=color, fillstyle="none", markersize=10)
    axis.axhline(6.0, color="0.6", linestyle=":")
    axis.axvline(95.0, color="0.6", linestyle=":")
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
    most_often = replace(config, max_loss_rough=min(ROUGH_LOSSES), vibration_factor=min(FACTORS))
    runs = [evidence(run, options.rate, most_often) for run in read_runs(options.folder)]
    number = {run.run.name: i for i, run in enumerate(runs)}
    show("folds by run", held_out(runs, config, lambda run: number[run.run.name] % FOLDS))
    show("folds by ground", held_out(runs, config, lambda run: run.run.ground))
    print(f"fitted to all runs: {fitted(runs, config)}")
    grounds = (*HARD, *SOFT)
    shipped = {g: [outcome([run for run in runs if run.run.ground == g], config)] for g in grounds}
    show("config/crash_stop.yaml on all runs", shipped)
    if options.picture:
        draw(options.picture, runs, config)


if __name__ == "__main__":
    main()
