"""Checkouts of this package: whether a folder is one, and commands in its workspace."""

from __future__ import annotations

import os
import subprocess
from argparse import ArgumentTypeError
from pathlib import Path
from typing import Dict, Sequence
from xml.etree.ElementTree import ParseError

from defusedxml import DefusedXmlException, ElementTree

PACKAGE = "husky_highlevel_controller"
OURS = Path(__file__).resolve().parents[2]
# PATH for another checkout's ./dev, without the folders that our ./dev has added
PROGRAMS = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
# variables of our ./dev, which would lead another ./dev into our workspace; without DISPLAY, no window opens
# during a measurement
LEFT_OUT = {
    "CMAKE_PREFIX_PATH", "DISPLAY", "LD_LIBRARY_PATH", "PKG_CONFIG_PATH", "PYTHONPATH",
    "ROSLISP_PACKAGE_DIRECTORIES", "ROS_PACKAGE_PATH",
}  # fmt: skip


class CheckoutError(Exception):
    """Failure of a command in a checkout; the text has the command, the checkout and the last output."""


def checkout(path: str) -> Path:
    """Return the absolute folder of a checkout of this package whose figures can be measured.

    Raises:
        ArgumentTypeError: The folder is missing, is not this package, or has no benchmark.
    """
    folder = Path(path).resolve()
    remedy = f"Name the folder of another checkout of {PACKAGE}."
    if not folder.is_dir():
        raise ArgumentTypeError(f"'{path}' is not a folder. {remedy}")
    try:
        name = (ElementTree.parse(folder / "package.xml").findtext("name") or "").strip()
    except (OSError, ParseError, DefusedXmlException, ValueError, LookupError) as error:
        raise ArgumentTypeError(f"Cannot read '{path}/package.xml': {error}. {remedy}") from None
    if name != PACKAGE:
        raise ArgumentTypeError(f"'{path}' is the package '{name}'. {remedy}")
    for needed in ("dev", "tools/benchmarks/bench.py"):
        if not (folder / needed).is_file():
            raise ArgumentTypeError(
                f"'{path}' has no {needed}, so it cannot be measured. Take a newer commit."
            )
    return folder


def variables() -> Dict[str, str]:
    """Return the environment without this workspace and its display."""
    kept = {name: value for name, value in os.environ.items() if name not in LEFT_OUT}
    return {**kept, "PATH": PROGRAMS}


def run_in(folder: Path, *command: str, accepted: Sequence[int] = (0,)) -> None:
    """Run `./dev COMMAND` of a checkout in the caller's folder.

    Raises:
        CheckoutError: The exit code is not one of `accepted`.
    """
    done = subprocess.run(
        [str(folder / "dev"), *command], env=variables(), stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", check=False,
    )  # fmt: skip
    if done.returncode not in accepted:
        said = done.stdout[-500:].strip()
        raise CheckoutError(
            f"{folder}/dev {' '.join(command)} failed with exit code {done.returncode}: {said}"
        )
