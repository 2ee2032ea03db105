"""Simulated robot as a ROS node; docs/reference.md lists its topics, services and parameters."""

from __future__ import annotations

import os
import sys
import threading
import time
from functools import partial
from typing import Any, Callable, List, Optional, Set

import rosgraph
import rospy
from std_msgs.msg import Bool
from std_srvs.srv import Empty, Trigger

from husky_highlevel_controller import srv
from husky_highlevel_controller.config import ConfigError
from husky_highlevel_controller.datatypes import HuskyError, Snapshot, World
from husky_highlevel_controller.robot import Robot
from husky_highlevel_controller.ros.master_graph import read_graph
from husky_highlevel_controller.ros.node import contained, run_node
from husky_highlevel_controller.ros.registration import RegistrationWatch
from husky_highlevel_controller.ros.simulator.base_status import BaseStatus
from husky_highlevel_controller.ros.simulator.call_queue import CallQueue
from husky_highlevel_controller.ros.simulator.commands import Commands
from husky_highlevel_controller.ros.simulator.depth_camera import DepthCamera
from husky_highlevel_controller.ros.simulator.findings import Findings
from husky_highlevel_controller.ros.simulator.gazebo_services import GazeboServices
from husky_highlevel_controller.ros.simulator.graph import (
    GraphWatch,
    Partners,
    SecondFilter,
    launched_nodes,
    launched_nodes_of_others,
)
from husky_highlevel_controller.ros.simulator.listeners import Listeners
from husky_highlevel_controller.ros.simulator.lockstep import PARTNERS_POLL_PERIOD, LeadLimit, Lockstep
from husky_highlevel_controller.ros.simulator.marker_frames import MarkerFrames
from husky_highlevel_controller.ros.simulator.one_simulator import running_simulator, why_not_two
from husky_highlevel_controller.ros.simulator.parameters import read_parameters, read_robot_description
from husky_highlevel_controller.ros.simulator.publishers import Publishers
from husky_highlevel_controller.ros.simulator.rviz_windows import is_rviz, without_window
from husky_highlevel_controller.ros.simulator.world_display import WorldDisplay
from husky_highlevel_controller.ros.simulator.world_services import WorldServices
from husky_highlevel_controller.simulator.arrival_watch import (
    Arrival,
    ArrivalWatch,
    PillarPlace,
    arrival_sentence,
    pillar_of,
)
from husky_highlevel_controller.simulator.diff_drive import CommandError
from husky_highlevel_controller.simulator.ground import with_ground
from husky_highlevel_controller.simulator.models.description import CAMERA_FRAME, variables_without_effect
from husky_highlevel_controller.simulator.models.robot_model import RobotModel, robot_model
from husky_highlevel_controller.simulator.models.sdf_world import find_world, load_world
from husky_highlevel_controller.simulator.pacing import Pacer
from husky_highlevel_controller.simulator.sensors.depth_camera import CameraSetup
from husky_highlevel_controller.simulator.simulation import Simulation
from husky_highlevel_controller.simulator.simulator_config import SimulatorConfig, steps_per

MAX_STEPS = 100_000  # largest number of physics steps that one request of ~step may ask for
# if the machine reaches less than this fraction of the requested real-time factor, a warning is logged
SLOW_FRACTION = 0.9
PAUSE_POLL_PERIOD = 0.05  # [s] longest wait for a service call during a pause; then /clock is published again
# [s] longest wait for the other launched nodes, if the real-time factor is unlimited; then time begins
# without them
LAUNCH_TIMEOUT = 10.0
RVIZ_TIMEOUT = 30.0  # [s] longest wait until the RViz of the same launch has opened its window
# [s] wall time between two checks of RViz; more checks would slow down the start of RViz
RVIZ_POLL_PERIOD = 0.2


class SimulatorNode:
    """Owns the simulation in the thread that calls `run`; callbacks queue commands and service calls."""

    def __init__(self) -> None:
        """Read the parameters, build the simulation, and advertise its topics; time begins in `run`.

        Raises:
            HuskyError: a parameter, the world or the robot description cannot be used.
        """
        # `start` has the world, the start pose and the pace; `config` has rates, robot and sensors
        start, config, depth_camera = read_parameters()
        self._start = start
        self._paused = start.paused  # true while simulated time stands still
        # says how long to sleep so that simulated time passes at the requested real-time factor
        self._pacer = Pacer(start.real_time_factor, 0.0, time.monotonic())
        # this topic is latched, so a web page that is opened later also knows whether the world is paused
        self._paused_topic = rospy.Publisher("~paused", Bool, queue_size=1, latch=True)
        self._paused_topic.publish(start.paused)
        robot = robot_model(read_robot_description(), config.robot, start.laser_frame)
        self._publishers = Publishers(config, robot)
        if start.lockstep and not self._publishers.scan:
            raise ConfigError(
                f"{rospy.get_name()}/lockstep = True, but the robot has no lidar, and lockstep waits for "
                "answers to its scans: let laser_enabled be true, or lockstep false"
            )
        # config.real is None if Gazebo's Husky is simulated; only the base of a real Husky publishes its
        # status
        self._status = BaseStatus(config.real.base.control_rate) if config.real else None
        world = self._read_world(start.world_name)

        # events of the run that are logged only once
        self._has_fallen = False  # true while the robot is far below its start
        self._touched: Set[str] = set()  # names of the objects that the robot has touched since the start
        self._arrival = ArrivalWatch(config.robot.footprint)  # detects an arrival at a pillar
        # true if the node arrival_exit was launched; it logs the arrival, so this node does not
        self._has_arrival_exit = rospy.has_param("arrival_exit/deadline")

        self._simulation = Simulation(world, robot, config, start.pose, start.seed, start_height=start.z)
        self._camera = self._make_camera(depth_camera, robot, config) if start.kinect_enabled else None
        self._listen_to_controllers(config.robot)
        # the program that records a run for grading gets a line about each service call that changes the
        # world
        self._calls = CallQueue(partial(self._publishers.truth_log.write_line, "changed"))
        self._offer_services(config.robot.name)
        ignored_variables = variables_without_effect(os.environ)
        if ignored_variables:
            rospy.logwarn("ignored by this simulator: %s", ", ".join(ignored_variables))
        rospy.loginfo(
            "simulating '%s' with %d bodies, physics at %d Hz%s",
            world.name, len(world.bodies), config.physics_rate, ", paused" if start.paused else "",
        )  # fmt: skip

    def _listen_to_controllers(self, robot: Robot) -> None:
        """Subscribe to commands, and prepare the waits of simulated time for slow controllers."""
        self._lockstep = Lockstep(
            self._start.lockstep,
            # shows whether the nodes that read the scans or the clock have finished their work
            Listeners(self._publishers.scan, self._publishers.clock),
            # the program that records a run for grading gets a line about each scan that was not answered
            self._publishers.truth_log.write_line,
        )
        # at unlimited speed without lockstep, the simulation could run far ahead of a slow controller, so
        # this limit makes the simulation wait
        self._lead_limit = LeadLimit(self._start.has_unlimited_speed and not self._start.lockstep)
        self._findings = Findings()  # mistakes of other nodes, for the log and for ./dev doctor
        self._commands = Commands(robot, self._lockstep, self._lead_limit, self._findings)
        # if the ROS master no longer knows this node, no new program can stop the robot, so all commands are
        # refused
        self._registration = RegistrationWatch(self._commands.refuse)

    def _make_camera(self, setup: CameraSetup, robot: RobotModel, config: SimulatorConfig) -> DepthCamera:
        """Make the depth camera; ConfigError if the robot has no frame for it, or the rate is not valid."""
        if CAMERA_FRAME not in robot.fixed_poses:
            raise ConfigError(
                f"{rospy.get_name()}/kinect_enabled = True, but robot_description has no '{CAMERA_FRAME}'"
            )
        steps = steps_per(setup.camera_rate, config.physics_rate, "camera_rate")
        return DepthCamera(setup.camera, robot.fixed_poses[CAMERA_FRAME], steps, wait=self._start.lockstep)

    def run(self) -> None:
        """Simulate until the node is shut down.

        Simulated time begins when the other nodes are connected. During a pause, the node serves service
        calls, and repeats the time on /clock for nodes that start during the pause.
        """
        publishers, simulation = self._publishers, self._simulation
        self._watch_other_nodes()
        self._wait_for_other_nodes()
        self._set_stamp_to_wall_time_if_used()
        if self._paused:
            # no step is made during the pause, so the scan and the transforms of the start are kept for RViz
            # and other new subscribers
            publishers.keep_for_new_subscribers(simulation.look())
        start_stamp = simulation.stamp
        self._pacer.restart(simulation.stamp, time.monotonic())
        while not rospy.is_shutdown():
            # in a pause, this call waits for the next service call, so that the loop uses little CPU time
            self._calls.process(PAUSE_POLL_PERIOD if self._paused else 0.0)
            # true if a service call has changed the world, for example by moving the robot
            world_has_changed = self._calls.take_change()
            if self._paused:
                # the scan that was kept at the start is out of date after the first step
                self._publish_in_pause(world_has_changed, with_scan=simulation.stamp == start_stamp)
            else:
                has_published_clock = self._advance()
                # after each message on /clock, the node sleeps until wall time has caught up
                if has_published_clock:
                    self._keep_pace()
        if self._camera:
            self._camera.close()
        simulation.close()

    def _publish_in_pause(self, world_has_changed: bool, with_scan: bool) -> None:
        """Show changes of the world, and repeat the time and the kept scan, because nodes may start now.

        Args:
            world_has_changed: true if a service call has changed the world since the last call.
            with_scan: true if the kept scan is repeated; it is repeated only until the first step.
        """
        publishers, simulation = self._publishers, self._simulation
        if world_has_changed:
            publishers.show_change(simulation.look())
        publishers.publish_clock(simulation.stamp)
        # in lockstep, the scan is not sent, because lockstep would need an answer to it
        if with_scan and not self._start.lockstep:
            publishers.send_kept_scan()
        # otherwise the simulation would hurry after the pause, to catch up with wall time
        self._pacer.restart(simulation.stamp, time.monotonic())
        if self._display:
            self._display.refresh()

    def _watch_other_nodes(self) -> None:
        """Start the threads that look for mistakes in the ROS graph, and for the loss of the registration."""
        publishers, findings = self._publishers, self._findings
        # if another launched node estimates the pose, this node stops publishing the filtered odometry and
        # the transform of odom
        filter_watch = SecondFilter(publishers.filter_topic, publishers.leave_filter_to)
        # while a student's program is graded, the program gets no hints about its markers
        markers = None if publishers.is_graded else MarkerFrames(publishers.frames, findings.tell)
        GraphWatch(
            simulated_time=lambda: self._simulation.stamp,
            warn=rospy.logwarn,
            filter_watch=filter_watch,
            markers=markers,
            findings=findings,
        ).start()
        self._registration.start()

    def _wait_for_other_nodes(self) -> None:
        """Wait for the nodes that would miss the begin of simulated time.

        - RViz must be open, so that the user sees the begin of a run.
        - In lockstep, or at unlimited speed, a controller that starts late would miss the first scans.
        - In lockstep, the recorder of a graded run must also be ready.

        If the world starts paused, this method waits only in lockstep. Otherwise there is no need to wait,
        because simulated time begins only when a user ends the pause.
        """
        publishers = self._publishers
        # simulated time also waits for the subscribers of these topics, because a message that is lost at the
        # start changes the run
        others = [publishers.clock, publishers.transforms, publishers.fixed_transforms]
        partners = Partners(publishers.scan, others, self._commands.topic_names, self._commands.has_sender)
        if self._start.wait_for_rviz and not self._paused and not publishers.is_graded:
            # RViz also subscribes to these topics, so its window must open before the wait for `partners`
            # begins
            self._wait_for_rviz()
        if self._start.lockstep:
            self._lockstep.wait_for_partners(partners, meanwhile=self._serve_while_time_waits)
            publishers.truth_log.wait_to_begin(meanwhile=self._serve_while_time_waits)
        elif self._start.has_unlimited_speed and not self._paused:
            self._wait_for_launch(partners)

    def _set_stamp_to_wall_time_if_used(self) -> None:
        """Set the stamp of the simulation to the wall time if the nodes do not use simulated time.

        Such nodes ask TF for transforms at the present wall time, and would not find the transforms of a
        simulation that counts from 0.
        """
        if self._publishers.uses_simulated_time:
            return
        self._simulation.set_stamp(time.time())
        # otherwise the node would sleep until wall time has caught up with the new stamp
        self._pacer.restart(self._simulation.stamp, time.monotonic())
        if self._start.real_time_factor != 1.0:
            rospy.logwarn_once(
                "use_sim_time is false and real_time_factor is %g: stamps and ROS time drift apart; let "
                "use_sim_time be true, or real_time_factor be 1",
                self._start.real_time_factor,
            )

    def _serve_while_time_waits(self) -> None:
        """Serve service calls, and publish the time, which stands still, for nodes that have just started."""
        self._calls.process()
        self._publishers.publish_clock(self._simulation.stamp)

    def _wait_for_launch(self, partners: Partners) -> None:
        """Wait until the nodes of the launch are connected; needed at unlimited speed.

        Without this wait, ten simulated seconds may pass while a controller starts.
        """

        def missing() -> str:
            """Return a sentence on the launched nodes that have not joined; empty if nothing is missing."""
            if partners.joined():
                return ""
            # nodes that roslaunch has started, without the simulator's own nodes
            other_nodes = launched_nodes_of_others()
            if not other_nodes:  # no controller was launched, so there is nothing to wait for
                return ""
            topics = partners.command_topics
            if partners.scan_topic:  # the name is empty for a robot without a lidar
                topics = f"{partners.scan_topic} and {topics}"
            return f"{', '.join(sorted(other_nodes))} did not join on {topics}"

        self._keep_time_waiting(missing, LAUNCH_TIMEOUT, period=PARTNERS_POLL_PERIOD)

    def _wait_for_rviz(self) -> None:
        """Wait for the RViz that a launch file opens, because it shows the begin of a run."""
        master_uri, caller = rosgraph.get_master_uri(), rospy.get_name()
        begin = time.monotonic()
        has_rviz = False  # true if the launch has an RViz; without one, nothing is logged

        def missing() -> str:
            """Return a sentence on the RViz nodes without an open window; empty if there are none."""
            nonlocal has_rviz
            rviz_nodes = sorted(node for node in launched_nodes() if is_rviz(node))
            if rviz_nodes:
                has_rviz = True
            loading_nodes = without_window(master_uri, caller, rviz_nodes)
            return f"{', '.join(loading_nodes)} did not open its window" if loading_nodes else ""

        all_windows_are_open = self._keep_time_waiting(missing, RVIZ_TIMEOUT, period=RVIZ_POLL_PERIOD)
        if all_windows_are_open and has_rviz:
            rospy.loginfo(f"time begins: RViz draws, after {time.monotonic() - begin:.1f} s of wall time")

    def _keep_time_waiting(self, missing: Callable[[], str], timeout: float, period: float) -> bool:
        """Let simulated time stand still until nothing is missing, or until `timeout` [s] has passed.

        Args:
            missing: returns a sentence on what is missing, which is logged after the timeout; empty if
                nothing is missing.
            timeout: longest wait, wall time [s].
            period: wall time between two calls of `missing` [s].

        Returns:
            Whether nothing is missing any more.
        """
        end = time.monotonic() + timeout
        while not rospy.is_shutdown():
            sentence = missing()
            if not sentence:
                return True
            if time.monotonic() > end:
                rospy.loginfo(f"time begins: {sentence} within {timeout:g} s of wall time")
                break
            self._serve_while_time_waits()
            time.sleep(period)
        return False

    def _advance(self) -> bool:
        """Advance the physics by one step and publish its messages. Return whether /clock was published.

        Most steps publish nothing, because sensors and clock are slower than the physics. In lockstep, a step
        that publishes /clock (a tick) waits after this message until the controllers have done what they do
        at this tick. A step with a scan then sends the scan, and waits for the controller's answer.
        """
        self._obey_new_commands()
        # a field of the snapshot is None if its sensor has no sample at this step
        snapshot = self._simulation.step()
        self._notice_events(snapshot)
        if snapshot.scan is not None:
            self._lead_limit.before_scan()  # waits for a controller that has not answered the last scans
            self._lockstep.begin_scan()  # commands that come after this call count as answers to this scan
        # /clock is published first, if it is due; then `_hold_tick` waits for the controllers; then all other
        # messages follow
        has_published_clock = self._publishers.publish(snapshot, on_clock=self._hold_tick)
        self._publishers.publish_points(snapshot, self._simulation.points)
        self._gazebo.publish(snapshot)  # poses and velocities of all models, on the same topic as in Gazebo
        if snapshot.power is not None and self._status:
            self._status.update(snapshot.power, self._commands.e_stop_is_on, snapshot.stamp)
        if self._display:
            self._display.update(snapshot.stamp)  # markers of the world for RViz
        if self._camera:
            self._camera.update(self._simulation, snapshot)
        if snapshot.scan is not None:
            self._lockstep.wait_for_answer(
                self._serve_during_step,
                # the first answer may be lost while connections are made, so the scan is sent again
                resend=partial(self._publishers.publish_scan, snapshot.scan),
                # a controller that sleeps in simulated time wakes only if simulated time goes on
                nudge=partial(self._publishers.publish_clock_between_ticks, snapshot.stamp),
            )
        return has_published_clock

    def _obey_new_commands(self) -> None:
        """Give the simulation the commands that have come since the last step; warn of invalid ones."""
        for topic, twist in self._commands.take(self._simulation.stamp):
            try:
                self._simulation.command(twist)
            except CommandError as error:  # the command is not valid; its speed may be NaN
                rospy.logwarn_throttle(1.0, f"{rospy.resolve_name(topic)}: {error}")

    def _hold_tick(self) -> None:
        """Wait, as long as lockstep requires it, until other nodes have reacted to the tick of /clock."""
        # lockstep may publish the same tick again, because a node that calls rospy.sleep may have missed it
        again = partial(self._publishers.publish_clock, self._simulation.stamp)
        self._lockstep.tick(self._serve_during_step, again)

    def _notice_events(self, snapshot: Snapshot) -> None:
        """Log what a user should know of a step: a fall, touches of objects, an arrival at a pillar."""
        self._notice_fall(snapshot)
        if snapshot.contacts:
            self._notice_touches(snapshot)
        if snapshot.odometry is not None:
            self._notice_arrival(snapshot)

    def _notice_fall(self, snapshot: Snapshot) -> None:
        """Log an error when the robot has fallen off the world, once for each fall."""
        has_fallen = self._simulation.has_fallen
        if has_fallen and not self._has_fallen:
            x, y, _ = snapshot.robot.pose_in_world.position
            rospy.logerr("the robot has fallen off the world near (%.1f, %.1f); ~reset puts it back", x, y)
        self._has_fallen = has_fallen

    def _notice_touches(self, snapshot: Snapshot) -> None:
        """Log the first touch of each object since the start or a reset, except in a run that is graded."""
        for name in sorted(set(snapshot.contacts) - self._touched):
            self._touched.add(name)
            if not self._publishers.is_graded:
                rospy.loginfo(f"the robot touches '{name}' at {snapshot.stamp:.2f} s of simulated time")

    def _notice_arrival(self, snapshot: Snapshot) -> None:
        """Log an arrival of the robot at a pillar, so that users of any controller learn about it.

        In a run that is graded, or if the node arrival_exit logs it, the arrival is not logged here.
        """
        arrival = self._arrival.update(snapshot.true_state, self._pillars)
        if arrival and not (self._has_arrival_exit or self._publishers.is_graded):
            # the thread asks the ROS master before it logs, which would delay the simulation
            threading.Thread(target=self._tell_arrival, args=(arrival, self._commands.driver)).start()

    @staticmethod
    def _tell_arrival(arrival: Arrival, driver: str) -> None:
        """Log an arrival, unless the node that drives (`driver`) announces its arrivals itself."""
        with contained("the announcement of an arrival"):
            graph = read_graph(rosgraph.get_master_uri())
            if graph is None or f"{driver}/arrived" not in graph.publishers:
                rospy.loginfo(arrival_sentence(arrival))

    def _pillars(self) -> List[PillarPlace]:
        """Return the bodies of the world that are pillars, at their present positions in the world."""
        pillars = []
        for name, body in self._simulation.bodies.items():
            # None if the body is not an upright cylinder
            pillar = pillar_of(body, self._simulation.pose_of(name))
            if pillar is not None:
                pillars.append(pillar)
        return pillars

    def _forget_touches_and_arrivals(self) -> None:
        """Let touches and arrivals be logged again; call this when the robot was put elsewhere."""
        self._touched.clear()
        self._arrival.forget()

    def _serve_during_step(self) -> None:
        """Serve calls and new subscribers while lockstep waits."""
        self._calls.process_during_step()
        self._publishers.send_last_transforms()

    def _keep_pace(self) -> None:
        """Sleep until wall time has caught up with simulated time; warn once if this machine is too slow."""
        stamp, now = self._simulation.stamp, time.monotonic()
        # None while simulated time is not late, or only so late that it can catch up. Otherwise, this is the
        # real-time factor that was reached, and the pace starts again from now.
        reached = self._pacer.lag(stamp, now)
        if reached is not None and reached < SLOW_FRACTION * self._start.real_time_factor:
            rospy.logwarn_once(
                f"this machine is too slow for real_time_factor {self._start.real_time_factor:g}: "
                f"reached {reached:.2f}; nothing is dropped, but simulated time passes more slowly",
            )
        delay = self._pacer.delay(stamp, now)
        if delay > 0.0:
            time.sleep(delay)

    def _offer_services(self, robot: str) -> None:
        """Advertise the services that read and change the world, under this node's and under Gazebo's names.

        In a run that is graded, RViz's markers and Gazebo's topics of true poses are left out.
        """
        self._world_services = WorldServices(self._simulation, self._calls)
        # while a student's program is graded, no topic may publish true poses, so None turns this topic off
        state_steps = None if self._publishers.is_graded else self._publishers.state_steps
        self._gazebo = GazeboServices(self._simulation, self._calls, robot, state_steps)
        self._display: Optional[WorldDisplay] = None
        if not self._publishers.is_graded:
            self._display = WorldDisplay(self._simulation, self._calls)
        # Each service has a name of this node and a name of Gazebo, and calls the function in the third
        # column. The last column is true if the service changes the world. Such a call waits for the end of
        # the present step, and the program that records a run for grading gets a line about the call.
        for name, gazebo_name, work, changes in (
            ("pause", "pause_physics", lambda _: self._set_paused(True), False),
            ("resume", "unpause_physics", lambda _: self._set_paused(False), False),
            ("reset", "reset_simulation", self._reset, True),
            ("reset_world", "reset_world", self._reset_poses, True),
        ):
            self._calls.offer(f"gazebo/{gazebo_name}", Empty, work, changes=changes, between_steps=changes)
            self._calls.offer(f"~{name}", Trigger, work, changes=changes, between_steps=changes)
        self._calls.offer("~step", srv.StepWorld, self._step, changes=True, between_steps=True)
        self._calls.offer("~load_world", srv.LoadWorld, self._load_world, changes=True, between_steps=True)

    def _set_paused(self, paused: bool) -> str:
        """Pause or resume the world, and return a sentence with the time for the response."""
        self._paused = paused
        self._paused_topic.publish(paused)
        # nodes without simulated time expect wall times as stamps, and wall time has passed during the pause
        self._set_stamp_to_wall_time_if_used()
        return f"{'paused at' if paused else 'running from'} {self._simulation.stamp:.3f} s"

    def _reset(self, _request: Any) -> str:
        """Reset robot and world, and return a sentence with the time for the response."""
        self._simulation.reset()
        self._commands.forget_commands()
        self._forget_touches_and_arrivals()
        return f"the world is as at the start; time continues from {self._simulation.stamp:.3f} s"

    def _read_world(self, name: str) -> World:
        """Read a world from its file, and add a ground if there is none below the start of the robot."""
        return with_ground(load_world(find_world(name)), self._start.pose, self._start.z)

    def _load_world(self, request: srv.LoadWorldRequest) -> str:
        """Load another world, and return a sentence for the response."""
        world = self._read_world(request.world_name)
        self._simulation.load_world(world)
        self._commands.forget_commands()
        self._forget_touches_and_arrivals()
        # the name of the world is a parameter, so that other nodes can read it
        rospy.set_param("~world_name", request.world_name)
        return f"'{world.name}' with {len(world.bodies)} bodies, the robot at the start"

    def _reset_poses(self, _request: Any) -> str:
        """Put robot and objects back to their first poses, and return a sentence for the response."""
        self._simulation.reset_poses()
        self._forget_touches_and_arrivals()
        return "the robot and every object are back at their first poses"

    def _step(self, request: srv.StepWorldRequest) -> str:
        """Advance the paused world by the requested number of steps, and return a sentence with the new time.

        Raises:
            HuskyError: the world is not paused, the number is out of range, or the node ends meanwhile.
        """
        steps = request.steps
        if not self._paused:
            raise HuskyError("the world is running; pause it before a step")
        if not 1 <= steps <= MAX_STEPS:
            raise HuskyError(f"steps = {steps} is not within 1..{MAX_STEPS}")
        for _ in range(steps):
            if rospy.is_shutdown():
                raise HuskyError("the simulator ends")
            self._advance()
        return f"{steps} steps; it is now {self._simulation.stamp:.3f} s"


def main() -> None:
    """Run the node."""
    master_uri = rosgraph.get_master_uri()
    simulator_name = running_simulator(master_uri)
    if simulator_name is not None:
        sys.exit(f"husky_simulator: {why_not_two(simulator_name, master_uri)}")
    # Commands come in threads of their own, so the threads must take turns quickly. At full speed, Python's
    # default switch interval of 5 ms would be 0.15 s of simulated time.
    sys.setswitchinterval(0.0005)
    run_node("husky_simulator", SimulatorNode, listen_to_clock=False)
