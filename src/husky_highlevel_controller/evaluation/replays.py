"""Replays of evaluated drives: a page that plays each, and their index.

In: a `Trace`, the words for it. Out: HTML files.
"""

from __future__ import annotations

import re
from html import escape
from pathlib import Path
from typing import Tuple
from urllib.parse import quote

from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.evaluation.rollout import Trace
from husky_highlevel_controller.replay import Replay, to_html
from husky_highlevel_controller.robot import Robot

INDEX = "index.html"
HEAD = '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>Evaluation</title></head>'


def replay_page(name: str, words: str, control: ControlConfig, trace: Trace, robot: Robot) -> Tuple[str, str]:
    """File name and text of the page that plays a drive; the name tells scenario, gains and stop distance."""
    gains = f"gains {control.p_gain_vel:g} {control.p_gain_ang:g}"
    title = f"{name}, {gains}, stop {control.stop_distance:g} m"
    page = to_html(Replay(title, words, trace.times, trace.poses, trace.pillars, robot=robot))
    return f"{re.sub(r'[^a-z0-9.]+', '_', title.lower())}.html", page


def write_index(folder: Path, table: str) -> None:
    """Write the page with the table and a link to every replay of a folder."""
    names = sorted(path.stem for path in folder.glob("*.html") if path.name != INDEX)
    links = (f'<li><a href="{quote(name)}.html">{escape(name.replace("_", " "))}</a></li>' for name in names)
    (folder / INDEX).write_text(
        f"{HEAD}<body><pre>{escape(table)}</pre><ul>{''.join(links)}</ul></body></html>"
    )
