"""Check of a submission's RViz on a virtual screen: its subscriptions, and the displays that are to be seen.

RViz runs once, with the submission's own fixed frame, and loads four configurations one after the other: with
nothing but TF, robot model, laser scan, then as it is. What differs from the background is that display.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any, Dict, Optional, Sequence, Tuple

import numpy as np
import yaml

from husky_highlevel_controller.grading.drive.plan import Plan, Submission
from husky_highlevel_controller.grading.drive.ros_graph import subscriptions
from husky_highlevel_controller.grading.drive.run import simulate
from husky_highlevel_controller.grading.drive.rviz_setup import (
    CLASSES,
    SIZE,
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
from husky_highlevel_controller.grading.isolation.forked import RVIZ_LOADER
from husky_highlevel_controller.grading.isolation.process import Process, wait
from husky_highlevel_controller.grading.isolation.ros_network import MarkingError, Network
from husky_highlevel_controller.grading.records import MarkingConfig, RvizView

STARTS = 3  # of an RViz that crashes
SCREEN_DEADLINE = 600.0  # [s] of wall time
START_DEADLINE, LOAD_DEADLINE = 60.0, 30.0  # [s] of wall time: RViz draws its first, another configuration
LOOK_PERIOD = 0.3  # [s] of wall time
WHOLE = "all"  # name of the configuration as it is
ENOUGH = {"tf": 15, "robot": 60, "scan": 6, WHOLE: 1}  # [pixels]; a distant point of the scan is one or two
# of the view, so that it is known which configuration is drawn
BACKGROUNDS = {"tf": (60, 20, 90), "robot": (20, 60, 90), "scan": (90, 20, 60)}
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
        size = f"{SIZE[0]}x{SIZE[1]}x24"
        command = ["Xvfb", "-displayfd", "1", "-noreset", "-screen", "0", size, "-fbdir", str(network.folder)]
        xvfb = network.start("xvfb", command)

        def number() -> Optional[str]:
            # complaints about displays that others have may come before it
            match = re.search(r"^(\d+)$", xvfb.output, re.MULTILINE)
            return match.group(1) if match else None

        if not wait(lambda: number() is not None or not xvfb.running, SCREEN_DEADLINE) or not xvfb.running:
            raise MarkingError(f"Xvfb does not start: {xvfb.output.strip()[-300:]}")
        self.display = f":{number()}"

    def pixels(self) -> np.ndarray:
        """(height, width, 3) of red, green, blue, 0 to 255."""
        data = np.memmap(self._memory, np.uint8, "r")  # in X's own format, XWD: a header of big-endian words
        header = data[:100].view(">u4").tolist()
        offset, (width, height), line = header[0] + 12 * header[19], header[4:6], header[12]
        rows = data[offset : offset + line * height].reshape(height, line)
        return rows[:, : 4 * width].reshape(height, width, 4)[:, :, 2::-1].astype(np.int16)


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


class Window:
    """RViz of a submission, which loads one of several configurations at a time."""

    def __init__(
        self,
        network: Network,
        submission: Submission,
        setup: RvizSetup,
        screen: Screen,
        configs: Dict[str, Dict[str, Any]],
    ) -> None:
        self._network, self._submission, self._remaps = network, submission, setup.remaps
        self._screen, self._configs = screen, configs
        self._starts = 0
        self._process: Optional[Process] = None
        self.refusal = ""  # of a request to load a configuration, in words: a person has to look

    @property
    def _name(self) -> str:
        return f"rviz_{self._starts}"

    @property
    def _node(self) -> str:
        return f"/marking_{self._name}"

    @property
    def subscriptions(self) -> Tuple[str, ...]:
        """Topics to which it subscribes."""
        return subscriptions(self._network.uri, self._node)

    def shows(self, name: str, background: Sequence[int]) -> bool:
        """Load a configuration; whether enough that is not background is seen in two looks in a row."""
        if self._process is None:
            return self._begins_with(name, background)
        path = self._network.folder_of(self._name) / f"{name}.rviz"
        loader = self._network.start(f"load_{name}", [RVIZ_LOADER, self._node, str(path)])
        if self._draws(name, background, LOAD_DEADLINE):
            return True
        if _is_crash(self._code):
            return self._begins_with(name, background)
        if self._code is None and loader.popen.poll():
            self.refusal = f"RViz loads no other configuration: {loader.output.strip()[-200:]}"
        return False

    def _begins_with(self, name: str, background: Sequence[int]) -> bool:
        """Start RViz with a configuration, again after a crash; whether it draws it."""
        while self._starts < STARTS:
            self._start(name)
            if self._draws(name, background, START_DEADLINE):
                return True
            if not _is_crash(self._code):
                break
        return False

    def _draws(self, name: str, background: Sequence[int], deadline: float) -> bool:
        looks = 0

        def decided() -> bool:
            nonlocal looks
            looks = looks + 1 if foreground(self._screen.pixels(), background) >= ENOUGH[name] else 0
            return looks >= 2 or self._code is not None

        wait(decided, deadline, LOOK_PERIOD)
        return looks >= 2

    @property
    def end(self) -> Optional[Tuple[int, str]]:
        """Exit code and last words; None: it runs."""
        code = self._code
        return None if code is None or self._process is None else (code, self._process.output.strip()[-200:])

    @property
    def _code(self) -> Optional[int]:
        return None if self._process is None else self._process.popen.poll()

    def _start(self, name: str) -> None:
        self._starts += 1
        folder = self._network.folder_of(self._name)
        for other, config in self._configs.items():  # all of them before RViz may write there
            (folder / f"{other}.rviz").write_text(yaml.safe_dump(config))
        command = ["rviz", "-s", "", "-d", str(folder / f"{name}.rviz"), f"__name:={self._node[1:]}"]
        self._process = self._network.start(
            self._name,
            [*command, *self._remaps],
            self._submission.workspace,
            DISPLAY=self._screen.display,
            LIBGL_ALWAYS_SOFTWARE="1",
            # Mesa's llvmpipe (22.3 with LLVM 15, Debian 12) crashes RViz 1.14: 14 of 164 starts, four at once
            # beside three busy loops; softpipe none of 92, and it is no slower
            GALLIUM_DRIVER="softpipe",
            QT_X11_NO_MITSHM="1",
            XDG_RUNTIME_DIR=str(folder),
        )


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
    """View and picture of RViz. One that crashes is started again."""
    enabled = enabled_classes(setup.config)
    configs = {
        name: placed(only(setup.config, kind), BACKGROUNDS[name])
        for name, kind in CLASSES.items()
        if kind in enabled
    }
    configs[WHOLE] = placed(setup.config)
    backgrounds = {**BACKGROUNDS, WHOLE: background(setup.config)}
    with Network(folder) as network:
        screen = Screen(network)
        simulate(network, rviz_world(), draw_trials(1, 0)[0], config, 1.0)
        window = Window(network, submission, setup, screen, configs)
        shown = {}
        for name in configs:
            if window.end is None and not window.refusal:
                shown[name] = window.shows(name, backgrounds[name])
        subscribed_to, pixels, end = window.subscriptions, screen.pixels(), window.end
    tf, robot, scan = (shown.get(name, False) for name in CLASSES)
    view = RvizView(setup.source, subscribed_to, tf, robot, scan, fixed_frame=fixed_frame(setup.config))
    if window.refusal:
        view = replace(view, problem=window.refusal, judged=False)
    return judged_by_end(view, end), pixels


def judged_by_end(view: RvizView, end: Optional[Tuple[int, str]]) -> RvizView:
    """The view, when RViz ended by itself; a crash may be this machine's fault, so a person has to look.

    Args:
        view: what was seen.
        end: exit code and last words; None: it ran on.
    """
    if end is None:
        return view
    code, words = end
    return replace(view, problem=f"RViz ends (exit code {code}): {words}", judged=not _is_crash(code))


def _is_crash(code: Optional[int]) -> bool:
    return code is not None and (code < 0 or code > SIGNALS)
