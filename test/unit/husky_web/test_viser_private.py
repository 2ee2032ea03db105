"""viser has the private names that the page uses: an update that drops one says here which."""

import asyncio
import inspect
import re
from pathlib import Path

import pytest
import viser
from viser import _messages
from viser.infra import _infra

from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.paths import share_folder
from husky_web import viser_private
from husky_web.viser_private import (
    LoopEvent,
    MessageBuffer,
    page_html,
)

FOLDER = Path(viser_private.__file__).parent
POSE = Pose((1.0, 2.0, 3.0), (0.0, 0.0, 1.0, 0.0))


@pytest.fixture(scope="module")
def server():
    with viser_private.started_behind(None, lambda handler: handler):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


def test_the_server_s_messages_wait_in_our_buffer(server):
    assert isinstance(server._websock_server._broadcast_buffer, MessageBuffer)
    assert isinstance(MessageBuffer(None, True).message_event, LoopEvent)


def test_a_node_is_placed_and_stays_where_it_hardly_moves(server):
    node = server.scene.add_frame("/node")
    viser_private.place(node, POSE)
    assert (node.position.tolist(), node.wxyz.tolist()) == ([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0])
    viser_private.place(node, POSE._replace(position=(1.0, 2.0, 3.0001)))
    assert node.position.tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("message", "fields"),
    [
        (_messages.SetPositionMessage, ["name", "position"]),
        (_messages.SetOrientationMessage, ["name", "wxyz"]),
        (_messages.SetCameraPositionMessage, ["position"]),
        (_messages.SetCameraLookAtMessage, ["look_at"]),
        (_messages.SetSceneNodeVisibilityMessage, ["name", "visible"]),
    ],
)
def test_a_message_has_these_fields_in_this_order(message, fields):
    assert list(inspect.signature(message).parameters)[: len(fields)] == fields


def test_a_page_s_connection_is_found_and_queues_messages():
    assert "client" in viser._viser._CameraHandleState.__annotations__
    assert "self._websock_connection = " in inspect.getsource(viser.ClientHandle.__init__)
    assert "self._state = " in inspect.getsource(viser.CameraHandle.__init__)
    assert callable(_infra.WebsockClientConnection.queue_message)


def test_the_client_is_one_page():
    assert "<title>Viser</title>" in page_html()


def test_no_other_module_uses_private_names_of_viser():
    private = r"\b(_messages|_infra|_impl|_websock_connection|_queue_scene_message|_websock_server)\b"
    users = {path.name for path in FOLDER.glob("*.py") if re.search(private, path.read_text())}
    assert users == {"viser_private.py"}


def test_a_message_of_another_thread_wakes_the_pages_by_their_own_loop():
    # viser sets the event in both; the first is a race that ends the caller (seen in a drive)
    async def scenario():
        event, loop = LoopEvent(), asyncio.get_running_loop()
        waiter = loop.create_task(event.wait())
        await loop.run_in_executor(None, event.set)
        before = event.is_set()
        loop.call_soon_threadsafe(event.set)
        await asyncio.wait_for(waiter, 10.0)
        return before, event.is_set()

    assert asyncio.run(scenario()) == (False, True)


CLIENT = Path(viser.__file__).parent / "client" / "src"
# names of viser's client that viser_client.js and viser.css hang on, and the file that has each
HOOKS = {
    "App.tsx": [
        "w.__viserMutable = mutable.current",
        "mutable.current.scene = useThree",
        "mutable.current.requestRender =",
        "devSettings: viewer.useDevSettings",
    ],
    "dock/FloatingWindowView.tsx": ["data-floating-window="],
    "ControlPanel/BottomPanel.tsx": [
        "bottom: 0,",
        'width: "20em"',
        'height: "3.5em"',
        "<Paper",
        "ScrollArea.Autosize",
    ],
    "ControlPanel/ControlPanel.tsx": [
        "<IconAdjustments",
        "<ActionIcon",
        "minHeight: 0,",
        "opacity: expanded",
    ],
    "DevSettingsStore.ts": ["fixedDpr: number | null"],
    "BrowserWarning.tsx": ['title: "Software WebGL rendering detected"'],
    "components/ButtonGroup.tsx": ["<Flex", "<Button"],
    "components/common.tsx": ["<label htmlFor", "<Tooltip", "flexShrink: 0,"],
    "components/Html.tsx": ["dangerouslySetInnerHTML"],
    "MessageHandler.tsx": ["viser-user:"],
}


@pytest.mark.parametrize("file", HOOKS)
def test_the_client_has_the_names_that_script_and_style_hang_on(file):
    text = (CLIENT / file).read_text()
    assert [name for name in HOOKS[file] if name not in text] == []


def test_no_other_script_or_style_uses_names_of_viser_s_client():
    private = r"mantine|__viser|data-floating|data-dock|viser-user"
    users = {path.name for path in (share_folder() / "web").iterdir() if path.is_file()}
    users = {name for name in users if re.search(private, (share_folder() / "web" / name).read_text())}
    assert users == {"viser_client.js", "viser.css"}
