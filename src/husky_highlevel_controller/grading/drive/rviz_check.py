"""Check of a submission's RViz on a virtual screen: its subscriptions, and the displays that are to be seen.

RViz runs four times side by side, with the submission's own view and fixed frame: as it is, and once each
with nothing but TF, robot model, laser scan. What then differs from the background is that display.
"""

from __future__ import annotations

import contextlib
import copy
import re
import shlex
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Sequence, Set, Tuple

import numpy as np
import yaml

from husky_highlevel_controller.grading.drive.plan import Plan, Submission
from husky_highlevel_controller.grading.drive.ros_graph import subscriptions
from husky_highlevel_controller.grading.drive.run import simulate
from husky_highlevel_controller.grading.drive.trials import draw_trials, rviz_world
from husky_highlevel_controller.grading.isolation.files import (
    UnreadableFileError,
    is_below,
    is_regular,
    read_text,
    walk,
)
from husky_highlevel_controller.grading.isolation.process import Process, wait
from husky_highlevel_controller.grading.isolation.ros_network import MarkingError, Network
from husky_highlevel_controller.grading.records import MarkingConfig, RvizView

STARTS = 3  # of a window that crashes
TILE = (800, 600)  # [pixels], one window
SCREEN_DEADLINE, SHOW_DEADLINE = 600.0, 60.0  # [s] of wall time
CLASSES = {"tf": "rviz/TF", "robot": "rviz/RobotModel", "scan": "rviz/LaserScan"}
ENOUGH = {"tf": 15, "robot": 60, "scan": 6}  # [pixels]; a distant point of the scan is one or two
DIFFERENT = 30  # of 255, in a colour, from the background
SIGNALS = 128  # of an exit code: above it stands the signal that ended a program
_NODE = re.compile(r"<node\b[^>]{0,500}?\spkg\s*=\s*[\"']([\w-]+)")
BLACK = 8  # of 255: a screen without windows
DRAWN = 0.05  # of the view must be background, or it is not there yet
MARGINS = (0.12, 0.94, 0.03, 0.97)  # of the window: without menu, tools and status line


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
    RViz, those of launch files without recordings and nodes of the package belong to it.

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
        files = [path for path in files if path.name not in elsewhere]
    if not files:
        return None
    best = max(files, key=lambda path: len(set(CLASSES.values()) & _enabled_classes(_read(path))))
    return RvizSetup(best.name, _read(best), remaps)


def _named_by_others(folder: Path, launch_file: str, but_viewers: bool) -> Set[str]:
    """Names of .rviz files in launch files of a package other than one of this name, and than viewers."""
    named: Set[str] = set()
    for path in walk(folder):
        if path.suffix == ".launch" and path.name != launch_file:
            with contextlib.suppress(UnreadableFileError):
                text = read_text(path)
                if not but_viewers or {"rosbag", folder.name} & set(_NODE.findall(text)):
                    named |= set(re.findall(r"([\w.-]+\.rviz)\b", text))
    return named


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
        content = yaml.safe_load(read_text(path))
    except (UnreadableFileError, ValueError, RecursionError, yaml.YAMLError):
        return {}
    return content if isinstance(content, dict) else {}


def _manager(config: Dict[str, Any]) -> Dict[str, Any]:
    manager = config.get("Visualization Manager")
    return manager if isinstance(manager, dict) else {}


def _displays(config: Dict[str, Any]) -> List[Any]:
    return _entries(_manager(config).get("Displays"))


def _entries(displays: Any) -> List[Any]:
    """A list of displays, whatever is in its place."""
    return displays if isinstance(displays, list) else []


def _options(config: Dict[str, Any]) -> Dict[str, Any]:
    options = _manager(config).get("Global Options")
    return options if isinstance(options, dict) else {}


def _enabled_classes(config: Dict[str, Any]) -> Set[str]:
    def of(displays: Sequence[Any]) -> Set[str]:
        found: Set[str] = set()
        for display in displays:
            if isinstance(display, dict) and display.get("Enabled", True):
                found.add(str(display.get("Class")))
                found |= of(_entries(display.get("Displays")))
        return found

    return of(_displays(config))


def only(config: Dict[str, Any], kind: str) -> Dict[str, Any]:
    """The configuration with nothing but the displays of one class; groups stay, with these in them."""

    def kept(displays: Sequence[Any]) -> List[Any]:
        chosen = []
        for display in displays:
            if not isinstance(display, dict):
                continue
            if display.get("Class") == "rviz/Group":
                chosen.append({**display, "Displays": kept(_entries(display.get("Displays")))})
            elif display.get("Class") == kind:
                chosen.append(display)
        return chosen

    return {**config, "Visualization Manager": {**_manager(config), "Displays": kept(_displays(config))}}


def _by_tcp(displays: Sequence[Any]) -> List[Any]:
    """The displays without `Unreliable`: it asks for UDP, which publishers in rospy do not speak."""
    known = [display for display in displays if isinstance(display, dict)]
    return [
        {**display, "Displays": _by_tcp(_entries(display["Displays"]))}
        if "Displays" in display
        else {**display, "Unreliable": False}
        for display in known
    ]


def placed(config: Dict[str, Any], column: int, row: int) -> Dict[str, Any]:
    """The configuration in a tile of the screen, by TCP, without panels, its camera on the robot, at 5 Hz."""
    config = copy.deepcopy(config)
    config["Panels"] = []
    config["Window Geometry"] = {
        "X": column * TILE[0], "Y": row * TILE[1], "Width": TILE[0], "Height": TILE[1],
        "Hide Left Dock": True, "Hide Right Dock": True,
    }  # fmt: skip
    config["Visualization Manager"] = {
        **_manager(config),
        "Displays": _by_tcp(_displays(config)),
        "Global Options": {**_options(config), "Frame Rate": 5},
        "Views": VIEWS,
    }
    return config


# ---------------------------------------------------------------------------- the screen


class Screen:
    """A virtual screen whose pixels can be looked at."""

    def __init__(self, network: Network) -> None:
        self._memory = network.folder / "Xvfb_screen0"
        size = f"{2 * TILE[0]}x{2 * TILE[1]}x24"
        command = ["Xvfb", "-displayfd", "1", "-noreset", "-screen", "0", size, "-fbdir", str(network.folder)]
        xvfb = network.start("xvfb", command)

        def number() -> Optional[str]:
            # complaints about displays that others have may come before it
            found = re.search(r"^(\d+)$", xvfb.output, re.MULTILINE)
            return found.group(1) if found else None

        if not wait(lambda: number() is not None or not xvfb.running, SCREEN_DEADLINE) or not xvfb.running:
            raise MarkingError(f"Xvfb does not start: {xvfb.output.strip()[-300:]}")
        self.display = f":{number()}"

    def tile(self, column: int, row: int) -> np.ndarray:
        """(height, width, 3) of red, green, blue, 0 to 255."""
        data = np.memmap(self._memory, np.uint8, "r")  # in X's own format, XWD: a header of big-endian words
        header = data[:100].view(">u4").tolist()
        offset, (width, height), line = header[0] + 12 * header[19], header[4:6], header[12]
        rows = data[offset : offset + line * height].reshape(height, line)
        pixels = rows[:, : 4 * width].reshape(height, width, 4)[:, :, 2::-1]
        left, top = column * TILE[0], row * TILE[1]
        return pixels[top : top + TILE[1], left : left + TILE[0]].astype(np.int16)


def without_margins(pixels: np.ndarray) -> np.ndarray:
    """RViz's window without menu, tools and status line."""
    top, bottom, left, right = MARGINS
    height, width = pixels.shape[:2]
    return pixels[int(top * height) : int(bottom * height), int(left * width) : int(right * width)]


def foreground(pixels: np.ndarray, background: Sequence[int]) -> int:
    """Number of pixels of the view that are not background; 0 while RViz has not drawn it."""
    view = without_margins(pixels)
    channels = np.moveaxis(np.abs(view - np.clip(background, 0, 255).astype(view.dtype)), 2, 0)
    away = np.maximum.reduce(list(channels))  # several times as fast as max(axis=2)
    drawn = (away <= 2).mean() >= DRAWN
    return int((away > DIFFERENT).sum()) if drawn else 0


def is_black(pixels: np.ndarray) -> bool:
    """Whether nothing has been drawn: no window came up."""
    return bool(pixels.max() <= BLACK)


def background(config: Dict[str, Any]) -> List[int]:
    """The background colour of a configuration."""
    words = str(_options(config).get("Background Color", "48; 48; 48"))
    try:
        red, green, blue = (int(word) for word in words.split(";"))
    except ValueError:
        return [48, 48, 48]
    return [red, green, blue]


# ---------------------------------------------------------------------------- the look


def look(
    submission: Submission, planned: Plan, config: MarkingConfig, folder: Path
) -> Tuple[RvizView, Optional[np.ndarray]]:
    """Run the submission's RViz beside a robot that stands, and look at it; and its picture."""
    launchable = submission.launchable
    setup = find_setup(planned, submission.root, launchable.name if launchable.kind == "launch" else "")
    if setup is None:
        return RvizView(started=bool(planned.rviz)), None
    absent = [program for program in ("rviz", "Xvfb") if shutil.which(program) is None]
    if absent:
        return RvizView(setup.source, problem=f"{' and '.join(absent)} not installed", judged=False), None
    if not _manager(setup.config):
        return RvizView(setup.source, problem="the file is not RViz's"), None
    view, pixels = _look_at(setup, submission, config, folder)
    return view, None if is_black(pixels) else without_margins(pixels)


def _look_at(
    setup: RvizSetup, submission: Submission, config: MarkingConfig, folder: Path
) -> Tuple[RvizView, np.ndarray]:
    """View and picture of RViz. A window that crashes is started again."""
    fixed_frame = str(_options(setup.config).get("Fixed Frame", "map"))
    with Network(folder) as network:
        screen = Screen(network)
        simulate(network, rviz_world(), draw_trials(1, 0)[0], config, 1.0)
        empty = background(setup.config)
        windows = {"all": (placed(setup.config, 0, 0), (0, 0))}
        tiles = {"tf": (1, 0), "robot": (0, 1), "scan": (1, 1)}
        kinds = [name for name in CLASSES if CLASSES[name] in _enabled_classes(setup.config)]
        for name in kinds:
            windows[name] = (placed(only(setup.config, CLASSES[name]), *tiles[name]), tiles[name])
        starts = dict.fromkeys(windows, 0)

        def start(name: str) -> Process:
            starts[name] += 1
            return _start(network, submission, setup, screen, f"{name}_{starts[name]}", windows[name][0])

        running = {name: start(name) for name in windows}
        ended: Dict[str, Tuple[int, str]] = {}  # for good: exit code, last words
        looks = dict.fromkeys(CLASSES, 0)  # in a row in which a display was seen

        def done() -> bool:
            for name, window in running.items():
                code = window.popen.poll()
                if _is_crash(code) and starts[name] < STARTS:
                    running[name] = start(name)
                elif code is not None:
                    ended[name] = code, window.output.strip()[-200:]
            for name in kinds:
                shown = foreground(screen.tile(*windows[name][1]), empty) >= ENOUGH[name]
                looks[name] = looks[name] + 1 if shown else 0
            return bool(ended) or (all(looks[name] >= 2 for name in kinds) and whole_is_up())

        def whole_is_up() -> bool:
            if is_black(screen.tile(0, 0)):
                return False
            return config.scan_topic in topics() if "scan" in windows else bool(topics())

        def topics() -> Tuple[str, ...]:
            return subscriptions(network.uri, f"/marking_rviz_all_{starts['all']}")

        wait(done, SHOW_DEADLINE, 0.3)
        subscribed_to, pixels = topics(), screen.tile(0, 0)
    tf, robot, scan = (looks[name] >= 2 for name in CLASSES)
    view = RvizView(setup.source, subscribed_to, tf, robot, scan, fixed_frame=fixed_frame)
    return judged_by_ends(view, ended), pixels


def judged_by_ends(view: RvizView, ended: Mapping[str, Tuple[int, str]]) -> RvizView:
    """The view, when some of RViz's windows ended by themselves.

    Args:
        view: what was seen.
        ended: exit code and last words of each of these windows. A crash may be this machine's fault, so a
            person has to look; any other end of the window with everything shows nothing.
    """
    for name, (code, words) in ended.items():
        crashed = _is_crash(code)
        if crashed or name == "all":
            return replace(view, problem=f"RViz ends (exit code {code}): {words}", judged=not crashed)
    return view


def _is_crash(code: Optional[int]) -> bool:
    return code is not None and (code < 0 or code > SIGNALS)


def _start(
    network: Network,
    submission: Submission,
    setup: RvizSetup,
    screen: Screen,
    name: str,
    config: Dict[str, Any],
) -> Process:
    path = network.folder_of(f"rviz_{name}") / "view.rviz"
    path.write_text(yaml.safe_dump(config))
    return network.start(
        f"rviz_{name}",
        ["rviz", "-s", "", "-d", str(path), f"__name:=marking_rviz_{name}", *setup.remaps],
        submission.workspace,
        DISPLAY=screen.display,
        LIBGL_ALWAYS_SOFTWARE="1",
        # Mesa's llvmpipe (22.3 with LLVM 15, Debian 12) crashes RViz 1.14: 14 of 164 starts, four at a time
        # beside three busy loops; softpipe none of 92, and it is no slower
        GALLIUM_DRIVER="softpipe",
        QT_X11_NO_MITSHM="1",
        XDG_RUNTIME_DIR=str(path.parent),
    )
