"""Robot that a submission is written for: by the topics it subscribes to, and by what it names."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from typing import Match, Optional, Pattern, Tuple

from husky_highlevel_controller.grading.drive.plan import Plan, Submission, start
from husky_highlevel_controller.grading.drive.progress import settles
from husky_highlevel_controller.grading.drive.ros_graph import (
    is_up,
    scan_topics,
    set_parameters,
    topics_subscribed,
)
from husky_highlevel_controller.grading.isolation.files import UnreadableFileError, read_text, walk
from husky_highlevel_controller.grading.isolation.ros_network import Network
from husky_highlevel_controller.grading.records import ROBOT_VERSIONS

DEFAULT = "husky"
TITLES = {"husky": "Husky", "husky_melodic": "Husky of ROS Melodic"}
MAX_TEXT = 200_000  # [bytes] of a file that is read
# in a package: it includes the SMB's launch file, looks its frame up, or listens to its sensors
SMB = re.compile(r"\bsmb_gazebo\b|\brslidar\b|/?\brslidar_points\b|/imu0\b")
# where no node can be asked: its topic of scans
SCANS = re.compile(r"(?P<husky>\bfront/scan\b)|(?<![\w/])/scan\b")
TEXTS = {"", ".launch", ".xml", ".py", ".cpp", ".cc", ".hpp", ".h", ".yaml", ".yml", ".rviz"}


def names_the_husky_s_scans(planned: Plan) -> bool:
    """Whether its package names the Husky's topic of scans, and nothing of the SMB."""
    mention = _named(planned, SCANS)
    return bool(mention and mention[1]["husky"]) and not _names_of_the_smb(planned)


def detect_robot(submission: Submission, planned: Plan, folder: Path) -> Tuple[str, str, str]:
    """The robot, the topic of the scans if it is another than the robot's, and a sentence that says why.

    Args:
        submission: what to start.
        planned: what it would start.
        folder: for logs.

    Raises:
        MarkingError: no ROS master can be started.
    """
    words = _names_of_the_smb(planned)
    if words:
        return "smb", "", f"the simulated robot is the SMB: {words}"
    if submission.problem or not planned.nodes:
        mention = _named(planned, SCANS)
        version = "husky_melodic" if mention and not mention[1]["husky"] else DEFAULT
        words = f"{mention[0].name} names {mention[1].group()}" if mention else "it names no topic of scans"
        return version, "", f"the simulated robot is the {TITLES[version]}: {words}"
    topics = {version: topic for version, (topic, _) in ROBOT_VERSIONS.items() if version != "smb"}
    with Network(folder) as network:
        set_parameters(network.uri, {"/run_id": "marking"})  # roslaunch waits for it
        process, _ = start(network, submission)

        def subscribed() -> str:
            subscriptions = topics_subscribed(network.uri)
            return next((version for version, topic in topics.items() if topic in subscriptions), "")

        settles(process, lambda: bool(subscribed()), lambda: is_up(network.uri, ()))
        version, scans = subscribed(), scan_topics(network.uri)
    if version:
        return version, "", subscribes_to(version)
    if len(scans) == 1:
        why = f"scans are sent on {scans[0]}, the only topic of scans that it subscribes to"
        return DEFAULT, scans[0], why
    why = f"it subscribes neither to {' nor to '.join(topics.values())}"
    return DEFAULT, "", f"the simulated robot is the {TITLES[DEFAULT]}: {why}"


def subscribes_to(version: str) -> str:
    """A sentence that says why the robot is this version of the Husky."""
    return f"the simulated robot is the {TITLES[version]}: it subscribes to {ROBOT_VERSIONS[version][0]}"


def _names_of_the_smb(planned: Plan) -> str:
    """Parts of the SMB that a submission includes or names, in words; empty: none."""
    if any(node.startswith(("smb_gazebo/", "smb_control/")) for node in planned.left_out):
        return "its launch file starts the SMB's nodes"
    mention = _named(planned, SMB)
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
