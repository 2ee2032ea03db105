"""Check of a submission's RViz on a virtual screen: its subscriptions, and the displays that are to be seen.

RViz runs four times side by side, with the submission's own view and fixed frame: as it is, and once each
with nothing but TF, robot model, laser scan. What then differs from the background is that display.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any, Dict, Mapping, Optional, Sequence, Tuple

import numpy as np
import yaml

from husky_highlevel_controller.grading.drive.plan import Plan, Submission
from husky_highlevel_controller.grading.drive.ros_graph import subscriptions
from husky_highlevel_controller.grading.drive.run import simulate
from husky_highlevel_controller.grading.drive.rviz_setup import (
    CLASSES,
    TILE,
    RvizSetup,
    background,
    enabled_classes,
    find_setup,
    fixed_frame,
    manager_of,
    only,
    placed,
)
from husky_highlevel_controller.grading.drive.trials import draw_trials, rviz_world
from husky_highlevel_controller.grading.isolation.process import Process, wait
from husky_highlevel_controller.grading.isolation.ros_network import MarkingError, Network
from husky_highlevel_controller.grading.records import MarkingConfig, RvizView

STARTS = 3  # of a window that crashes
SCREEN_DEADLINE, SHOW_DEADLINE = 600.0, 60.0  # [s] of wall time
ENOUGH = {"tf": 15, "robot": 60, "scan": 6}  # [pixels]; a distant point of the scan is one or two
DIFFERENT = 30  # of 255, in a colour, from the background
SIGNALS = 128  # of an exit code: above it stands the signal that ended a program
BLACK = 8  # of 255: a screen without windows
DRAWN = 0.05  # of the view must be background, or it is not there yet
MARGINS = (0.12, 0.94, 0.03, 0.97)  # of the window: without menu, tools and status line


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
            match = re.search(r"^(\d+)$", xvfb.output, re.MULTILINE)
            return match.group(1) if match else None

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
    is_drawn = (away <= 2).mean() >= DRAWN
    return int((away > DIFFERENT).sum()) if is_drawn else 0


def is_black(pixels: np.ndarray) -> bool:
    """Whether nothing has been drawn: no window came up."""
    return bool(pixels.max() <= BLACK)


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
    if not manager_of(setup.config):
        return RvizView(setup.source, problem="the file is not RViz's"), None
    view, pixels = _look_at(setup, submission, config, folder)
    return view, None if is_black(pixels) else without_margins(pixels)


def _look_at(
    setup: RvizSetup, submission: Submission, config: MarkingConfig, folder: Path
) -> Tuple[RvizView, np.ndarray]:
    """View and picture of RViz. A window that crashes is started again."""
    with Network(folder) as network:
        screen = Screen(network)
        simulate(network, rviz_world(), draw_trials(1, 0)[0], config, 1.0)
        empty = background(setup.config)
        windows = {"all": (placed(setup.config, 0, 0), (0, 0))}
        tiles = {"tf": (1, 0), "robot": (0, 1), "scan": (1, 1)}
        kinds = [name for name in CLASSES if CLASSES[name] in enabled_classes(setup.config)]
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
                is_shown = foreground(screen.tile(*windows[name][1]), empty) >= ENOUGH[name]
                looks[name] = looks[name] + 1 if is_shown else 0
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
    view = RvizView(setup.source, subscribed_to, tf, robot, scan, fixed_frame=fixed_frame(setup.config))
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
