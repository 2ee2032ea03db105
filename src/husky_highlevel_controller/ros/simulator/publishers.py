"""Publishers of the simulator: the robot's topics at the robot's rates.

The simulator also publishes the transforms of the robot's frames. On a real robot, robot_state_publisher
publishes them. But robot_state_publisher (1.15.2) asks the ROS master twice for each message, and this took,
in both processes together, half as much CPU time as a whole simulator.
"""

from __future__ import annotations

from math import gcd
from typing import Any, Callable, List, Optional, Set, Tuple

import numpy as np
import rospy
from geometry_msgs.msg import TwistStamped, Vector3Stamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState, LaserScan, MagneticField, NavSatFix, PointCloud2
from tf2_msgs.msg import TFMessage

from husky_highlevel_controller.datatypes import OdometrySample, Pose, Scan, Snapshot
from husky_highlevel_controller.geometry import inverse, pose_from_2d, world_in_odom
from husky_highlevel_controller.msg import Bumps
from husky_highlevel_controller.robot import RobotTopics
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.clouds import points_to_msg
from husky_highlevel_controller.ros.fast_messages import MovingTree
from husky_highlevel_controller.ros.node import publish
from husky_highlevel_controller.ros.simulator.truth_log import TruthLog
from husky_highlevel_controller.simulator.models.robot_model import RobotModel
from husky_highlevel_controller.simulator.simulator_config import ODOMETRY_RATE, SimulatorConfig, steps_per

WORLD, ODOM, BASE = "world", "odom", "base_link"
STATE_PUBLISHER = "robot_state_publisher"
# number of messages that wait for a slow subscriber; older ones are dropped, so a subscriber that hangs
# cannot stop the simulation
QUEUE = 200
# [s] After each change of the world in a pause, transforms are sent with a stamp that is later by this. It is
# much shorter than a physics step.
LATER = 1e-6


class Publishers:
    """Publishes snapshots; no message is made for a topic without a subscriber."""

    def __init__(self, config: SimulatorConfig, robot: RobotModel) -> None:
        """Advertise all topics of the robot, as far as it has the sensors for them.

        Raises:
            HuskyError: a rate does not divide the rate of the physics.
        """
        # numbers of physics steps between two messages about the robot's state; a real base reports the state
        # of its wheels less often
        self.state_steps = steps_per(ODOMETRY_RATE, config.physics_rate, "the rate of odometry")
        wheel_rate = config.real.base.control_rate if config.real else ODOMETRY_RATE
        self._wheel_steps = steps_per(wheel_rate, config.physics_rate, "the rate of wheel odometry")
        scan_steps = steps_per(config.scan_rate, config.physics_rate, "scan_rate")
        # [s] Shortest time between two messages on /clock. Such a message comes with each state and with each
        # scan. If a state comes every 20 ms, and a scan every 25 ms, this time is 5 ms, from 20 to 25 ms.
        self._clock_period = gcd(self.state_steps, scan_steps) / config.physics_rate

        # stamp [s] and sample of the odometry that was published last
        self._last_odometry: Optional[Tuple[float, OdometrySample]] = None
        self._kept_scan: Optional[Scan] = None  # scan for nodes that subscribe before simulated time begins
        # [s] stamp of the transforms that `show_change` has sent last. Simulated time stands still in a
        # pause, but TF ignores a second transform with the same stamp, so this stamp is later than simulated
        # time.
        self._shown_stamp = 0.0
        # bodies that the robot has touched since the last message on the topic bumps
        self._bumped_bodies: Set[str] = set()
        # connections to the subscribers of /tf at the last check for new subscribers
        self._transform_connections: List[Any] = []
        # true if another node estimates the pose of the robot, and publishes the filtered odometry and the
        # transform odom -> base_link in place of this node; any thread may set it
        self.has_other_filter = False

        # true if nodes take the time from /clock; otherwise they use wall time
        self.uses_simulated_time = bool(rospy.get_param("/use_sim_time", False))
        self.truth_log = TruthLog()
        self.clock = rospy.Publisher("/clock", Clock, queue_size=QUEUE)

        self._advertise_transforms(robot)
        self._advertise_sensors(config, robot)
        self._advertise_state(config.robot.topics)
        self._set_time(rospy.Time())  # simulated time begins at 0

    def _advertise_transforms(self, robot: RobotModel) -> None:
        """Advertise the topics of TF, publish the fixed transforms, and make the messages for /tf."""
        self._wheels = robot.wheels
        # names of all frames that this node publishes; a marker of another node in any other frame causes a
        # warning
        self.frames = {ODOM, BASE, *robot.fixed_poses, *(wheel.link for wheel in robot.wheels)}
        self.transforms = rospy.Publisher("/tf", TFMessage, queue_size=QUEUE)
        base, wheels = [(ODOM, BASE)], [(BASE, wheel.link) for wheel in robot.wheels]
        # Messages for /tf, which are made only once, because making a message takes time. Another node may
        # publish the transform odom -> base_link, or the transforms of the wheels, so there are three
        # messages. A key says whether the message has odom -> base_link, and whether it has the wheels.
        self._moving_trees = {
            (True, False): MovingTree(base),
            (False, True): MovingTree(wheels),
            (True, True): MovingTree(base + wheels),
        }
        self.fixed_transforms = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
        self.fixed_transforms.publish(conversions.tree_to_msg(robot.fixed_joints, 0.0))

    def _advertise_sensors(self, config: SimulatorConfig, robot: RobotModel) -> None:
        """Advertise the topics of the lidars, the joints, the IMU and the GPS, as far as the robot has them.

        Raises:
            HuskyError: the rate of the point clouds does not divide the rate of the physics.
        """
        topics = config.robot.topics
        self.scan: Optional[rospy.Publisher] = None  # stays None for a robot without a lidar
        if robot.laser_frame in robot.fixed_poses:
            self.scan = rospy.Publisher(topics.scan, LaserScan, queue_size=QUEUE)
        self.joints = rospy.Publisher("joint_states", JointState, queue_size=QUEUE)
        # Rows for `publish`, one for each topic: name of the field of the snapshot that has the sample,
        # publisher, function that makes the message, and the arguments of this function after the sample.
        self._sensors: List[Tuple[str, rospy.Publisher, Callable[..., Any], Tuple]] = []

        def advertise(topic: str, kind: Any, field: str, make: Callable[..., Any], *args: Any) -> None:
            """Advertise a topic; its messages are `make(sample, *args)` of the samples in a field."""
            self._sensors.append((field, rospy.Publisher(topic, kind, queue_size=QUEUE), make, args))

        # the last argument of each call is the frame of the message; `config.gps.drift` gives the
        # covariance of the fix
        advertise(topics.imu, Imu, "imu", conversions.imu_to_msg, config.robot.imu_mount.frame)
        if config.real:  # the IMU of a real Husky also publishes raw samples and the magnetic field
            advertise("imu/data_raw", Imu, "imu", conversions.imu_to_raw_msg, BASE)
            advertise("imu/mag", MagneticField, "mag", conversions.mag_to_msg, BASE)
        if config.gps_rate:
            advertise("navsat/fix", NavSatFix, "gps", conversions.fix_to_msg, config.gps.drift, BASE)
            advertise("navsat/vel", Vector3Stamped, "gps", conversions.fix_velocity_to_msg, BASE)
        self._points: Optional[rospy.Publisher] = None  # None if the lidar measures no point clouds
        if config.points_rate and self.scan:
            self._points = rospy.Publisher(topics.points, PointCloud2, queue_size=QUEUE)
            self._points_steps = steps_per(config.points_rate, config.physics_rate, "points_rate")
            self._points_frame = robot.laser_frame

    def _advertise_state(self, topics: RobotTopics) -> None:
        """Advertise the topics of the robot's state, and outside graded runs those of its true pose."""
        self._odometry = rospy.Publisher(topics.odometry, Odometry, queue_size=QUEUE)
        # full name of the topic of the filtered odometry; another node may publish this topic in place of the
        # simulator
        self.filter_topic = self._odometry.resolved_name
        self._wheel_odometry = rospy.Publisher(topics.wheel_odometry, Odometry, queue_size=QUEUE)
        # the command after the limits of the robot were applied; the wheels follow it
        self._command = rospy.Publisher(topics.limited_command, TwistStamped, queue_size=QUEUE)
        # true pose of the robot, and its transforms; None in a run that is graded
        self._truth: Optional[rospy.Publisher] = None
        self._world_transforms: Optional[rospy.Publisher] = None
        if not self.is_graded:  # a graded program must not get the true poses
            # The true poses have a topic of their own. On /tf, they would give the frame odom a parent. But
            # odom can have only one parent, and a localization node may publish it, as on a real Husky.
            self._world_transforms = rospy.Publisher("~world_tf", TFMessage, queue_size=QUEUE, latch=True)
            self._truth = rospy.Publisher("ground_truth/odom", Odometry, queue_size=QUEUE)
        self._bumps = rospy.Publisher("bumps", Bumps, queue_size=QUEUE)

    @property
    def is_graded(self) -> bool:
        """Return whether this run is graded; if so, no topic has true poses, and no node gets hints.

        The graded program could use them. A run is graded if a recorder reads the true poses.
        """
        return self.truth_log.is_open

    def publish(self, snapshot: Snapshot, on_clock: Callable[[], None] = lambda: None) -> bool:
        """Publish the samples of a snapshot. Return whether /clock was published.

        The order is /clock, transforms, scan, and then all other topics. A controller needs only the first
        three for its answer to a scan, so it can begin early. `on_clock` is called after the message on
        /clock was sent.
        """
        # a snapshot with a scan always has odometry, but the robot's state is published only at some steps
        is_state_due = snapshot.step % self.state_steps == 0
        odometry = snapshot.odometry if is_state_due else None  # None if the state is not published now
        is_tick = odometry is not None or snapshot.scan is not None  # true if this step publishes /clock
        if odometry is not None:
            self.truth_log.write(snapshot)  # must come before /clock
        if is_tick:
            self.publish_clock(snapshot.stamp)
            on_clock()
        if odometry is not None:
            self._last_odometry = snapshot.stamp, odometry
            # a robot_state_publisher, if one runs, publishes the transforms of the wheels itself
            with_wheels = snapshot.step % self._wheel_steps == 0 and not self._has_state_publisher()
            self._publish_transforms(snapshot.stamp, odometry, with_wheels)
        if snapshot.scan is not None:
            self.publish_scan(snapshot.scan)
        self._bumped_bodies.update(snapshot.contacts)
        if odometry is not None:
            self._publish_state(snapshot, odometry)
        for field, publisher, make, args in self._sensors:
            sample = getattr(snapshot, field)
            if sample is not None:
                publish_if_subscribed(publisher, make, sample, *args)
        return is_tick

    def _publish_transforms(self, stamp: float, odometry: OdometrySample, with_wheels: bool) -> None:
        """Publish odom -> base_link if no other filter runs, and the wheels if `with_wheels`.

        The stamp of the transforms is `stamp` [s]. If neither is to be sent, nothing is published.
        """
        with_base = not self.has_other_filter  # read only once, because another thread may set it now
        if with_base or with_wheels:
            publish_if_subscribed(
                self.transforms, self._moving_tree_to_msg, stamp, odometry, with_base, with_wheels
            )

    def leave_filter_to(self, node: str) -> None:
        """Stop publishing the filtered odometry and the transform of odom, because `node` publishes them.

        Any thread may call this.
        """
        self.has_other_filter = True
        rospy.loginfo(
            f"{node} publishes {self.filter_topic}, so the simulator leaves it and {ODOM} -> {BASE} to {node}"
        )

    def send_last_transforms(self) -> None:
        """Send the last transforms to new subscribers of /tf, such as an RViz that is opened in a pause.

        Without this call they would get no transforms while time stands still. Only the thread that publishes
        may call this. rospy has one buffer for all messages of a publisher, and two threads would mix their
        messages in the buffer.
        """
        if self._last_odometry is None:  # no transforms were published so far
            return
        publisher = self.transforms.impl
        connections = publisher.connections
        # rospy makes a new list whenever a connection is added or removed, so the same list means no new
        # subscribers
        if connections is self._transform_connections:
            return
        self._transform_connections = connections
        stamp, odometry = self._last_odometry
        # at time 0, this node sends the wheels even if a robot_state_publisher runs, which sends none then
        with_wheels = self._has_wheels_in_pause(stamp)
        with_base = not self.has_other_filter  # read only once, because another thread may set it now
        if with_base or with_wheels:  # otherwise other nodes publish all transforms
            self._send_to_new(publisher, self._moving_tree_to_msg(stamp, odometry, with_base, with_wheels))

    def _has_wheels_in_pause(self, stamp: float) -> bool:
        """Return whether this node sends the wheels' transforms in a pause that is at the time `stamp` [s].

        If a robot_state_publisher runs, it sends these transforms in place of this node. But it sends none at
        time 0, and a simulator that starts with a pause is at time 0.
        """
        return stamp == 0.0 or not self._has_state_publisher()

    @staticmethod
    def _send_to_new(publisher: Any, message: Any) -> None:
        """Send a message only to the subscribers that have not had any message of this publisher.

        The other subscribers have this message already, and TF would warn of a repeated transform.
        """
        for connection in publisher.connections:
            if connection.stat_num_msg == 0:  # rospy counts the messages of each connection
                publish(publisher, message, connection_override=connection)

    def keep_for_new_subscribers(self, snapshot: Snapshot) -> None:
        """Keep transforms and scan of the start, which new subscribers get until time begins."""
        if snapshot.odometry is not None:
            self._last_odometry = snapshot.stamp, snapshot.odometry
            if self._world_transforms:  # a latched topic, so new subscribers get this message later
                publish(self._world_transforms, self._world_tree_to_msg(snapshot, snapshot.odometry))
        self._kept_scan = snapshot.scan

    def show_change(self, snapshot: Snapshot) -> None:
        """Publish the transforms after a change of the world in a pause, such as a move of the robot.

        New subscribers first get the transforms with simulated time as their stamp. Then all subscribers get
        the transforms with a stamp that is later than simulated time by LATER, and by LATER more after each
        further change. Scan and odometry are also kept for later subscribers.
        """
        odometry = snapshot.odometry
        assert odometry is not None  # a snapshot that is taken in a pause always has odometry
        self._kept_scan = snapshot.scan
        self._last_odometry = snapshot.stamp, odometry
        # without this message, a new subscriber could not look up a transform at simulated time
        self.send_last_transforms()
        # TF would ignore a second transform with the same stamp, but simulated time stands still
        self._shown_stamp = max(snapshot.stamp, self._shown_stamp) + LATER
        if self._world_transforms:
            later = snapshot._replace(stamp=self._shown_stamp)
            publish(self._world_transforms, self._world_tree_to_msg(later, odometry))
        with_wheels = self._has_wheels_in_pause(snapshot.stamp)
        self._publish_transforms(self._shown_stamp, odometry, with_wheels)

    def send_kept_scan(self) -> None:
        """Send the scan that was kept to new subscribers; only the thread that publishes may call this."""
        if self.scan and self._kept_scan is not None:
            self._send_to_new(self.scan.impl, conversions.scan_to_msg(self._kept_scan))

    def publish_scan(self, scan: Scan) -> None:
        """Publish a scan, if the robot has a lidar."""
        if self.scan:
            publish_if_subscribed(self.scan, conversions.scan_to_msg, scan)

    def publish_points(self, snapshot: Snapshot, measure: Callable[[], np.ndarray]) -> None:
        """Publish the points of the 3D lidar if they are due at this step.

        `measure` casts the rays and returns the points. This takes time, so it is called only if the points
        are due and have a subscriber.
        """
        if self._points and snapshot.step % self._points_steps == 0:
            publish_if_subscribed(
                self._points,
                lambda: points_to_msg(measure(), snapshot.stamp, self._points_frame),
            )

    def _publish_state(self, snapshot: Snapshot, odometry: OdometrySample) -> None:
        """Publish the state of the robot: joints, odometry, limited command, true poses and bumps.

        Joints and wheel odometry are published only at the steps at which the base reports its wheels. The
        filtered odometry is published only if no other node estimates the pose.
        """
        stamp = snapshot.stamp
        if snapshot.step % self._wheel_steps == 0:
            publish_if_subscribed(self.joints, conversions.wheels_to_msg, odometry.wheels, stamp)
            publish_if_subscribed(
                self._wheel_odometry, conversions.odometry_to_msg, odometry.from_wheels, stamp, ODOM, BASE
            )
        if not self.has_other_filter:
            publish_if_subscribed(
                self._odometry, conversions.odometry_to_msg, odometry.filtered, stamp, ODOM, BASE
            )
        publish_if_subscribed(self._command, conversions.twist_to_stamped_msg, snapshot.command, stamp)
        if self._world_transforms:
            publish_if_subscribed(self._world_transforms, self._world_tree_to_msg, snapshot, odometry)
        if self._truth:
            publish_if_subscribed(self._truth, conversions.truth_to_msg, snapshot.robot, stamp, WORLD, BASE)
        publish_if_subscribed(
            self._bumps, lambda: Bumps(conversions.header(stamp, BASE), sorted(self._bumped_bodies))
        )
        self._bumped_bodies.clear()

    def _moving_tree_to_msg(
        self, stamp: float, odometry: OdometrySample, with_base: bool, with_wheels: bool
    ) -> MovingTree:
        """Return a /tf message: odom -> base_link if `with_base`, and the wheels if `with_wheels`.

        At least one of the two is true. The stamp of the transforms is `stamp` [s]. All are in one message,
        because each message costs a system call and wakes every subscriber.
        """
        poses = [pose_from_2d(odometry.filtered.pose_base_in_odom)] if with_base else []
        if with_wheels:
            poses += self._wheel_poses(odometry)
        tree, now = self._moving_trees[with_base, with_wheels], conversions.time_to_msg(stamp)
        tree.move(now.secs, now.nsecs, poses)
        return tree

    def _world_tree_to_msg(self, snapshot: Snapshot, odometry: OdometrySample) -> TFMessage:
        """Return a message with the true pose of the robot in the world, its wheels, and the pose of odom.

        The pose of odom shows how far the filtered odometry has drifted from the true pose.
        """
        base_in_world = snapshot.robot.pose_in_world
        odom_in_world = inverse(world_in_odom(base_in_world, odometry.filtered.pose_base_in_odom))
        wheels = zip(self._wheels, self._wheel_poses(odometry))
        tree = [(WORLD, BASE, base_in_world), (WORLD, ODOM, odom_in_world)]
        tree += [(BASE, wheel.link, pose) for wheel, pose in wheels]
        return conversions.tree_to_msg(tree, snapshot.stamp)

    def _wheel_poses(self, odometry: OdometrySample) -> List[Pose]:
        """Poses of the wheels in base_link."""
        return [wheel.pose_at(angle) for wheel, angle in zip(self._wheels, odometry.wheels.angles)]

    def _has_state_publisher(self) -> bool:
        """Return whether a robot_state_publisher runs, which publishes the transforms of the wheels itself.

        TF would warn of each transform that is sent by both nodes. A robot_state_publisher is a subscriber of
        joint_states, so it is found among the connections of this topic.
        """
        return any(link.endpoint_id.endswith(STATE_PUBLISHER) for link in self.joints.impl.connections)

    def publish_clock(self, stamp: float) -> None:
        """Set the time [s] of this node, which does not subscribe to /clock, and publish the time.

        During a pause this call is repeated, so it also sends the last transforms to new subscribers of /tf.
        """
        now = conversions.time_to_msg(stamp)
        self._set_time(rospy.Time(now.secs, now.nsecs))
        publish_if_subscribed(self.clock, Clock, now)
        self.send_last_transforms()

    def publish_clock_between_ticks(self, stamp: float) -> None:
        """Publish a time shortly before the next tick of /clock, to wake nodes that sleep between two ticks.

        `stamp` [s] is the time of the last tick.
        """
        self.publish_clock(stamp + 0.95 * self._clock_period)

    def _set_time(self, now: rospy.Time) -> None:
        """Set rospy's time of this process, if the node uses simulated time."""
        if self.uses_simulated_time:
            # Private function of rospy, which rospy's own subscriber of /clock also calls. A subscription to
            # /clock would cost the simulator 3 % more CPU time in lockstep, and would set the time too late.
            rospy.rostime._set_rostime(now)


def publish_if_subscribed(publisher: rospy.Publisher, make: Callable[..., Any], *args: Any) -> None:
    """Publish the message `make(*args)`; without a subscriber, it is not even made, which saves time."""
    if publisher.get_num_connections():
        publish(publisher, make(*args))
