"""Services that change the world: spawn, delete, move, list."""

from __future__ import annotations

from typing import List

import rospy
from geometry_msgs.msg import Pose as PoseMsg

from husky_highlevel_controller import srv
from husky_highlevel_controller.datatypes import Body, HuskyError, Pose
from husky_highlevel_controller.geometry import compose, inverse
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.simulator.call_queue import CallQueue
from husky_highlevel_controller.ros.simulator.publishers import ODOM, WORLD
from husky_highlevel_controller.simulator.models.sdf_world import parse_model
from husky_highlevel_controller.simulator.models.urdf_object import is_urdf, parse_urdf_object
from husky_highlevel_controller.simulator.simulation import Simulation
from husky_highlevel_controller.simulator.spawn_request import (
    ObjectError,
    check_bounds,
    check_name,
    checked_pose,
    make_object,
)


class WorldServices:
    """Services that respond with success and a message; a refused request changes nothing."""

    def __init__(self, simulation: Simulation, calls: CallQueue) -> None:
        """Offer the services."""
        self._simulation, self._calls = simulation, calls
        calls.offer("~spawn", srv.SpawnObject, self._spawn)
        calls.offer("~delete", srv.DeleteObject, self._delete)
        calls.offer("~move", srv.MoveObject, self._move)
        # `offer` is for responses with only success and a message, and a list has more fields
        rospy.Service("~list", srv.ListObjects, self._on_list)

    def _spawn(self, request: srv.SpawnObjectRequest) -> str:
        """Add the requested object, and return a sentence for the response."""
        pose = self._in_world(request.initial_pose, request.reference_frame)
        self._simulation.spawn(_bodies_of(request, pose))
        return f"'{request.model_name}' was added"

    def _delete(self, request: srv.DeleteObjectRequest) -> str:
        """Delete a body, and return a sentence for the response."""
        self._simulation.delete(request.model_name)
        return f"'{request.model_name}' was deleted"

    def _move(self, request: srv.MoveObjectRequest) -> str:
        """Move a body, and return a sentence for the response."""
        pose = self._in_world(request.pose, request.reference_frame)
        self._simulation.move(request.model_name, pose)
        return f"'{request.model_name}' was moved"

    def _in_world(self, pose: PoseMsg, frame: str) -> Pose:
        """Convert the pose of a request to the world; ObjectError if the pose or the frame is not valid."""
        pose_in_frame = checked_pose(conversions.pose_from_msg(pose))
        return compose(self._frame_in_world(frame), pose_in_frame)

    def _frame_in_world(self, frame: str) -> Pose:
        """Return the pose of a request's frame in the world; ObjectError if it is neither world nor odom."""
        if frame in ("", WORLD):
            return Pose()
        if frame == ODOM:
            return inverse(self._simulation.pose_world_in_odom)
        raise ObjectError(f"reference_frame '{frame}' is not one of {WORLD}, {ODOM}")

    def _list(self, frame: str) -> srv.ListObjectsResponse:
        """Answer with the names of all bodies and their poses in a frame."""
        world_in_frame = inverse(self._frame_in_world(frame))
        names, poses = list(self._simulation.bodies), []
        for name in names:
            pose_in_frame = compose(world_in_frame, self._simulation.pose_of(name))
            poses.append(conversions.pose_to_msg(pose_in_frame))
        return srv.ListObjectsResponse(
            success=True, status_message=f"{len(names)} objects", model_names=names, poses=poses
        )

    def _on_list(self, request: srv.ListObjectsRequest) -> srv.ListObjectsResponse:
        """Answer a request for the list of bodies; an unknown frame is a failure with a sentence."""
        try:
            response: srv.ListObjectsResponse = self._calls.call(lambda: self._list(request.reference_frame))
            # the report tells the grader that a node has seen true poses, which a submission must not use
            self._calls.report("the true poses of all bodies were listed")
            return response
        except HuskyError as error:
            return srv.ListObjectsResponse(success=False, status_message=str(error))


def bodies_of_xml(model_xml: str, name: str, pose_in_world: Pose) -> List[Body]:
    """Return the bodies of a model, given as SDF or URDF text; HuskyError if it cannot be simulated.

    Args:
        model_xml: text of the model.
        name: name of the model in the simulation.
        pose_in_world: pose of the model.
    """
    check_name(name)  # only this name is checked; the names of the model's links may be any text
    if is_urdf(model_xml):
        bodies = [parse_urdf_object(model_xml, name, pose_in_world)]
    else:
        bodies = list(parse_model(model_xml, name, pose_in_world))
    for body in bodies:
        check_bounds(body)
    return bodies


def _bodies_of(request: srv.SpawnObjectRequest, pose: Pose) -> List[Body]:
    """Return the bodies that a request asks for: an SDF or URDF model, or one body of a simple shape."""
    name = request.model_name
    if request.model_xml:
        return bodies_of_xml(request.model_xml, name, pose)
    size = request.size
    return [make_object(name, request.shape, (size.x, size.y, size.z), request.mass, pose)]
