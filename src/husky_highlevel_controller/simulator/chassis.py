"""Robot chassis: ground forces on the wheels, true motion, contacts.

In: a Bullet world with the robot, the wheels' commanded speeds. Out: forces on the robot, its state.
Must not know: ROS, PyBullet, sensors, commands.
"""

from __future__ import annotations

from typing import Sequence, Tuple

from husky_highlevel_controller.datatypes import Pose, RobotState, Vector3
from husky_highlevel_controller.geometry import Axes, axes_from_quat, compose
from husky_highlevel_controller.simulator.bullet.robot import RobotWorld
from husky_highlevel_controller.simulator.models.robot_model import RobotModel
from husky_highlevel_controller.simulator.traction import TractionConfig, WheelContact, ground_forces

LOAD_SMOOTHING = 0.02  # [s], low-pass on the wheels' normal forces: the solver's are rough
SUPPORT_SLOPE = 0.5  # a wheel stands on what pushes it up at least steeply (cosine), and bumps into the rest


class Chassis:
    """The robot in a Bullet world."""

    def __init__(self, bullet: RobotWorld, robot: RobotModel, traction: TractionConfig, dt: float) -> None:
        self._bullet, self._robot, self._traction, self._dt = bullet, robot, traction, dt
        self._radii = [wheel.radius for wheel in robot.wheels]

    def place(self, pose_base_in_world: Pose, gravity: Vector3) -> None:
        """Put the robot into a Bullet world that has none."""
        self._gravity = gravity
        self._bullet.add_robot(self._robot, pose_base_in_world)
        self._land()

    def move(self, pose_base_in_world: Pose) -> None:
        """Put the robot somewhere else, at rest.

        Raises:
            PlacementError: something stands there; the robot stays where it is.
        """
        self._bullet.move_robot(pose_base_in_world)
        self._land()

    def on_ground(self, pose_on_ground: Pose) -> Pose:
        """Pose of base_link when the wheels stand on the xy plane of a pose."""
        wheel = self._robot.wheels[0]
        return compose(pose_on_ground, Pose((0.0, 0.0, wheel.radius - wheel.position[2])))

    def _land(self) -> None:
        wheels = self._robot.wheels
        self._loads = [0.0] * len(wheels)
        self.torques = [0.0] * len(wheels)
        self._footprints = [(w.position[0], w.position[1], w.position[2] - w.radius) for w in wheels]
        self.observe()

    def observe(self) -> RobotState:
        """Read the robot's pose and velocity; kept as `state`."""
        pose, velocity, spin = self._bullet.robot_motion()
        self._axes = axes_from_quat(pose.quat_xyzw)
        (vx, vy, vz), (wx, wy, wz) = (_onto(self._axes, v) for v in (velocity, spin))
        x, y, z = self._bullet.robot_com
        # v(base_link) = v(com) - w x com
        at_base = (vx - (wy * z - wz * y), vy - (wz * x - wx * z), vz - (wx * y - wy * x))
        self.state = RobotState(pose, at_base, (wx, wy, wz))
        return self.state

    def drive(self, speeds: Sequence[float]) -> None:
        """Turn the wheels at these speeds [rad/s] and apply the ground's forces, for one step."""
        self._bullet.drive_wheels(speeds)
        robot, state = self._robot, self.state
        com_x, com_y, _ = robot.total_com
        contacts = [
            WheelContact(point[0] - com_x, point[1] - com_y, load, speed * radius)
            for point, load, speed, radius in zip(self._footprints, self._loads, speeds, self._radii)
        ]
        (vx, vy, _), (_, _, yaw_rate) = state.velocity_in_base, state.angular_velocity_in_base
        pull_x, pull_y, _ = _onto(self._axes, self._gravity)
        forces = ground_forces(
            contacts,
            velocity=(vx - yaw_rate * com_y, vy + yaw_rate * com_x, yaw_rate),
            external=(robot.total_mass * pull_x, robot.total_mass * pull_y),
            mass=robot.total_mass,
            yaw_inertia=robot.total_yaw_inertia,
            dt=self._dt,
            config=self._traction,
        )
        self.torques = [
            along * radius for (along, _), radius in zip(forces, self._radii)
        ]  # [N m], at the wheels
        ahead, left, up = self._axes
        px, py, pz = state.pose_in_world.position
        for (x, y, z), load, (along, across) in zip(self._footprints, self._loads, forces):
            if load > 0.0:
                self._bullet.push_robot(
                    (
                        along * ahead[0] + across * left[0],
                        along * ahead[1] + across * left[1],
                        along * ahead[2] + across * left[2],
                    ),
                    (
                        px + x * ahead[0] + y * left[0] + z * up[0],
                        py + x * ahead[1] + y * left[1] + z * up[1],
                        pz + x * ahead[2] + y * left[2] + z * up[2],
                    ),
                )

    def update_contacts(self) -> Tuple[str, ...]:
        """Update each wheel's load and footprint; names of what the robot touches but does not stand on."""
        ux, uy, uz = self._axes[2]
        underfoot = [[0.0, 0.0, 0.0, 0.0] for _ in self._loads]  # load [N], and load times point [N m]
        contacts = set()
        for body, wheel, (x, y, z), (nx, ny, nz), force in self._bullet.contact_points():
            support = nx * ux + ny * uy + nz * uz
            if wheel is None or support < SUPPORT_SLOPE:
                contacts.add(body)
                continue
            load, sums = force * support, underfoot[wheel]
            sums[0] += load
            sums[1] += load * x
            sums[2] += load * y
            sums[3] += load * z
        px, py, pz = self.state.pose_in_world.position
        for wheel, (load, x, y, z) in enumerate(underfoot):
            if load <= 0.0:
                self._loads[wheel] = 0.0  # in the air: no grip, at once
                continue
            self._loads[wheel] += (load - self._loads[wheel]) * self._dt / (self._dt + LOAD_SMOOTHING)
            self._footprints[wheel] = _onto(self._axes, (x / load - px, y / load - py, z / load - pz))
        return tuple(sorted(contacts))


def _onto(axes: Axes, vector: Vector3) -> Vector3:
    """A vector of the world, in the frame of these axes."""
    x, y, z = vector
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = axes
    return (ax * x + ay * y + az * z, bx * x + by * y + bz * z, cx * x + cy * y + cz * z)
