"""Settings of each page: its camera, its colours, its mouse and its view of the log."""

from __future__ import annotations

from math import dist
from typing import Any, Callable, Optional, Sequence, Tuple

import viser

from husky_highlevel_controller.datatypes import Vector3
from husky_highlevel_controller.ros.web.drawing import look
from husky_highlevel_controller.ros.web.log import LEVELS, Filter, LogBuffer, to_html

FOLLOW, PILLAR, ABOVE, FREE = CAMERAS = ("Follow", "Pillar", "Above", "Free")
LOOK, PUT, MOVE, DELETE = TOOLS = ("Look", "Put", "Move", "Delete")
# of the camera from what it looks at [m]
OFFSETS = {FOLLOW: (-3.6, 2.4, 2.4), PILLAR: (-3.0, -3.4, 2.0), ABOVE: (-0.01, 0.0, 14.0)}
JUMP = 1.0  # [m] from here on the robot was put elsewhere
BRAND = (30, 110, 190)


class Page:
    """Fields and settings of one browser."""

    def __init__(
        self,
        client: viser.ClientHandle,
        tabs: Tuple[Any, Any],
        log: LogBuffer,
        on_tool: Callable[[], None],
    ) -> None:
        """Add the page's own fields.

        Args:
            client: the browser.
            tabs: those of view and log.
            log: what the log tab shows.
            on_tool: called when the mouse gets another tool.
        """
        self.client, self.tool, self._log = client, LOOK, log
        self._camera, self._is_placed = FOLLOW, False
        self._at: Optional[Vector3] = None
        self._offset, self._is_settled = OFFSETS[FOLLOW], True
        self._filter, self._log_count = Filter(), -1
        self._on_tool = on_tool
        self._make_view(tabs[0])
        self._make_log(tabs[1])

    # ------------------------------------------------------------------ each tick

    def update(self, base: Optional[Vector3], pillar: Optional[Vector3]) -> None:
        """Move the camera with what it looks at [m, fixed frame], and show new lines of the log."""
        self._move_camera(pillar if self._camera == PILLAR else base)
        if self._log_count != self._log.count:
            self._log_count = self._log.count
            self._show_log()

    def _move_camera(self, target: Optional[Vector3]) -> None:
        camera = self.client.camera
        if target is None or self._camera == FREE or camera.update_timestamp == 0.0:
            return
        if not self._is_placed:
            self._offset, self._is_settled = OFFSETS[self._camera], False
        elif self._at is not None and dist(target, self._at) > 0.002:
            self._is_settled &= dist(target, self._at) < JUMP
            self._take_offset(target)
        else:
            return
        with self.client.atomic():
            if not self._is_placed:
                camera.up_direction = (0.0, 0.0, 1.0)
            look(camera, _sum(target, self._offset), target)
        self._is_placed, self._at = True, target

    def _take_offset(self, target: Vector3) -> None:
        """Look from where the page's mouse has turned the view to.

        The page's positions come late, the direction that it looks in does not; but while the camera jumps,
        the page tells of its new position with the old point that it looks at.
        """
        center = self.client.camera.look_at.tolist()
        offset = (self.client.camera.position - self.client.camera.look_at).tolist()
        if not self._is_settled:
            self._is_settled = dist(center, target) < JUMP and dist(offset, self._offset) < JUMP
        if self._is_settled:
            self._offset = (offset[0], offset[1], offset[2])

    # ------------------------------------------------------------------ fields

    def _make_view(self, tab: Any) -> None:
        with tab:
            gui = self.client.gui
            camera = gui.add_button_group("Camera", CAMERAS, order=-2)
            camera.on_click(self._on_camera)
            dark = gui.add_checkbox("Dark", False, hint="for this page only", order=-1)
            dark.on_update(lambda event: theme(gui, event.target.value))

    def make_tools(self, tab: Any) -> None:
        """Fields of the mouse's tools, the first of a tab."""
        with tab:
            tool = self.client.gui.add_button_group(
                "Mouse",
                TOOLS,
                hint="Put: click the ground. Move: drag an object or the robot. Delete: click",
                order=-1,
            )
            self._hint = self.client.gui.add_markdown(_HINTS[LOOK], order=-0.5)
        tool.on_click(self._on_tool_click)

    def _make_log(self, tab: Any) -> None:
        with tab:
            gui = self.client.gui
            level = gui.add_dropdown("Level", tuple(LEVELS), initial_value="info")
            node = gui.add_text("Node", "", hint="part of the node's name")
            text = gui.add_text("Text", "", hint="part of the line")
            self._lines = gui.add_html(to_html([]))
        level.on_update(lambda event: self._set_filter(level=LEVELS[event.target.value]))
        node.on_update(lambda event: self._set_filter(node=event.target.value))
        text.on_update(lambda event: self._set_filter(text=event.target.value))

    def _set_filter(self, **changes: Any) -> None:
        self._filter = self._filter._replace(**changes)
        self._show_log()

    def _show_log(self) -> None:
        self._lines.content = to_html(self._log.select(self._filter))

    def _on_camera(self, event: Any) -> None:
        self._camera, self._is_placed = event.target.value, False

    def _on_tool_click(self, event: Any) -> None:
        self.tool = event.target.value
        self._on_tool()
        self._hint.content = _HINTS[self.tool]  # what it asks for works by now


_HINTS = {
    LOOK: "The mouse turns the view.",
    PUT: "**Click the ground**: the shape below is put there.",
    MOVE: "**Drag** an object, or the robot, over the ground.",
    DELETE: "**Click** an object to delete it.",
}


def theme(gui: viser.GuiApi, is_dark: bool) -> None:
    """Colours of a page; the button that would share it through another host is not offered."""
    gui.configure_theme(
        dark_mode=is_dark, show_logo=False, show_share_button=False, brand_color=BRAND, control_width="medium"
    )


def _sum(a: Any, b: Sequence[float]) -> Vector3:
    x, y, z = (float(p) + float(q) for p, q in zip(a, b))
    return (x, y, z)
