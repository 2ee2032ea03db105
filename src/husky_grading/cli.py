"""Command `grade`: grades a launch file, a node or the submissions of a class; see docs/marking.md."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Optional, Sequence, Tuple

from husky_evaluation.tasks.command import (
    add_old_name,
    add_worker_options,
    between,
    exit_codes,
    seed_value,
)
from husky_grading.batch import Batch, class_seed, mark_all
from husky_grading.exercises.catalogue import EXERCISES
from husky_grading.isolation.process import stop_on_signals
from husky_grading.records import (
    AUTO,
    ROBOT_VERSIONS,
    Job,
    Launchable,
    MarkingConfig,
    MarkingResult,
    Rules,
)
from husky_grading.reports.files import add_step_summary
from husky_grading.reports.tables import to_result
from husky_grading.run_jobs import run_program
from husky_grading.settings import load_rules


def parse(arguments: Optional[Sequence[str]]) -> argparse.Namespace:
    """Return the options of a command line; argparse ends the program if an option is wrong."""
    parser = _make_parser()
    options = parser.parse_args(arguments)
    # earlier name of `--robot`, which is hidden in the help; the error gives the new name
    if options.husky:
        parser.error(f"--husky is now called --robot; choose from {', '.join((AUTO, *ROBOT_VERSIONS))}")
    if options.cluster and not options.all:
        parser.error(f"--cluster {options.cluster} needs --all")
    if options.time_limit and not options.all:
        parser.error(f"--time-limit {options.time_limit:g} needs --all")
    # argparse has no setting for "at least two values", so the number is checked here
    if options.launch and len(options.launch) < 2:
        parser.error("--launch needs a package and a file")
    if options.node and len(options.node) < 2:
        parser.error("--node needs a package and a type")
    if options.all and not options.all.is_dir():
        parser.error(f"--all {options.all} is not a folder; check the path")
    if options.underlay and not options.underlay.is_file():
        parser.error(f"--underlay {options.underlay} is not a file; check the path")
    return options


def _make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line, with all options."""
    parser = argparse.ArgumentParser(
        prog="grade",
        description="Grade a controller by the course's rubric, headless. "
        "The exit code is 0 for full marks, 1 if points are lost, and 2 if it could not be graded.",
    )
    choice = parser.add_mutually_exclusive_group(required=True)
    add = parser.add_argument
    choice.add_argument(
        "--launch", nargs="+", metavar=("PACKAGE", "FILE"), help="launch file to grade, and its arguments"
    )
    choice.add_argument(
        "--node", nargs="+", metavar=("PACKAGE", "TYPE"), help="node to grade, and its arguments"
    )
    choice.add_argument(
        "--all", type=Path, metavar="DIR",
        help="folder of a class; each folder or archive in it is one submission",
    )  # fmt: skip
    choice.add_argument(
        "--review", type=Path, metavar="OUT",
        help="write a page on which you grade by hand the items that `grade --all ... --out OUT` left open",
    )  # fmt: skip
    add("--exercise", type=int, choices=sorted(EXERCISES), default=3, help="exercise to grade (default: 3)")
    add(
        "--robot", choices=(AUTO, *ROBOT_VERSIONS), default=AUTO,
        help="robot to simulate: husky (scans on /front/scan in front_laser), husky_melodic (on /scan in "
        "base_laser) or smb (on /scan in rslidar); auto takes the robot whose topics and frames the "
        "submission uses (default: auto)",
    )  # fmt: skip
    add(
        "--seed", type=seed_value,
        help="random seed for start poses, pillars and noise (with --all defaults to one that is drawn "
        "for the class and kept in --out; otherwise 0)",
    )  # fmt: skip
    _add_run_options(parser)
    add("--out", type=Path, default=Path("marking"), help="folder of results (default: ./marking)")
    # `--setup` is the earlier name of `--underlay`
    add(
        "--underlay", "--setup", dest="underlay", type=Path, metavar="SETUP.bash",
        help="setup file to source first: the submission's workspace, or with --all a workspace that all "
        "submissions are built on",
    )  # fmt: skip
    # adds --jobs, which is 1 by default, and --cluster
    add_worker_options(parser, 1, "with --all, number of submissions that are graded at the same time")
    add(
        "--time-limit", type=between(float, 1.0, 86400.0), metavar="S",
        help="time limit of one submission with --all, in wall-clock seconds (default: an hour and the time "
        "limits of its runs, which is 5940 with three runs of exercise 3)",
    )  # fmt: skip
    add(
        "--rubric",
        type=Path,
        metavar="FILE",
        help="YAML file with tolerances, weights and items that are graded by hand",
    )
    add("--only", action="append", default=[], metavar="NAME", help="submission to grade again, with --all")
    add("--husky", help=argparse.SUPPRESS)  # earlier name of `--robot`
    return parser


def _add_run_options(parser: argparse.ArgumentParser) -> None:
    """Add the number of runs, their time limit and their real-time factor, with each exercise's defaults."""
    add = parser.add_argument
    # the help names the exercises with several runs, such as "3", and each exercise's defaults
    with_several_runs = " and ".join(str(number) for number, each in EXERCISES.items() if each.random_starts)
    runs = add(
        "--runs", dest="trials", type=between(int, 1, 1000), default=3, metavar="RUNS",
        help=f"number of runs in exercise {with_several_runs} (default: 3)",
    )  # fmt: skip
    add_old_name(parser, "--trials", runs)
    positive_number = between(float, 0.1, 3600.0)
    deadlines = ", ".join(f"{each.deadline:g} in exercise {number}" for number, each in EXERCISES.items())
    add(
        "--deadline", type=positive_number,
        help=f"time limit of a run in simulated seconds (default: {deadlines})",
    )  # fmt: skip
    paces = ", ".join(f"{each.pace:g} in exercise {number}" for number, each in EXERCISES.items())
    pace = add(
        "--real-time-factor", dest="pace", type=positive_number, metavar="FACTOR",
        help=f"maximum real-time factor (default: {paces})",
    )  # fmt: skip
    add_old_name(parser, "--pace", pace)


def grade(options: argparse.Namespace) -> int:
    """Grade the submissions that the options name, or write a review page, and return the exit code.

    The code is 0 for full marks, 1 if points are lost, and 2 if a submission could not be graded.
    """
    if options.review:
        # imported only here, because the review page needs matplotlib, which takes long to load
        from husky_grading.review import write_review

        print(f"open this page in a browser: {write_review(options.review.resolve()).as_uri()}")
        return 0
    exercise = EXERCISES[options.exercise]
    rules = load_rules(options.rubric, exercise.items) if options.rubric else Rules()
    out = options.out.resolve()
    seed = options.seed
    # a class gets a random seed, so no student knows the start poses; a single submission always gets seed 0
    if seed is None:
        seed = class_seed(out) if options.all else 0
    config = MarkingConfig(
        options.exercise, options.robot, seed, options.trials,
        options.deadline or exercise.deadline, options.pace or exercise.pace, rules,
    )  # fmt: skip
    setups = (str(options.underlay.resolve()),) if options.underlay else ()
    if options.all:
        batch = Batch(
            options.all.resolve(), out, options.jobs, tuple(options.only), setups,
            cluster=options.cluster, time_limit=options.time_limit or 0.0,
        )  # fmt: skip
        results = mark_all(config, batch)
    else:
        results = [_grade_single(options, config, setups, out)]
    if any(result.problem for result in results):
        return 2
    return 0 if all(result.full for result in results) else 1


def _grade_single(
    options: argparse.Namespace, config: MarkingConfig, setups: Tuple[str, ...], out: Path
) -> MarkingResult:
    """Grade the launch file or node that the options name, print its result, and return it."""
    # the options have either `--launch PACKAGE FILE ...` or `--node PACKAGE TYPE ...`
    kind = "launch" if options.launch else "node"
    package, name, *arguments = options.launch or options.node
    launchable = Launchable(kind, package, name, tuple(arguments))
    job = Job(f"{package} {name}", str(out), config, launchable, setups=setups)
    result = run_program(job, shows_errors=True)
    add_step_summary([result])
    print(to_result(result))  # a table of the items, and the notes
    print(f"\npictures, JSON, JUnit XML and logs: {out}")
    return result


def main(arguments: Optional[Sequence[str]] = None) -> None:
    """Run the command."""
    options = parse(arguments)
    if not options.cluster:
        # lets Ctrl-C end all programs that `grade` has started; with a cluster, its workers start them
        stop_on_signals()
    with exit_codes("grade"):
        raise SystemExit(grade(options))
