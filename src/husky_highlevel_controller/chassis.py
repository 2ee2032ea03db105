"""The robot on its wheels: how the ground holds it, how it moves, what it touches.

In: an engine with the robot in it, the wheels' commanded speeds. Out: forces on the robot, its state.
Must not know: ROS, PyBullet, sensors, commands.
"""

from __future__ import annotations

from typing import List, Sequence, Tuple

from husky_highlevel_controller.datatypes import Pose, RobotState, Vector3
from husky_highlevel_controller.engine import Engine
from husky_highlevel_controller.geometry import compose, inverse, quat_inverse, rotate, transform_point
from husky_highlevel_controller.robot import RobotModel
from husky_highlevel_controller.traction import Contact, TractionConfig, ground_forces

LOAD_SMOOTHING = 0.02  # [s], low-pass on the wheels' normal forces: the solver's are rough
SUPPORT_SLOPE = 0.5  # a wheel stands on what pushes it up at least steeply (cosine), and bumps into the rest


class Chassis:
    """The robot's body in an engine."""

    def __init__(self, engine: Engine, robot: RobotModel, traction: TractionConfig, dt: float) -> None:
        self._engine, self._robot, self._traction, self._dt = engine, robot, traction, dt

    def place(self, pose_base_in_world: Pose, gravity: Vector3) -> None:
        """Put the robot into an engine that has none."""
        self._gravity = gravity
        self._engine.add_robot(self._robot, pose_base_in_world)
        self._land()

    def move(self, pose_base_in_world: Pose) -> None:
        """Put the robot somewhere else, at rest.

        Raises:
            PlacementError: something stands there; the robot stays where it is.
        """
        self._engine.move_robot(pose_base_in_world)
        self._land()

    def on_ground(self, pose_on_ground: Pose) -> Pose:
        """Pose of base_link when the wheels stand on the xy plane of a pose."""
        wheel = self._robot.wheels[0]
        return compose(pose_on_ground, Pose((0.0, 0.0, wheel.radius - wheel.position[2])))

    def _land(self) -> None:
        wheels = self._robot.wheels
        self._loads = [0.0] * len(wheels)
        self._footprints = [(w.position[0], w.position[1], w.position[2] - w.radius) for w in wheels]
        self.observe()

    def observe(self) -> RobotState:
        """Look where the robot is and how it moves; kept as `state`."""
        pose, velocity, spin = self._engine.robot_motion()
        to_base = quat_inverse(pose.quat_xyzw)
        (vx, vy, vz), (wx, wy, wz) = rotate(to_base, velocity), rotate(to_base, spin)
        x, y, z = self._engine.robot_com()
        # v(base_link) = v(com) - w x com
        at_base = (vx - (wy * z - wz * y), vy - (wz * x - wx * z), vz - (wx * y - wy * x))
        self.state = RobotState(pose, at_base, (wx, wy, wz))
        return self.state

    def drive(self, speeds: Sequence[float]) -> None:
        """Turn the wheels at these speeds [rad/s], and push the robot as the ground does, for one step."""
        self._engine.drive_wheels(speeds)
        robot, state = self._robot, self.state
        quat, com = state.pose_in_world.quat_xyzw, robot.total_com
        contacts = [
            Contact(point[0] - com[0], point[1] - com[1], load, speed * wheel.radius)
            for point, load, speed, wheel in zip(self._footprints, self._loads, speeds, robot.wheels)
        ]
        (vx, vy, _), (_, _, yaw_rate) = state.velocity_in_base, state.angular_velocity_in_base
        gravity = rotate(quat_inverse(quat), self._gravity)
        forces = ground_forces(
            contacts,
            velocity=(vx - yaw_rate * com[1], vy + yaw_rate * com[0], yaw_rate),
            external=(robot.total_mass * gravity[0], robot.total_mass * gravity[1]),
            mass=robot.total_mass,
            yaw_inertia=robot.total_yaw_inertia,
            dt=self._dt,
            config=self._traction,
        )
        for point, load, (along, across) in zip(self._footprints, self._loads, forces):
            if load > 0.0:
                self._engine.push_robot(
                    rotate(quat, (along, across, 0.0)), transform_point(state.pose_in_world, point)
                )

    def feel(self) -> Tuple[str, ...]:
        """Note each wheel's load and footprint; tell what the robot touches but does not stand on."""
        up = rotate(self.state.pose_in_world.quat_xyzw, (0.0, 0.0, 1.0))
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
        self._loads[wheel] += (load - self._loads[wheel]) * self._dt / (self._dt + LOAD_SMOOTHING)
        x, y, z = (sum(force * point[axis] for force, point in points) / load for axis in range(3))
        self._footprints[wheel] = transform_point(inverse(self.state.pose_in_world), (x, y, z))
