"""Layers of the view and the legend: each drawn part has a row with its colour."""

from __future__ import annotations

from functools import partial
from typing import Any, Callable, NamedTuple, Optional, Tuple

import viser

from husky_highlevel_controller.ros.controller.display import COLORS, ESTIMATE, IN_LASER, IN_ODOM, TARGET

Rgb = Tuple[int, int, int]
SCAN_COLOR, RAY_COLOR, CLOUD_COLOR = (235, 30, 250), (205, 130, 215), (60, 170, 160)
TRAIL_COLOR, PLAN_COLOR = (20, 120, 255), (255, 120, 0)


class Layer(NamedTuple):
    """Part of the view that can be hidden."""

    name: str
    title: str
    color: Optional[Rgb]  # colour of the layer; None if it has several colours
    is_shown: bool  # true if the layer is shown when the page opens


LAYERS = (
    Layer("scan", "scan", SCAN_COLOR, True),
    Layer("rays", "beams that return", RAY_COLOR, True),
    Layer("plan", "plan: way to go", PLAN_COLOR, True),
    Layer("trail", "trail: way driven", TRAIL_COLOR, True),
    Layer("markers", "markers", None, True),
    Layer("frames", "TF frames", None, False),
    Layer("depth", "depth points", CLOUD_COLOR, False),
)
MARKERS = {
    IN_ODOM: "pillar in odom",
    IN_LASER: "pillar in the lidar's frame",
    ESTIMATE: "pillar, remembered",
    TARGET: "stop point of the lidar",
}


def add_layers(gui: viser.GuiApi, on_change: Callable[[str, bool], None]) -> viser.GuiInputHandle[bool]:
    """Add a box for each layer, with the dot of its colour, and return the box of the depth points.

    The caller hides this box while no topic has depth points.
    """
    boxes = {}  # box of each layer; the key is the layer's name
    for layer in LAYERS:
        if layer.color is not None:
            gui.add_html(_dot_of_next(layer.name, layer.color))
        box = gui.add_checkbox(layer.title, layer.is_shown, hint="for every page")
        box.on_update(partial(_pass_on, on_change, layer.name))
        boxes[layer.name] = box
        if layer.name == "markers":  # this layer has several colours, so each kind of marker gets a row
            gui.add_html(_rows_of_markers())
    return boxes["depth"]


def _rows_of_markers() -> str:
    """Return HTML with a row for each kind of marker of the controller: a dot in its colour, its title."""
    rows = []
    for namespace, title in MARKERS.items():
        color = tuple(round(255.0 * getattr(COLORS[namespace], part)) for part in "rgb")
        rows.append(f'<div><i class="husky-dot" style="background: rgb{color}"></i>{title}</div>')
    return f'<div class="husky-block husky-legend">{"".join(rows)}</div>'


def _pass_on(on_change: Callable[[str, bool], None], name: str, event: Any) -> None:
    """Call `on_change` with the name of a layer, and whether its box is checked now."""
    on_change(name, event.target.value)


def _dot_of_next(name: str, color: Rgb) -> str:
    """Return an invisible element with which viser.css draws a dot before the label of the next box."""
    rule = f"div:has(> .husky-layer-{name}) + * {{ --husky-dot: rgb{color}; }}"
    return f'<i class="husky-layer husky-layer-{name}" hidden></i><style>{rule}</style>'
