"""The world in motion, with a Husky in it.

In: a `World`, a robot description, velocity commands, a seed. Out: a `Snapshot` a step.
Must not know: ROS, clocks, threads.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from math import isclose
from typing import Mapping, Optional, Sequence

import numpy as np

from husky_highlevel_controller.chassis import Chassis
from husky_highlevel_controller.datatypes import (
    GpsFix,
    HuskyError,
    ImuSample,
    Odometry,
    Pose,
    Pose2D,
    Scan,
    Snapshot,
    Thing,
    Twist2D,
    World,
)
from husky_highlevel_controller.drive import Drive, DriveConfig, twist_of_wheels, wheel_speeds
from husky_highlevel_controller.engine import ROBOT, PlacementError
from husky_highlevel_controller.geometry import compose, inverse, pose_from_2d, pose_to_2d
from husky_highlevel_controller.gps import Gps, GpsConfig
from husky_highlevel_controller.imu import ImuConfig, measure
from husky_highlevel_controller.lidar import LidarConfig, sweep
from husky_highlevel_controller.odometry import advance_odometry
from husky_highlevel_controller.raycast import cast_rays
from husky_highlevel_controller.robot import RobotModel
from husky_highlevel_controller.robot_engine import RobotEngine
from husky_highlevel_controller.scenery import Scenery
from husky_highlevel_controller.traction import TractionConfig

# of the seed: each draws from a stream of its own, so that none shifts another's; the lidar's is the seed's
IMU_STREAM, GPS_STREAM = 1, 2
ODOMETRY_RATE = 50  # [Hz], as on the Husky; besides, odometry is fresh whenever there is a scan


@dataclass(frozen=True)
class SimulatorConfig:
    """How the simulation runs."""

    physics_rate: int = field(
        default=200, metadata={"min": 50, "max": 2000, "help": "physics steps a second [Hz]"}
    )
    scan_rate: int = field(default=50, metadata={"min": 1, "max": 200, "help": "scans a second [Hz]"})
    lidar: LidarConfig = field(default_factory=LidarConfig, metadata={"help": "the lidar"})
    imu_rate: int = field(default=50, metadata={"min": 1, "max": 1000, "help": "IMU samples a second [Hz]"})
    imu: ImuConfig = field(default_factory=ImuConfig, metadata={"help": "the inertial measurement unit"})
    gps_rate: int = field(default=40, metadata={"min": 1, "max": 200, "help": "fixes a second [Hz]"})
    gps: GpsConfig = field(default_factory=GpsConfig, metadata={"help": "the satellite receiver"})
    drive: DriveConfig = field(default_factory=DriveConfig)
    traction: TractionConfig = field(default_factory=TractionConfig)


def steps_per(rate: float, physics_rate: float, name: str) -> int:
    """How many physics steps make one period of `rate` [Hz].

    Raises:
        HuskyError: the period is not a whole multiple of the physics step.
    """
    ratio = physics_rate / rate
    if round(ratio) < 1 or not isclose(ratio, round(ratio), rel_tol=1e-9):
        raise HuskyError(
            f"{name} = {rate} Hz does not divide physics_rate = {physics_rate} Hz; "
            "every period is a whole number of physics steps"
        )
    return round(ratio)


class Simulation:
    """A Husky in a world.

    `step()` advances one physics step. Everything random comes from `seed`: same world, robot, config, start,
    seed and commands give the same snapshots, to the last bit.
    """

    def __init__(
        self, world: World, robot: RobotModel, config: SimulatorConfig, start: Pose2D, seed: int
    ) -> None:
        """Build the world, with the robot's wheels on the plane z = 0 at `start`.

        Raises:
            HuskyError: a period is not a multiple of the physics step.
            PlacementError: a thing cannot be simulated (a movable plane), or stands where the robot starts.
        """
        left, right = robot.wheels[0], robot.wheels[1]
        geometry = {"wheel_separation": left.position[1] - right.position[1], "wheel_radius": left.radius}
        self.config = replace(config, drive=replace(config.drive, **geometry))
        self.dt = 1.0 / config.physics_rate
        self._scan_steps = steps_per(config.scan_rate, config.physics_rate, "scan_rate")
        self._imu_steps = steps_per(config.imu_rate, config.physics_rate, "imu_rate")
        self._odometry_steps = steps_per(ODOMETRY_RATE, config.physics_rate, "the rate of odometry")
        self._gps_steps = steps_per(config.gps_rate, config.physics_rate, "gps_rate")
        self._world, self._robot = world, robot
        self._start, self._seed = start, seed
        self._laser_in_base = robot.fixed_poses.get(robot.laser_frame)
        self._drive = Drive(self.config.drive)
        self._engine = RobotEngine(self.dt)
        self._scenery = Scenery(self._engine)
        self._chassis = Chassis(self._engine, robot, config.traction, self.dt)
        self._steps_before = self._steps = 0
        self.reset()

    def close(self) -> None:
        """Give the engine's memory back."""
        self._engine.close()

    def reset(self, start: Optional[Pose2D] = None, seed: Optional[int] = None) -> None:
        """Back to the beginning, as if made anew; only the stamp runs on.

        Args:
            start: where the robot starts; None: where it started before.
            seed: of all noise; None: the one before.
        """
        self._start = self._start if start is None else start
        self._seed = self._seed if seed is None else seed
        self._steps_before += self._steps
        self._steps = 0
        self._lidar_rng = np.random.default_rng(self._seed)
        self._imu_rng, gps_rng = (
            np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(stream,)))
            for stream in (IMU_STREAM, GPS_STREAM)
        )
        self._gps = Gps(self.config.gps, self._gps_steps * self.dt, gps_rng)
        self._drive.reset()
        self._gyro, self._wheel_odometry, self._odometry = 0.0, Odometry(), Odometry()
        self._engine.clear(self._world.gravity)
        self._scenery.furnish(self._world.things)
        self._chassis.place(self._chassis.on_ground(pose_from_2d(self._start)), self._world.gravity)
        self._felt = self._chassis.state
        self._wheels, self._reckoned = self._engine.wheels(), 0

    @property
    def stamp(self) -> float:
        """Simulated time [s]; it never goes back."""
        return (self._steps_before + self._steps) / self.config.physics_rate

    @property
    def _since_reset(self) -> float:
        return self._steps / self.config.physics_rate

    def command(self, twist: Twist2D) -> None:
        """Hand over a velocity command, as if it arrived now.

        Raises:
            CommandError: it is not finite; the one before stays in force.
        """
        self._drive.command(twist, self._since_reset)

    def step(self) -> Snapshot:
        """Advance one physics step; at the end of a sensor's period the snapshot holds its sample."""
        command = self._drive.update(self._since_reset, self.dt)
        left, right = wheel_speeds(command, self.config.drive)
        self._chassis.drive((left, right, left, right))
        self._engine.step()
        self._steps += 1

        state = self._chassis.observe()
        touched = self._chassis.feel()
        imu = self._feel() if self._steps % self._imu_steps == 0 else None
        scans = self._steps % self._scan_steps == 0
        if scans or self._steps % self._odometry_steps == 0:
            self._reckon()
        return Snapshot(
            self.stamp,
            state,
            self._wheels,
            command,
            self._wheel_odometry,
            self._odometry,
            touched,
            scan=self._sweep() if scans else None,
            imu=imu,
            gps=self._locate() if self._steps % self._gps_steps == 0 else None,
        )

    # ------------------------------------------------------------------ sensors

    def _reckon(self) -> None:
        """Read the wheels, and advance both odometries by what they have turned since the last time."""
        before, self._wheels = self._wheels, self._engine.wheels()
        duration = (self._steps - self._reckoned) * self.dt
        self._reckoned = self._steps
        a, b, c, d = (
            (now - then) / duration for now, then in zip(self._wheels.angles, before.angles)
        )  # mean speeds
        rolled = twist_of_wheels((a + c) / 2.0, (b + d) / 2.0, self.config.drive)
        self._wheel_odometry = advance_odometry(self._wheel_odometry, rolled, duration)
        fused = Twist2D(rolled.linear, self._gyro)
        self._odometry = advance_odometry(self._odometry, fused, duration)

    def _sweep(self) -> Optional[Scan]:
        if self._laser_in_base is None:
            return None
        rays = partial(cast_rays, self._scenery.scene())
        pose = compose(self._chassis.state.pose_in_world, self._laser_in_base)
        frame = self._robot.laser_frame
        return sweep(rays, pose, self.config.lidar, self._lidar_rng, self.stamp, frame)

    def _feel(self) -> ImuSample:
        before, self._felt = self._felt, self._chassis.state
        period, gravity = self._imu_steps * self.dt, self._world.gravity
        sample = measure(before, self._felt, period, gravity, self.config.imu, self._imu_rng, self.stamp)
        self._gyro = sample.angular_velocity[2]
        return sample

    def _locate(self) -> GpsFix:
        return self._gps.locate(self._chassis.state, self.stamp)

    # ------------------------------------------------------------------ the world

    @property
    def things(self) -> Mapping[str, Thing]:
        """Everything but the robot, by name; a thing's own pose is where it was put."""
        return self._scenery.things

    def pose_of(self, name: str) -> Pose:
        """Where a thing is now, in the world; PlacementError if there is none of that name."""
        return self._scenery.pose_of(name)

    @property
    def pose_world_in_odom(self) -> Pose:
        """Where the world lies for someone who trusts `odometry`; odom is level and as high as base_link."""
        height = self._chassis.on_ground(Pose()).position[2]
        base_in_odom = pose_from_2d(self._odometry.pose_base_in_odom)
        base_in_world = pose_from_2d(pose_to_2d(self._chassis.state.pose_in_world), height)
        return compose(base_in_odom, inverse(base_in_world))

    def spawn(self, things: Sequence[Thing]) -> None:
        """Put new things into the world, all or none; PlacementError where there is no room or no name."""
        self._scenery.add(things)

    def delete(self, name: str) -> None:
        """Take a thing, or the things of a model, out of the world; PlacementError if there is none."""
        if name == ROBOT:
            raise PlacementError(f"'{ROBOT}' is the robot, which stays")
        self._scenery.delete(name)

    def move(self, name: str, pose_in_world: Pose) -> None:
        """Put a thing, or the robot's wheels, somewhere else, at rest.

        The odometry of a robot that is moved goes along, so that odom stays where it is in the world.

        Raises:
            PlacementError: there is none of that name, or something stands there; then it stays where it is.
        """
        if name != ROBOT:
            self._scenery.move(name, pose_in_world)
            return
        world_in_odom = self.pose_world_in_odom
        self._chassis.move(self._chassis.on_ground(pose_in_world))
        self._felt = self._chassis.state
        self._drive.reset()
        self._gyro = 0.0
        base_in_odom = compose(world_in_odom, self._chassis.state.pose_in_world)
        self._odometry = Odometry(pose_to_2d(base_in_odom))

    def put_back(self) -> None:
        """Put the robot and every thing back to where they were put first, at rest."""
        self._scenery.put_back()
        self.move(ROBOT, pose_from_2d(self._start))
