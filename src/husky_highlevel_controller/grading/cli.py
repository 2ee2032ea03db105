"""Marks submissions: one command, one table; docs/marking.md says how.

In: a launch file, a node, or a folder of packages. Out: tables, files, exit code.
Must not know: how things are judged, drawn or started.
"""

from __future__ import annotations

import argparse
import shutil
import signal
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Dict, Optional, Sequence

from tqdm import tqdm

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.grading import batch
from husky_highlevel_controller.grading.drive import rviz_check
from husky_highlevel_controller.grading.drive.recording import Recording, empty_recording
from husky_highlevel_controller.grading.drive.robot_version import detect_robot
from husky_highlevel_controller.grading.drive.run import (
    ROBOT_VERSIONS,
    GradingConfig,
    Plan,
    Submission,
    drive,
    plan,
)
from husky_highlevel_controller.grading.drive.trials import Trial, draw_trials
from husky_highlevel_controller.grading.isolation import private_network
from husky_highlevel_controller.grading.isolation.files import write_whole
from husky_highlevel_controller.grading.isolation.private_network import is_private
from husky_highlevel_controller.grading.isolation.process import request_stop
from husky_highlevel_controller.grading.isolation.sandbox import Workspace, kind_of_sandbox
from husky_highlevel_controller.grading.record import (
    Record,
    differences,
    hash_of_poses,
    hashes_of_files,
    load_record,
    versions,
)
from husky_highlevel_controller.grading.record import to_json as record_to_json
from husky_highlevel_controller.grading.reports.files import add_step_summary, write_result
from husky_highlevel_controller.grading.reports.plots import draw_drives, draw_pixels
from husky_highlevel_controller.grading.reports.replays import REPLAY, replay_page
from husky_highlevel_controller.grading.reports.tables import Result, table
from husky_highlevel_controller.grading.rubrics import exercise_2, exercise_3, exercise_5
from husky_highlevel_controller.grading.rubrics.rules import DEFAULT, Rules, load_rules
from husky_highlevel_controller.tasks.command import add_cluster_option, exit_codes, positive

RUBRICS = {
    2: exercise_2.judge_exercise_2,
    3: exercise_3.judge_exercise_3,
    5: exercise_5.judge_exercise_5,
}
ITEMS = {2: exercise_2.ITEMS, 3: exercise_3.ITEMS, 5: exercise_5.ITEMS}  # names, for a rubric file
PACES = {2: 1.0, 3: 5.0, 5: 2.0}  # simulated seconds a second, for each exercise
DEADLINES = {2: 60.0, 3: 120.0, 5: 60.0}  # [s], simulated


@dataclass(frozen=True)
class Marking:
    """How every submission is marked."""

    config: GradingConfig
    seed: int = 0
    trials: int = 3
    rules: Rules = DEFAULT
    shows_progress: bool = False  # of each drive

    @property
    def exercise(self) -> int:
        """Its number."""
        return self.config.exercise

    @property
    def settings(self) -> Dict[str, Any]:
        """For the result."""
        config = self.config
        return {
            "exercise": config.exercise, "robot": config.robot, "seed": self.seed, "trials": self.trials,
            "deadline": config.deadline, "pace": config.pace,
            "rubric": None if self.rules == DEFAULT else str(self.rules), "sandbox": kind_of_sandbox(),
            "network": "loopback only" if is_private() else "not kept apart",
        }  # fmt: skip

    def mark(
        self, submission: Submission, name: str, out: Path, notes: Sequence[str] = (), robot: str = ""
    ) -> Result:
        """Mark a submission; its drives, logs and pictures go into a folder.

        Args:
            submission: what to start.
            name: whose it is.
            out: folder for the result; drives of an earlier marking in it are deleted.
            notes: what is known about it already.
            robot: that it is written for, of ROBOT_VERSIONS; empty: as configured.

        Raises:
            MarkingError: marking does not work here.
        """
        out.mkdir(parents=True, exist_ok=True)
        for old in [*out.glob("drive_*"), out / "plan", out / "rviz", out / "robot"]:
            shutil.rmtree(old, ignore_errors=True)
        planned = plan(submission, out / "plan")
        config, notes = replace(self.config, robot=robot or self.config.robot), list(notes)
        if config.robot == "auto":
            found, why = detect_robot(submission, planned, out / "robot") if planned.nodes else ("husky", "")
            config = replace(config, robot=found)
            notes += [why] * bool(why)
        drives = draw_trials(self.trials if config.exercise == 3 else 1, self.seed)
        recordings = []
        for trial in drives:
            if planned.nodes:
                with self._bar(trial, config) as bar:
                    folder = out / f"drive_{trial.number}"
                    recordings.append(drive(submission, trial, config, folder, partial(_advance, bar)))
            else:
                recordings.append(empty_recording(trial.pillar, config.deadline, planned.notes))
        view, pixels = rviz_check.look(submission, planned, config, out / "rviz")
        items = RUBRICS[config.exercise](recordings, view, config.scan_topic, self.rules)
        everything = [*notes, *planned.notes, *(note for r in recordings for note in r.notes)]
        result = Result(name, submission.words, self.settings, tuple(items), tuple(dict.fromkeys(everything)))
        record = self._record(result, submission, planned, config, recordings)
        write_whole(out / "record.json", record_to_json(record))
        (out / "drive.png").write_bytes(draw_drives(recordings, name))
        for trial, recording in zip(drives, recordings):
            page = replay_page(recording, f"{name}, drive {trial.number}")
            if page:
                write_whole(out / f"drive_{trial.number}" / REPLAY, page)
        if pixels is not None:
            (out / "rviz.png").write_bytes(draw_pixels(pixels))
        return result

    def _bar(self, trial: Trial, config: GradingConfig) -> Any:
        """How far a drive is, in simulated seconds up to its deadline, at which it may end earlier."""
        words = f"drive {trial.number} of {self.trials if config.exercise == 3 else 1}"
        shape = "{desc}: {percentage:3.0f} %|{bar}| {n:.0f} of at most {total:.0f} s [{elapsed}<{remaining}]"
        hidden = not self.shows_progress
        return tqdm(total=config.deadline, desc=words, bar_format=shape, disable=hidden, leave=False)

    def _record(
        self,
        result: Result,
        submission: Submission,
        planned: Plan,
        config: GradingConfig,
        recordings: Sequence[Recording],
    ) -> Record:
        workspace, folder = submission.workspace, Path(planned.package_path) if planned.package_path else None
        return Record(
            result.name, submission.what,
            tuple(map(str, workspace.setups)), tuple(map(str, workspace.packages)),
            {"exercise": config.exercise, "robot": config.robot, "seed": self.seed, "trials": self.trials,
             "deadline": config.deadline, "pace": config.pace},
            hashes_of_files(folder) if folder and folder.is_dir() else {},
            versions(),
            tuple(hash_of_poses(recording) for recording in recordings),
            {item.name: item.points for item in result.items},
        )  # fmt: skip


def _advance(bar: Any, now: float) -> None:
    """Show a simulated time [s]."""
    bar.update(round(min(now, bar.total) - bar.n, 1))


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
    what.add_argument(
        "--all",
        type=Path,
        metavar="DIR",
        help="every hand-in in a folder: each folder or archive in it is one",
    )
    what.add_argument(
        "--verify", type=Path, metavar="RECORD",
        help="drive again as a record.json of exercise 3 says; exit code 0: it is the same, 1: it is not",
    )  # fmt: skip
    parser.add_argument("--exercise", type=int, choices=sorted(PACES), default=3, help="(default 3)")
    parser.add_argument(
        "--robot", choices=("auto", *ROBOT_VERSIONS), default="auto",
        help="husky: scans on /front/scan in front_laser, husky_melodic: on /scan in base_laser, smb: on "
        "/scan in rslidar (default auto: what the submission subscribes to and names)",
    )  # fmt: skip
    parser.add_argument(
        "--seed", type=_not_negative, default=0, help="of starts, pillars and noise (default 0)"
    )
    parser.add_argument("--trials", type=positive, default=3, help="drives in exercise 3 (default 3)")
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
    parser.add_argument(
        "--underlay", "--setup", dest="underlay", type=Path, metavar="SETUP.bash",
        help="sourced first: the submission's workspace, or with --all one that hand-ins are built on",
    )  # fmt: skip
    parser.add_argument("--jobs", type=positive, default=1, help="with --all: hand-ins at a time (default 1)")
    add_cluster_option(parser)
    parser.add_argument(
        "--rubric", type=Path, metavar="FILE", help="YAML: tolerances, weights, items that a person judges"
    )
    parser.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="with --all: mark this one again"
    )
    options = parser.parse_args(arguments)
    if options.cluster and not options.all:
        parser.error(f"--cluster {options.cluster}: only with --all")
    for kind in ("launch", "node"):
        if getattr(options, kind) and len(getattr(options, kind)) < 2:
            parser.error(f"--{kind} wants a package and a {'file' if kind == 'launch' else 'type'}")
    if options.all and not options.all.is_dir():
        parser.error(f"--all {options.all}: no such folder")
    if options.underlay and not options.underlay.is_file():
        parser.error(f"--underlay {options.underlay}: no such file")
    return options


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


def verify(path: Path, out: Path, rules: Rules) -> int:
    """Drive again as a record says, and print what is not the same; the exit code."""
    before = load_record(path)
    settings = before.settings
    if settings["exercise"] != 3:
        raise HuskyError(f"{path}: exercise {settings['exercise']} cannot be verified, only exercise 3")
    config = GradingConfig(3, settings["robot"], settings["deadline"], settings["pace"])
    workspace = Workspace(setups=tuple(map(Path, before.setups)), packages=tuple(map(Path, before.packages)))
    marking = Marking(config, settings["seed"], settings["trials"], rules)
    marking.mark(Submission(before.what, workspace), before.name, out)
    found = differences(before, load_record(out / "record.json"))
    print("\n".join(found) if found else f"{before.name}: the same files, drives and points as recorded")
    return 1 if found else 0


def run(options: argparse.Namespace) -> int:
    """Mark what the command line says; the exit code."""
    exercise = options.exercise
    config = GradingConfig(
        exercise, options.robot, options.deadline or DEADLINES[exercise], options.pace or PACES[exercise]
    )
    rules = load_rules(options.rubric, ITEMS[exercise]) if options.rubric else DEFAULT
    marking = Marking(config, options.seed, options.trials, rules, shows_progress=not options.all)
    out = options.out.resolve()
    if options.verify:
        return verify(options.verify, out / "verify", rules)
    underlay = Workspace(setups=(options.underlay.resolve(),) if options.underlay else ())
    if options.all:
        what = batch.Batch(
            options.all.resolve(), out, options.jobs, tuple(options.only), underlay, options.cluster
        )
        results = batch.mark_all(marking, what)
        return 2 if any(result.problem for result in results) else int(not all(r.full for r in results))
    kind = "launch" if options.launch else "node"
    words = getattr(options, kind)
    is_ours = words[0] == "husky_highlevel_controller" and not options.underlay
    submission = Submission((f"--{kind}", *words), replace(underlay, own_modules=is_ours))
    name = " ".join(words[:2])
    result = marking.mark(submission, name, out)
    write_result(result, out)
    add_step_summary([result])
    print(table(result))
    print(f"\npicture, JSON, JUnit XML and logs: {out}")
    return 0 if result.full else 1


def main(arguments: Optional[Sequence[str]] = None) -> None:
    """Run the command."""
    options = parse(arguments)

    def stop(*_: Any) -> None:
        request_stop()

    if not options.cluster:  # which is not reached from a network of one's own, and marks elsewhere
        private_network.enter()
        for asked in (signal.SIGINT, signal.SIGTERM):
            signal.signal(asked, stop)  # waits end, and clean up behind them
    with exit_codes("grade"):
        raise SystemExit(run(options))


if __name__ == "__main__":
    from husky_highlevel_controller.grading import cli  # by its name, or no worker could load a Marking

    cli.main()
