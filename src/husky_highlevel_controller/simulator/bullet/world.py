"""PyBullet world of bodies: add, remove, move, step.

In: bodies, poses, velocities. Out: poses, velocities, depth buffers. Only this folder talks to PyBullet.
"""

from __future__ import annotations

import logging
from functools import partial
from math import degrees
from typing import Any, Dict, List, Mapping, NamedTuple, Sequence, Set, Tuple

import numpy as np
import pybullet

from husky_highlevel_controller.datatypes import (
    Body,
    Geometry,
    HuskyError,
    Plane,
    Pose,
    Vector3,
)
from husky_highlevel_controller.geometry import (
    compose,
    cross,
    inverse,
    minus,
    rotate,
    transform_point,
)
from husky_highlevel_controller.simulator.bullet.shapes import MAX_SHAPES, compound_shape, volume_and_center

ROBOT = "husky"  # name of the robot among the bodies
# A body in Bullet consists of a base and of links that joints connect with the base. Bullet's functions take
# this index for the base; the links have the indices 0, 1, 2 and so on.
BASE_INDEX = -1

# rospy's logger is the parent of this logger, so lines reach /rosout although this module does not import
# rospy
log = logging.getLogger("rosout.engine")

# Bullet's default is 50 iterations; 20 iterations take half the time, and the motion differs by at most 0.1 %
_SOLVER_ITERATIONS = 20
# [m] Bullet breaks the contact of two bodies when their gap becomes larger than this. With Bullet's default
# of 0.02, the ground would also touch the flanks of a tyre, which are 5 mm above the ground.
_BREAKING_THRESHOLD = 0.005
# The ground acts like a spring. On rigid ground, the solver could distribute the weight over the four rigid
# wheels in many ways. On springs, only one distribution is possible, which depends neither on the solver nor
# on the time step.
_GROUND_STIFFNESS = 1e6  # [N/m] stiffness of each contact; a Husky's wheel sinks 0.15 mm
# [N s/m] roughly the critical damping for a quarter of the Husky's mass, which is the part on each wheel
_GROUND_DAMPING = 8e3
_LIFT_FROM = 1e-3  # [m] a movable body that is deeper in the ground than this is put on top of the ground
# Places of two values in the tuples that Bullet's getClosestPoints(first, second) returns: the unit normal,
# which points from the second body to the first, and the distance [m], which is negative if they overlap.
_NORMAL, _DISTANCE = 7, 8
# [m] A body must not reach deeper than this into another body. A depth of 1 mm is allowed, because the
# triangles of a mesh are 1 mm thick in Bullet.
_TOO_DEEP = 2e-3


class PlacementError(HuskyError):
    """A body cannot be placed: its name is taken or unknown, or there is no room."""


class _Part(NamedTuple):
    """Base of a body in Bullet, or a link that is fixed to the base.

    A body of more than MAX_SHAPES shapes needs such links, because one part cannot have more shapes.
    """

    shape: int  # Bullet's number of the compound shape
    mass: float = 0.0  # [kg]; 0 if the body never moves
    center: Vector3 = (0.0, 0.0, 0.0)  # [m] centre of mass in the body's frame


class _Engine:
    """PyBullet's functions, each with the number of one physics server filled in.

    BulletClient of pybullet_utils does the same, but prints a text when it starts.
    """

    def __init__(self) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)

    def __getattr__(self, name: str) -> Any:
        """Return PyBullet's function of this name, for this server.

        Python calls `__getattr__` only for a missing attribute. The function becomes an attribute here, so
        the next use of the same name is fast.
        """
        function = partial(getattr(pybullet, name), physicsClientId=self._client)
        setattr(self, name, function)
        return function


class BulletWorld:
    """A Bullet physics server, in this process and without a window."""

    def __init__(self, dt: float) -> None:
        """Start a server; `dt` is the duration of a step [s]."""
        self._dt = dt
        self._engine = _Engine()
        if not self._engine.isConnected():
            raise HuskyError("PyBullet did not start a physics server")

    def close(self) -> None:
        """Disconnect from the server and free its memory; nothing else may be called afterwards."""
        self._engine.disconnect()

    def clear(self, gravity: Vector3) -> None:
        """Remove every body and set gravity."""
        self._engine.resetSimulation()
        self._engine.setGravity(*gravity)
        self._engine.setPhysicsEngineParameter(
            fixedTimeStep=self._dt,
            numSolverIterations=_SOLVER_ITERATIONS,
            contactBreakingThreshold=_BREAKING_THRESHOLD,
            deterministicOverlappingPairs=1,  # the same commands always give the same motion
        )
        self._name_by_id: Dict[int, str] = {}  # name of the body by Bullet's id
        # Bullet's ids of each body of the world. A body with planes has an id for each plane, and then an id
        # for all other shapes. A body without planes, such as any movable body, has only the last id.
        self._ids_by_name: Dict[str, List[int]] = {}
        # Bullet's id of each collision shape. Its key describes the shape, so equal shapes are made once.
        self._shapes: Dict[Tuple[Any, ...], int] = {}
        # parts of each body by its id: its base, and then links if it has more than MAX_SHAPES shapes
        self._parts: Dict[int, List[_Part]] = {}
        self._planes: List[int] = []  # ids of the bodies that are planes
        # pose of the centre-of-mass frame in the body's frame, by id. Bullet takes and returns only poses of
        # the centre-of-mass frame, so each pose is converted with this pose. For a plane, which has no mass,
        # it is the pose of the plane in the body's frame.
        self._inertial_in_body: Dict[int, Pose] = {}
        # ids of the bodies of each model; bodies of one model pass through one another
        self._ids_by_model: Dict[str, List[int]] = {}

    def add_body(self, body: Body) -> None:
        """Add a body; a movable body that reaches into the ground is lifted out of the ground.

        Raises:
            PlacementError: the body is a plane that can move, or has the robot's name.
        """
        if body.name == ROBOT:
            raise PlacementError(f"'{ROBOT}' is the name of the robot; choose another name")
        solids = []
        for geometry in body.collisions:
            # a compound shape of Bullet cannot contain a plane, so a plane becomes a body of its own
            if isinstance(geometry.shape, Plane):
                self._add_plane(body, geometry.shape.normal, geometry.pose_in_body)
            else:
                solids.append(geometry)
        is_movable = body.mass > 0.0
        if solids:
            body_id = self._create_body(body.name, self._parts_of(solids, body.mass), body.pose_in_world)
            # bodies of one model pass through one another, as in Gazebo
            if body.model:
                others = self._ids_by_model.setdefault(body.model, [])
                self._set_collides(body_id, others, collides=False)
                others.append(body_id)
            if is_movable:
                self._lift_out_of_the_ground(body_id)
            else:  # a static body may be a floor
                self._make_springy(body_id)

    def _make_springy(self, body_id: int) -> None:
        """Let contacts with all parts of a static body act like springs, see _GROUND_STIFFNESS."""
        for index in self._indices(body_id):
            self._engine.changeDynamics(
                body_id, index, contactStiffness=_GROUND_STIFFNESS, contactDamping=_GROUND_DAMPING
            )

    def _set_collides(self, body_id: int, others: List[int], collides: bool) -> None:
        """Set whether a body collides with other bodies, or passes through them."""
        for other in others:
            for index in self._indices(body_id):
                for other_index in self._indices(other):
                    self._engine.setCollisionFilterPair(body_id, other, index, other_index, int(collides))

    def _indices(self, body_id: int) -> range:
        """Bullet's indices of the parts of a body: its base, then its links, which begin at 0."""
        return range(BASE_INDEX, BASE_INDEX + len(self._parts[body_id]))

    def remove_body(self, name: str) -> None:
        """Remove a body from the world."""
        for body_id in self._ids_by_name.pop(name):
            self._remove(body_id)
            if body_id in self._planes:
                self._planes.remove(body_id)

    def _remove(self, body_id: int) -> None:
        """Remove a body from Bullet, and forget all records of its id."""
        for model_ids in self._ids_by_model.values():
            if body_id in model_ids:
                model_ids.remove(body_id)
                # Bullet will give this id to another new body. Without the next line, that body would pass
                # through the bodies of this model.
                self._set_collides(body_id, model_ids, collides=True)
        self._engine.removeBody(body_id)
        for record in (self._name_by_id, self._parts, self._inertial_in_body):
            record.pop(body_id, None)

    def check_movable(self, name: str) -> None:
        """Raise PlacementError if a body has a plane, because planes cannot be moved."""
        if any(body_id in self._planes for body_id in self._ids_by_name[name]):
            raise PlacementError(f"'{name}' is a plane, which cannot be moved")

    def move_body(self, name: str, pose_in_world: Pose) -> None:
        """Move a body without planes to another pose, at rest."""
        body_id = self._ids_by_name[name][-1]  # the only id, because the body has no planes
        self._set_pose(body_id, pose_in_world)
        mass = self._engine.getDynamicsInfo(body_id, BASE_INDEX)[0]
        if mass > 0.0:
            self._lift_out_of_the_ground(body_id)

    def set_pose_unchecked(self, name: str, pose_in_world: Pose) -> None:
        """Move a body and let it overlap with other bodies; this is for a world that is only rendered."""
        self._set_pose(self._ids_by_name[name][-1], pose_in_world)

    def depth_buffer(
        self,
        pose_camera_in_world: Pose,
        width: int,
        height: int,
        vertical_field_of_view: float,
        near: float,
        far: float,
    ) -> np.ndarray:
        """Render an image, and return its OpenGL depth buffer, (height, width) in 0..1.

        0 is the near limit and 1 is the far limit, but the values between are not proportional to the
        distance.

        Args:
            pose_camera_in_world: pose of the optical frame, z ahead and y down.
            width: columns [px].
            height: rows [px].
            vertical_field_of_view: angle from the upper to the lower edge [rad].
            near: distance of the near limit [m].
            far: distance of the far limit [m].
        """
        # Bullet takes the position of the camera, a point ahead of it, and a direction upwards
        eye = pose_camera_in_world.position
        view = self._engine.computeViewMatrix(
            eye,
            transform_point(pose_camera_in_world, (0.0, 0.0, 1.0)),
            rotate(pose_camera_in_world.quat_xyzw, (0.0, -1.0, 0.0)),
        )
        projection = self._engine.computeProjectionMatrixFOV(
            degrees(vertical_field_of_view), width / height, near, far
        )
        # the result is (width, height, colours, depths, body ids) of the image; only the depths are used
        _, _, _, depth, _ = self._engine.getCameraImage(
            width,
            height,
            view,
            projection,
            shadow=0,
            flags=pybullet.ER_NO_SEGMENTATION_MASK,
            renderer=pybullet.ER_TINY_RENDERER,
        )
        return np.reshape(depth, (height, width))

    def _set_pose(self, body_id: int, pose_in_world: Pose) -> None:
        """Put the body with an id at a pose of the body's frame, at rest."""
        # Bullet takes the pose of the centre-of-mass frame
        com_pose = compose(pose_in_world, self._inertial_in_body[body_id])
        self._engine.resetBasePositionAndOrientation(body_id, com_pose.position, com_pose.quat_xyzw)
        self._engine.resetBaseVelocity(body_id, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def check_moves(self, poses: Mapping[str, Pose], checked: str) -> None:
        """Check that a body has room at its new pose, after all bodies in `poses` have moved.

        Nothing moves yet. The check makes copies at the new poses and removes them again, because a body that
        is moved there and back would lose its contacts.

        Args:
            poses: new poses in the world of all bodies that move together, by name.
            checked: name of the body that is checked, one of the names in `poses`.

        Raises:
            PlacementError: the body would reach into another body.
        """
        copies: Dict[str, int] = {}  # id of the copy of each body
        try:
            for name, pose in poses.items():
                # a body with planes would need several copies, but it cannot move (`check_movable`)
                copies[name] = self._copy(name, pose)
            # the bodies will leave their present poses, so only their copies can be in the way
            leaving_ids = [body_id for name in poses for body_id in self._ids_by_name[name]]
            self._check_overlaps([copies[checked]], may_overlap=leaving_ids)
        finally:
            for body_id in copies.values():
                self._remove(body_id)

    def _copy(self, name: str, pose_in_world: Pose) -> int:
        """Create a copy of a body without planes at a pose, for `check_moves`, and return the copy's id."""
        body_id = self._ids_by_name[name][-1]
        parts = self._parts[body_id]
        copy = self._create(parts, pose_in_world)
        self._name_by_id[copy] = name
        # `_check_overlaps` lets bodies of one model overlap, so the copy must belong to the model of the body
        for model_ids in self._ids_by_model.values():
            if body_id in model_ids:
                model_ids.append(copy)
        if parts[0].mass > 0.0:
            self._lift_out_of_the_ground(copy)  # `move_body` lifts the body in the same way
        return copy

    def check_room(self, name: str) -> None:
        """Check that a body, or the robot, does not stand inside another body at its present pose.

        Raises PlacementError if it does.
        """
        # only the start of the robot is checked here, and a user chooses it by launch arguments
        remedy = "; choose another x, y or z" if name == ROBOT else ""
        self._check_overlaps(self._ids_by_name[name], remedy=remedy)

    def _check_overlaps(
        self, checked_ids: Sequence[int], may_overlap: Sequence[int] = (), remedy: str = ""
    ) -> None:
        """Check that a body does not stand inside another body.

        The body may overlap with planes, and with other bodies of its model.

        Args:
            checked_ids: all ids of the body in Bullet; a body with planes has several.
            may_overlap: ids of more bodies with which the body may overlap.
            remedy: end of the error's text, which tells the user what to do.

        Raises:
            PlacementError: the body reaches into another body.
        """
        allowed_ids = {*checked_ids, *may_overlap, *self._planes}
        for model_ids in self._ids_by_model.values():
            if any(body_id in model_ids for body_id in checked_ids):
                allowed_ids.update(model_ids)
        # Bullet's bounding boxes and contacts are of the last step; compute them for the present poses
        self._engine.performCollisionDetection()
        for checked_id in checked_ids:
            for other in sorted(self._ids_near(checked_id) - allowed_ids):
                points = self._engine.getClosestPoints(checked_id, other, 0.0)
                if any(point[_DISTANCE] < -_TOO_DEEP for point in points):
                    name, name_of_other = self._name_by_id[checked_id], self._name_by_id[other]
                    raise PlacementError(f"'{name}' would stand inside '{name_of_other}'{remedy}")

    def _ids_near(self, body_id: int) -> Set[int]:
        """Return the ids of the bodies whose bounding boxes overlap with those of a body.

        Only these bodies can touch the body. Bullet finds them much faster than it measures exact distances.
        """
        ids: Set[int] = set()
        # a body has its base, and a link for each of its joints
        for part in range(BASE_INDEX, self._engine.getNumJoints(body_id)):
            low, high = self._engine.getAABB(body_id, part)
            # Bullet returns pairs of a body and one of its parts, or None if nothing overlaps
            pairs = self._engine.getOverlappingObjects(low, high) or ()
            ids.update(other for other, _ in pairs)
        return ids

    def pose_of(self, name: str) -> Pose:
        """Pose of a body in the world."""
        return self._pose(self._ids_by_name[name][-1])

    def velocity_of(self, name: str) -> Tuple[Vector3, Vector3]:
        """Velocity of a movable body's origin [m/s] and its spin [rad/s], in the world."""
        body_id = self._ids_by_name[name][-1]  # a movable body has only one id
        velocity_of_com, spin = self._engine.getBaseVelocity(body_id)
        # v_origin = v_com - w x r, with r from the origin to the centre of mass
        velocity = minus(velocity_of_com, cross(spin, self._origin_to_com(body_id)))
        return velocity, spin

    def set_velocity(self, name: str, velocity: Vector3, spin: Vector3) -> None:
        """Give a movable body a velocity of its origin [m/s] and a spin [rad/s], in the world."""
        body_id = self._ids_by_name[name][-1]  # a movable body has only one id
        # v_com = v_origin + w x r = v_origin - r x w, with r from the origin to the centre of mass
        velocity_of_com = minus(velocity, cross(self._origin_to_com(body_id), spin))
        self._engine.resetBaseVelocity(body_id, velocity_of_com, spin)

    def _origin_to_com(self, body_id: int) -> Vector3:
        """Vector from a body's origin to its centre of mass, in the world [m]."""
        return rotate(self._pose(body_id).quat_xyzw, self._inertial_in_body[body_id].position)

    def _pose(self, body_id: int) -> Pose:
        """Return the pose of a body's frame in the world; Bullet has only that of its centre of mass."""
        position, quat = self._engine.getBasePositionAndOrientation(body_id)
        return compose(Pose(position, quat), inverse(self._inertial_in_body[body_id]))

    def _add_plane(self, body: Body, normal: Vector3, pose_in_body: Pose) -> None:
        """Add a plane of a body. Raises PlacementError if the body can move.

        Contacts with the plane act like a spring, see _GROUND_STIFFNESS. The plane gets an id of its own,
        because a compound shape of Bullet cannot contain a plane.
        """
        if body.mass > 0.0:
            raise PlacementError(f"'{body.name}' is a plane that can move ({body.mass} kg); make it static")
        shape = self._engine.createCollisionShape(pybullet.GEOM_PLANE, planeNormal=normal)
        pose = compose(body.pose_in_world, pose_in_body)
        plane = self._create_body(body.name, [_Part(shape)], pose)
        self._make_springy(plane)
        # Bullet has the pose of the plane, which may stand away from the origin of its body. With this entry,
        # `_pose` computes the pose of the body from the pose of the plane.
        self._inertial_in_body[plane] = pose_in_body
        self._planes.append(plane)

    def _create_body(self, name: str, parts: Sequence[_Part], pose: Pose) -> int:
        """Create a body in Bullet as part of the body `name`, and return its id.

        Raises PlacementError if Bullet refuses the body.
        """
        body_id = self._create(parts, pose)
        if body_id < 0:
            raise PlacementError(f"PyBullet refused '{name}' at {pose.position}")
        self._name_by_id[body_id] = name
        self._ids_by_name.setdefault(name, []).append(body_id)
        return body_id

    def _create(self, parts: Sequence[_Part], pose: Pose) -> int:
        """Create a body, and return its id, which is negative if Bullet refuses the body.

        The first part is the base of the body; all other parts are links that are fixed to the base.
        """
        base, links = parts[0], parts[1:]
        arguments: Dict[str, Any] = {}
        if links:
            count, origin, no_turn = len(links), (0.0, 0.0, 0.0), Pose().quat_xyzw
            arguments = {
                "linkMasses": [link.mass for link in links],
                "linkCollisionShapeIndices": [link.shape for link in links],
                "linkVisualShapeIndices": [-1] * count,  # Bullet draws the collision shapes
                "linkPositions": [origin] * count,
                "linkOrientations": [no_turn] * count,
                "linkInertialFramePositions": [link.center for link in links],
                "linkInertialFrameOrientations": [no_turn] * count,
                "linkParentIndices": [0] * count,  # 0 means the base here
                "linkJointTypes": [pybullet.JOINT_FIXED] * count,
                "linkJointAxis": [(0.0, 0.0, 1.0)] * count,
            }
        body_id: int = self._engine.createMultiBody(
            baseMass=base.mass,
            baseCollisionShapeIndex=base.shape,
            basePosition=pose.position,
            baseOrientation=pose.quat_xyzw,
            baseInertialFramePosition=base.center,
            baseInertialFrameOrientation=Pose().quat_xyzw,
            **arguments,
        )
        # `_create_body` raises an error for a negative id, so these entries have no effect then
        self._parts[body_id] = list(parts)
        self._inertial_in_body[body_id] = Pose(base.center)
        return body_id

    def _parts_of(self, solids: Sequence[Geometry], mass: float) -> List[_Part]:
        """Divide the solid shapes of a body into parts of at most MAX_SHAPES shapes, and return the parts.

        Each part gets a share of the mass [kg] in proportion to its volume.
        """
        groups = [solids[first : first + MAX_SHAPES] for first in range(0, len(solids), MAX_SHAPES)]
        volumes_and_centers = [volume_and_center(group) for group in groups]
        total_volume = sum(volume for volume, _ in volumes_and_centers)
        return [
            _Part(self._shape_of(group, is_movable=mass > 0.0), mass * (volume / total_volume), center)
            for group, (volume, center) in zip(groups, volumes_and_centers)
        ]

    def _shape_of(self, solids: Sequence[Geometry], is_movable: bool) -> int:
        """Return Bullet's number of a collision shape that combines solids.

        Equal shapes are made once, because Bullet keeps the memory of each shape until `clear`.
        """
        key = (is_movable, *((geometry.shape, geometry.pose_in_body) for geometry in solids))
        if key not in self._shapes:
            self._shapes[key] = compound_shape(solids, is_movable, self._engine)
        return self._shapes[key]

    def _lift_out_of_the_ground(self, body_id: int) -> None:
        """Put a movable body that reaches into a plane on top of this plane.

        Otherwise Bullet would push the body out of the plane so strongly that the body flies into the air.
        """
        for plane in self._planes:
            points = self._engine.getClosestPoints(body_id, plane, 0.0)
            # depth of each point below the plane [m], and the plane's normal, which points out of the ground
            depths_and_normals = [(-point[_DISTANCE], point[_NORMAL]) for point in points]
            depth, normal = max(depths_and_normals, default=(0.0, ()))  # the deepest point
            if depth > _LIFT_FROM:
                position, quat = self._engine.getBasePositionAndOrientation(body_id)
                lifted = [coordinate + depth * up for coordinate, up in zip(position, normal)]
                self._engine.resetBasePositionAndOrientation(body_id, lifted, quat)
                body, ground = self._name_by_id[body_id], self._name_by_id[plane]
                log.debug("'%s' was sunk %.2f m into '%s' and now stands on it", body, depth, ground)

    def step(self) -> None:
        """Advance the physics by one step."""
        self._engine.stepSimulation()
