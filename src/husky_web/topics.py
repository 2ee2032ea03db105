"""Subscriptions of the page; open only while a client is connected."""

from __future__ import annotations

import threading
import time
from collections import deque
from functools import partial
from math import inf
from typing import Any, Deque, Dict, List, Optional, Tuple

import rospy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist
from nav_msgs.msg import Path
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import InteractiveMarkerInit, InteractiveMarkerUpdate, Marker, MarkerArray

from husky_highlevel_controller.robot import load_robot

# [s] a thread that has read a message pauses for this time, so that it reads the next messages together;
# NUMBERS_PAUSE is for messages that are only shown as numbers
PAUSE, NUMBERS_PAUSE = 0.05, 0.1
# The messages that come during a pause are read at once after the pause, and cause no further pause. A
# message counts as one of them if it is read at most this fraction of the pause's length after the pause.
BURST_SHARE = 0.2
# largest number of messages of a topic that are kept until they are read; if there are more, the oldest are
# lost
QUEUE = 2000
DRAWN = {kind._type: kind for kind in (Marker, MarkerArray, Path)}
INTERACTIVE = "visualization_msgs/InteractiveMarkerUpdate"
# topics of commands, with the highest priority first and the controller's topic last; the same for every
# robot
INPUTS = load_robot().topics.velocity
Received = Tuple[str, Any]  # topic and message


class Topics:
    """Subscriptions of the page; the thread that draws takes their messages."""

    def __init__(self, names: Dict[str, str]) -> None:
        """Begin without subscriptions; `names` has the topics by use, such as scan or odometry."""
        self.names = names
        self.scan_count = 0  # number of scans that have come so far
        # `_last_pause.end` is the wall time [s] at which the last pause in `_push` ended. rospy has a thread
        # for each publisher, and each thread has a value of its own.
        self._last_pause = threading.local()
        # messages that wait for the thread that draws; a topic in `names` keeps only the newest message,
        # because an older one is of no use, but the five uses below need every message
        self._queues: Dict[str, Deque[Received]] = {use: deque(maxlen=1) for use in names}
        for kind in ("tf", "markers", "objects", "diagnostics", "inputs"):
            self._queues[kind] = deque(maxlen=QUEUE)
        # subscribers; the key is the use for a topic in `names`, such as "scan", otherwise the topic's name
        self._subscribers: Dict[str, rospy.Subscriber] = {}

    @property
    def is_open(self) -> bool:
        """Return whether there are subscriptions."""
        return bool(self._subscribers)

    def open(self) -> None:
        """Subscribe to the topics of every robot; `follow` adds further topics of the network."""
        self.listen("scan", numpy_msg(LaserScan), is_wanted=True)
        for topic in ("/tf", "/tf_static"):
            self._subscribers[topic] = self._subscriber(topic, TFMessage, "tf")
        self._subscribers["/diagnostics"] = self._subscriber("/diagnostics", DiagnosticArray, "diagnostics")
        # the topics are not resolved to full names, because `take_all("inputs")` must return the names in
        # INPUTS
        for name in INPUTS:
            self._subscribers[name] = self._subscriber(name, Twist, "inputs", NUMBERS_PAUSE)

    def follow(self, published: List[Tuple[str, str]]) -> None:
        """Subscribe to every topic of markers, paths and objects that can be dragged.

        `published` has the name and the message type of each topic that the ROS master knows.
        """
        for topic, kind in published:
            if topic in self._subscribers:
                continue
            if kind in DRAWN:
                self._subscribers[topic] = self._subscriber(topic, DRAWN[kind], "markers")
            elif kind == INTERACTIVE:
                full = f"{topic}_full"  # topic on which a server sends all its objects at the start
                self._subscribers[topic] = self._subscriber(topic, InteractiveMarkerUpdate, "objects")
                self._subscribers[full] = self._subscriber(full, InteractiveMarkerInit, "objects")

    def listen(self, use: str, kind: Any, is_wanted: bool) -> None:
        """Subscribe to a topic, or unsubscribe from a topic that is not shown now.

        Args:
            use: use of the topic, a key of `names`, such as "scan" or "odometry".
            kind: class of the messages.
            is_wanted: true to subscribe, false to unsubscribe.
        """
        if is_wanted and use not in self._subscribers:
            # scan and cloud are drawn in the view; the other topics are only shown as numbers, which may come
            # a little later
            pause = PAUSE if use in ("scan", "cloud") else NUMBERS_PAUSE
            self._subscribers[use] = self._subscriber(self.names[use], kind, use, pause)
        elif not is_wanted and use in self._subscribers:
            self._subscribers.pop(use).unregister()

    def take(self, use: str) -> Optional[Any]:
        """Return the newest message of one use, a key of `names`; None if there is no new message."""
        for _, msg in self.take_all(use):
            return msg  # the queue of such a use keeps only one message
        return None

    def take_all(self, kind: str) -> List[Received]:
        """Return the messages since the last call, oldest first."""
        queue = self._queues[kind]
        messages = []
        while queue:
            messages.append(queue.popleft())
        return messages

    def close(self) -> None:
        """Drop every subscription."""
        for subscriber in self._subscribers.values():
            subscriber.unregister()
        self._subscribers.clear()
        for queue in self._queues.values():
            queue.clear()

    def _subscriber(self, topic: str, kind: Any, use: str, pause: float = PAUSE) -> rospy.Subscriber:
        """Return a new subscriber that puts the messages of a topic into the queue of a use."""
        push = partial(self._push, use, topic, pause)
        return rospy.Subscriber(topic, kind, push, queue_size=QUEUE, buff_size=2**20, tcp_nodelay=True)

    def _push(self, use: str, topic: str, pause: float, msg: Any) -> None:
        """Keep a message, and sleep `pause` [s] so that the next messages are read together.

        Messages that come during the sleep wait in the connection. After the sleep, rospy calls this function
        for each of them without a delay, and they cause no further sleep. Without sleeps, the messages of a
        run would wake this process 475 times per second.
        """
        self._queues[use].append((topic, msg))
        if use == "scan":
            self.scan_count += 1
        end_of_pause = getattr(self._last_pause, "end", -inf)  # -inf before the first pause of this thread
        # true if this message has come during the last pause, because it is read at once after this pause
        came_during_pause = time.monotonic() - end_of_pause <= BURST_SHARE * pause
        if not came_during_pause:
            time.sleep(pause)
            self._last_pause.end = time.monotonic()
