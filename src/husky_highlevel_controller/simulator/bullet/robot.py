"""PyBullet robot with four driven wheels, in a world of bodies.

In: a robot's model, wheel speeds, forces. Out: how it moves and what it touches.
Must not know: ROS, commands, sensors, how a tyre grips.
"""

from __future__ import annotations

import os
import tempfile
from typing import List, NamedTuple, Optional, Sequence, Tuple

import pybullet

from husky_highlevel_controller.datatypes import Pose, Vector3, WheelState
from husky_highlevel_controller.simulator.bullet.world import BASE_INDEX, ROBOT, BulletWorld, PlacementError
from husky_highlevel_controller.simulator.models.robot_model import RobotModel

_WHEEL_TORQUE = (
    1000.0  # [N m], so that the wheels follow their commanded speed (Gazebo: ideal velocity interface)
)
_URDF_FLAGS = pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_USE_IMPLICIT_CYLINDER


class ContactPoint(NamedTuple):
    """One contact point of the robot with another body."""

    body: str
    wheel: Optional[int]  # index of the wheel that touches; None for the rest of the robot
    point_in_world: Vector3  # [m]
    normal_in_world: Vector3  # unit, from the body to the robot
    force: float  # [N], along the normal


class RobotWorld(BulletWorld):
    """A Bullet physics server with one robot in it."""

    def add_robot(self, model: RobotModel, pose: Pose) -> None:
        """Add the robot with base_link at `pose`.

        Raises:
            PlacementError: something stands there.
        """
        # Bullet reads URDFs from files only, and caches them by name: hence a new name every time
        handle, path = tempfile.mkstemp(suffix=".urdf")
        try:
            with os.fdopen(handle, "w") as file:
                file.write(model.physics_urdf)
            self._robot = pybullet.loadURDF(path, flags=_URDF_FLAGS, physicsClientId=self._client)
        finally:
            os.remove(path)
        links = range(pybullet.getNumJoints(self._robot, physicsClientId=self._client))
        infos = [pybullet.getJointInfo(self._robot, link, physicsClientId=self._client) for link in links]
        names = [info[1].decode() for info in infos]
        self._wheel_names = tuple(wheel.joint for wheel in model.wheels)
        self._wheels = [names.index(name) for name in self._wheel_names]
        self._wheel_targets: Sequence[float] = ()
        self._wheel_of = {link: wheel for wheel, link in enumerate(self._wheels)}
        for link in (BASE_INDEX, *links):
            # no grip of Bullet's own at the wheels (traction.py has it), nothing that slows the robot down
            grip = {"lateralFriction": 0.0} if link in self._wheels else {}
            pybullet.changeDynamics(
                self._robot, link, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0,
                physicsClientId=self._client, **grip,
            )  # fmt: skip
        info = pybullet.getDynamicsInfo(self._robot, BASE_INDEX, physicsClientId=self._client)
        self._note_inertial_frame(self._robot, Pose(info[3], info[4]))
        # centre of mass of the base, in base_link [m]: whose velocity `robot_motion` returns
        self.robot_com: Vector3 = info[3]
        self._names[self._robot], self._ids[ROBOT] = ROBOT, [self._robot]
        self._put(self._robot, pose)
        self.check_room(ROBOT)

    def move_robot(self, pose: Pose) -> None:
        """Move the robot, at rest, with base_link at `pose`.

        Raises:
            PlacementError: something stands there; the robot stays where it is.
        """
        before = self._pose(self._robot)
        self._put(self._robot, pose)
        try:
            self.check_room(ROBOT)
        except PlacementError:
            self._put(self._robot, before)
            raise
        for wheel in self._wheels:
            angle = pybullet.getJointState(self._robot, wheel, physicsClientId=self._client)[0]
            pybullet.resetJointState(self._robot, wheel, angle, 0.0, physicsClientId=self._client)

    def robot_motion(self) -> Tuple[Pose, Vector3, Vector3]:
        """Pose of base_link, velocity of the base's centre of mass [m/s] and spin [rad/s], in the world."""
        velocity, spin = pybullet.getBaseVelocity(self._robot, physicsClientId=self._client)
        return self._pose(self._robot), velocity, spin

    def contact_points(self) -> List[ContactPoint]:
        """Contact points of the robot with other bodies."""
        contacts = pybullet.getContactPoints(bodyA=self._robot, physicsClientId=self._client)
        names, wheel_of = self._names, self._wheel_of
        return [
            ContactPoint(names[other], wheel_of.get(link), point, normal, force)
            for _, _, other, link, _, point, _, normal, _, force, *_ in contacts
            if force > 0.0
        ]

    def wheels(self) -> WheelState:
        """Angles, speeds and torques of the wheels."""
        states = pybullet.getJointStates(self._robot, self._wheels, physicsClientId=self._client)
        angles, speeds, _, torques = zip(*states)
        return WheelState(self._wheel_names, angles, speeds, torques)

    def drive_wheels(self, speeds: Sequence[float]) -> None:
        """Set the velocity targets of the wheel motors [rad/s]."""
        if speeds == self._wheel_targets:
            return
        self._wheel_targets = speeds
        pybullet.setJointMotorControlArray(
            self._robot,
            self._wheels,
            pybullet.VELOCITY_CONTROL,
            targetVelocities=speeds,
            forces=[_WHEEL_TORQUE] * len(self._wheels),
            physicsClientId=self._client,
        )

    def push_robot(self, force_in_world: Vector3, point_in_world: Vector3) -> None:
        """Apply an external force to the robot's base during the next step, at a point [N, m]."""
        pybullet.applyExternalForce(
            self._robot,
            BASE_INDEX,
            force_in_world,
            point_in_world,
            pybullet.WORLD_FRAME,
            physicsClientId=self._client,
        )
