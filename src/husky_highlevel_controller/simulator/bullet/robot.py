"""PyBullet robot, one rigid body, in a world of bodies.

In: a robot's model, forces. Out: its motion and its contacts.
"""

from __future__ import annotations

import os
import tempfile
from typing import List, Tuple

import pybullet

from husky_highlevel_controller.datatypes import Pose, Vector3
from husky_highlevel_controller.simulator.bullet.world import BASE_INDEX, ROBOT, BulletWorld
from husky_highlevel_controller.simulator.models.robot_model import RobotModel

# Bullet uses the inertia in the URDF instead of its own, and exact cylinders instead of polygons
_URDF_FLAGS = pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_USE_IMPLICIT_CYLINDER


# A contact point of the robot: name of the other body, position in the world [m], unit normal in the world
# (from the other body to the robot), and force along the normal [N]. Every physics step makes several contact
# points, so a contact point is a plain tuple, which is faster to make than a record.
ContactPoint = Tuple[str, Vector3, Vector3, float]


class RobotWorld(BulletWorld):
    """A Bullet physics server with one robot in it."""

    def add_robot(self, model: RobotModel, pose: Pose) -> None:
        """Add the robot with base_link at `pose`; PlacementError if something stands there."""
        self._model = model
        self._robot = self._load(pose)
        self._ids_by_name[ROBOT] = [self._robot]
        # Bullet's friction is switched off, because traction.py computes it. Bullet's damping, which slows
        # every moving body down, is switched off, too.
        self._engine.changeDynamics(
            self._robot, BASE_INDEX, lateralFriction=0.0, linearDamping=0.0, angularDamping=0.0
        )
        self.check_room(ROBOT)

    def _load(self, pose: Pose) -> int:
        """Create a body in Bullet from the robot's URDF, and return its id.

        base_link gets this pose, or a pose above it if the body would be in the ground.
        """
        # Bullet reads a URDF only from a file. It does not read a file of the same name again, even if the
        # content has changed, so each URDF is written into a new file.
        handle, path = tempfile.mkstemp(suffix=".urdf")
        try:
            with os.fdopen(handle, "w") as file:
                file.write(self._model.physics_urdf)
            body_id: int = self._engine.loadURDF(path, flags=_URDF_FLAGS)
        finally:
            os.remove(path)
        _, _, _, com_position, com_quat, *_ = self._engine.getDynamicsInfo(body_id, BASE_INDEX)
        # Bullet takes and returns the poses of a frame at the centre of mass. `_set_pose` and `_pose` need
        # the offset of this frame from base_link to convert between these poses and the poses of base_link.
        self._inertial_in_body[body_id] = Pose(com_position, com_quat)
        self._name_by_id[body_id] = ROBOT
        self._put(body_id, pose)
        return body_id

    def _put(self, body_id: int, pose: Pose) -> None:
        """Put the robot, or a copy of the robot, at a pose of base_link, but not inside the ground."""
        self._set_pose(body_id, pose)
        self._lift_out_of_the_ground(body_id)

    def move_robot(self, pose: Pose) -> None:
        """Move base_link to a pose, at rest.

        Raises PlacementError, and moves nothing, if something stands at this pose.
        """
        self.check_moves({ROBOT: pose}, checked=ROBOT)
        self._put(self._robot, pose)

    def _copy(self, name: str, pose_in_world: Pose) -> int:
        """Create a copy of a body, or of the robot, at a pose, and return its id."""
        if name != ROBOT:
            return super()._copy(name, pose_in_world)
        return self._load(pose_in_world)

    def robot_motion(self) -> Tuple[Pose, Vector3, Vector3]:
        """Pose of base_link, velocity of the centre of mass [m/s] and spin [rad/s], in the world."""
        velocity, spin = self._engine.getBaseVelocity(self._robot)
        return self._pose(self._robot), velocity, spin

    def contact_points(self) -> List[ContactPoint]:
        """Contact points of the robot with other bodies."""
        # Each contact of Bullet is a tuple, with the id of the other body at index 2, the position on the
        # robot at 5, the normal at 7, and the force along the normal at 9. A body that is near the robot, but
        # does not touch the robot, has a contact without force.
        contacts = self._engine.getContactPoints(bodyA=self._robot)
        names = self._name_by_id
        return [
            (names[contact[2]], contact[5], contact[7], contact[9])
            for contact in contacts
            if contact[9] > 0.0
        ]

    def push_robot(self, force_in_world: Vector3, point_in_world: Vector3) -> None:
        """Apply an external force [N] to the robot at a point [m]; Bullet uses it for the next step only."""
        self._engine.applyExternalForce(
            self._robot, BASE_INDEX, force_in_world, point_in_world, pybullet.WORLD_FRAME
        )
