"""Private names of viser 1.1 that the page needs; test_viser_private.py fails if an update breaks one."""

from __future__ import annotations

import asyncio
import logging
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Callable, Iterator, Sequence, Tuple

import viser
import websockets.asyncio.server
from viser import _messages
from viser.infra import _infra

from husky_highlevel_controller.datatypes import Pose, Quaternion, Vector3

# [m] if a coordinate has changed less than this, its change is not sent; the same limit holds for a component
# of a quaternion, and means a turn of 1 mrad there
INVISIBLE = 5e-4


class LoopEvent(asyncio.Event):
    """Event that only its loop's thread sets.

    viser calls `set` twice for each message: at once, in the thread of the message, and again in its loop.
    The call in the thread races with the loop, and can raise "deque mutated during iteration", which was seen
    within a minute on a busy machine. The call in the loop is enough.
    """

    def set(self) -> None:
        """Set the event, if this thread runs a loop; ignore the call of any other thread."""
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            return
        super().set()


class MessageBuffer(_infra.AsyncMessageBuffer):
    """viser's buffer of messages to send, with an event that is safe to set from any thread."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.message_event = LoopEvent()


@contextmanager
def started_behind(process_request: Any, wrap: Callable[[Any], Any]) -> Iterator[None]:
    """Let a server that is started in this block check each request, and wrap its handler.

    viser has no hook for a check of its requests, so the function of `websockets` that starts its server is
    replaced. Viser's message buffer is replaced, too, by `MessageBuffer`, which is safe in several threads.

    Args:
        process_request: argument of `websockets.asyncio.server.serve`.
        wrap: function that gets the handler of connections and returns another one.
    """
    # original function of websockets, which is put back at the end of the block
    original: Any = websockets.asyncio.server.serve
    logger = logging.getLogger("husky_web.websockets")
    # errors are hidden, because websockets would report each HTTP request for the page as a failed WebSocket
    # handshake
    logger.setLevel(logging.CRITICAL)

    def serve(handler: Any, *args: Any, **kwargs: Any) -> Any:
        """Start a server, as websockets does, with the check of requests and the wrapped handler."""
        kwargs.update(process_request=process_request, logger=logger)
        return original(wrap(handler), *args, **kwargs)

    # the class of the buffer stays replaced after the block, because viser makes a buffer for each page that
    # connects later
    _infra.AsyncMessageBuffer = MessageBuffer  # type: ignore
    websockets.asyncio.server.serve = serve  # type: ignore
    try:
        yield
    finally:
        websockets.asyncio.server.serve = original  # type: ignore


def page_html() -> str:
    """Return the page of viser's client, which is one file."""
    return (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text()


def place(node: Any, pose: Pose) -> None:
    """Set the pose of a node if it has changed, because every change is sent to every page.

    The message is queued without viser's setter, which compares by numpy.allclose: 6 us instead of 39 us.
    """
    # `state` is viser's own record of the node, with the pose that the pages have
    state, position, rotation = node._impl, pose.position, wxyz(pose.quat_xyzw)
    if _differ(state.position.tolist(), position):
        state.position[:] = position
        state.api._queue_scene_message(_messages.SetPositionMessage(state.name, position))
    if _differ(state.wxyz.tolist(), rotation):
        state.wxyz[:] = rotation
        state.api._queue_scene_message(_messages.SetOrientationMessage(state.name, rotation))


def look(camera: viser.CameraHandle, position: Vector3, look_at: Vector3) -> None:
    """Move a page's camera. `camera` keeps the position that the page has last reported.

    viser's setters are not used, because they also calculate the rotation. This calculation took a seventh of
    the time of the thread that draws.
    """
    queue = camera._state.client._websock_connection.queue_message
    queue(_messages.SetCameraPositionMessage(position))
    queue(_messages.SetCameraLookAtMessage(look_at))


def show_in_page(client: viser.ClientHandle, name: str, is_visible: bool) -> None:
    """Show or hide a node of the scene in one page; viser has no visibility for one page."""
    client._websock_connection.queue_message(_messages.SetSceneNodeVisibilityMessage(name, is_visible))


def wxyz(quat_xyzw: Quaternion) -> Tuple[float, float, float, float]:
    """Return a quaternion in viser's order."""
    x, y, z, w = quat_xyzw
    return (w, x, y, z)


def _differ(a: Sequence[float], b: Sequence[float]) -> bool:
    """Return whether two positions or quaternions differ so much that a person can see it."""
    return any(abs(p - q) > INVISIBLE for p, q in zip(a, b))
