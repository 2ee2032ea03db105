"""Configuration of a submission's RViz: which one it is, and what of it marking shows."""

from __future__ import annotations

import contextlib
import copy
import re
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Set, Tuple

from husky_highlevel_controller.grading.drive.plan import Plan
from husky_highlevel_controller.grading.isolation.files import (
    UnreadableFileError,
    is_below,
    is_regular,
    read_text,
    read_yaml,
    walk,
)

SIZE = (800, 600)  # [pixels], of the window
CLASSES = {"tf": "rviz/TF", "robot": "rviz/RobotModel", "scan": "rviz/LaserScan"}
_NODE = re.compile(r"<node\b[^>]{0,500}?\spkg\s*=\s*[\"']([\w-]+)")

# the saved camera is wherever its owner looked last; what counts is which displays are on
VIEWS = {
    "Current": {
        "Class": "rviz/Orbit", "Name": "Current View", "Target Frame": "base_link",
        "Distance": 6.0, "Pitch": 0.7, "Yaw": 3.8, "Focal Point": {"X": 0.3, "Y": 0.0, "Z": 0.3},
    },
    "Saved": [],
}  # fmt: skip


@dataclass(frozen=True)
class RvizSetup:
    """Configuration with which a submission would start RViz."""

    source: str  # in words
    config: Dict[str, Any]  # of RViz
    remaps: Tuple[str, ...] = ()


def find_setup(planned: Plan, root: Optional[Path] = None, launch_file: str = "") -> Optional[RvizSetup]:
    """The configuration of the first rviz node; else the package's .rviz file with most of the displays.

    A file that only another launch file than `launch_file` names is that one's; where `launch_file` starts no
    RViz, those of launch files without recordings and nodes of the package belong to it, and where it starts
    one without a configuration, the package's only file does, unless it shows recordings.

    None where no configuration was handed in: a node without one shows what is in the student's ~/.rviz.
    A hand-in's configuration lies below `root`, whatever its launch file names.
    """
    remaps: Tuple[str, ...] = ()
    for node in planned.rviz[:1]:
        remaps = tuple(f"{old}:={new}" for old, new in node.remap)
        path = _display_config(node.args)
        if path is not None and is_regular(path) and (root is None or is_below(path, root)):
            return RvizSetup(f"its rviz node, {path.name}", _read(path), remaps)
    folder = planned.package_path
    files = [path for path in walk(folder) if path.suffix == ".rviz"][:20] if folder else []
    if folder and launch_file:
        elsewhere = _named_by_others(folder, Path(launch_file).name, not planned.rviz)
        owner = elsewhere.get(files[0].name) if planned.rviz and len(files) == 1 else None
        if owner and "rosbag" not in _NODE.findall(read_text(owner)):
            source = f"{files[0].name}, the package's only one, of {owner.name}"
            return RvizSetup(source, _read(files[0]), remaps)
        files = [path for path in files if path.name not in elsewhere]
    if not files:
        return None
    best = max(files, key=lambda path: len(set(CLASSES.values()) & enabled_classes(_read(path))))
    return RvizSetup(best.name, _read(best), remaps)


def files_of_others(planned: Plan, launch_file: str) -> List[str]:
    """Sentences on .rviz files of a package that belong to other launch files than this one."""
    folder = planned.package_path
    named = _named_by_others(folder, launch_file, not planned.rviz) if folder else {}
    return [f"{name} belongs to {path.name}, and is not looked at" for name, path in named.items()]


def _named_by_others(folder: Path, launch_file: str, but_viewers: bool) -> Dict[str, Path]:
    """Launch file by name of the .rviz file in it, of those other than one of this name, and than viewers."""
    names: Dict[str, Path] = {}
    for path in walk(folder):
        if path.suffix == ".launch" and path.name != launch_file:
            with contextlib.suppress(UnreadableFileError):
                text = read_text(path)
                if not but_viewers or {"rosbag", folder.name} & set(_NODE.findall(text)):
                    names.update(dict.fromkeys(re.findall(r"([\w.-]{1,200}\.rviz)\b", text), path))
    return names


def _display_config(arguments: str) -> Optional[Path]:
    try:
        words = shlex.split(arguments)
    except ValueError:  # a quote that is not closed
        words = arguments.replace('"', " ").replace("'", " ").split()
    for flag, value in zip(words, words[1:]):
        if flag in ("-d", "--display-config"):
            return Path(value)
    return next((Path(word) for word in words if word.endswith(".rviz")), None)


def _read(path: Path) -> Dict[str, Any]:
    try:
        content = read_yaml(path)
    except UnreadableFileError:
        return {}
    return content if isinstance(content, dict) else {}


def manager_of(config: Dict[str, Any]) -> Dict[str, Any]:
    """The visualization manager of a configuration, with all displays; empty where the file is not RViz's."""
    manager = config.get("Visualization Manager")
    return manager if isinstance(manager, dict) else {}


def _displays(config: Dict[str, Any]) -> List[Any]:
    return _entries(manager_of(config).get("Displays"))


def _entries(displays: Any) -> List[Any]:
    """A list of displays, whatever is in its place."""
    return displays if isinstance(displays, list) else []


def _options(config: Dict[str, Any]) -> Dict[str, Any]:
    options = manager_of(config).get("Global Options")
    return options if isinstance(options, dict) else {}


def enabled_classes(config: Dict[str, Any]) -> Set[str]:
    """Classes of the displays that are switched on."""

    def of(displays: Sequence[Any]) -> Set[str]:
        classes: Set[str] = set()
        for display in displays:
            if isinstance(display, dict) and display.get("Enabled", True):
                classes.add(str(display.get("Class")))
                classes |= of(_entries(display.get("Displays")))
        return classes

    return of(_displays(config))


def only(config: Dict[str, Any], kind: str) -> Dict[str, Any]:
    """The configuration with nothing but the displays of one class; groups stay, with these in them."""

    def of_kind(displays: Sequence[Any]) -> List[Any]:
        selection = []
        for display in displays:
            if not isinstance(display, dict):
                continue
            if display.get("Class") == "rviz/Group":
                selection.append({**display, "Displays": of_kind(_entries(display.get("Displays")))})
            elif display.get("Class") == kind:
                selection.append(display)
        return selection

    return {**config, "Visualization Manager": {**manager_of(config), "Displays": of_kind(_displays(config))}}


def _by_tcp(displays: Sequence[Any]) -> List[Any]:
    """The displays without `Unreliable`: it asks for UDP, which publishers in rospy do not speak."""
    return [
        {**display, "Displays": _by_tcp(_entries(display["Displays"]))}
        if "Displays" in display
        else {**display, "Unreliable": False}
        for display in displays
        if isinstance(display, dict)
    ]


def placed(config: Dict[str, Any], background: Optional[Sequence[int]] = None) -> Dict[str, Any]:
    """The configuration on the whole screen, by TCP, without panels, its camera on the robot, at 5 Hz.

    With a background colour, that one (red, green, blue).
    """
    config = copy.deepcopy(config)
    config["Panels"] = []
    config["Window Geometry"] = {
        "X": 0, "Y": 0, "Width": SIZE[0], "Height": SIZE[1],
        "Hide Left Dock": True, "Hide Right Dock": True,
    }  # fmt: skip
    options = {**_options(config), "Frame Rate": 5}
    if background:
        options["Background Color"] = "; ".join(map(str, background))
    config["Visualization Manager"] = {
        **manager_of(config),
        "Displays": _by_tcp(_displays(config)),
        "Global Options": options,
        "Views": VIEWS,
    }
    return config


def background(config: Dict[str, Any]) -> List[int]:
    """The background colour of a configuration."""
    words = str(_options(config).get("Background Color", "48; 48; 48"))
    try:
        red, green, blue = (int(word) for word in words.split(";"))
    except ValueError:
        return [48, 48, 48]
    return [red, green, blue]


def fixed_frame(config: Dict[str, Any]) -> str:
    """The fixed frame of a configuration."""
    return str(_options(config).get("Fixed Frame", "map"))
