"""The browser page as a ROS node: a client like RViz, which also acts through topics and services."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import time
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple

import rosgraph
import rospkg
import rospy
from geometry_msgs.msg import PointStamped, TwistStamped, Vector3Stamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Bool

from husky_highlevel_controller.config import number, read_config, setting
from husky_highlevel_controller.robot import ROBOTS, load_robot
from husky_highlevel_controller.ros.node import run_node
from husky_highlevel_controller.ros.registration import Registration
from husky_highlevel_controller.xml_rpc import ask
from husky_web.actions import MASTER_DEADLINE, Actions, parameter
from husky_web.camera import FIELD_OF_VIEW
from husky_web.drawing import on_error_log_and_skip
from husky_web.drive_tab import DriveTab
from husky_web.drivers import Drivers, short_name
from husky_web.legend import add_layers
from husky_web.log import LogBuffer, lines_of_rosout
from husky_web.mouse import Mouse
from husky_web.numbers import Numbers
from husky_web.objects import Objects
from husky_web.page_server import serve
from husky_web.pages import Pages, theme
from husky_web.plots import Plots
from husky_web.recorder import Recorder
from husky_web.scene import Scene
from husky_web.state_bar import Figures, Moving, RobotStatus, StateBar, StopReason
from husky_web.teleop import Teleop
from husky_web.topics import Topics
from husky_web.tuning import Tuning
from husky_web.world_tab import WorldTab

READINGS_PERIOD = 0.2  # [s] time between two updates of numbers and diagnostics
CURVES_PERIOD = 1.0  # [s] time between two updates of curves and of the log
NETWORK_PERIOD = 3.0  # [s] time between two questions to the ROS master for all published topics
# number of bytes that are read from the end of rosout.log; a line has about 700 bytes
ROSOUT_BYTES = 1_000_000
# [s] while no page is open, the node checks once per IDLE_PERIOD whether it must end
IDLE_PERIOD = 1.0

# text that viser_client.js shows instead of viser's own warning, because the warning would cover the scene
SOFTWARE = (
    '<div class="husky-block husky-software">This browser has no graphics card, so it draws '
    "fewer pictures per second.</div>"
)


@dataclass(frozen=True)
class WebConfig:
    """Parameters of the page."""

    address: str = setting(
        "address of the page; an address other than loopback requires a token", "127.0.0.1"
    )
    port: int = number(1, 65535, "port of the page; if it is in use, the next free port", 8080)
    rate: float = number(1.0, 60.0, "rate of the view [Hz]", 20.0)
    fixed_frame: str = setting("frame in which everything is drawn", "odom")
    controller: str = setting("controller node to start and stop", "husky_highlevel_controller")
    simulator: str = setting("simulator node, with services such as pause and spawn", "husky_simulator")
    scan_topic: str = setting("sensor_msgs/LaserScan", load_robot().topics.scan)
    cloud_topic: str = setting("sensor_msgs/PointCloud2", "camera/depth/points")
    odometry_topic: str = setting("nav_msgs/Odometry", load_robot().topics.odometry)
    truth_topic: str = setting("nav_msgs/Odometry with true poses, if any", "ground_truth/odom")
    command_topic: str = setting(
        "geometry_msgs/TwistStamped, the wheels' command", load_robot().topics.limited_command
    )


class Master(Enum):
    """State of the ROS master at the last query."""

    KNOWS_NODE = "knows this node"
    # The master was started again, and does not know this node. The new master never learns of this node's
    # publishers. So the page asks for a restart of the node, and the state never becomes KNOWS_NODE again.
    IS_NEW = "was started again"
    IS_SILENT = "does not answer"


class WebNode:
    """Shows the robot to every open page; without a page it only subscribes to the log."""

    def __init__(self) -> None:
        (config,) = read_config(rospy.get_param("~", {}), rospy.get_name() + "/", WebConfig)
        # relative names get the namespace of this node here, because the page compares them with the full
        # names of nodes, topics and diagnostics
        config = replace(
            config,
            controller=rospy.resolve_name(config.controller),
            simulator=rospy.resolve_name(config.simulator),
        )
        self._config = config
        self._description = ""  # URDF of the robot that is drawn; empty before the first URDF has come
        self._log = LogBuffer()  # lines of /rosout_agg, also while no page is open
        rospy.Subscriber("/rosout_agg", Log, self._log.add, queue_size=100)
        self._topics = Topics(_topic_names(config))
        self._actions = Actions()  # queue of the service calls of the pages' buttons
        self._teleop = Teleop(config.simulator)  # driving by hand, and the emergency stop
        self._server, address, has_token = serve(
            config.address, config.port, self._teleop.on_message, self._teleop.on_leave
        )
        self._build(config)
        self._master = Master.KNOWS_NODE  # state of the ROS master at the last query
        self._registration = Registration()  # asks the master whether it knows this node
        self._is_paused: Optional[bool] = None  # true if simulated time is paused; None without a simulator
        self._reason = StopReason()  # warning that came when the controller stopped, for the state bar
        self._world_name = ""  # name of the simulator's world
        # rosout.log is read after the subscription to /rosout_agg, so that no line is lost between the two;
        # `add_earlier` leaves out the lines that have come on the topic, too
        self._log.add_earlier(lines_of_rosout(read_rosout()))
        rospy.Subscriber(f"{config.simulator}/paused", Bool, self._on_paused, queue_size=1)
        invitation = f"open this page in a browser: {address}"
        if has_token:  # everybody can read the log, so the token is only printed in this terminal
            print(invitation)
        else:
            rospy.loginfo(invitation)

    def _build(self, config: WebConfig) -> None:
        """Make the scene and the fields of the page, and connect their callbacks."""
        server = self._server
        theme(server.gui, False)  # light colours; a page that prefers dark ones gets its own theme later
        server.initial_camera.fov = FIELD_OF_VIEW
        self._scene = Scene(server, config.fixed_frame, config.controller)
        self._objects = Objects(server, self._scene.frames, config.fixed_frame)
        # the state bar is above the tabs, so that it is visible in each tab
        self._state_bar = StateBar(server.gui)
        self._moving = Moving()  # name of the object that a page moves now
        self._drivers = Drivers()  # last command of each node that drives the robot
        group = server.gui.add_tab_group()
        names = ("Drive", "World", "Tune", "Curves", "Log", "View")
        self._tabs = {name: group.add_tab(name) for name in names}
        with self._tabs["Drive"]:
            self._drive = DriveTab(
                server, self._actions, self._teleop, self._moving, config.controller, config.simulator
            )
        # if a page presses the emergency stop, the controller is stopped, too
        self._teleop.on_lock = self._drive.stop
        self._state_bar.on_again = self._drive.again  # function of the button "Drive again"
        with self._tabs["World"]:
            self._world = world = WorldTab(
                server, self._actions, self._moving, config.simulator, config.fixed_frame
            )
        # function of the button "Move the pillar"
        self._state_bar.on_elsewhere = lambda client: world.move_away(client, self._numbers.pillar)
        self._pages = Pages(server, self._tabs, self._log)
        self._mouse = Mouse(self._scene, self._objects, world, self._moving, self._pages.open)
        server.scene.on_click()(self._mouse.on_ground)  # clicks beside the objects
        # a node of the scene reacts to the mouse only if the tool of a page acts on it, so `bind` updates the
        # nodes if a page chooses another tool
        self._pages.on_tool, self._pages.on_leave = self._mouse.bind, self._mouse.release
        with self._tabs["Tune"]:
            self._tuning = Tuning(server, self._actions, self._tabs["Tune"])
        with self._tabs["Curves"]:
            self._plots = Plots(server.gui)
        self._numbers = Numbers(self._plots.curves)
        self._tuning.on_change = self._on_parameter  # marks the change of a parameter in the curves
        with self._tabs["View"]:
            with server.gui.add_folder("Layers"):
                # each box shows or hides a layer; the box of the depth points is hidden while no topic has
                # such points
                self._depth_box = add_layers(server.gui, self._scene.show_layer)
            server.gui.add_html(SOFTWARE)
            self._recorder = Recorder(server, self._actions)

    def run(self) -> None:
        """Draw for the open pages until the node is shut down; without a page, only wait for one.

        The view is drawn `rate` times per second. Numbers, curves and the network have longer periods. Each
        part runs in its own block, which logs an error and skips the rest of the part, so that one bad
        message does not end the page with its emergency stop.
        """
        period = 1.0 / self._config.rate
        # [s] wall time of the next update; 0, so that the first picture of a page has all parts
        readings_due = curves_due = network_due = 0.0
        while not rospy.is_shutdown():
            with on_error_log_and_skip("a page"):
                self._pages.admit()
            if not self._pages.open:
                self._wait_for_page()
                readings_due = curves_due = network_due = 0.0
                continue
            now = time.monotonic()
            if now >= network_due:
                with on_error_log_and_skip("a change of the network"):
                    self._follow_network()
                network_due = now + NETWORK_PERIOD
            with self._server.atomic():  # the browser shows all changes of the block in one picture
                with on_error_log_and_skip("a part of the view"):
                    self._update()
                with on_error_log_and_skip("the state"):
                    self._take_numbers(now)
                    self._show_state(now)
                if now >= readings_due:
                    with on_error_log_and_skip("a reading"):
                        self._show_readings()
                    readings_due = now + READINGS_PERIOD
                if now >= curves_due:
                    with on_error_log_and_skip("a curve or the log"):
                        self._plots.update()
                        for page in self._pages.open.values():
                            page.show_log()
                    curves_due = now + CURVES_PERIOD
            time.sleep(max(0.0, period - (time.monotonic() - now)))
        self._server.stop()

    def _wait_for_page(self) -> None:
        """Drop everything that was kept for pages, then wait until a page comes, at most IDLE_PERIOD."""
        with on_error_log_and_skip("the end of the last page"):
            self._forget()
        self._pages.page_came.wait(IDLE_PERIOD)
        self._pages.page_came.clear()

    def _forget(self) -> None:
        """Drop everything that was kept for pages; called again and again while no page is open."""
        if self._topics.is_open:  # true only in the first call after the last page has gone
            self._topics.close()
            self._tuning.follow([])
            self._recorder.stop()
            self._objects.clear()
            self._scene.forget()
            self._numbers.forget()
            self._drive.forget()
            self._drivers.forget()
        # called each time, because other nodes may switch the emergency stop on or off while no page is open
        self._state_bar.forget(self._teleop.is_locked, self._teleop.has_listener)
        # the last connection may end later than the last page, and the process keeps its memory until then
        if self._server.gate.last_has_gone():
            give_memory_back()

    def _follow_network(self) -> None:
        """Subscribe to the topics that the network has now, and read the robot and the world from it."""
        master, published = self._ask_for_topics()
        has_changed = master is not self._master
        self._master = master
        if master is Master.IS_SILENT:
            # the subscriptions stay as they are, because other nodes send their messages without the master
            rospy.logwarn_throttle(60.0, f"the ROS master does not answer at {rosgraph.get_master_uri()}")
            return
        if has_changed:
            # The master was started again, or it may have been started again while it was silent. A new
            # master does not have the subscriptions of this node, so all of them are made again.
            self._topics.close()
        if not self._topics.is_open:
            self._topics.open()
        self._topics.follow(published)
        offered = dict(published)  # message type of each published topic
        if f"{self._config.simulator}/paused" not in offered:
            self._is_paused = None  # the simulator has ended, so it is not paused any more
        self._listen_to_numbers_and_cloud(offered)
        self._depth_box.visible = self._topics.names["cloud"] in offered
        self._tuning.follow(published)
        self._world_name = str(parameter(f"{self._config.simulator}/world_name", ""))
        self._follow_description()
        # the name of the robot comes from its description
        self._server.gui.set_panel_label(title(self._scene.robot_name, self._world_name))

    def _listen_to_numbers_and_cloud(self, offered: Dict[str, str]) -> None:
        """Subscribe to the published topics of numbers, and to the cloud while it is shown.

        If a topic is no longer published or shown, this function unsubscribes from it. `offered` has the name
        and the message type of each published topic.
        """
        # if a simulator publishes true poses, they are shown instead of the odometry
        has_truth = self._topics.names["truth"] in offered
        self._topics.listen("truth", Odometry, is_wanted=has_truth)
        self._topics.listen("odometry", Odometry, is_wanted=not has_truth)
        for use, kind in (("command", TwistStamped), ("error", Vector3Stamped), ("pillar", PointStamped)):
            self._topics.listen(use, kind, is_wanted=self._topics.names[use] in offered)
        # a cloud is large, so it is only subscribed to while its layer is shown
        self._topics.listen("cloud", PointCloud2, is_wanted=self._scene.layers["depth"])

    def _follow_description(self) -> None:
        """Draw the robot again if its description on the parameter server has changed."""
        # The master searches for the parameter in the namespaces of this node, from the innermost to the
        # root. If no namespace has it, `full_name` is the relative name, which gives an empty description.
        full_name = self._ask("searchParam", "robot_description") or "robot_description"
        description = str(parameter(full_name, ""))  # URDF
        if description and description != self._description:
            self._description = description
            self._scene.draw_robot(description)
            self._recorder.robot_name = self._scene.robot_name
            # `draw_robot` has made new nodes in the scene, which do not react to the mouse yet
            self._mouse.bind_robot()

    def _ask_for_topics(self) -> Tuple[Master, List[Tuple[str, str]]]:
        """Ask the master whether it knows this node, and for the name and type of each published topic.

        Without an answer, the list is empty.
        """
        # `look` sets `is_lost` if the master does not know this node, and returns None without an answer
        if self._registration.look() is None:
            return Master.IS_SILENT, []
        published = self._ask("getPublishedTopics", "")
        if published is None:
            return Master.IS_SILENT, []
        master = Master.IS_NEW if self._registration.is_lost else Master.KNOWS_NODE
        return master, [(name, kind) for name, kind in published]

    def _ask(self, method: str, *arguments: Any) -> Any:
        """Call a method of the master; return its value, or None if it fails or takes MASTER_DEADLINE."""
        uri, name = rosgraph.get_master_uri(), rospy.get_name()
        return ask(uri, method, name, *arguments, deadline=MASTER_DEADLINE)

    def _update(self) -> None:
        """Draw the new messages in the view, move the cameras of the pages, and record the pose."""
        self._scene.update(self._topics)
        self._objects.update(self._topics.take_all("objects"))
        base = self._scene.base
        for page in self._pages.open.values():
            page.update(base, self._numbers.pillar)
        self._recorder.tick(self._numbers.time, base, self._numbers.pillar)

    def _show_readings(self) -> None:
        """Show the numbers that change slowly, and the name of the world."""
        numbers = self._numbers
        # the numbers have the order of `drive_tab.READINGS`; the rate of the clock is the real-time factor,
        # simulated time per wall time
        readings = (numbers.bearing, numbers.clock.rate, numbers.scans.rate)
        self._drive.update(readings, self._is_paused)
        self._world.show_loaded(self._world_name)

    def _take_numbers(self, now: float) -> None:
        """Take in the new messages with numbers, diagnostics and commands; `now` is wall time [s]."""
        numbers = self._numbers
        if self._is_paused:
            # a paused simulator sends no odometry, and the state bar must not report this as a fault
            numbers.expect_silence(now)
        numbers.take(self._topics, self._scene, now)
        self._drive.take([msg for _, msg in self._topics.take_all("diagnostics")], now, numbers.time)
        self._drivers.take(self._topics.take_all("inputs"), numbers.time, now)

    def _show_state(self, now: float) -> None:
        """Show who drives the robot, what the robot does, and why it stands; `now` is wall time [s]."""
        numbers = self._numbers
        controller = self._drive.controller_status()
        if self._teleop.is_locked:  # the emergency stop is the reason for the stop, and not a warning
            self._reason.forget()
        else:
            self._reason.update(controller.state, numbers.time, self._log.warning)
        obeyed = self._drivers.command(numbers.time, now)  # command that the robot obeys, or None
        other_driver = ""  # name of the node that has sent this command, if it is not the controller
        if obeyed is not None and obeyed.sender != self._config.controller:
            other_driver = short_name(obeyed.sender)
        self._state_bar.update(
            RobotStatus(
                is_locked=self._teleop.is_locked,
                has_listener=self._teleop.has_listener,
                is_master_gone=self._master is not Master.KNOWS_NODE,
                is_paused=bool(self._is_paused),
                is_silent=numbers.is_silent(now),
                # name of the object that a page moves; it stays until the robot has had time to notice this
                moving=self._moving.text(numbers.time, now),
                # a person drives with a page of this node, or with another node
                is_by_hand=self._teleop.is_held or (obeyed is not None and obeyed.is_by_hand),
                driver=other_driver,
                level=controller.level,
                activity=controller.state,
                fault=controller.fault,
                reason=self._reason.text,
            ),
            Figures(numbers.distance, numbers.speed, numbers.time),
            now,
        )

    def _on_parameter(self, change: str) -> None:
        """Mark the change of a parameter in the curves, at the present simulated time."""
        if self._numbers.time is not None:
            self._plots.mark(self._numbers.time, change)

    def _on_paused(self, msg: Bool) -> None:
        """Keep whether simulated time is paused."""
        self._is_paused = msg.data


def read_rosout() -> str:
    """Return the end of rosout.log, the log of this ROS network; empty if the file is not on this machine."""
    try:
        file = Path(rospkg.get_log_dir()) / str(parameter("/run_id", "")) / "rosout.log"
        with file.open("rb") as log:
            log.seek(max(0, file.stat().st_size - ROSOUT_BYTES))
            return log.read().decode(errors="replace")
    except OSError:
        return ""


def title(robot: str, world: str) -> str:
    """Return the title of the page: the robot and the file of its world, as far as they are known.

    `robot` is the robot's name in its URDF, and `world` is a path; both are empty if unknown.
    """
    name = load_robot(robot).title if robot in ROBOTS else robot.replace("_", " ")
    name = name or "Husky"
    return f"{name} in {Path(world).stem}" if world else name


def give_memory_back() -> None:
    """Return freed memory to the operating system, because the C library would keep it for this process."""
    gc.collect()
    with contextlib.suppress(AttributeError, OSError):  # malloc_trim exists only in the GNU C library
        ctypes.CDLL(None).malloc_trim(0)


def _topic_names(config: WebConfig) -> Dict[str, str]:
    """Return the full names of the topics that the page reads, by use."""
    names = {
        "scan": config.scan_topic,
        "cloud": config.cloud_topic,
        "odometry": config.odometry_topic,
        "truth": config.truth_topic,
        "command": config.command_topic,
        "error": f"{config.controller}/error",
        "pillar": f"{config.controller}/pillar",
    }
    return {use: rospy.resolve_name(name) for use, name in names.items()}


def main() -> None:
    """Run the node."""
    run_node("husky_web", WebNode, listen_to_clock=False)
