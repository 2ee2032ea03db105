"""Gazebo's services and topic for models, answered by the simulation.

Stands in for services and topics of gazebo_ros 2.9 (Noetic) with Gazebo 11, with the messages of
compat/gazebo_msgs. No test runs the original, which Debian does not have. `test_gazebo_messages.py` compares
the MD5 sums of the messages with the published sums of gazebo_msgs 2.9.2.
"""

from __future__ import annotations

import os
from typing import Any, Callable, Optional, Tuple

import rospy
from gazebo_msgs.msg import ModelStates
from gazebo_msgs.srv import (
    DeleteModel,
    DeleteModelRequest,
    GetModelState,
    GetModelStateRequest,
    GetModelStateResponse,
    GetWorldProperties,
    GetWorldPropertiesResponse,
    SetModelState,
    SetModelStateRequest,
    SpawnModel,
    SpawnModelRequest,
)
from geometry_msgs.msg import Twist

from husky_highlevel_controller.datatypes import IDENTITY, HuskyError, ModelMotion, Snapshot
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.simulator.call_queue import CallQueue
from husky_highlevel_controller.ros.simulator.publishers import QUEUE, WORLD, publish_if_subscribed
from husky_highlevel_controller.ros.simulator.world_services import bodies_of_xml
from husky_highlevel_controller.simulator.bullet.world import ROBOT
from husky_highlevel_controller.simulator.model_motion import checked_motion, in_world, seen_from
from husky_highlevel_controller.simulator.models.own_description import MODEL_VARIABLE
from husky_highlevel_controller.simulator.simulation import Simulation
from husky_highlevel_controller.simulator.spawn_request import ObjectError

# these names mean the robot in every request; husky_gazebo used mobile_base until ROS Kinetic
NAMES_OF_ROBOT = (ROBOT, "mobile_base")
FRAMES_OF_WORLD = ("", WORLD, "map", "/map")  # each of these frame names means the world in a request


class GazeboServices:
    """Services for models under Gazebo's names, and the topic of all models' motions."""

    def __init__(self, simulation: Simulation, calls: CallQueue, robot: str, steps: Optional[int]) -> None:
        """Offer the services.

        Args:
            simulation: the simulation.
            calls: the queue of calls to the simulation.
            robot: name of the robot among the models, unless spawn_model gives it another one.
            steps: physics steps between two messages; None for no topic.
        """
        self._simulation, self._calls = simulation, calls
        # a launch file may give the robot another name; the environment variable MODEL_VARIABLE has this name
        self._robot_name = os.environ.get(MODEL_VARIABLE) or robot
        # `offer` is for services whose response has only success and a message; the responses of
        # get_model_state and get_world_properties have more fields
        calls.offer("gazebo/set_model_state", SetModelState, self._set_state)
        calls.offer("gazebo/spawn_sdf_model", SpawnModel, self._spawn)
        calls.offer("gazebo/spawn_urdf_model", SpawnModel, self._spawn)
        calls.offer("gazebo/delete_model", DeleteModel, self._delete)
        rospy.Service("gazebo/get_model_state", GetModelState, self._on_get_state)
        rospy.Service("gazebo/get_world_properties", GetWorldProperties, self._on_get_properties)
        self._states_publisher: Optional[rospy.Publisher] = None
        if steps is not None:
            self._steps = steps
            self._states_publisher = rospy.Publisher("gazebo/model_states", ModelStates, queue_size=QUEUE)

    def publish(self, snapshot: Snapshot) -> None:
        """Publish the motions of all models, if they are due and somebody listens."""
        if self._states_publisher and snapshot.step % self._steps == 0:
            publish_if_subscribed(self._states_publisher, self._states_to_msg)

    def _states_to_msg(self) -> ModelStates:
        """Return a message with the names, true poses and true velocities of all models in the world."""
        poses, twists = [], []
        for model in self._simulation.models:
            pose, twist = conversions.motion_to_msg(self._simulation.motion_of(model))
            poses.append(pose)
            twists.append(twist)
        return ModelStates(self._names(), poses, twists)

    def _names(self) -> list:
        """Return the names of all models; in them, the robot has its name for Gazebo's clients."""
        return [self._robot_name if model == ROBOT else model for model in self._simulation.models]

    def _model_name(self, name: str, field: str) -> str:
        """Return the name that the simulation has for a model of a request.

        Args:
            name: name of the model in the request.
            field: field of the request that has the name, for the error.

        Raises:
            ObjectError: the simulation has no such model.
        """
        if name in (self._robot_name, *NAMES_OF_ROBOT):
            return ROBOT
        if name not in self._simulation.models:
            raise ObjectError(f"{field} '{name}' is not one of {', '.join(self._names())}")
        return name

    def _frame_motion(self, name: str, field: str) -> ModelMotion:
        """Return the motion of a reference frame in the world; a model is a frame, too.

        Args:
            name: name of the frame in a request of Gazebo.
            field: field of the request that has the name, for the error.

        Raises:
            ObjectError: no model has this name.
        """
        if name in FRAMES_OF_WORLD:
            return ModelMotion(IDENTITY)
        return self._simulation.motion_of(self._model_name(name, field))

    def _set_state(self, request: SetModelStateRequest) -> str:
        """Put a model at a pose, with a velocity, and return a sentence for the response."""
        state = request.model_state
        model = self._model_name(state.model_name, "model_name")
        frame = self._frame_motion(state.reference_frame, "reference_frame")
        try:
            motion = checked_motion(conversions.motion_from_msg(state.pose, state.twist))
            self._simulation.place_model(model, in_world(motion, frame))
        except HuskyError as error:
            raise ObjectError(f"'{state.model_name}' stays where it is: {error}") from error
        return f"'{state.model_name}' was moved"

    def _spawn(self, request: SpawnModelRequest) -> str:
        """Add a model, given as SDF or URDF, and return a sentence for the response."""
        name = request.model_name
        if name in (self._robot_name, *NAMES_OF_ROBOT):
            raise ObjectError(f"'{name}' is not spawned: this name means the robot; choose another name")
        frame = self._frame_motion(request.reference_frame, "reference_frame")
        try:
            at_rest = Twist()  # a request to spawn a model has no velocity
            motion = checked_motion(conversions.motion_from_msg(request.initial_pose, at_rest))
            self._simulation.spawn(bodies_of_xml(request.model_xml, name, in_world(motion, frame).pose))
        except HuskyError as error:
            raise ObjectError(f"'{name}' is not spawned: {error}") from error
        return f"'{name}' was added"

    def _delete(self, request: DeleteModelRequest) -> str:
        """Delete a model, and return a sentence for the response."""
        self._simulation.delete(self._model_name(request.model_name, "model_name"))
        return f"'{request.model_name}' was deleted"

    def _ask_simulation(self, read: Callable[[], Any], data: str) -> Tuple[Any, str]:
        """Read something in the simulation's thread, and tell the recorder of a graded run about it.

        Args:
            read: function that reads; it raises HuskyError if the request is not valid.
            data: text that says what is read, for the sentence "... was read".

        Returns:
            The result of `read` and this sentence, or None and the reason of the error.
        """
        try:
            result = self._calls.call(read)
        except HuskyError as error:
            rospy.logwarn(f"refused: {error}")
            return None, str(error)
        self._calls.report(f"{data} was read")
        return result, f"{data} was read"

    def _on_get_state(self, request: GetModelStateRequest) -> GetModelStateResponse:
        """Answer with the pose and velocity of a model in the frame of another one, or of the world."""

        def read() -> Tuple[float, ModelMotion]:
            """Return the simulated time [s], and the motion in the requested frame."""
            motion = self._simulation.motion_of(self._model_name(request.model_name, "model_name"))
            frame = self._frame_motion(request.relative_entity_name, "relative_entity_name")
            return self._simulation.stamp, seen_from(motion, frame)

        result, sentence = self._ask_simulation(read, data=f"the true state of '{request.model_name}'")
        if result is None:
            return GetModelStateResponse(success=False, status_message=sentence)
        stamp, motion = result
        header = conversions.header(stamp, request.relative_entity_name)
        pose_msg, twist_msg = conversions.motion_to_msg(motion)
        return GetModelStateResponse(
            header=header, pose=pose_msg, twist=twist_msg, success=True, status_message=sentence
        )

    def _on_get_properties(self, _request: Any) -> GetWorldPropertiesResponse:
        """Answer with the simulated time and the names of all models."""
        stamp, names = self._calls.call(lambda: (self._simulation.stamp, self._names()))
        return GetWorldPropertiesResponse(
            sim_time=stamp,
            model_names=names,
            rendering_enabled=False,
            success=True,
            status_message=f"{len(names)} models",
        )
