"""Subscriptions of the page; open only while a client is connected."""

from __future__ import annotations

import threading
import time
from collections import deque
from functools import partial
from math import inf
from typing import Any, Callable, Deque, Dict, List, NamedTuple, Optional, Tuple

import rospy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Path
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import InteractiveMarkerInit, InteractiveMarkerUpdate, Marker, MarkerArray

PAUSE, NUMBERS_PAUSE = 0.05, 0.1  # [s] between two readings of what is drawn, and of numbers
BURST_SHARE = 0.2  # of a pause: a message so soon after it had come in meanwhile
QUEUE = 2000  # messages of one topic kept between two looks; a page that stays behind loses the oldest
DRAWN = {kind._type: kind for kind in (Marker, MarkerArray, Path)}
INTERACTIVE = "visualization_msgs/InteractiveMarkerUpdate"


class Paced:
    """A callback that pauses, so that what comes in meanwhile is read at one go.

    Without it the messages of a drive wake this process 475 times a second.
    """

    def __init__(self, take: Callable[[Any], None], pause: float) -> None:
        """After a message that did not arrive during the last pause, sleep `pause` [s]: then read a burst."""
        self._take, self._pause = take, pause
        self._ended = threading.local()  # [s], the last pause; a topic has a thread for each publisher

    def __call__(self, msg: Any) -> None:
        """Take a message."""
        self._take(msg)
        if time.monotonic() - getattr(self._ended, "at", -inf) > BURST_SHARE * self._pause:
            time.sleep(self._pause)
            self._ended.at = time.monotonic()


class Newest:
    """The newest message of a topic, unpacked only when it is asked for."""

    def __init__(self, topic: str, kind: Any, pause: float) -> None:
        self.count = 0
        self._kind, self._raw = kind, None
        self._subscriber = rospy.Subscriber(
            topic, rospy.AnyMsg, Paced(self._on_message, pause), buff_size=2**20
        )

    def take(self) -> Optional[Any]:
        """The newest message; None if there is no new one, or one of another type."""
        raw, self._raw = self._raw, None
        if raw is None or raw._connection_header["type"] != self._kind._type:
            return None
        return self._kind().deserialize(raw._buff)

    def close(self) -> None:
        """Listen no more."""
        self._subscriber.unregister()

    def _on_message(self, msg: Any) -> None:
        self.count += 1
        self._raw = msg


class Received(NamedTuple):
    """A message and the topic it came on."""

    topic: str
    msg: Any


class Topics:
    """Subscriptions of the page; what came in is taken by the thread that draws."""

    def __init__(self, names: Dict[str, str]) -> None:
        """Listen to nothing yet; `names` has the topics by use, such as scan or odometry."""
        self._names = names
        self.newest: Dict[str, Newest] = {}
        self._queues: Dict[str, Deque[Received]] = {
            kind: deque(maxlen=QUEUE) for kind in ("tf", "markers", "objects", "diagnostics")
        }
        self._subscribers: Dict[str, rospy.Subscriber] = {}

    @property
    def is_open(self) -> bool:
        """Whether there are subscriptions."""
        return bool(self._subscribers)

    def name(self, use: str) -> str:
        """The topic of one use."""
        return self._names[use]

    def open(self) -> None:
        """Listen to what every robot has; `follow` adds what the network offers."""
        self.listen("scan", numpy_msg(LaserScan), True)
        for topic in ("/tf", "/tf_static"):
            self._subscribe(topic, TFMessage, "tf")
        self._subscribe("/diagnostics", DiagnosticArray, "diagnostics")

    def follow(self, published: List[Tuple[str, str]]) -> None:
        """Subscribe to every topic of markers, paths and objects that can be dragged."""
        for topic, kind in published:
            if topic in self._subscribers:
                continue
            if kind in DRAWN:
                self._subscribe(topic, DRAWN[kind], "markers")
            elif kind == INTERACTIVE:
                self._subscribe(topic, InteractiveMarkerUpdate, "objects")
                self._subscribe(topic + "_full", InteractiveMarkerInit, "objects")

    def listen(self, use: str, kind: Any, is_open: bool) -> None:
        """Subscribe or not to what is shown on demand."""
        if is_open and use not in self.newest:
            pause = PAUSE if use in ("scan", "cloud") else NUMBERS_PAUSE
            self.newest[use] = Newest(self._names[use], kind, pause)
        elif not is_open and use in self.newest:
            self.newest.pop(use).close()

    def take(self, use: str) -> Optional[Any]:
        """The newest message of one use, or None."""
        newest = self.newest.get(use)
        return None if newest is None else newest.take()

    def take_all(self, kind: str) -> List[Received]:
        """Messages since the last call, oldest first."""
        queue, messages = self._queues[kind], []
        while queue:
            messages.append(queue.popleft())
        return messages

    def close(self) -> None:
        """Drop every subscription."""
        for newest in self.newest.values():
            newest.close()
        for subscriber in self._subscribers.values():
            subscriber.unregister()
        self.newest.clear()
        self._subscribers.clear()
        for queue in self._queues.values():
            queue.clear()

    def _subscribe(self, topic: str, kind: Any, queue: str) -> None:
        push = Paced(partial(self._push, queue, topic), PAUSE)
        self._subscribers[topic] = rospy.Subscriber(topic, kind, push, queue_size=QUEUE, tcp_nodelay=True)

    def _push(self, queue: str, topic: str, msg: Any) -> None:
        self._queues[queue].append(Received(topic, msg))
