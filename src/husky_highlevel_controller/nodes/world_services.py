"""The simulator's services about the world: spawn, delete, move, list."""

from __future__ import annotations

from typing import Any, Callable, List

import rospy
from geometry_msgs.msg import Pose as PoseMsg

from husky_highlevel_controller import messages
from husky_highlevel_controller.datatypes import HuskyError, Pose, Thing
from husky_highlevel_controller.geometry import compose, inverse
from husky_highlevel_controller.nodes.requests import Requests
from husky_highlevel_controller.objects import ObjectError, checked, checked_pose, make_object
from husky_highlevel_controller.simulation import Simulation
from husky_highlevel_controller.srv import (
    DeleteObject,
    DeleteObjectRequest,
    DeleteObjectResponse,
    ListObjects,
    ListObjectsRequest,
    ListObjectsResponse,
    MoveObject,
    MoveObjectRequest,
    MoveObjectResponse,
    SpawnObject,
    SpawnObjectRequest,
    SpawnObjectResponse,
)
from husky_highlevel_controller.world import parse_model

WORLD, ODOM = "world", "odom"


class WorldServices:
    """Each answers success and a sentence; a request that is refused changes nothing."""

    def __init__(self, simulation: Simulation, requests: Requests) -> None:
        self._simulation, self._requests = simulation, requests
        rospy.Service("~spawn", SpawnObject, self._on_spawn)
        rospy.Service("~delete", DeleteObject, self._on_delete)
        rospy.Service("~move", MoveObject, self._on_move)
        rospy.Service("~list", ListObjects, self._on_list)

    def spawn(self, request: SpawnObjectRequest) -> str:
        """Put an object into the world; for the thread that owns the simulation, as all of these."""
        pose = self._in_world(request.initial_pose, request.reference_frame)
        self._simulation.spawn(_things(request, pose))
        return f"'{request.model_name}' is there"

    def delete(self, name: str) -> str:
        """Take an object out of the world."""
        self._simulation.delete(name)
        return f"'{name}' is gone"

    def move(self, request: MoveObjectRequest) -> str:
        """Put an object or the robot somewhere else."""
        pose = self._in_world(request.pose, request.reference_frame)
        self._simulation.move(request.model_name, pose)
        return f"'{request.model_name}' has moved"

    def _in_world(self, pose: PoseMsg, frame: str) -> Pose:
        pose_in_frame = checked_pose(messages.pose_from_msg(pose))
        return compose(self._frame_in_world(frame), pose_in_frame)

    def _frame_in_world(self, frame: str) -> Pose:
        if frame in ("", WORLD):
            return Pose()
        if frame == ODOM:
            return inverse(self._simulation.pose_world_in_odom)
        raise ObjectError(f"reference_frame '{frame}' is not one of {WORLD}, {ODOM}")

    def _list(self, frame: str) -> ListObjectsResponse:
        to_frame = inverse(self._frame_in_world(frame))
        names = list(self._simulation.things)
        poses = [messages.pose_to_msg(compose(to_frame, self._simulation.pose_of(name))) for name in names]
        return ListObjectsResponse(True, f"{len(names)} objects", names, poses)

    # ------------------------------------------------------------------ callbacks

    def _on_spawn(self, request: SpawnObjectRequest) -> SpawnObjectResponse:
        return SpawnObjectResponse(*self._ask(lambda: self.spawn(request)))

    def _on_delete(self, request: DeleteObjectRequest) -> DeleteObjectResponse:
        return DeleteObjectResponse(*self._ask(lambda: self.delete(request.model_name)))

    def _on_move(self, request: MoveObjectRequest) -> MoveObjectResponse:
        return MoveObjectResponse(*self._ask(lambda: self.move(request)))

    def _on_list(self, request: ListObjectsRequest) -> ListObjectsResponse:
        try:
            response: ListObjectsResponse = self._requests.ask(lambda: self._list(request.reference_frame))
            return response
        except HuskyError as error:
            return ListObjectsResponse(False, str(error), [], [])

    def _ask(self, work: Callable[[], str]) -> Any:
        return ask(self._requests, work)


def ask(requests: Requests, work: Callable[[], str]) -> Any:
    """Success and a sentence; a refusal is also logged."""
    try:
        return True, requests.ask(work)
    except HuskyError as error:
        rospy.logwarn(f"refused: {error}")
        return False, str(error)


def _things(request: SpawnObjectRequest, pose: Pose) -> List[Thing]:
    name = request.model_name
    if request.model_xml:
        return [checked(thing) for thing in parse_model(request.model_xml, name, pose)]
    size = request.size
    return [make_object(name, request.shape, (size.x, size.y, size.z), request.mass, pose)]
