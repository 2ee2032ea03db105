"""Robot chassis: ground forces on the wheels, true motion, contacts.

In: a Bullet world with the robot, the wheels' commanded speeds. Out: forces on the robot, its state.
"""

from __future__ import annotations

from math import hypot
from typing import List, Optional, Sequence, Tuple

from husky_highlevel_controller.datatypes import Pose, RobotState, Vector3, WheelState
from husky_highlevel_controller.geometry import along_axes, axes_from_quat, compose, dot, minus
from husky_highlevel_controller.simulator.bullet.robot import RobotWorld
from husky_highlevel_controller.simulator.bullet.world import ROBOT
from husky_highlevel_controller.simulator.models.robot_model import FLANK_DEPTH, RobotModel
from husky_highlevel_controller.simulator.traction import (
    TractionConfig,
    Vector2,
    WheelContact,
    ground_forces,
)

# [s] time constant of the low-pass filter for the normal forces on the wheels, because the forces from
# Bullet's solver are noisy
LOAD_SMOOTHING = 0.02
# A contact carries a wheel if the cosine of the contact's slope is at least this. At a steeper contact, the
# wheel bumps into an object.
SUPPORT_SLOPE = 0.5
CONTACT_DEPTH = 0.003  # [m] a contact point farther than this from the surface of a tyre is not on the tyre
# coefficient of friction of contacts on the hull, as between other bodies: Bullet multiplies the coefficients
# of the two bodies, which are 0.5 by default
HULL_FRICTION = 0.25
# [m/s] If the hull slides over an object more slowly than this, its friction grows with the speed (viscous).
# Otherwise the simulation would not be stable with steps of 5 ms.
HULL_SLIP_SPEED = 0.1

# contact on the hull in base_link: point [m], unit normal, and force along the normal [N]
HullContact = Tuple[Vector3, Vector3, float]


class Chassis:
    """The robot in a Bullet world, one rigid body, and the forces of the ground on its wheels.

    The wheels do not turn in Bullet. This class computes the force that the ground would have on turning
    wheels, and pushes the rigid body with this force. A wheel always has its commanded speed, as with
    Gazebo's ideal velocity interface. So the torque of its motor follows from the ground's force and the
    wheel's inertia.
    """

    def __init__(self, bullet: RobotWorld, robot: RobotModel, traction: TractionConfig, dt: float) -> None:
        """Prepare the wheels of a robot model; `dt` is the duration of a physics step [s]."""
        self._bullet, self._robot, self._traction, self._dt = bullet, robot, traction, dt
        self._radii = [wheel.radius for wheel in robot.wheels]
        self._axial_inertias = [wheel.axial_inertia for wheel in robot.wheels]
        self._joint_names = tuple(wheel.joint for wheel in robot.wheels)
        # position of the centre in base_link, radius and half of the width of each tyre [m]
        self._tyres = [(wheel.position, wheel.radius, wheel.width / 2.0) for wheel in robot.wheels]
        self._yaw_inertia = float(robot.inertia[2, 2])

    def place(self, pose_base_in_world: Pose, gravity: Vector3) -> None:
        """Add the robot to a Bullet world in which there is no robot."""
        self._gravity = gravity
        # [rad] angles by which the wheels have turned since the start; they grow beyond 2 pi
        self._wheel_angles = [0.0] * len(self._robot.wheels)
        self._bullet.add_robot(self._robot, pose_base_in_world)
        self._reset_contacts()

    def move(self, pose_base_in_world: Pose) -> None:
        """Move the robot, at rest. Raises PlacementError, and moves nothing, if there is no room."""
        self._bullet.move_robot(pose_base_in_world)
        self._reset_contacts()

    def set_velocity(self, velocity: Vector3, spin: Vector3) -> None:
        """Give the robot a velocity of base_link [m/s] and a spin [rad/s], in the world; its wheels stand."""
        self._bullet.set_velocity(ROBOT, velocity, spin)
        self.observe()

    def on_ground(self, pose_on_ground: Pose) -> Pose:
        """Pose of base_link in the world for a robot whose wheels stand on the xy plane of a pose."""
        return compose(pose_on_ground, Pose((0.0, 0.0, self._robot.base_height)))

    def _reset_contacts(self) -> None:
        """Forget loads, bumps, speeds and torques, because the robot was put elsewhere at rest."""
        wheels = self._robot.wheels
        self._loads = [0.0] * len(wheels)  # [N] normal force of the ground on each wheel
        # [m] contact of each wheel with the ground, in base_link; at first the lowest point of the wheel
        self._footprints = [(w.position[0], w.position[1], w.position[2] - w.radius) for w in wheels]
        # sum of the normal forces under the wheels, in base_link [N]
        self._ground_force: Vector3 = (0.0, 0.0, 0.0)
        # contacts of the last step that carry no wheel
        self._hull_contacts: List[HullContact] = []
        self._wheel_speeds: Sequence[float] = (0.0,) * len(wheels)  # [rad/s]
        self.torques = [0.0] * len(wheels)  # [N m] torques of the wheels' motors
        self.observe()  # reads `state` at the new pose

    def wheels(self) -> WheelState:
        """Angles, speeds and torques of the wheels."""
        return WheelState(
            self._joint_names, tuple(self._wheel_angles), tuple(self._wheel_speeds), tuple(self.torques)
        )

    def observe(self) -> RobotState:
        """Read the robot's pose and velocity, keep them as `state`, and return them."""
        pose, velocity, spin = self._bullet.robot_motion()
        self._base_axes = axes_from_quat(pose.quat_xyzw)
        # the products of vectors are written out in this class, because function calls cost time in every
        # physics step
        (vx, vy, vz), (wx, wy, wz) = along_axes(self._base_axes, velocity), along_axes(self._base_axes, spin)
        x, y, z = self._robot.com
        # v is the velocity of the centre of mass, so the velocity of base_link's origin is v - w x com
        velocity_in_base = vx - (wy * z - wz * y), vy - (wz * x - wx * z), vz - (wx * y - wy * x)
        self.state = RobotState(pose, velocity_in_base, (wx, wy, wz))
        return self.state

    def drive(self, speeds: Sequence[float]) -> None:
        """Push the robot with the forces of the ground on wheels that turn at these speeds [rad/s].

        The forces have an effect in the next step of Bullet. The angles of the wheels and the torques of
        their motors are computed, too. The loads and the contact points of the wheels come from the last
        `update_contacts`.
        """
        forces = self._tyre_forces(speeds)
        self._turn_wheels(speeds, forces)
        # Bullet finds the contacts of a step before it moves the robot, so `update_contacts` needs this pose
        # after the step
        self._contact_axes, self._contact_position = self._base_axes, self.state.pose_in_world.position
        # forces [N] and the points at which they push [m], in base_link: of the ground on the wheels, and of
        # friction at the contacts of the hull
        pushes = [
            ((forward, left, 0.0), footprint)
            for footprint, load, (forward, left) in zip(self._footprints, self._loads, forces)
            if load > 0.0
        ]
        pushes += [
            (self._hull_friction(point, normal, load), point) for point, normal, load in self._hull_contacts
        ]
        self._push(pushes)

    def _tyre_forces(self, speeds: Sequence[float]) -> List[Vector2]:
        """Return the force of the ground on each tyre, forwards and to the left [N].

        `speeds` are the speeds of the wheels [rad/s].
        """
        # `ground_forces` measures all positions from the centre of mass
        com_x, com_y, _ = self._robot.com
        contacts = [
            WheelContact(point[0] - com_x, point[1] - com_y, load, speed * radius)
            for point, load, speed, radius in zip(self._footprints, self._loads, speeds, self._radii)
        ]
        state, mass = self.state, self._robot.mass
        (vx, vy, _), (_, _, yaw_rate) = state.velocity_in_base, state.angular_velocity_in_base
        downhill_x, downhill_y = self._downhill()
        return ground_forces(
            contacts,
            velocity=(vx - yaw_rate * com_y, vy + yaw_rate * com_x, yaw_rate),
            external=(mass * downhill_x, mass * downhill_y),
            mass=mass,
            yaw_inertia=self._yaw_inertia,
            dt=self._dt,
            config=self._traction,
        )

    def _turn_wheels(self, speeds: Sequence[float], forces: Sequence[Vector2]) -> None:
        """Turn the wheels for one step, and compute the torques of their motors [N m].

        A torque balances the force of the ground on the tyre, and accelerates the wheel.

        Args:
            speeds: speeds of the wheels in this step [rad/s].
            forces: force of the ground on each tyre, forwards and to the left [N].
        """
        dt = self._dt
        self.torques = [
            forward * radius + inertia * (speed - last_speed) / dt
            for (forward, _), radius, inertia, speed, last_speed in zip(
                forces, self._radii, self._axial_inertias, speeds, self._wheel_speeds
            )
        ]
        self._wheel_angles = [angle + speed * dt for angle, speed in zip(self._wheel_angles, speeds)]
        self._wheel_speeds = speeds

    def _push(self, pushes: Sequence[Tuple[Vector3, Vector3]]) -> None:
        """Push the robot with forces [N] at points [m]; all are in base_link, and Bullet needs the world."""
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = self._base_axes  # axes of base_link in the world
        px, py, pz = self.state.pose_in_world.position
        for (fx, fy, fz), (x, y, z) in pushes:
            self._bullet.push_robot(
                (fx * ax + fy * bx + fz * cx, fx * ay + fy * by + fz * cy, fx * az + fy * bz + fz * cz),
                (
                    px + x * ax + y * bx + z * cx,
                    py + x * ay + y * by + z * cy,
                    pz + x * az + y * bz + z * cz,
                ),
            )

    def _downhill(self) -> Tuple[float, float]:
        """Return the part of gravity that pulls the robot down the slope, along base_link's x and y [m/s^2].

        The direction of the slope follows from the normal forces under the wheels. If no wheel is on the
        ground, the result is the whole gravity along x and y.
        """
        gx, gy, gz = along_axes(self._base_axes, self._gravity)
        nx, ny, nz = self._ground_force
        square = nx * nx + ny * ny + nz * nz
        # g - (g.n / n.n) n: gravity g without its part along the normal force n
        multiple = (gx * nx + gy * ny + gz * nz) / square if square > 0.0 else 0.0
        return gx - multiple * nx, gy - multiple * ny

    def _hull_friction(self, point: Vector3, normal: Vector3, load: float) -> Vector3:
        """Friction on the robot at a contact without a tyre, in base_link [N].

        Bullet's friction of the robot is switched off, so the chassis pushes the robot with this force. The
        other body gets no friction in return, which is a simplification; it gets only Bullet's normal force.

        Args:
            point: contact in base_link [m].
            normal: unit normal of the contact in base_link.
            load: normal force [N].
        """
        x, y, z = point
        (vx, vy, vz), (wx, wy, wz) = self.state.velocity_in_base, self.state.angular_velocity_in_base
        # velocity of the point: v + w x point
        velocity = vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x
        # the slip is the part of the velocity along the surface: v - (v . n) n
        slip_x, slip_y, slip_z = minus(velocity, normal, dot(velocity, normal))
        # friction against the slip; because of HULL_SLIP_SPEED, the friction goes to 0 smoothly when the slip
        # ends, and does not jump
        force_per_slip = -HULL_FRICTION * load / (hypot(slip_x, slip_y, slip_z) + HULL_SLIP_SPEED)
        return (force_per_slip * slip_x, force_per_slip * slip_y, force_per_slip * slip_z)

    def update_contacts(self) -> Tuple[str, ...]:
        """Read the contacts of the last step, and return the names of the bodies that the robot bumps into.

        A contact on a tyre carries the wheel if its normal points upwards. Such contacts give the wheel's
        load and footprint for the next `drive`. All other contacts are bumps, at which the next `drive`
        pushes the robot with friction.
        """
        # pose of base_link before the last step, because the engine found the contacts at this pose
        axes, (px, py, pz) = self._contact_axes, self._contact_position
        # A wheel may have several contacts. For each wheel, these are sums over its contacts: the load [N],
        # and the load times x, y and z of the contact point in base_link [N m].
        wheel_sums = [[0.0, 0.0, 0.0, 0.0] for _ in self._loads]
        ground_x = ground_y = ground_z = 0.0  # sum of the normal forces under the wheels [N]
        bumped_bodies = set()
        self._hull_contacts = []
        for body, (x, y, z), normal_in_world, force in self._bullet.contact_points():
            point, normal = along_axes(axes, (x - px, y - py, z - pz)), along_axes(axes, normal_in_world)
            wheel = self._wheel_at(point)  # index of the wheel if the contact is on a tyre, otherwise None
            support = normal[2]  # cosine of the contact's slope: 1 on level ground, 0 at an upright wall
            if wheel is None or support < SUPPORT_SLOPE:
                bumped_bodies.add(body)
                self._hull_contacts.append((point, normal, force))
                continue
            ground_x += force * normal[0]
            ground_y += force * normal[1]
            ground_z += force * support
            # only the upward part of the force carries the wheel
            load, sums = force * support, wheel_sums[wheel]
            sums[0] += load
            sums[1] += load * point[0]
            sums[2] += load * point[1]
            sums[3] += load * point[2]
        # `_downhill` uses the direction of this sum as the normal of the ground
        self._ground_force = (ground_x, ground_y, ground_z)
        for wheel, (load, load_x, load_y, load_z) in enumerate(wheel_sums):
            if load <= 0.0:
                self._loads[wheel] = 0.0  # a wheel in the air loses its grip at once
                continue
            # low-pass filter of the load
            self._loads[wheel] += (load - self._loads[wheel]) * self._dt / (self._dt + LOAD_SMOOTHING)
            # mean of the contact points, weighted by their loads
            self._footprints[wheel] = (load_x / load, load_y / load, load_z / load)
        return tuple(sorted(bumped_bodies))

    def _wheel_at(self, point: Vector3) -> Optional[int]:
        """Return the index of the wheel whose tyre has a contact at a point in base_link [m].

        Return None if the point is on no tyre, but on the hull.
        """
        x, y, z = point
        for index, ((wheel_x, wheel_y, wheel_z), radius, half_width) in enumerate(self._tyres):
            if abs(y - wheel_y) <= half_width + CONTACT_DEPTH:
                # The shape of a tyre in Bullet is two cylinders: a narrow one with the wheel's radius, and a
                # wide one whose radius is smaller by FLANK_DEPTH. A contact on the round side of either
                # cylinder is on the tyre. A contact nearer to the axle is on the flat side of the wheel or on
                # the body. Such a contact cannot carry the wheel, so it counts as a contact of the hull.
                depth = radius - hypot(x - wheel_x, z - wheel_z)  # [m] below the tread
                if -CONTACT_DEPTH <= depth <= FLANK_DEPTH + CONTACT_DEPTH:
                    return index
        return None
