"""Robot that a submission is written for, by what the files of its package name."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from typing import Match, Optional, Pattern, Tuple

from husky_highlevel_controller.grading.hand_in.plan import Plan
from husky_highlevel_controller.grading.isolation.files import UnreadableFileError, read_text, walk
from husky_highlevel_controller.grading.records import ROBOT_TITLES, SMB

DEFAULT = "husky"
MAX_TEXT = 200_000  # [bytes] of a file that is read
# in a package: it includes the SMB's launch file, looks its frame up, or listens to its sensors
SMB_NAMES = re.compile(r"\bsmb_gazebo\b|\brslidar\b|/?\brslidar_points\b|/imu0\b")
# of its sheet 4; a Husky's hand-in may name /rslidar_points and smb_top_view, too
FILTERS_OF_THE_SMB = re.compile(r"\bsmb_(?:control|description)\b")
# where no node can be asked: its topic of scans
SCANS = re.compile(r"(?P<husky>\bfront/scan\b)|(?<![\w/])/scan\b")
TEXTS = {"", ".launch", ".xml", ".py", ".cpp", ".cc", ".hpp", ".h", ".yaml", ".yml", ".rviz"}


def named_robot(planned: Plan) -> Tuple[str, str]:
    """Robot that a submission names, a key of ROBOT_VERSIONS; and a sentence that says why.

    It is certain for the SMB; else the topic that the submission subscribes to decides.
    """
    words = _names_of_the_smb(planned)
    if words:
        return SMB, f"the simulated robot is the {ROBOT_TITLES[SMB]}: {words}"
    mention = _named(planned, SCANS)
    version = "husky_melodic" if mention and not mention[1]["husky"] else DEFAULT
    words = f"{mention[0].name} names {mention[1].group()}" if mention else "it names no topic of scans"
    return version, f"the simulated robot is the {ROBOT_TITLES[version]}: {words}"


def named_bag(planned: Plan) -> Tuple[str, str]:
    """Robot of whose bag a filter is, by the parameters that it loads; and a sentence that says why."""
    mention = _named(planned, FILTERS_OF_THE_SMB)
    if mention:
        return SMB, f"the bag is the SMB's: {mention[0].name} names {mention[1].group()}"
    return DEFAULT, "the bag is the Husky's: it names no package of the SMB"


def _names_of_the_smb(planned: Plan) -> str:
    """Parts of the SMB that a submission includes or names, in words; empty: none."""
    if any(node.startswith(("smb_gazebo/", "smb_control/")) for node in planned.left_out):
        return "its launch file starts the SMB's nodes"
    mention = _named(planned, SMB_NAMES)
    return f"{mention[0].name} names {mention[1].group()}" if mention else ""


def _named(planned: Plan, pattern: Pattern[str]) -> Optional[Tuple[Path, Match[str]]]:
    """The first file of a submission's package in which a pattern is found, and what fits it."""
    folder = planned.package_path
    with suppress(UnreadableFileError):  # too many files
        for path in walk(folder) if folder else ():
            if path.suffix in TEXTS:
                with suppress(UnreadableFileError):  # a long one
                    match = pattern.search(read_text(path, MAX_TEXT))
                    if match:
                        return path, match
    return None
