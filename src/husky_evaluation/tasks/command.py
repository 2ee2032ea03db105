"""Names, options and exit codes that several commands share.

In: an argument parser. Out: options, exit codes.
"""

from __future__ import annotations

import argparse
import sys
import traceback
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Callable, Iterator, Sequence

from husky_highlevel_controller.config import ConfigError
from husky_highlevel_controller.datatypes import HuskyError

STOPPED = 130  # exit code of a command that Ctrl-C ended
# command that `pip install .` installs; every other command is a sub-command of it, such as `husky sweep`
ONE_COMMAND = "husky"


def name_as_typed(command: str) -> str:
    """Return the name by which the user started a command: 'husky sweep' after pip, 'sweep' with rosrun."""
    return f"{ONE_COMMAND} {command}" if is_typed_by_one_command() else command


def is_typed_by_one_command() -> bool:
    """Return whether the user started ONE_COMMAND; then ROS may be missing."""
    return Path(sys.argv[0]).stem == ONE_COMMAND


def add_old_name(parser: argparse.ArgumentParser, old: str, option: argparse.Action) -> None:
    """Accept the name that an option had before version 1.0; each use of this name prints the new name."""
    new = option.option_strings[0]

    class OldName(argparse.Action):
        """Action of the old name: it prints the new name, and stores the value as the value of the option."""

        def __call__(self, parser: Any, namespace: Any, values: Any, option_string: Any = None) -> None:
            print(f"{parser.prog}: {old} is now called {new}; the old name still works", file=sys.stderr)
            setattr(namespace, self.dest, values)

    # The old name is not in the help. It has no default, because the default of the option is enough.
    parser.add_argument(
        old, dest=option.dest, type=option.type or str, action=OldName, help=argparse.SUPPRESS,
        default=argparse.SUPPRESS,
    )  # fmt: skip


def add_worker_options(
    parser: argparse.ArgumentParser, jobs: int = 2, jobs_help: str = "processes of this machine"
) -> None:
    """Add --jobs and --cluster."""
    parser.add_argument("--jobs", type=positive, default=jobs, help=f"{jobs_help} (default: {jobs})")
    parser.add_argument(
        "--cluster", default="", metavar="tcp://HOST:8786",
        help="address of the scheduler of a Dask cluster that does the work instead, see docs/cluster.md",
    )  # fmt: skip


def refuse_doubled_name(names: Sequence[str], remedy: str) -> None:
    """Raise ConfigError if a parameter is named twice; the error ends with the `remedy`."""
    if len(set(names)) < len(names):
        most_frequent = max(names, key=names.count)
        raise ConfigError(f"{most_frequent} is given twice; {remedy}")


def positive(text: str) -> int:
    """Return the whole number above 0 in a text; argparse calls this for an argument of this type."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text} is less than 1")
    return number


def between(kind: Callable[[str], float], low: float, high: float) -> Callable[[str], float]:
    """Return a function that reads a number from `low` to `high`, as the type of an argument of argparse."""

    def number(text: str) -> float:
        if not low <= kind(text) <= high:
            raise argparse.ArgumentTypeError(f"{text} is not in {low}..{high}")
        return kind(text)

    return number


# type of a random seed; the limit leaves room for the number of a run, which may be added to the seed
seed_value = between(int, 0, 2**31 - 1001)


@contextmanager
def exit_codes(name: str) -> Iterator[None]:
    """Exit with 2 on bad input (a sentence) or a bug (a traceback), and with STOPPED on Ctrl-C.

    Python's own exit code of an exception is 1, which means "a metric missed" or "less than full marks" here.
    """
    try:
        yield
    except (HuskyError, OSError) as error:  # an OSError comes from a full disk, for example
        print(f"{name}: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except Exception as error:
        traceback.print_exc()
        print(f"{name}: this is a bug: {type(error).__name__}: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        kept = "if results are kept in a file, the same command goes on where it was"
        print(f"{name}: stopped; {kept}", file=sys.stderr)
        raise SystemExit(STOPPED) from None
