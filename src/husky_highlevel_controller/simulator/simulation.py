"""Simulation of a robot in a world: physics, drive and sensors.

In: a `World`, a robot description, velocity commands, a seed. Out: a `Snapshot` per step.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.datatypes import (
    Beams,
    Body,
    ModelMotion,
    Pose,
    Pose2D,
    PowerState,
    Snapshot,
    Twist2D,
    World,
)
from husky_highlevel_controller.geometry import (
    compose,
    pose_from_2d,
    pose_to_2d,
    rotate,
    world_in_odom,
)
from husky_highlevel_controller.simulator.bullet.robot import RobotWorld
from husky_highlevel_controller.simulator.bullet.world import ROBOT, PlacementError
from husky_highlevel_controller.simulator.chassis import Chassis
from husky_highlevel_controller.simulator.equipment import POINTS_STREAM, Equipment, equip
from husky_highlevel_controller.simulator.ground import FALL_DEPTH, MAX_DROP, floor_height, has_floor
from husky_highlevel_controller.simulator.models.robot_model import RobotModel
from husky_highlevel_controller.simulator.odometry import Odometer
from husky_highlevel_controller.simulator.sensors.raycast import cast_rays
from husky_highlevel_controller.simulator.simulator_config import ODOMETRY_RATE, SimulatorConfig, steps_per
from husky_highlevel_controller.simulator.world_objects import WorldObjects


class Simulation:
    """A robot in a world.

    `step()` advances one physics step. All random numbers come from `seed`. The same world, robot, config,
    start, seed and commands give the same snapshots, to the last bit.
    """

    def __init__(
        self,
        world: World,
        robot: RobotModel,
        config: SimulatorConfig,
        start: Pose2D,
        seed: int,
        start_height: float = 0.0,
    ) -> None:
        """Make the parts of the simulation, and build the world, with the robot on the floor at `start`.

        If `start_height` is a little above the floor (up to MAX_DROP), the robot starts there and falls to
        the floor, as in Gazebo.

        Args:
            world: bodies and gravity.
            robot: masses, wheels and frames.
            config: rates, sensors and limits; but `robot` gives the wheels' distance and radius.
            start: first pose of base_link in the world.
            seed: random seed of all noise.
            start_height: height of the start pose in the world [m]; the search for the floor begins here.

        Raises:
            HuskyError: a period is not a multiple of the physics step.
            PlacementError: a body cannot be simulated (a movable plane), or stands where the robot starts.
        """
        front_left, front_right, _, _ = robot.wheels
        self._drive_config = replace(
            config.robot.drive,
            wheel_separation=front_left.position[1] - front_right.position[1],
            wheel_radius=front_left.radius,
        )
        # the profile of a real robot names a ground (hard or soft), whose grip replaces the grip in Gazebo
        if config.real:
            ground = config.real.ground
            traction = replace(config.traction, friction=ground.friction, lateral_grip=ground.lateral_grip)
            config = replace(config, traction=traction)
        self._physics_rate = config.physics_rate  # [Hz]
        self.dt = 1.0 / config.physics_rate  # [s] duration of a physics step
        # number of physics steps from one sample of odometry to the next
        self._odometry_steps = steps_per(ODOMETRY_RATE, config.physics_rate, "the rate of odometry")
        self._world, self._robot, self._config = world, robot, config
        self._start_pose, self._seed = pose_from_2d(start, start_height), seed
        self._equipment = self._make_equipment()
        self._odometer = Odometer(self._drive_config, self.dt)
        self._bullet = RobotWorld(self.dt)
        self._objects = WorldObjects(self._bullet)
        self._chassis = Chassis(self._bullet, robot, config.traction, self.dt)
        # Two counts of physics steps. A reset sets the second count to 0, but not the simulated time, because
        # the time of a ROS clock must not go back. So the simulated time comes from the sum of both counts.
        self._steps_before_reset = self._steps_since_reset = 0
        try:
            self.reset()  # builds the world, and puts the robot into it
        except Exception:
            self.close()  # otherwise the physics engine would keep 35 MB of memory
            raise

    def _make_equipment(self) -> Equipment:
        """Return new drive, battery and sensors for the present world."""
        return equip(self._config, self._drive_config, self._robot, self._cast_rays, self._world.gravity)

    def _cast_rays(self, pose_laser_in_world: Pose, beams: Beams, max_range: float) -> np.ndarray:
        """Return the distance at which each beam of a lidar meets a body now, (N,) [m].

        The distance is inf if a beam meets nothing up to `max_range` [m]. The lidars get this method instead
        of a scene, because the scene changes when bodies move.
        """
        return cast_rays(self._objects.scene(), pose_laser_in_world, beams, max_range)

    def close(self) -> None:
        """Free the memory of the physics engine."""
        self._bullet.close()

    def reset(self, seed: Optional[int] = None) -> None:
        """Reset everything except the stamp to the state of a new simulation.

        Args:
            seed: seed of all noise; None keeps the last seed.

        Raises:
            ValueError: the seed is negative. Then nothing changes.
        """
        seed = self._seed if seed is None else seed
        sensors = [(sensor.device, sensor.stream) for sensor in self._equipment.sensors]
        if self._equipment.points:
            sensors.append((self._equipment.points, POINTS_STREAM))
        # Each sensor gets a random generator of its own, so that no sensor changes the noise of another one.
        # The generators differ by the number of the sensor's stream; the lidar has none, see LIDAR_STREAM.
        # All generators are made before anything changes, because a negative seed raises ValueError here.
        generators = []
        for _, stream in sensors:
            spawn_key = () if stream is None else (stream,)
            generators.append(np.random.default_rng(np.random.SeedSequence(seed, spawn_key=spawn_key)))
        self._seed = seed
        self._steps_before_reset += self._steps_since_reset
        self._steps_since_reset = 0
        for (device, _), generator in zip(sensors, generators):
            device.reset(generator)
        if self._equipment.power:
            self._equipment.power.reset()
        self._equipment.drive.reset()
        self._bullet.clear(self._world.gravity)
        self._objects.load(self._world.bodies)
        self._chassis.place(self._pose_on_or_above_floor(self._start_pose), self._world.gravity)
        # [m] height at which the robot's wheels were put last, on the floor or a little above it. A robot far
        # below this height has fallen off the world (`has_fallen`).
        self._height_of_last_floor = self.ground_height
        self._odometer.reset(self._chassis.wheels())

    def _pose_on_floor(self, pose: Pose) -> Pose:
        """Return the pose of base_link for a robot whose wheels stand on the floor at a pose in the world.

        If there is no floor, the wheels stand on the xy plane of the given pose.
        """
        height = floor_height(self._objects.scene(), pose)  # relative to the pose; 0 if there is no floor
        pose_on_floor = compose(pose, Pose((0.0, 0.0, height))) if height else pose
        return self._chassis.on_ground(pose_on_floor)

    def _pose_on_or_above_floor(self, requested: Pose) -> Pose:
        """Return a pose for base_link: the requested pose, or on the floor if this pose is not usable.

        The requested height is kept only if it is above the height on the floor by up to MAX_DROP. The robot
        then falls to the floor.
        """
        pose_on_floor = self._pose_on_floor(requested)
        x, y, lowest = pose_on_floor.position
        height = requested.position[2]
        if lowest < height <= lowest + MAX_DROP:
            return Pose((x, y, height), pose_on_floor.quat_xyzw)
        return pose_on_floor

    def load_world(self, world: World) -> None:
        """Replace the world, and restart the simulation in it.

        Raises:
            HuskyError: the world cannot be simulated, or something stands at the start. Then nothing changes.
        """
        start, height = pose_to_2d(self._start_pose), self._start_pose.position[2]
        # this simulation of the new world is only a test, which raises the errors before anything changes
        Simulation(world, self._robot, self._config, start, self._seed, height).close()
        self._world = world
        self._equipment = self._make_equipment()  # the IMU needs the gravity of the new world
        self.reset()

    @property
    def stamp(self) -> float:
        """Simulated time [s]; it never goes back."""
        return (self._steps_before_reset + self._steps_since_reset) / self._physics_rate

    def set_stamp(self, stamp: float) -> None:
        """Continue from this simulated time [s], rounded to a step. A time before now changes nothing."""
        steps = round(stamp * self._physics_rate)  # number of steps at this time, the sum of both step counts
        self._steps_before_reset = max(self._steps_before_reset, steps - self._steps_since_reset)

    @property
    def _time_since_reset(self) -> float:
        """Simulated time since the last reset [s]; the drive uses it to find out when a command expires."""
        return self._steps_since_reset / self._physics_rate

    def command(self, twist: Twist2D) -> None:
        """Take a velocity command now.

        Raises:
            CommandError: the command is not finite; then the last command stays in force.
        """
        self._equipment.drive.command(twist, self._time_since_reset)

    def step(self) -> Snapshot:
        """Advance one physics step, and return its snapshot.

        A snapshot has the sample of a sensor only if the sensor's period ends with this step. Otherwise the
        field of this sensor is None.
        """
        equipment = self._equipment
        # the command that the drive obeys now, and the speeds of the left and the right wheels [rad/s]
        command, (left, right) = equipment.drive.turn(self._time_since_reset, self.dt)
        self._chassis.drive((left, right, left, right))  # front left, front right, rear left, rear right
        self._bullet.step()
        self._steps_since_reset += 1

        state, stamp, step = self._chassis.observe(), self.stamp, self._steps_since_reset
        contacts = self._chassis.update_contacts()
        # samples of the sensors whose period ends with this step, by their fields in `Snapshot`
        samples: Dict[str, Any] = {
            field: device.sample(state, stamp)
            for steps, device, field, _ in equipment.sensors
            if step % steps == 0
        }
        # a real Husky reads its wheel encoders and its power only once in each period of its control loop
        is_end_of_drive_period = step % equipment.drive.steps == 0
        # each scan comes with odometry of the same stamp, so that the scan can be transformed to odom
        if "scan" in samples or step % self._odometry_steps == 0:
            wheels = equipment.drive.encoded(self._chassis.wheels()) if is_end_of_drive_period else None
            samples["odometry"] = self._odometer.sample(wheels, equipment.imu.yaw_rate, step)
        if equipment.power and is_end_of_drive_period:
            samples["power"] = self._measure_power((left, right))
        return Snapshot(stamp, step, state, command, contacts, **samples)

    def look(self) -> Snapshot:
        """Return a snapshot of now, with odometry and a scan, without a step.

        A caller may look at any time, and as often as it wants, without a change of the results of later
        steps. So copies of the odometer and of the lidar make these measurements. The snapshot has no command
        and no contacts, because they belong to a step.
        """
        yaw_rate, step = self._equipment.imu.yaw_rate, self._steps_since_reset
        # The method `sample` changes the odometer. So a copy of the odometer makes the sample, and the
        # odometer itself stays as it is. A shallow copy is enough, because `sample` only assigns new objects
        # to the attributes. Without a reading of the wheels, the sample contains the last reading.
        odometry = copy(self._odometer).sample(wheels=None, yaw_rate=yaw_rate, step=step)
        samples = {}
        for sensor in self._equipment.sensors:
            if sensor.field == "scan":
                lidar = copy(sensor.device)
                # the copy would take random numbers from the lidar's own generator, and so change the noise
                # of later scans; it gets a new generator instead
                lidar.reset(np.random.default_rng(self._seed))
                # The real lidar gives a scan the time of the first beam, some milliseconds ago. This time may
                # be before the start of the simulation, so this scan gets the present time.
                samples["scan"] = replace(lidar.sample(self._chassis.state, self.stamp), stamp=self.stamp)
        return Snapshot(
            self.stamp,
            step,
            self._chassis.state,
            command=Twist2D(),
            contacts=(),
            odometry=odometry,
            **samples,
        )

    def points(self) -> np.ndarray:
        """Return the points that the 3D lidar measures now, in the lidar's frame, (rings, columns, 3) [m].

        The coordinates are NaN for a beam that meets nothing.
        """
        assert self._equipment.points is not None, "points_rate is 0, or the robot has no lidar"
        return self._equipment.points.sample(self._chassis.state)

    def _measure_power(self, speeds: Tuple[float, float]) -> PowerState:
        """Drain the battery for one period of the drive, and return currents, voltage and temperatures.

        `speeds` are the speeds of the (left, right) wheels [rad/s].
        """
        power = self._equipment.power
        assert power is not None
        front_left, front_right, rear_left, rear_right = self._chassis.torques
        torques = (front_left + rear_left, front_right + rear_right)
        radius, period = self._drive_config.wheel_radius, self._equipment.drive.steps * self.dt
        return power.update(torques, (speeds[0] * radius, speeds[1] * radius), period)

    @property
    def bodies(self) -> Mapping[str, Body]:
        """Bodies except the robot, by name; the pose in a `Body` is its initial pose."""
        return self._objects.bodies

    def pose_of(self, name: str) -> Pose:
        """Return the pose of a body in the world. Raises PlacementError if no body has this name."""
        return self._objects.pose_of(name)

    @property
    def pose_world_in_odom(self) -> Pose:
        """Pose of the world in odom, from the true pose of base_link and its pose by the filtered odometry.

        The pose changes slowly while the robot drives, because odometry drifts.
        """
        pose_base_in_odom = self._odometer.filtered.pose_base_in_odom
        return world_in_odom(self._chassis.state.pose_in_world, pose_base_in_odom)

    @property
    def ground_height(self) -> float:
        """Height in the world of the ground under the wheels of a robot that stands level [m]."""
        return self._chassis.state.pose_in_world.position[2] - self._robot.base_height

    @property
    def has_fallen(self) -> bool:
        """Return whether the robot has fallen off the world: far below the floor on which it was put."""
        return self.ground_height < self._height_of_last_floor - FALL_DEPTH

    def spawn(self, bodies: Sequence[Body]) -> None:
        """Add all new bodies, or none. Raises PlacementError if a name is taken, or if a body has no room."""
        self._objects.add(bodies)

    def delete(self, name: str) -> None:
        """Remove a body, or all bodies of a model. Raises PlacementError if nothing has this name."""
        if name == ROBOT:
            raise PlacementError(f"'{ROBOT}' is the robot, which cannot be deleted")
        self._objects.delete(name)

    def move(self, name: str, pose_in_world: Pose) -> None:
        """Put a body, or the robot, somewhere else, at rest.

        The robot is put with its wheels on the floor. The pose in the odometry changes by the same move, so
        that the frame odom keeps its x, y and yaw in the world. The height of odom in the world changes if
        the new floor is higher or lower, because odometry has no height: odom is as high as base_link.

        Raises:
            PlacementError: no object has this name, or another object is in the way; then nothing changes.
        """
        if name == ROBOT:
            self._move_robot(self._pose_on_floor(pose_in_world))
        else:
            self._objects.move(name, pose_in_world)

    def move_robot_level(self, pose: Pose2D) -> None:
        """Put the robot at x, y and yaw, at rest, on the floor that is there at the robot's present height.

        If no floor is there, because the robot has fallen below every floor, it is put at the height of the
        floor on which it was put before.

        Raises:
            PlacementError: another object is in the way; then nothing changes.
        """
        height = self.ground_height
        if not has_floor(self._objects.scene(), (pose.x, pose.y, height)):
            height = self._height_of_last_floor
        self._move_robot(self._pose_on_floor(pose_from_2d(pose, height)))

    @property
    def models(self) -> List[str]:
        """Names of the models in the world, and of the robot."""
        return [*self._objects.models, ROBOT]

    def motion_of(self, model: str) -> ModelMotion:
        """Return pose and velocities of a model, or of the robot's base_link, in the world.

        Raises PlacementError if no model has this name.
        """
        if model != ROBOT:
            return self._objects.motion_of(model)
        pose, velocity_in_base, spin_in_base = self._chassis.state
        attitude = pose.quat_xyzw
        return ModelMotion(pose, rotate(attitude, velocity_in_base), rotate(attitude, spin_in_base))

    def place_model(self, model: str, motion_in_world: ModelMotion) -> None:
        """Put a model, or the robot's base_link, somewhere else, with a velocity.

        A robot that is put up to MAX_DROP above the floor falls from there. A robot that is put higher, or
        below the floor, is put on the floor instead.

        Raises:
            PlacementError: no model has this name, or another object is in the way; then nothing changes.
        """
        if model != ROBOT:
            self._objects.place_model(model, motion_in_world)
            return
        self._move_robot(self._pose_on_or_above_floor(motion_in_world.pose))
        self._chassis.set_velocity(motion_in_world.velocity, motion_in_world.angular_velocity)

    def _move_robot(self, pose_base_in_world: Pose) -> None:
        """Put base_link at a pose, at rest, and change its pose in the odometry by the same move.

        So odom keeps its x, y and yaw in the world, as if the robot had driven to the new pose.

        Raises:
            PlacementError: another object is in the way; then nothing changes.
        """
        pose_before = self._chassis.state.pose_in_world
        self._chassis.move(pose_base_in_world)  # the first change, because this line may raise PlacementError
        # 1. The last sample of odometry may be some steps old. So a new sample adds the way that the robot
        # drove until the move. It needs the angles of the wheels and the yaw rate of the IMU, which the move
        # has not changed.
        self._odometer.sample(self._chassis.wheels(), self._equipment.imu.yaw_rate, self._steps_since_reset)
        # 2. odom stays where it is in the world, so the odometry gets the robot's new pose in odom
        pose_world_in_odom = world_in_odom(pose_before, self._odometer.filtered.pose_base_in_odom)
        pose_base_in_odom = compose(pose_world_in_odom, self._chassis.state.pose_in_world)
        self._odometer.relocate(pose_to_2d(pose_base_in_odom))
        # 3. the robot is at rest at another place
        self._equipment.imu.restart()
        self._equipment.drive.reset()
        self._height_of_last_floor = self.ground_height

    def reset_poses(self) -> None:
        """Put the robot and every body back to their first poses, at rest.

        Raises:
            PlacementError: something stands at the robot's start; then nothing changes.
        """
        # all bodies move at the same time as the robot, so the robot needs room among the first poses of the
        # bodies, not among their present poses
        first_poses = {**self._objects.initial_poses, ROBOT: self._pose_on_floor(self._start_pose)}
        self._bullet.check_moves(first_poses, checked=ROBOT)
        self._objects.reset_poses()
        # the floor is searched again, because another body may be the floor when the bodies are back
        self._move_robot(self._pose_on_floor(self._start_pose))
