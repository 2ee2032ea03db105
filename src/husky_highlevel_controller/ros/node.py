"""Start-up, publishing and shutdown common to all nodes of this package."""

from __future__ import annotations

import faulthandler
import signal
import sys
import threading
import traceback
from contextlib import contextmanager
from io import TextIOWrapper
from typing import Any, Callable, Dict, Iterator, Protocol, Set, Tuple

import rospy

from husky_highlevel_controller.config import ConfigError
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.robot import Robot, load_robot
from husky_highlevel_controller.ros.rosout import remember_parameter
from husky_highlevel_controller.ros.shared_receiver import receive_in_one_thread
from husky_highlevel_controller.ros.transport import replace_transport

LAUNCH_FILES = {  # launch file that loads the parameters of each node
    "husky_highlevel_controller": "controller", "arrival_exit": "simulator", "husky_simulator": "simulator",
    "husky_web": "web", "crash_stop": "crash_stop", "proximity_stop": "proximity_stop",
}  # fmt: skip


def parameters_and_robot() -> Tuple[Dict[str, Any], Robot]:
    """Return the node's private parameters without `~robot_name`, and the robot that `~robot_name` names.

    The robot is the Husky if the parameter is not set.

    Raises:
        ConfigError: the name is not the name of a robot.
    """
    values = dict(rospy.get_param("~", {}))
    try:
        return values, load_robot(str(values.pop("robot_name", "husky")))
    except ConfigError as error:
        raise ConfigError(f"{rospy.get_name()}/robot_name: {error}") from None


def publish(publisher: Any, message: Any, **options: Any) -> None:
    """Publish a message, and ignore the error that the topic is closed while the node shuts down.

    rospy closes the topics at the beginning of the shutdown, while callbacks still run and publish. Without
    this function, each of them would end with a traceback in the log.
    """
    try:
        publisher.publish(message, **options)
    except (rospy.ROSException, ValueError):
        # `rospy.is_shutdown()` is not enough here, because it becomes true only after the topics were closed
        if not rospy.core.is_shutdown_requested():
            raise


@contextmanager
def contained(what: str) -> Iterator[None]:
    """Log an error of the block in place of raising it, because the thread must go on after any error.

    Use it as `with contained("drawing the map"): ...`. Each kind of error is logged once, with its traceback.
    Errors are ignored while the node shuts down.

    Args:
        what: action of the block, as the beginning of the sentence "... failed and will be tried again".
    """
    try:
        yield
    except Exception as error:
        kind = (what, type(error).__name__)
        if kind not in _logged_errors and not rospy.core.is_shutdown_requested():
            _logged_errors.add(kind)
            rospy.logerr(f"{what} failed and will be tried again: {traceback.format_exc()}")


# failed actions, each with the kind of its error; each pair is logged only once
_logged_errors: Set[Tuple[str, str]] = set()


class NewSubscribers(rospy.SubscribeListener):
    """Remembers that a node has subscribed to a topic; give it to the publisher of the topic."""

    def __init__(self) -> None:
        self._came = threading.Event()

    def peer_subscribe(self, *_: Any) -> None:
        """Note a new subscriber; rospy calls this, in a thread of its own."""
        self._came.set()

    def take(self) -> bool:
        """Return whether a node has subscribed since the last call."""
        subscribed = self._came.is_set()
        self._came.clear()
        return subscribed


def _end_on_signals() -> None:
    """Let SIGINT and SIGTERM shut the node down in a separate thread.

    Python calls a signal handler in the main thread, in the middle of the thread's work. rospy's own handler
    shuts down there, and waits forever if it needs a lock that the main thread holds. This happened in 1 of
    25 launches that were ended while they started.
    """

    def end(number: int, _: object) -> None:
        threading.Thread(target=rospy.signal_shutdown, args=(f"signal {number}",)).start()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)


class Runnable(Protocol):
    """A node that is set up by its constructor."""

    def run(self) -> None:
        """Work until the node is shut down."""


def run_node(
    name: str, make: Callable[[], Runnable], listen_to_clock: bool = True, in_one_thread: bool = False
) -> None:
    """Make and run a node. Bad input ends the node with a message and exit code 1, a signal with exit code 0.

    With the argument --debug on its command line, the node logs at DEBUG level, and shows a stack trace if a
    crash, such as one of the physics engine, ends Python itself.

    Args:
        name: name of the node, unless the launch file gives it another.
        make: makes the node; it is called after rospy was set up, and raises HuskyError for bad input.
        listen_to_clock: false for a node that sets its own time.
        in_one_thread: true if one thread receives all topics, which is faster for a node that gets messages
            of several topics at the same moment; false if each topic has a thread. In one thread, a callback
            that waits would delay all topics.
    """
    if isinstance(sys.stdout, TextIOWrapper):
        # each line of the log is written at once, even if the log goes into a pipe or file
        sys.stdout.reconfigure(line_buffering=True)
    debug = "--debug" in rospy.myargv()
    if debug:
        faulthandler.enable()
    # rospy's own transport is too slow; this call must come before the first publisher is made
    replace_transport()
    if in_one_thread:
        receive_in_one_thread()
    level = rospy.DEBUG if debug else rospy.INFO
    # Without `argv`, rospy would use the arguments that the process had when rospy was imported. This process
    # may be a fork that was made after the import, and then has other arguments.
    rospy.init_node(
        name, argv=sys.argv, log_level=level, disable_rostime=not listen_to_clock, disable_signals=True
    )
    # without this call, rospy would ask the master for a parameter with each line of the log
    remember_parameter()
    _end_on_signals()
    try:
        make().run()
    except HuskyError as error:
        # a node without any parameter was probably started without its launch file
        hint = ""
        if name in LAUNCH_FILES and not rospy.get_param("~", {}):
            hint = f"; start it by roslaunch husky_highlevel_controller {LAUNCH_FILES[name]}.launch"
        rospy.logfatal(f"{error}{hint}")
        rospy.signal_shutdown("bad input")
        sys.exit(1)
