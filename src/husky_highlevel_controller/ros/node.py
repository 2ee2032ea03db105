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
    """Return the node's private parameters without `~robot_name`, and the robot of this name or the Husky.

    Raises:
        ConfigError: the name is not the name of a robot.
    """
    values = dict(rospy.get_param("~", {}))
    try:
        return values, load_robot(str(values.pop("robot_name", "husky")))
    except ConfigError as error:
        raise ConfigError(f"{rospy.get_name()}/robot_name: {error}") from None


def publish(publisher: Any, message: Any, **options: Any) -> None:
    """Publish a message. A message that a callback publishes while the node shuts down may be lost.

    rospy closes topics before `is_shutdown()` is true; `is_shutdown_requested()` is true from the signal on.
    """
    try:
        publisher.publish(message, **options)
    except (rospy.ROSException, ValueError):
        # this error means that the topic is closed, which is normal only while the node shuts down
        if not rospy.core.is_shutdown_requested():
            raise


@contextmanager
def contained(what: str) -> Iterator[None]:
    """Run a block whose error must not end its thread, because the node still needs the thread.

    Each kind of error is logged once with its traceback, and errors are ignored while the node shuts down.

    Args:
        what: what fails, as the beginning of a sentence.
    """
    try:
        yield
    except Exception as error:  # the thread must continue after any error
        kind = (what, type(error).__name__)
        if kind not in _logged_errors and not rospy.core.is_shutdown_requested():
            _logged_errors.add(kind)
            rospy.logerr(f"{what} failed and will be tried again: {traceback.format_exc()}")


# failed actions, each with the kind of its error; each pair is logged only once
_logged_errors: Set[Tuple[str, str]] = set()


class NewSubscribers(rospy.SubscribeListener):
    """Flag of a publisher that is set when a node subscribes."""

    def __init__(self) -> None:
        self._came = threading.Event()

    def peer_subscribe(self, *_: Any) -> None:
        """Called by rospy, in a thread of its own."""
        self._came.set()

    def take(self) -> bool:
        """Return whether a node has subscribed since the last call."""
        subscribed = self._came.is_set()
        self._came.clear()
        return subscribed


def _end_on_signals() -> None:
    """Shut down on SIGINT and SIGTERM in a separate thread.

    rospy's handler shuts down in the middle of the main thread's work, and waits forever for a lock that the
    main thread holds. This happened in 1 of 25 launches that were ended while they started.
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
    """Make and run a node. Bad input ends it with a message and exit code 1, and a signal with exit code 0.

    With the argument --debug it logs at DEBUG level, and shows a stack trace if a crash, such as one of the
    physics engine, ends Python itself.

    Args:
        name: name of the node, unless the launch file gives it another.
        make: makes the node.
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
