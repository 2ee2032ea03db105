"""Mouse in the scene: each page has a tool, and the scene's nodes report clicks and drags."""

from __future__ import annotations

from functools import partial
from math import dist, hypot
from typing import TYPE_CHECKING, Any, Callable, Dict, Optional, Sequence

from husky_highlevel_controller.datatypes import Pose, Vector3
from husky_web.objects import Object, ObjectKey, Objects
from husky_web.pages import DELETE, LOOK, MOVE, PUT, Page
from husky_web.scene import BASE, Scene
from husky_web.state_bar import Moving

# world_tab is imported only for type checks, because it needs generated messages, which tests without a built
# workspace do not have
if TYPE_CHECKING:
    from husky_web.world_tab import WorldTab

# [m] a clicked point farther away than this is ignored, because a click just below the horizon is not exact
FARTHEST = 200.0
# Slope of the mouse's ray, as height per distance. If the ray is steeper than this, a dragged object moves in
# a level plane. If the ray is flatter, the object would jump too far in a level plane, so it moves in an
# upright plane.
STEEP = 0.05


class Mouse:
    """Binds clicks and drags to nodes on which a page's tool acts; on others, the mouse turns the view."""

    def __init__(
        self, scene: Scene, objects: Objects, world: WorldTab, moving: Moving, pages: Dict[int, Page]
    ) -> None:
        """Begin without drags.

        Args:
            scene: scene with the nodes of the robot.
            objects: objects in the scene.
            world: tab that puts and deletes objects.
            moving: name of the object that is dragged; the state bar shows this name.
            pages: open pages; the key is the number of viser's client.
        """
        self._scene, self._objects, self._world, self._pages = scene, objects, world, pages
        self._moving = moving
        self._drags: Dict[Any, Drag] = {}  # drags that go on, by the key of the object; BASE is the robot
        objects.on_new = self._bind_object

    def bind(self) -> None:
        """Bind every node according to the tools of the pages."""
        for key, shown in list(self._objects.shown.items()):
            self._bind_object(key, shown)
        self.bind_robot()

    def bind_robot(self) -> None:
        """Let the robot be dragged while a page has the tool for it."""
        for node in self._scene.robot_shapes:
            node.remove_drag_callback("all")
            if self._is_used(MOVE):
                node.on_drag("left")(self._on_drag_robot)

    def release(self, page: int) -> None:
        """End the drags of a closed page; the objects stay where they were."""
        for key in [key for key, drag in list(self._drags.items()) if drag.page == page]:
            self._end(key)

    def _end(self, key: Any) -> None:
        """End the drag of an object or of the robot, if it is dragged."""
        if self._drags.pop(key, None) is not None and not self._drags:
            self._moving.end()
        if key == BASE:
            self._scene.show_ghost(None)
        else:
            self._objects.dragged.pop(key, None)

    def _is_used(self, tool: str) -> bool:
        """Return whether at least one open page has this tool."""
        return any(page.tool == tool for page in list(self._pages.values()))

    def _tool(self, event: Any) -> str:
        """Return the tool of the page from which an event comes; LOOK if the page was closed."""
        page = self._pages.get(event.client.client_id)
        return LOOK if page is None else page.tool

    def _bind_object(self, key: ObjectKey, shown: Object) -> None:
        """Bind the tools that the open pages have now to an object, in place of earlier bindings."""
        for node in shown.shapes:
            node.remove_click_callback("all")
            node.remove_drag_callback("all")
            if shown.is_movable and self._is_used(DELETE):
                node.on_click(partial(self._on_click_object, key))
            if shown.is_movable and self._is_used(MOVE):
                node.on_drag("left")(partial(self._on_drag_object, key))

    def on_ground(self, event: Any) -> None:
        """Put the chosen shape at the clicked point, if the page has chosen this tool."""
        if self._tool(event) != PUT:
            return
        point = point_on_level(event.ray_origin, event.ray_direction, self._scene.ground)
        if point is not None:
            self._world.put(event.client, point[0], point[1], point[2])

    def _on_click_object(self, key: ObjectKey, event: Any) -> None:
        """Delete the clicked object, if the mouse of the page deletes objects."""
        if self._tool(event) != DELETE or key not in self._objects.shown:
            return
        # an object without an entry *Delete* in its menu is deleted by the service of the simulator
        was_in_menu = self._objects.delete(key)
        if not was_in_menu:
            self._world.delete(event.client, key.name)

    # async, because viser calls async callbacks in the order of the mouse's events
    async def _on_drag_object(self, key: ObjectKey, event: Any) -> None:
        """Begin, continue or end the drag of an object, if the mouse of the page moves objects."""
        shown = self._objects.shown.get(key)
        if shown is None or self._tool(event) != MOVE:
            return
        if event.phase == "start":
            w, x, y, z = shown.node.wxyz
            pose = Pose(tuple(shown.node.position), (x, y, z, w))

            def show(pose: Pose) -> None:
                """Draw the object at a pose in the fixed frame, from the next update on."""
                self._objects.dragged[key] = pose

            drop = partial(self._objects.drop, key)  # sends the last pose to the server of the object
            self._begin(key, key.name, Drag(event.client.client_id, pose, show, drop))
        self._follow(key, event)

    async def _on_drag_robot(self, event: Any) -> None:
        """Begin, continue or end a drag of the robot; only its ghost moves, until the drag ends."""
        base = self._scene.base
        if base is None or self._tool(event) != MOVE:
            return
        if event.phase == "start":
            drop = partial(self._world.move_robot, event.client)
            self._begin(BASE, "the robot", Drag(event.client.client_id, base, self._scene.show_ghost, drop))
        self._follow(BASE, event)

    def _begin(self, key: Any, name: str, drag: Drag) -> None:
        """Keep a drag of an object or of the robot, and show its name in the state bar."""
        self._drags[key] = drag
        self._moving.begin(name)

    def _follow(self, key: Any, event: Any) -> None:
        """Move the dragged object as an event of the mouse says, and end the drag at its last event."""
        drag = self._drags.get(key)
        if drag is not None:
            drag.on_event(event)
        if event.phase == "end":
            self._end(key)


class Drag:
    """Object that the mouse drags over the ground; its grasped point stays under the mouse."""

    def __init__(
        self, page: int, pose: Pose, show: Callable[[Pose], None], drop: Callable[[Pose], None]
    ) -> None:
        """Begin a page's drag at a pose in the fixed frame; `show` draws a pose, `drop` gets the last one."""
        self.page = page
        self._start, self._pose, self._show, self._drop = pose, pose, show, drop
        self._grasp: Any = None  # [m] grasped point in the fixed frame; None before the first event
        # true if the object follows the mouse in a level plane, and false in an upright plane
        self._is_level = True

    def on_event(self, event: Any) -> None:
        """Follow the mouse to the intersection of its ray with a plane through the grasped point.

        The plane is level. If the camera looks at it from a flat angle, the plane is upright instead.
        """
        # [m] position of the camera, at which the mouse's ray begins
        eye = [float(value) for value in event.client.camera.position]
        if event.phase == "start" or self._grasp is None:  # None if the first event is not a start
            self._grasp = tuple(float(value) for value in event.start_position)
            # the slope of the ray at the start decides on the plane, which stays the same until the end of
            # the drag
            height, distance = eye[2] - self._grasp[2], dist(eye[:2], self._grasp[:2])
            self._is_level = height > STEEP * distance
        # direction from the camera to the point at which the mouse is now
        ray = [float(a) - b for a, b in zip(event.end_position, eye)]
        if self._is_level:
            point = point_on_level(eye, ray, self._grasp[2])
        else:
            point = point_before(eye, ray, self._grasp)
        if point is not None:
            # the object moves by the same distance as the grasped point, and keeps its height
            x, y, z = self._start.position
            moved = (x + point[0] - self._grasp[0], y + point[1] - self._grasp[1], z)
            self._pose = self._start._replace(position=moved)
            self._show(self._pose)
        if event.phase == "end":
            self._drop(self._pose)


def point_on_level(origin: Sequence[float], direction: Sequence[float], z: float) -> Optional[Vector3]:
    """Return the intersection of a ray with the plane at height `z` [m]; None if behind or too far."""
    return _intersection(origin, direction, (0.0, 0.0, z), (0.0, 0.0, 1.0))


def point_before(
    origin: Sequence[float], direction: Sequence[float], point: Sequence[float]
) -> Optional[Vector3]:
    """Return the intersection of a ray with an upright plane [m]; None if it is behind or too far.

    The plane goes through a point [m], and faces the origin of the ray.
    """
    return _intersection(origin, direction, point, (point[0] - origin[0], point[1] - origin[1], 0.0))


def _intersection(
    origin: Sequence[float], direction: Sequence[float], point: Sequence[float], normal: Sequence[float]
) -> Optional[Vector3]:
    """Return the intersection [m] of a ray with a plane; None if it is behind the origin or too far.

    Args:
        origin: origin of the ray [m].
        direction: direction of the ray, of any length.
        point: point on the plane [m].
        normal: normal of the plane, of any length.
    """
    direction_along_normal = sum(a * b for a, b in zip(direction, normal))
    if abs(direction_along_normal) < 1e-9:  # the ray is parallel to the plane
        return None
    distance_along_normal = sum((p - o) * n for p, o, n in zip(point, origin, normal))
    # distance from the origin of the ray to the plane, as a multiple of `direction`; the length of the normal
    # is a factor of both values, so it has no effect
    lengths = distance_along_normal / direction_along_normal
    if not 0.0 < lengths * hypot(*direction) < FARTHEST:
        return None
    x, y, z = (o + lengths * d for o, d in zip(origin, direction))
    return (x, y, z)
