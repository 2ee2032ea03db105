"""Marks submissions: one command, one table; docs/marking.md tells how.

In: a launch file, a node, or a folder of packages. Out: tables, files, exit code.
Must not know: how things are judged, drawn or started.
"""

from __future__ import annotations

import argparse
import shutil
import signal
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence

import numpy as np

from husky_highlevel_controller import class_marking, rviz_view
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.grading import RvizView
from husky_highlevel_controller.marking import Rules, Submission, drive, plan
from husky_highlevel_controller.picture import draw_drives, draw_pixels
from husky_highlevel_controller.processes import STOP
from husky_highlevel_controller.recording import Recording, empty_recording
from husky_highlevel_controller.report import Result, table, to_html, to_json, to_junit
from husky_highlevel_controller.sheets import judge
from husky_highlevel_controller.trials import draw_trials

PACES = {2: 1.0, 3: 5.0, 5: 2.0}  # simulated seconds a second, for each exercise
DEADLINES = {2: 60.0, 3: 120.0, 5: 60.0}  # [s], simulated
PICTURES = ("drive.png", "rviz.png")


@dataclass(frozen=True)
class Marking:
    """How everybody is marked."""

    rules: Rules
    seed: int = 0
    trials: int = 3

    @property
    def settings(self) -> Dict[str, Any]:
        """For the result."""
        rules = self.rules
        return {
            "exercise": rules.exercise, "husky": rules.husky, "seed": self.seed, "trials": self.trials,
            "deadline": rules.deadline, "pace": rules.pace,
        }  # fmt: skip

    def mark(self, submission: Submission, name: str, out: Path, notes: Sequence[str] = ()) -> Result:
        """Mark a submission and write everything about it into a folder.

        Args:
            submission: what to start.
            name: whose it is.
            out: folder for the result; drives of an earlier marking in it are deleted.
            notes: what is known to be wrong already.

        Raises:
            MarkingError: marking does not work here.
        """
        out.mkdir(parents=True, exist_ok=True)
        for old in [*out.glob("drive_*"), out / "plan", out / "rviz"]:
            shutil.rmtree(old, ignore_errors=True)
        planned = plan(submission, out / "plan")
        drives = draw_trials(self.trials if self.rules.exercise == 3 else 1, self.seed)
        recordings = []
        for trial in drives:
            if planned.nodes:
                recordings.append(drive(submission, trial, self.rules, out / f"drive_{trial.number}"))
            else:
                recordings.append(empty_recording(trial.pillar, self.rules.deadline, planned.notes))
        view, pixels = rviz_view.look(submission, planned, self.rules, out / "rviz")
        items = judge(self.rules.exercise, recordings, view, self.rules.scan_topic)
        everything = [*notes, *planned.notes, *(note for r in recordings for note in r.notes)]
        result = Result(
            name, " ".join(submission.what), self.settings, tuple(items), tuple(dict.fromkeys(everything))
        )
        self._write(result, recordings, view, pixels, out)
        return result

    @staticmethod
    def _write(
        result: Result,
        recordings: Sequence[Recording],
        view: RvizView,
        pixels: Optional[np.ndarray],
        out: Path,
    ) -> None:
        title = f"{result.name}: {result.points:g} of {result.most:g}"
        (out / "drive.png").write_bytes(draw_drives(recordings, title))
        if pixels is not None:
            (out / "rviz.png").write_bytes(draw_pixels(pixels))
        (out / "table.txt").write_text(table(result) + "\n")
        (out / "junit.xml").write_text(to_junit([result]))
        (out / "page.html").write_text(to_html([result], {result.name: pictures(out)}))
        (out / "result.json").write_text(to_json(result))  # the last one: with it, it is done


def pictures(out: Path) -> List[bytes]:
    """The pictures in a folder of a result."""
    return [(out / name).read_bytes() for name in PICTURES if (out / name).is_file()]


def parse(arguments: Optional[Sequence[str]]) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="grade",
        description="Mark a controller by the course's rubric, headless. "
        "Exit code 0: full marks, 1: less, 2: it could not be marked.",
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--launch", nargs="+", metavar=("PACKAGE", "FILE"), help="a launch file, and its arguments"
    )
    what.add_argument("--node", nargs="+", metavar=("PACKAGE", "TYPE"), help="a node, and its arguments")
    what.add_argument("--all", type=Path, metavar="DIR", help="every catkin package in a folder")
    parser.add_argument("--exercise", type=int, choices=sorted(PACES), default=3, help="(default 3)")
    parser.add_argument(
        "--husky", choices=("noetic", "melodic"), default="noetic",
        help="scans on /front/scan in front_laser, or on /scan in base_laser (default noetic)",
    )  # fmt: skip
    parser.add_argument(
        "--seed", type=_not_negative, default=0, help="of starts, pillars and noise (default 0)"
    )
    parser.add_argument("--trials", type=_positive, default=3, help="drives in exercise 3 (default 3)")
    parser.add_argument(
        "--deadline", type=_seconds, help="of a drive, simulated seconds (default 120; 60 in 2, 5)"
    )
    parser.add_argument(
        "--pace", type=_seconds,
        help="simulated seconds a second, at most (default 5; 1 in exercise 2, 2 in 5)",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, default=Path("marking"), help="folder of results (default ./marking)"
    )
    parser.add_argument("--setup", type=Path, help="setup.bash of the submission's workspace")
    parser.add_argument(
        "--jobs", type=_positive, default=1, help="with --all: submissions at a time (default 1)"
    )
    parser.add_argument(
        "--entry", default="*controller*.launch",
        help="with --all: which launch file, where there are several (default '*controller*.launch')",
    )  # fmt: skip
    options = parser.parse_args(arguments)
    for kind in ("launch", "node"):
        if getattr(options, kind) and len(getattr(options, kind)) < 2:
            parser.error(f"--{kind} wants a package and a {'file' if kind == 'launch' else 'type'}")
    if options.all and not options.all.is_dir():
        parser.error(f"--all {options.all}: no such folder")
    return options


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text} is less than 1")
    return number


def _not_negative(text: str) -> int:
    number = int(text)
    if not 0 <= number < 2**31 - 1000:
        raise argparse.ArgumentTypeError(f"{text} is not in 0..{2**31 - 1001}")
    return number


def _seconds(text: str) -> float:
    number = float(text)
    if not 0.1 <= number <= 3600.0:
        raise argparse.ArgumentTypeError(f"{text} is not in 0.1..3600")
    return number


def run(options: argparse.Namespace) -> int:
    """Mark what the command line says; the exit code."""
    exercise = options.exercise
    rules = Rules(
        exercise, options.husky, options.deadline or DEADLINES[exercise], options.pace or PACES[exercise]
    )
    marking = Marking(rules, options.seed, options.trials)
    out = options.out.resolve()
    if options.all:
        results = class_marking.mark_all(marking, options.all.resolve(), out, options.jobs, options.entry)
        full = all(result is not None and result.full for result in results)
        return 0 if results and full else 2 if None in results or not results else 1
    kind = "launch" if options.launch else "node"
    words = getattr(options, kind)
    env = class_marking.sourced(options.setup.resolve()) if options.setup else None
    submission = Submission((f"--{kind}", *words), env) if env else Submission((f"--{kind}", *words))
    name = " ".join(words[:2])
    result = marking.mark(submission, name, out)
    print(table(result))
    print(f"\npicture, JSON, JUnit XML and logs: {out}")
    return 0 if result.full else 1


def main(arguments: Optional[Sequence[str]] = None) -> None:
    """Run the command."""
    options = parse(arguments)

    def stop(*_: Any) -> None:
        STOP.set()

    for asked in (signal.SIGINT, signal.SIGTERM):
        signal.signal(asked, stop)  # waits end, and clean up behind them
    try:
        code = run(options)
    except HuskyError as error:
        print(f"grade: {error}", file=sys.stderr)
        code = 2
    raise SystemExit(code)


if __name__ == "__main__":
    main()
