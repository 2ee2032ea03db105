"""World tab: the shape that a click puts down, and the loaded world."""

from __future__ import annotations

from contextlib import suppress
from html import escape
from math import cos, dist, pi, sin
from pathlib import Path
from random import uniform
from typing import Any, Dict, Optional, Tuple

import viser
from geometry_msgs.msg import Vector3 as Vector3Msg
from husky_highlevel_controller.srv import DeleteObject, ListObjects, LoadWorld, MoveObject, SpawnObject

from husky_highlevel_controller.datatypes import HuskyError, Pose, Vector3
from husky_highlevel_controller.geometry import pose_from_2d, pose_to_2d
from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.ros import conversions
from husky_web.actions import LONG_TIMEOUT, Actions, answer_of, call
from husky_web.state_bar import Moving

ROBOT = "husky"  # name of the robot in the services of the simulator
# name of the ground in the world files; the ground is not an object that can be moved
GROUND = "ground_plane"
MOVE_ATTEMPTS = 10  # largest number of random positions that are tried, because a position may be occupied
SIZES = {"box": (0.4, 0.4, 0.8), "cylinder": (0.4, 0.4, 1.0), "sphere": (0.5, 0.5, 0.5)}  # [m]


class WorldTab:
    """Puts, moves, deletes and loads through the simulator's services."""

    def __init__(
        self, server: viser.ViserServer, actions: Actions, moving: Moving, simulator: str, frame: str
    ) -> None:
        """Build the tab.

        Args:
            server: server of the page.
            actions: queue of service calls.
            moving: name of the object that a page moves, for the state bar.
            simulator: name of the simulator's node.
            frame: frame of all positions, the page's fixed frame; the simulator accepts world and odom.
        """
        self._actions, self._moving, self._simulator, self._frame = actions, moving, simulator, frame
        gui = server.gui
        with gui.add_folder("Put"):
            self._shape = gui.add_dropdown("Shape", tuple(SIZES), initial_value="box")
            self._size: Any = gui.add_vector3(
                "Size [m]",
                SIZES["box"],
                min=(0.01, 0.01, 0.01),
                step=0.05,
                hint="full extents; cylinder: d, d, height",
            )
            self._mass = gui.add_number(
                "Mass [kg]", 5.0, min=0.0, step=0.5, hint="an object of 0 kg never moves"
            )
        self._shape.on_update(self._on_shape)
        with gui.add_folder("World"):
            self._loaded = gui.add_html("")
            files = sorted(path.name for path in (share_folder() / "worlds").glob("*.world"))
            self._worlds: Any = gui.add_dropdown("File", files)
            load = gui.add_button("Load", hint="load this world; the robot starts in it, also after a reset")
        load.on_click(lambda event: actions.do(self._load, event.client, "World"))

    def show_loaded(self, name: str) -> None:
        """Show the name or path of the loaded world, and select its file if it has changed."""
        content = f'<div class="husky-block">loaded: <b>{escape(Path(name).name)}</b></div>' if name else ""
        # the choice of a person stays until another world is loaded
        if content != self._loaded.content and Path(name).name in self._worlds.options:
            self._worlds.value = Path(name).name
        self._loaded.content = content

    def put(self, client: viser.ClientHandle, x: float, y: float, ground: float) -> None:
        """Put the chosen shape on the ground."""
        shape, size, mass = self._shape.value, tuple(self._size.value), self._mass.value
        pose = Pose((x, y, ground + size[2] / 2.0))
        self._actions.do(lambda: self._spawn(shape, size, mass, pose), client, "Put")

    def move_robot(self, client: Optional[viser.ClientHandle], pose: Pose) -> None:
        """Move the robot to a pose, upright on the ground."""
        level = pose_from_2d(pose_to_2d(pose))
        self._actions.do(lambda: self._move(ROBOT, level), client, "Move")

    def delete(self, client: viser.ClientHandle, name: str) -> None:
        """Delete an object."""
        service = f"{self._simulator}/delete"
        self._actions.do(lambda: call(service, DeleteObject, name), client, "Delete")

    def move_away(self, client: viser.ClientHandle, point: Optional[Vector3]) -> None:
        """Move the object nearest to a point [m, in the page's frame] to a random position 4 to 8 m away."""
        self._actions.do(lambda: self._move_away(point), client, "Move")

    def _move_away(self, point: Optional[Vector3]) -> str:
        """Move the object nearest to a point to a random position 4 to 8 m away from its present one.

        A random position may be occupied, so up to MOVE_ATTEMPTS random positions are tried. The result is
        the simulator's sentence. `point` [m] is in the page's frame.

        Raises:
            HuskyError: the point is unknown, the world has no object, or every attempt has failed.
        """
        name, pose = self._nearest_object(point)
        x, y, z = pose.position

        def random_pose() -> Pose:
            """Return a pose 4 to 8 m away, in any direction, at the same height."""
            distance, angle = uniform(4.0, 8.0), uniform(-pi, pi)
            return pose._replace(position=(x + distance * cos(angle), y + distance * sin(angle), z))

        for _ in range(MOVE_ATTEMPTS - 1):
            with suppress(HuskyError):
                return self._move(name, random_pose())
        return self._move(name, random_pose())  # the error of the last attempt is raised, and not suppressed

    def _nearest_object(self, point: Optional[Vector3]) -> Tuple[str, Pose]:
        """Return the name and the pose of the object nearest to a point [m], both in the page's frame.

        Raises:
            HuskyError: the point is unknown, or the world has no object.
        """
        poses = {}  # pose of each object that is neither the ground nor the robot
        for name, pose in self._poses().items():
            if _model_of(name) not in (GROUND, ROBOT):
                poses[name] = pose
        if point is None or not poses:
            raise HuskyError("there is no pillar to move")
        nearest = min(poses, key=lambda name: dist(poses[name].position[:2], point[:2]))
        return nearest, poses[nearest]

    def _spawn(self, shape: str, size: Any, mass: float, pose: Pose) -> str:
        """Put a shape with the first free name, such as box_3, and return the simulator's sentence."""
        taken = {_model_of(body) for body in self._poses()}
        number = 1
        while f"{shape}_{number}" in taken:
            number += 1
        return call(
            f"{self._simulator}/spawn",
            SpawnObject,
            f"{shape}_{number}",
            "",  # no model file, because shape, size and mass describe the object
            shape,
            Vector3Msg(*size),
            mass,
            conversions.pose_to_msg(pose),
            self._frame,
        )

    def _move(self, name: str, pose: Pose) -> str:
        """Move an object or the robot, show this in the state bar, and return the simulator's sentence."""
        with self._moving("the robot" if name == ROBOT else name):
            return call(
                f"{self._simulator}/move", MoveObject, name, conversions.pose_to_msg(pose), self._frame
            )

    def _poses(self) -> Dict[str, Pose]:
        """Return the poses of all objects in the page's frame."""
        answer = answer_of(f"{self._simulator}/list", ListObjects, self._frame)
        if not answer.success:
            raise HuskyError(f"{self._simulator}/list: {answer.status_message}")
        return dict(zip(answer.model_names, map(conversions.pose_from_msg, answer.poses)))

    def _load(self) -> str:
        """Load the chosen world, show this in the state bar, and return the simulator's sentence."""
        with self._moving("robot and world"):
            return call(f"{self._simulator}/load_world", LoadWorld, self._worlds.value, timeout=LONG_TIMEOUT)

    def _on_shape(self, event: Any) -> None:
        """Show the usual size of the chosen shape."""
        self._size.value = SIZES[event.target.value]


def _model_of(body: str) -> str:
    """Return the model of a body by its name; a body of a model with several links is called MODEL::LINK."""
    return body.partition("::")[0]
