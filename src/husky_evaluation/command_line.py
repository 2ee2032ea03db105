"""Command `husky` of `pip install .`, because a bare name such as `compare` may hide a program of the system.

In: the name of a command and its arguments. Out: the effect of that command.
"""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from typing import Optional, Sequence

from husky_evaluation.tasks.command import ONE_COMMAND

COMMANDS = {
    "evaluate": "measure the controller",
    "sweep": "drive for every value of one or more parameters",
    "tune": "find better parameters",
    "compare": "compare two controllers",
}


def main(arguments: Optional[Sequence[str]] = None) -> None:
    """Run the command that the first argument names, with the other arguments."""
    parser = argparse.ArgumentParser(
        prog=ONE_COMMAND, description="Measure controllers of a simulated Husky, without ROS.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="commands:\n" + "\n".join(f"  {name:10}{does}" for name, does in COMMANDS.items()),
    )  # fmt: skip
    parser.add_argument("command", choices=COMMANDS, help=f"see also '{ONE_COMMAND} COMMAND --help'")
    given = list(sys.argv[1:] if arguments is None else arguments)
    # this parser gets only the name of the command, because each command has its own parser for its arguments
    command = parser.parse_args(given[:1]).command
    # only the module of the chosen command is imported, because each of them loads large libraries
    import_module(f"husky_evaluation.{command}").main(given[1:])
