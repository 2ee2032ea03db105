"""Open pages, and the fields and settings of each: camera, colours, tool of the mouse, view of the log."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any, Callable, Deque, Dict, Mapping, Optional, Tuple

import viser

from husky_highlevel_controller.datatypes import Pose, Vector3
from husky_web.backdrop import show_backdrop
from husky_web.camera import CAMERAS, Camera
from husky_web.drawing import on_error_log_and_skip
from husky_web.log import LEVELS, Filter, LogBuffer, log_to_html
from husky_web.plots import choice_html

LOOK, PUT, MOVE, DELETE = TOOLS = ("Look", "Put", "Move", "Delete")
# viser's "brand" colour for light (False) and dark (True) pages; with it, text has a contrast of at least 4.5
BRANDS = {False: (20, 85, 155), True: (95, 170, 245)}
# keys of the browser's storage: DARK has the user's choice; page.js sets IS_DARK to "1" if the page has to be
# dark, by this choice or by the settings of the browser
DARK, IS_DARK = "dark", "is-dark"
# [s] longest wait for a value from the browser's storage; it is long, because a browser without a graphics
# card answers late
STORAGE_TIMEOUT = 30.0


class Page:
    """Fields and settings of one browser."""

    def __init__(
        self,
        client: viser.ClientHandle,
        tabs: Mapping[str, Any],
        log: LogBuffer,
        on_tool: Callable[[], None],
        is_dark: bool,
    ) -> None:
        """Add the page's own fields to the tabs; `on_tool` is called if its mouse gets another tool."""
        self.client, self._log = client, log
        self.tool = LOOK  # chosen tool of the mouse, one of TOOLS
        self._camera = Camera(client)
        self._filter = Filter()  # conditions for the lines of the log that this page shows
        # number of lines in the log when the page last showed them; -1 if the page must show them again
        self._log_count = -1
        self._on_tool = on_tool
        self._make_view(tabs["View"], is_dark)
        self._make_log(tabs["Log"])
        self._make_tools(tabs["World"])

    def update(self, base: Optional[Pose], pillar: Optional[Vector3]) -> None:
        """Move the camera with the robot or the pillar, both in the fixed frame [m]."""
        self._camera.update(base, pillar)

    def show_log(self) -> None:
        """Show the lines of the log that pass its filter, if there are new lines."""
        if self._log_count != self._log.count:
            self._log_count = self._log.count
            self._lines.content = log_to_html(self._log.select(self._filter))

    def _make_view(self, tab: Any, is_dark: bool) -> None:
        """Add the choice of the camera and of dark colours at the top of a tab."""
        with tab:
            gui = self.client.gui
            # viser sorts the fields by `order`: this page's own fields come first, because their order is
            # negative, and then the fields that all pages share
            self._chosen_camera = gui.add_html(choice_html(0), order=-2.5)  # marks the first button as chosen
            camera = gui.add_button_group("Camera", CAMERAS, order=-2)
            camera.on_click(self._on_camera)
            dark = gui.add_checkbox("Dark", is_dark, hint="for this browser only", order=-1)
            dark.on_update(self._on_dark)
        self._show_dark(is_dark)

    def _on_dark(self, event: Any) -> None:
        """Show dark or light colours, and keep the choice in the browser's storage."""
        self._show_dark(event.target.value)
        self.client.local_storage.set_item(DARK, "1" if event.target.value else "0")

    def _show_dark(self, is_dark: bool) -> None:
        """Show the page and the view in dark or light colours."""
        theme(self.client.gui, is_dark)
        show_backdrop(self.client, is_dark)

    def _make_tools(self, tab: Any) -> None:
        """Add the fields of the mouse's tools at the top of a tab."""
        with tab:
            # this element marks LOOK, the first button of the group below, as chosen; fields with a negative
            # `order` come before the fields that all pages share
            self._chosen_tool = self.client.gui.add_html(choice_html(0), order=-1.5)
            tool = self.client.gui.add_button_group(
                "Mouse",
                TOOLS,
                hint="Put: click the ground. Move: drag an object or the robot. Delete: click",
                order=-1,
            )
            self._hint = self.client.gui.add_html(_HINTS[LOOK], order=-0.5)
        tool.on_click(self._on_tool_click)

    def _make_log(self, tab: Any) -> None:
        """Add the fields of the filter, and the lines that pass it, to a tab."""
        with tab:
            gui = self.client.gui
            level = gui.add_dropdown("Level", tuple(LEVELS), initial_value="info")
            node = gui.add_text("Node", "", hint="part of the node's name")
            text = gui.add_text("Text", "", hint="part of the line")
            self._lines = gui.add_html(log_to_html([]))
        level.on_update(lambda event: self._set_filter(level=LEVELS[event.target.value]))
        node.on_update(lambda event: self._set_filter(node=event.target.value))
        text.on_update(lambda event: self._set_filter(text=event.target.value))

    def _set_filter(self, **changes: Any) -> None:
        """Change conditions of the filter, and show the lines that pass now."""
        self._filter, self._log_count = self._filter._replace(**changes), -1
        self.show_log()

    def _on_camera(self, event: Any) -> None:
        """Choose the camera of the pressed button, and mark this button as chosen."""
        self._camera.choose(event.target.value)
        self._chosen_camera.content = choice_html(CAMERAS.index(event.target.value))

    def _on_tool_click(self, event: Any) -> None:
        """Give the mouse the tool of the pressed button, and mark this button as chosen."""
        self.tool = event.target.value
        self._chosen_tool.content = choice_html(TOOLS.index(self.tool))
        self._on_tool()
        # the hint changes last, so that the tool already works when a person reads its hint
        self._hint.content = _HINTS[self.tool]


_HINTS = {
    LOOK: '<div class="husky-block">The mouse turns the view.</div>',
    PUT: '<div class="husky-block"><b>Click the ground</b> to put the shape below there.</div>',
    MOVE: '<div class="husky-block"><b>Drag</b> an object, or the robot, over the ground.</div>',
    DELETE: '<div class="husky-block"><b>Click</b> an object to delete it.</div>',
}


class Pages:
    """Open pages; they arrive in threads of viser, and the thread that draws admits them."""

    def __init__(self, server: viser.ViserServer, tabs: Mapping[str, Any], log: LogBuffer) -> None:
        self.open: Dict[int, Page] = {}  # open pages; the key is the number of viser's client
        self.page_came = threading.Event()  # set when a browser connects; `admit` then adds its page
        # function that is called when a page chooses another use of its mouse, such as to delete objects
        self.on_tool: Callable[[], None] = lambda: None
        # function that is called with the number of a page that was closed
        self.on_leave: Callable[[int], None] = lambda page: None
        self._server, self._tabs, self._log = server, tabs, log
        # browsers that are connected but have no page yet, each with true if it prefers dark colours
        self._arrivals: Deque[Tuple[viser.ClientHandle, bool]] = deque()
        server.on_client_connect(self._on_connect)

    def admit(self) -> None:
        """Add the fields of new pages, and forget closed pages."""
        clients = self._server.get_clients()
        leavers = self.open.keys() - clients
        while self._arrivals:
            client, is_dark = self._arrivals.popleft()
            if client.client_id not in clients:
                # the page was closed while `wants_dark` read its choice of colours from the browser
                continue
            with on_error_log_and_skip("a page that comes"):
                self.open[client.client_id] = Page(client, self._tabs, self._log, self.on_tool, is_dark)
        for number in leavers:
            self.open.pop(number)
            with on_error_log_and_skip("a page that goes"):
                self.on_leave(number)
                self.on_tool()  # the tool of this page no longer counts

    def _on_connect(self, client: viser.ClientHandle) -> None:
        """Keep a new browser until `admit` adds its page, and wake up the thread that draws."""
        self._arrivals.append((client, wants_dark(client)))
        self.page_came.set()


def wants_dark(client: viser.ClientHandle) -> bool:
    """Return whether a browser prefers dark colours, as page.js has stored it in the browser's storage."""
    try:
        # page.js sets IS_DARK by the user's earlier choice, otherwise by the settings of the browser
        return client.local_storage.get_item(IS_DARK, STORAGE_TIMEOUT) == "1"
    except (RuntimeError, TimeoutError):  # the page was closed, or its browser has no storage
        return False


def theme(gui: viser.GuiApi, is_dark: bool) -> None:
    """Set the colours of a page, and hide viser's button that shares a page through another host."""
    gui.configure_theme(
        dark_mode=is_dark,
        show_logo=False,
        show_share_button=False,
        brand_color=BRANDS[is_dark],
        control_width="large",
    )
