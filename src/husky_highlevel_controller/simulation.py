"""The world in motion, with a Husky in it.

In: a `World`, a robot description, velocity commands, a seed. Out: a `Snapshot` a step.
Must not know: ROS, clocks, threads.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from math import isclose
from typing import List, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.datatypes import (
    HuskyError,
    ImuSample,
    Odometry,
    Plane,
    Pose,
    Pose2D,
    RobotState,
    Scan,
    Snapshot,
    Twist2D,
    Vector3,
    World,
)
from husky_highlevel_controller.drive import Drive, DriveConfig, wheel_speeds
from husky_highlevel_controller.engine import Engine
from husky_highlevel_controller.geometry import (
    compose,
    inverse,
    pose_from_2d,
    quat_inverse,
    rotate,
    transform_point,
)
from husky_highlevel_controller.imu import ImuConfig, measure
from husky_highlevel_controller.lidar import LidarConfig, sweep
from husky_highlevel_controller.odometry import advance_odometry
from husky_highlevel_controller.raycast import cast_rays, make_scene
from husky_highlevel_controller.robot import RobotModel
from husky_highlevel_controller.traction import Contact, TractionConfig, ground_forces

LOAD_SMOOTHING = 0.02  # [s], low-pass on the wheels' normal forces: the solver's are rough
IMU_STREAM = 1  # of the seed: the IMU draws from a stream of its own, so that it does not shift the lidar's
SUPPORT_SLOPE = 0.5  # a wheel stands on what pushes it up at least steeply (cosine), and bumps into the rest


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
            PlacementError: a thing cannot be simulated, such as a movable plane.
        """
        left, right = robot.wheels[0], robot.wheels[1]
        geometry = {"wheel_separation": left.position[1] - right.position[1], "wheel_radius": left.radius}
        self.config = replace(config, drive=replace(config.drive, **geometry))
        self.dt = 1.0 / config.physics_rate
        self._scan_steps = steps_per(config.scan_rate, config.physics_rate, "scan_rate")
        self._imu_steps = steps_per(config.imu_rate, config.physics_rate, "imu_rate")
        self._world, self._robot = world, robot
        self._laser_in_base = robot.fixed_poses.get(robot.laser_frame)
        self._drive = Drive(self.config.drive)
        self._engine = Engine(self.dt)
        self.reset(start, seed)

    def close(self) -> None:
        """Give the engine's memory back."""
        self._engine.close()

    def reset(self, start: Pose2D, seed: int) -> None:
        """Back to the beginning, with the robot at `start`: the stamp starts at 0 again."""
        self._steps = 0
        self._rng = np.random.default_rng(seed)
        self._imu_rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(IMU_STREAM,)))
        self._drive.reset()
        self._odometry = Odometry()
        self._engine.clear(self._world.gravity)
        for thing in self._world.things:
            self._engine.add_thing(thing)
        self._show_to_the_lidar()
        wheels = self._robot.wheels
        self._engine.add_robot(self._robot, pose_from_2d(start, wheels[0].radius - wheels[0].position[2]))
        self._loads = [0.0] * len(wheels)
        self._footprints = [(w.position[0], w.position[1], w.position[2] - w.radius) for w in wheels]
        self._state = self._felt = self._observe_robot()

    @property
    def stamp(self) -> float:
        """Simulated time [s]."""
        return self._steps / self.config.physics_rate

    def command(self, twist: Twist2D) -> None:
        """Hand over a velocity command, as if it arrived now.

        Raises:
            CommandError: it is not finite; the one before stays in force.
        """
        self._drive.command(twist, self.stamp)

    def pose_of(self, name: str) -> Pose:
        """Where a thing is now, in the world; PlacementError if there is none of that name."""
        return self._engine.pose_of(name)

    def step(self) -> Snapshot:
        """Advance one physics step; at the end of a sensor's period the snapshot holds its sample."""
        left, right = wheel_speeds(self._drive.update(self.stamp, self.dt), self.config.drive)
        self._engine.drive_wheels((left, right, left, right))
        self._hold_the_ground((left, right, left, right))
        self._engine.step()
        self._steps += 1

        self._state = self._observe_robot()
        touched = self._observe_touches()
        wheels = self._engine.wheels()
        left, right = (wheels.speeds[0] + wheels.speeds[2]) / 2.0, (wheels.speeds[1] + wheels.speeds[3]) / 2.0
        yaw_rate = self._state.angular_velocity_in_base[2]
        self._odometry = advance_odometry(self._odometry, left, right, yaw_rate, self.dt, self.config.drive)
        scan = None
        if self._laser_in_base is not None and self._steps % self._scan_steps == 0:
            scan = self._sweep(self._laser_in_base)
        imu = self._feel() if self._steps % self._imu_steps == 0 else None
        return Snapshot(self.stamp, self._state, wheels, self._odometry, touched, scan, imu)

    # ------------------------------------------------------------------ wheels on the ground

    def _hold_the_ground(self, speeds: Tuple[float, float, float, float]) -> None:
        """Push the robot as the ground does during the next step."""
        robot, state = self._robot, self._state
        quat, com = state.pose_in_world.quat_xyzw, robot.total_com
        contacts = [
            Contact(point[0] - com[0], point[1] - com[1], load, speed * wheel.radius)
            for point, load, speed, wheel in zip(self._footprints, self._loads, speeds, robot.wheels)
        ]
        (vx, vy, _), (_, _, yaw_rate) = state.velocity_in_base, state.angular_velocity_in_base
        gravity = rotate(quat_inverse(quat), self._world.gravity)
        forces = ground_forces(
            contacts,
            velocity=(vx - yaw_rate * com[1], vy + yaw_rate * com[0], yaw_rate),
            external=(robot.total_mass * gravity[0], robot.total_mass * gravity[1]),
            mass=robot.total_mass,
            yaw_inertia=robot.total_yaw_inertia,
            dt=self.dt,
            config=self.config.traction,
        )
        for point, load, (along, across) in zip(self._footprints, self._loads, forces):
            if load > 0.0:
                self._engine.push_robot(
                    rotate(quat, (along, across, 0.0)), transform_point(state.pose_in_world, point)
                )

    def _observe_robot(self) -> RobotState:
        pose, velocity, spin = self._engine.robot_motion()
        to_base = quat_inverse(pose.quat_xyzw)
        (vx, vy, vz), (wx, wy, wz) = rotate(to_base, velocity), rotate(to_base, spin)
        x, y, z = self._engine.robot_com()
        # v(base_link) = v(com) - w x com
        at_base = (vx - (wy * z - wz * y), vy - (wz * x - wx * z), vz - (wx * y - wy * x))
        return RobotState(pose, at_base, (wx, wy, wz))

    def _observe_touches(self) -> Tuple[str, ...]:
        """Note each wheel's load and footprint; tell what the robot touches but does not stand on."""
        up = rotate(self._state.pose_in_world.quat_xyzw, (0.0, 0.0, 1.0))
        underfoot: List[List[Tuple[float, Vector3]]] = [[] for _ in self._loads]
        touched = set()
        for touch in self._engine.robot_touches():
            support = sum(a * b for a, b in zip(touch.normal_in_world, up))
            if touch.wheel is None or support < SUPPORT_SLOPE:
                touched.add(touch.thing)
            else:
                underfoot[touch.wheel].append((touch.force * support, touch.point_in_world))
        for wheel, points in enumerate(underfoot):
            self._note_footprint(wheel, points)
        return tuple(sorted(touched))

    def _note_footprint(self, wheel: int, points: Sequence[Tuple[float, Vector3]]) -> None:
        load = sum(force for force, _ in points)
        if load <= 0.0:
            self._loads[wheel] = 0.0  # in the air: no grip, at once
            return
        self._loads[wheel] += (load - self._loads[wheel]) * self.dt / (self.dt + LOAD_SMOOTHING)
        x, y, z = (sum(force * point[axis] for force, point in points) / load for axis in range(3))
        self._footprints[wheel] = transform_point(inverse(self._state.pose_in_world), (x, y, z))

    # ------------------------------------------------------------------ lidar

    def _show_to_the_lidar(self) -> None:
        """Make the lidar's scene: every part of every thing, but nothing of the robot."""
        parts = [(thing, part) for thing in self._world.things for part in thing.collisions]
        shapes = [
            (part.shape, compose(self._engine.pose_of(thing.name), part.pose_in_thing))
            for thing, part in parts
        ]
        self._scene = make_scene(shapes)
        solids = [(thing, part) for thing, part in parts if not isinstance(part.shape, Plane)]
        self._movable = [(i, thing.name, part) for i, (thing, part) in enumerate(solids) if thing.mass > 0.0]

    def _sweep(self, laser_in_base: Pose) -> Scan:
        for index, name, part in self._movable:
            self._scene.move(index, compose(self._engine.pose_of(name), part.pose_in_thing))
        pose = compose(self._state.pose_in_world, laser_in_base)
        frame = self._robot.laser_frame
        return sweep(partial(cast_rays, self._scene), pose, self.config.lidar, self._rng, self.stamp, frame)

    # ------------------------------------------------------------------ IMU

    def _feel(self) -> ImuSample:
        before, self._felt = self._felt, self._state
        period, gravity = self._imu_steps * self.dt, self._world.gravity
        return measure(before, self._state, period, gravity, self.config.imu, self._imu_rng, self.stamp)
