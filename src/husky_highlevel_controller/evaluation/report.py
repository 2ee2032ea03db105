"""Pages of results of many drives, with pictures; replays of single drives."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Mapping, Optional, Tuple

from husky_highlevel_controller.config import to_json
from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.evaluation.rollout import Trace
from husky_highlevel_controller.replay import Replay, to_html
from husky_highlevel_controller.result import Result
from husky_highlevel_controller.robot import Robot
from husky_highlevel_controller.templates import render


def write_page(result: Result, folder: Path, pictures: Optional[Mapping[str, bytes]] = None) -> Path:
    """Write index.html, with PNGs by their captions, and report.json into a folder; return the page."""
    (folder / "report.json").write_text(to_json(result), encoding="utf-8")
    page = folder / "index.html"
    page.write_text(render("report.html", report=result, pictures=pictures or {}), encoding="utf-8")
    return page


def replay_page(
    name: str, summary: str, control: ControlConfig, trace: Trace, robot: Robot
) -> Tuple[str, str]:
    """File name and text of the page that plays a drive; the name tells scenario, gains and stop distance."""
    gains = f"gains {control.p_gain_vel:g} {control.p_gain_ang:g}"
    title = f"{name}, {gains}, stop {control.stop_distance:g} m"
    page = to_html(Replay(title, summary, trace.times, trace.poses, trace.pillars, robot=robot))
    return f"{re.sub(r'[^a-z0-9.]+', '_', title.lower())}.html", page
