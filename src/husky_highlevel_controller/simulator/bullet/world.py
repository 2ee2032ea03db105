"""PyBullet world of bodies: add, remove, move, step.

In: bodies, poses, velocities. Out: poses, velocities, depth buffers. Only this folder talks to PyBullet.
"""

from __future__ import annotations

import logging
from functools import partial
from math import degrees
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

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
BASE_INDEX = -1  # Bullet's index of the base of a body; the links of the body have indices from 0 on

# rospy's logger is the parent of this logger, so lines reach /rosout although this module does not import
# rospy
log = logging.getLogger("rosout.engine")

# Bullet's default is 50 iterations; 20 iterations take half the time, and the motion differs by at most 0.1 %
_SOLVER_ITERATIONS = 20
# [m] bodies that are nearer than this have a contact; with Bullet's default of 0.02, the ground would also
# touch the flanks of a tyre, which are 5 mm above the ground
_BREAKING_THRESHOLD = 0.005
# The ground acts like a spring. On rigid ground, the solver could distribute the weight over the four rigid
# wheels in many ways. On springs, only one distribution is possible, which depends neither on the solver nor
# on the time step.
_GROUND_STIFFNESS = 1e6  # [N/m] stiffness of each contact; a Husky's wheel sinks 0.15 mm
_GROUND_DAMPING = 8e3  # [N s/m] roughly the critical damping of a quarter of the Husky
_LIFT_FROM = 1e-3  # [m] a movable body that is deeper in the ground than this is put on top of the ground
# indices in a tuple of getClosestPoints: the unit normal from the second body, and the distance, which is
# negative if the bodies overlap
_NORMAL, _DISTANCE = 7, 8
# [m] a body must not reach deeper than this into another body; Bullet's triangles are 1 mm thick, so a
# smaller depth is allowed
_TOO_DEEP = 2e-3


class PlacementError(HuskyError):
    """A body cannot be placed: its name is taken or unknown, or there is no room."""


class _Part(NamedTuple):
    """Part of a body: its base, or a link that is fixed to the base, with at most MAX_SHAPES shapes."""

    shape: int  # Bullet's number of the compound shape
    mass: float = 0.0  # [kg]; 0 if the body never moves
    center: Vector3 = (0.0, 0.0, 0.0)  # [m] centre of mass in the body's frame


class _Engine:
    """PyBullet's functions, bound to one server; BulletClient of pybullet_utils would print at its start."""

    def __init__(self) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)

    def __getattr__(self, name: str) -> Any:
        """Return a function of PyBullet that uses this server; it becomes an attribute, to save time."""
        bound = partial(getattr(pybullet, name), physicsClientId=self._client)
        setattr(self, name, bound)
        return bound


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
        # Bullet gives each of its bodies an id. A body of the world may be several bodies in Bullet: one for
        # each of its planes, and the last one for all its other shapes.
        self._name_by_id: Dict[int, str] = {}
        self._ids_by_name: Dict[str, List[int]] = {}
        # ids of shapes by their content, because equal shapes share an id
        self._shapes: Dict[Tuple[Any, ...], int] = {}
        # parts of each body by its id: its base, and then links if it has more than MAX_SHAPES shapes
        self._parts: Dict[int, List[_Part]] = {}
        self._planes: List[int] = []  # ids of the bodies that are planes
        # pose of the centre-of-mass frame in the body's frame, by id; all poses from Bullet are poses of the
        # centre-of-mass frame
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
        for bodies in self._ids_by_model.values():
            # Bullet gives the id to the next new body, which must not pass through the bodies of this model
            if body_id in bodies:
                bodies.remove(body_id)
                self._set_collides(body_id, bodies, collides=True)
        self._engine.removeBody(body_id)
        for record in (self._name_by_id, self._parts, self._inertial_in_body):
            record.pop(body_id, None)

    def check_movable(self, name: str) -> None:
        """Raise PlacementError if a body is a plane, because planes cannot be moved."""
        (*planes, body_id) = self._ids_by_name[name]
        if planes or body_id in self._planes:
            raise PlacementError(f"'{name}' is a plane, which cannot be moved")

    def move_body(self, name: str, pose_in_world: Pose) -> None:
        """Move a body, but not a plane, to another pose, at rest."""
        body_id = self._ids_by_name[name][-1]
        self._set_pose(body_id, pose_in_world)
        mass = self._engine.getDynamicsInfo(body_id, BASE_INDEX)[0]
        if mass > 0.0:
            self._lift_out_of_the_ground(body_id)

    def set_pose_unchecked(self, name: str, pose_in_world: Pose) -> None:
        """Move a body without a check for room; this is for a world that is only rendered."""
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
        """Return the OpenGL depth buffer of a camera, (height, width) in 0..1.

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
        """Put a body with an id of Bullet at a pose, at rest."""
        pose = compose(pose_in_world, self._inertial_in_body[body_id])
        self._engine.resetBasePositionAndOrientation(body_id, pose.position, pose.quat_xyzw)
        self._engine.resetBaseVelocity(body_id, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def check_moves(self, poses: Mapping[str, Pose], checked: str) -> None:
        """Check that a body has room at its new pose, when other bodies move to new poses together with it.

        The check uses copies of the bodies, because a body that is moved there and back would lose its
        contacts.

        Args:
            poses: new poses in the world of all bodies that move together, by name.
            checked: name of the body that is checked, one of the names in `poses`.

        Raises:
            PlacementError: the body would reach into another body.
        """
        copies: Dict[str, int] = {}
        try:
            for other, pose in poses.items():
                # one copy is the whole body, because a body with planes cannot move (`check_movable`)
                copies[other] = self._copy(other, pose)
            # the bodies leave their present poses, so only their copies at the new poses count
            present_ids = [body_id for other in poses for body_id in self._ids_by_name[other]]
            self.check_room(checked, copy=copies[checked], ignored=present_ids)
        finally:
            for body_id in copies.values():
                self._remove(body_id)

    def _copy(self, name: str, pose_in_world: Pose) -> int:
        """Create a copy of a body at a pose, for `check_moves`, and return its id; the body has no planes."""
        body_id = self._ids_by_name[name][-1]
        parts = self._parts[body_id]
        copy = self._create(parts, pose_in_world)
        self._name_by_id[copy] = name
        # the copy belongs to the same model, so that `check_room` lets the model's bodies overlap here, too
        for bodies in self._ids_by_model.values():
            if body_id in bodies:
                bodies.append(copy)
        if parts[0].mass > 0.0:
            self._lift_out_of_the_ground(copy)  # `move_body` lifts the body in the same way
        return copy

    def check_room(self, name: str, copy: Optional[int] = None, ignored: Sequence[int] = ()) -> None:
        """Check that a body, or the robot, does not stand inside another body.

        The body may overlap with planes, and with other bodies of its model.

        Args:
            name: name of the body, or of the robot.
            copy: id of a copy at a new pose, which is checked instead of the body; None for the body itself.
            ignored: ids of bodies that the body may also overlap with.

        Raises:
            PlacementError: the body reaches into another body.
        """
        # a body with planes has several ids in Bullet
        checked_ids = self._ids_by_name[name] if copy is None else [copy]
        body_ids = set(self._ids_by_name[name])
        same_model_ids = [bodies for bodies in self._ids_by_model.values() if not body_ids.isdisjoint(bodies)]
        self._engine.performCollisionDetection()  # the contacts are computed again for the present poses
        for checked_id in checked_ids:
            # Bullet quickly finds the bodies whose bounding boxes overlap; only these bodies are checked
            # exactly. A body consists of its base (index -1) and of a link for each joint (from index 0 on).
            parts = range(BASE_INDEX, self._engine.getNumJoints(checked_id))
            boxes = [self._engine.getAABB(checked_id, part) for part in parts]
            # `or ()`, because Bullet returns None if nothing overlaps
            near = {other for box in boxes for other, _ in self._engine.getOverlappingObjects(*box) or ()}
            for other in sorted(near.difference(checked_ids, ignored, self._planes, *same_model_ids)):
                points = self._engine.getClosestPoints(checked_id, other, 0.0)
                if any(point[_DISTANCE] < -_TOO_DEEP for point in points):
                    # only the robot's start has the launch arguments x, y and z; a move checks a copy
                    remedy = "; choose another x, y or z" if name == ROBOT and copy is None else ""
                    raise PlacementError(f"'{name}' would stand inside '{self._name_by_id[other]}'{remedy}")

    def pose_of(self, name: str) -> Pose:
        """Pose of a body in the world."""
        return self._pose(self._ids_by_name[name][-1])

    def velocity_of(self, name: str) -> Tuple[Vector3, Vector3]:
        """Velocity of a body's origin [m/s] and its spin [rad/s], in the world."""
        body_id = self._ids_by_name[name][-1]
        velocity, spin = self._engine.getBaseVelocity(body_id)
        return minus(velocity, cross(spin, self._origin_to_com(body_id))), spin

    def set_velocity(self, name: str, velocity: Vector3, spin: Vector3) -> None:
        """Give a body a velocity of its origin [m/s] and a spin [rad/s], in the world."""
        body_id = self._ids_by_name[name][-1]
        at_com = minus(velocity, cross(self._origin_to_com(body_id), spin))
        self._engine.resetBaseVelocity(body_id, at_com, spin)

    def _origin_to_com(self, body_id: int) -> Vector3:
        """Vector from a body's origin to its centre of mass, in the world [m]."""
        return rotate(self._pose(body_id).quat_xyzw, self._inertial_in_body[body_id].position)

    def _pose(self, body_id: int) -> Pose:
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
        # Bullet has only the pose of the plane; with this entry, `_pose` returns the pose of the body
        self._inertial_in_body[plane] = pose_in_body
        self._planes.append(plane)

    def _create_body(self, name: str, parts: Sequence[_Part], pose: Pose) -> int:
        """Create a body for a name, and return its id. Raises PlacementError if Bullet refuses the body."""
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
        """Return the parts of a body of solid shapes, at most MAX_SHAPES shapes in each part.

        The mass [kg] is distributed by volume.
        """
        groups = [solids[first : first + MAX_SHAPES] for first in range(0, len(solids), MAX_SHAPES)]
        volumes_and_centers = [volume_and_center(group) for group in groups]
        total_volume = sum(volume for volume, _ in volumes_and_centers)
        return [
            _Part(self._shape_of(group, is_movable=mass > 0.0), mass * (volume / total_volume), center)
            for group, (volume, center) in zip(groups, volumes_and_centers)
        ]

    def _shape_of(self, solids: Sequence[Geometry], is_movable: bool) -> int:
        """Return a collision shape; equal shapes are made once, because Bullet frees none before `clear`."""
        key = (is_movable, *((geometry.shape, geometry.pose_in_body) for geometry in solids))
        if key not in self._shapes:
            self._shapes[key] = compound_shape(solids, is_movable, self._engine)
        return self._shapes[key]

    def _lift_out_of_the_ground(self, body_id: int) -> None:
        """Lift a movable body out of a plane, because Bullet would throw a body in a plane into the air."""
        for plane in self._planes:
            points = self._engine.getClosestPoints(body_id, plane, 0.0)
            # the deepest point counts; its normal is the normal of the plane, which points out of the ground
            depths_and_normals = [(-point[_DISTANCE], point[_NORMAL]) for point in points]
            depth, normal = max(depths_and_normals, default=(0.0, ()))
            if depth > _LIFT_FROM:
                position, quat = self._engine.getBasePositionAndOrientation(body_id)
                lifted = [coordinate + depth * up for coordinate, up in zip(position, normal)]
                self._engine.resetBasePositionAndOrientation(body_id, lifted, quat)
                names = self._name_by_id[body_id], self._name_by_id[plane]
                log.debug("'%s' was sunk %.2f m into '%s' and now stands on it", names[0], depth, names[1])

    def step(self) -> None:
        """Advance the physics by one step."""
        self._engine.stepSimulation()
