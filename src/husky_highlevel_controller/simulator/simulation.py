"""Simulation of a Husky in a world: physics, drive and sensors.

In: a `World`, a robot description, velocity commands, a seed. Out: a `Snapshot` a step.
Must not know: ROS, clocks, threads.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import isclose
from typing import Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from husky_highlevel_controller.datatypes import (
    Beams,
    Body,
    HuskyError,
    Pose,
    Pose2D,
    PowerState,
    Snapshot,
    Twist2D,
    WheelState,
    World,
)
from husky_highlevel_controller.geometry import compose, inverse, pose_from_2d, pose_to_2d
from husky_highlevel_controller.simulator.bullet.robot import RobotWorld
from husky_highlevel_controller.simulator.bullet.world import ROBOT, PlacementError
from husky_highlevel_controller.simulator.chassis import Chassis
from husky_highlevel_controller.simulator.diff_drive import Drive, DriveConfig, IdealBase
from husky_highlevel_controller.simulator.husky_base import HuskyBase, as_encoded
from husky_highlevel_controller.simulator.models.robot_model import RobotModel
from husky_highlevel_controller.simulator.odometry import Odometer
from husky_highlevel_controller.simulator.power import Power
from husky_highlevel_controller.simulator.profile import RealHusky
from husky_highlevel_controller.simulator.sensors.gps import Gps, GpsConfig
from husky_highlevel_controller.simulator.sensors.imu import Imu, ImuConfig
from husky_highlevel_controller.simulator.sensors.lidar import Lidar, LidarConfig
from husky_highlevel_controller.simulator.sensors.lms1xx import Lms1xx
from husky_highlevel_controller.simulator.sensors.magnetometer import Magnetometer
from husky_highlevel_controller.simulator.sensors.raycast import cast_rays
from husky_highlevel_controller.simulator.sensors.vibration import ShakenImu
from husky_highlevel_controller.simulator.traction import TractionConfig
from husky_highlevel_controller.simulator.world_objects import WorldObjects

# of the seed: each sensor draws from its own stream, so that none shifts another's; the lidar's is the seed's
IMU_STREAM, GPS_STREAM, MAG_STREAM = 1, 2, 3
ODOMETRY_RATE = 50  # [Hz], as on the Husky; besides, odometry is fresh whenever there is a scan


@dataclass(frozen=True)
class SimulatorConfig:
    """Rates and sensors of the simulation."""

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
    real: Optional[RealHusky] = None  # what a real Husky does differently; None: Gazebo's Husky


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
            PlacementError: a body cannot be simulated (a movable plane), or stands where the robot starts.
        """
        left, right = robot.wheels[0], robot.wheels[1]
        geometry = {"wheel_separation": left.position[1] - right.position[1], "wheel_radius": left.radius}
        self.config = replace(config, drive=replace(config.drive, **geometry))
        self._real = real = config.real
        if real:
            grip = {"friction": real.ground.friction, "lateral_grip": real.ground.lateral_grip}
            self.config = replace(self.config, traction=replace(config.traction, **grip))
            steps_per(
                real.base.control_rate, ODOMETRY_RATE, "base/control_rate"
            )  # read with an odometry sample
        self.dt = 1.0 / config.physics_rate
        self._scan_steps = steps_per(config.scan_rate, config.physics_rate, "scan_rate")
        self._imu_steps = steps_per(config.imu_rate, config.physics_rate, "imu_rate")
        self._odometry_steps = steps_per(ODOMETRY_RATE, config.physics_rate, "the rate of odometry")
        self._gps_steps = steps_per(config.gps_rate, config.physics_rate, "gps_rate")
        self._world, self._robot = world, robot
        self._start, self._seed = start, seed
        self._drive = Drive(self.config.drive)
        self._wheel_steps = 1  # physics steps between two readings of the encoders
        self._base: Union[IdealBase, HuskyBase] = IdealBase(self._drive, self.config.drive, self.dt)
        self._power: Optional[Power] = None
        self._mag: Optional[Magnetometer] = None
        if real:
            self._wheel_steps = steps_per(real.base.control_rate, config.physics_rate, "base/control_rate")
            self._base = HuskyBase(self._drive, self.config.drive, real.base, self.dt)
            self._power, self._mag = Power(real.power, real.ground.rolling_current), Magnetometer()
        self._odometer = Odometer(self.config.drive, self.dt)
        self._lidar = self._make_lidar()
        self._imu = self._make_imu()
        self._gps = Gps(config.gps, self._gps_steps * self.dt)
        self._bullet = RobotWorld(self.dt)
        self._objects = WorldObjects(self._bullet)
        self._chassis = Chassis(self._bullet, robot, self.config.traction, self.dt)
        self._steps_before = self._steps = 0
        self.reset()

    def _make_imu(self) -> Union[Imu, ShakenImu]:
        imu = Imu(self.config.imu, self._imu_steps * self.dt, self._world.gravity)
        drive = self.config.drive
        track = drive.wheel_separation * drive.wheel_separation_multiplier
        return ShakenImu(imu, self._real.ground.vibration, track) if self._real else imu

    def _make_lidar(self) -> Union[Lidar, Lms1xx, None]:
        """The lidar, if the robot has its frame."""
        frame = self._robot.laser_frame
        if frame not in self._robot.fixed_poses:
            return None

        def cast(pose_laser_in_world: Pose, beams: Beams, max_range: float) -> np.ndarray:
            return cast_rays(self._objects.scene(), pose_laser_in_world, beams, max_range)

        pose = self._robot.fixed_poses[frame]
        if self._real:
            return Lms1xx(self._real.lidar, cast, frame, pose, self._scan_steps * self.dt)
        return Lidar(self.config.lidar, cast, frame, pose)

    def close(self) -> None:
        """Free the memory of the physics engine."""
        self._bullet.close()

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
        if self._lidar:
            self._lidar.reset(np.random.default_rng(self._seed))
        for sensor, stream in (
            (self._imu, IMU_STREAM),
            (self._gps, GPS_STREAM),
            (self._mag, MAG_STREAM),
        ):
            if sensor:
                sensor.reset(np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(stream,))))
        if self._power:
            self._power.reset()
        self._base.reset()
        self._bullet.clear(self._world.gravity)
        self._objects.load(self._world.bodies)
        self._chassis.place(self._chassis.on_ground(pose_from_2d(self._start)), self._world.gravity)
        self._odometer.reset(self._chassis.wheels())

    @property
    def stamp(self) -> float:
        """Simulated time [s]; it never goes back."""
        return (self._steps_before + self._steps) / self.config.physics_rate

    @property
    def _since_reset(self) -> float:
        return self._steps / self.config.physics_rate

    def command(self, twist: Twist2D) -> None:
        """Give a velocity command, as if it arrived now.

        Raises:
            CommandError: it is not finite; the one before stays in force.
        """
        self._drive.command(twist, self._since_reset)

    def step(self) -> Snapshot:
        """Advance one physics step; at the end of a sensor's period the snapshot holds its sample."""
        command, (left, right) = self._base.update(self._since_reset)
        self._chassis.drive((left, right, left, right))
        self._bullet.step()
        self._steps += 1

        state, stamp, step = self._chassis.observe(), self.stamp, self._steps
        contacts = self._chassis.update_contacts()
        imu_due, wheels_due = step % self._imu_steps == 0, step % self._wheel_steps == 0
        imu = self._imu.sample(state, stamp) if imu_due else None
        odometry = scan = None
        if step % self._scan_steps == 0 or step % self._odometry_steps == 0:
            wheels = self._read_wheels() if wheels_due else None
            odometry = self._odometer.sample(wheels, self._imu.yaw_rate, step)
        if self._lidar and step % self._scan_steps == 0:
            scan = self._lidar.sample(state, stamp)
        gps = self._gps.sample(state, stamp) if step % self._gps_steps == 0 else None
        if not self._real:
            return Snapshot(stamp, step, state, command, contacts, odometry, scan, imu, gps)
        mag = self._mag.sample(state, stamp) if self._mag and imu_due else None
        power = self._measure_power((left, right)) if wheels_due else None
        return Snapshot(stamp, step, state, command, contacts, odometry, scan, imu, gps, mag, power)

    def _read_wheels(self) -> WheelState:
        """The wheels as their encoders report them."""
        wheels = self._chassis.wheels()
        if not self._real:
            return wheels
        return as_encoded(wheels, self._real.base.speed_resolution, self.config.drive.wheel_radius)

    def _measure_power(self, speeds: Tuple[float, float]) -> Optional[PowerState]:
        """The power since the last reading of the encoders; speeds of the (left, right) wheels in rad/s."""
        if not self._power:
            return None
        radius, torques = self.config.drive.wheel_radius, self._chassis.torques
        sides = (torques[0] + torques[2], torques[1] + torques[3])
        treads = (speeds[0] * radius, speeds[1] * radius)
        return self._power.update(sides, treads, self._wheel_steps * self.dt)

    # ------------------------------------------------------------------ the world

    @property
    def bodies(self) -> Mapping[str, Body]:
        """Everything but the robot, by name; a body's own pose is where it was put."""
        return self._objects.bodies

    def pose_of(self, name: str) -> Pose:
        """Where a body is now, in the world; PlacementError if there is none of that name."""
        return self._objects.pose_of(name)

    @property
    def pose_world_in_odom(self) -> Pose:
        """Pose of the world by the filtered odometry; odom is level and as high as base_link."""
        height = self._chassis.on_ground(Pose()).position[2]
        base_in_odom = pose_from_2d(self._odometer.filtered.pose_base_in_odom)
        base_in_world = pose_from_2d(pose_to_2d(self._chassis.state.pose_in_world), height)
        return compose(base_in_odom, inverse(base_in_world))

    def spawn(self, bodies: Sequence[Body]) -> None:
        """Put new bodies into the world, all or none; PlacementError where there is no room or no name."""
        self._objects.add(bodies)

    def delete(self, name: str) -> None:
        """Take a body, or the bodies of a model, out of the world; PlacementError if there is none."""
        if name == ROBOT:
            raise PlacementError(f"'{ROBOT}' is the robot, which stays")
        self._objects.delete(name)

    def move(self, name: str, pose_in_world: Pose) -> None:
        """Put a body, or the robot's wheels, somewhere else, at rest.

        The odometry of a robot that is moved goes along, so that odom stays where it is in the world.

        Raises:
            PlacementError: there is none of that name, or something stands there; then it stays where it is.
        """
        if name != ROBOT:
            self._objects.move(name, pose_in_world)
            return
        world_in_odom = self.pose_world_in_odom
        self._chassis.move(self._chassis.on_ground(pose_in_world))
        self._imu.restart()
        self._base.reset()
        self._odometer.relocate(pose_to_2d(compose(world_in_odom, self._chassis.state.pose_in_world)))

    def reset_poses(self) -> None:
        """Put the robot and every body back to where they were put first, at rest."""
        self._objects.reset_poses()
        self.move(ROBOT, pose_from_2d(self._start))
