"""Options and exit codes common to the commands that do many tasks.

In: an argument parser. Out: options, exit codes.
"""

from __future__ import annotations

import argparse
import sys
import traceback
from contextlib import contextmanager
from typing import Callable, Iterator

from husky_highlevel_controller.datatypes import HuskyError

STOPPED = 130  # exit code of what Ctrl-C ended


def add_worker_options(
    parser: argparse.ArgumentParser, jobs: int = 2, jobs_help: str = "processes of this machine"
) -> None:
    """Add --jobs and --cluster."""
    parser.add_argument("--jobs", type=positive, default=jobs, help=f"{jobs_help} (default {jobs})")
    parser.add_argument(
        "--cluster", default="", metavar="tcp://HOST:8786",
        help="scheduler of a Dask cluster that does the work instead: docs/cluster.md",
    )  # fmt: skip


def positive(text: str) -> int:
    """A whole number above 0, for argparse."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text} is less than 1")
    return number


def between(kind: Callable[[str], float], low: float, high: float) -> Callable[[str], float]:
    """A type of argument for argparse: a number in a range."""

    def number(text: str) -> float:
        if not low <= kind(text) <= high:
            raise argparse.ArgumentTypeError(f"{text} is not in {low}..{high}")
        return kind(text)

    return number


seed_value = between(int, 0, 2**31 - 1001)  # of everything random; drives add their number


@contextmanager
def exit_codes(name: str) -> Iterator[None]:
    """Exit codes of a command: 2 on bad input (a sentence) or a bug (a traceback), STOPPED on Ctrl-C.

    Python's own exit code of an exception is 1, which means "a figure missed" or "less than full marks".
    """
    try:
        yield
    except (HuskyError, OSError) as error:  # a full disk is an OSError
        print(f"{name}: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except Exception as error:
        traceback.print_exc()
        print(f"{name}: this is a bug: {type(error).__name__}: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        print(
            f"{name}: stopped; with the same results file the same command goes on from here", file=sys.stderr
        )
        raise SystemExit(STOPPED) from None
