"""Ground under the robot: height of the floor under its wheels, and a plane for worlds without ground.

Heights are found by rays that look down, with the ray caster of the lidar. The distance from the beginning of
a ray to the first body is called the drop. The drop is 0 if the ray begins inside a body, and inf if the ray
meets no body.

In: a `World` or the scene of its shapes, a pose. Out: the world, with a plane if it has no ground; heights.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from math import inf, isfinite, pi
from typing import List, Sequence, Tuple

from husky_highlevel_controller.datatypes import (
    Body,
    Geometry,
    Plane,
    Pose,
    Pose2D,
    Vector3,
    World,
    even_beams,
)
from husky_highlevel_controller.geometry import compose, quat_from_rpy, transform_point
from husky_highlevel_controller.simulator.sensors.raycast import RayScene, cast_rays, make_scene

FALL_DEPTH = 10.0  # [m] a robot this far below the floor on which it was put has fallen off the world
# [m] largest drop that is searched, which is twice the greatest height that the simulator accepts
_SEARCH_DEPTH = 2e4
# [m] The pose at which a robot shall stand may be inside a low slab, such as asphalt. If the top of the slab
# is at most this height above the pose, the robot is put on the slab. A slab of this height does not reach
# the robot's hull.
MAX_SLAB = 0.12
# [m] if the pose is inside a thicker floor, the top of the floor is searched up to this height above the pose
MAX_RISE = 5.0
# [m] a robot that is put at most this much above the floor falls to the floor, as in Gazebo; a robot that is
# put higher stands on the floor at once
MAX_DROP = 1.0
_WHEEL_REACH = 0.3  # [m] approximate distance from base_link to the wheels along x and y
# points in the middle of the robot and between its wheels, at which an object would be inside the hull [m]
_MIDDLE_POINTS = (
    (0.0, 0.0),
    (-_WHEEL_REACH, 0.0),
    (_WHEEL_REACH, 0.0),
    (0.0, -_WHEEL_REACH),
    (0.0, _WHEEL_REACH),
)
# [m] If the pose is inside a body, this body is a floor if it reaches from the pose at least this far along x
# and y. A smaller body is an obstacle, on which the robot is not put.
_FLOOR_REACH = 1.0
_RISE_STEP = 0.1  # [m] step of the search for the top of a floor
_LEVEL_TOLERANCE = 1e-3  # [m] a floor is level if its heights differ by less than this
# [m] if the heights under the wheels differ by less than this, the floor is uneven ground, such as a terrain
# or a ramp; if they differ by more, the robot is at the edge of a floor
_MAX_UNEVENNESS = 0.3
# points (x, y) under the robot [m], a grid, at which the highest point of uneven ground is searched
_POINTS_UNDER_ROBOT = [(0.1 * i, 0.1 * j) for i in range(-5, 6) for j in range(-4, 5)]
# [m] on uneven ground, the robot is put this much above the highest of _POINTS_UNDER_ROBOT, because the
# ground may be higher between these points
_CLEARANCE = 0.02
_LOOKING_DOWN = quat_from_rpy(0.0, pi / 2.0, 0.0)

# rospy's logger is the parent of this logger, so lines reach /rosout although this module does not import
# rospy
log = logging.getLogger("rosout.world")


def with_ground(world: World, start: Pose2D, height: float = 0.0) -> World:
    """Return the world, with an additional plane at z = 0 if nothing is below the robot's start.

    Without this plane, the robot would fall without end in a world that has no ground.

    Args:
        world: the world.
        start: pose in the world at which the robot starts.
        height: height of the start in the world [m].
    """
    shapes_and_poses = [
        (part.shape, compose(body.pose_in_world, part.pose_in_body))
        for body in world.bodies
        for part in body.collisions
    ]
    scene = make_scene(shapes_and_poses)
    # If the start is below z = 0, a plane at z = 0 may be above the start. The robot is put on top of this
    # plane, so the search begins at z = 0 and finds this plane, and also all that is below the start.
    highest = max(height, 0.0)
    if has_floor(scene, (start.x, start.y, highest)):
        return world
    place = f"({start.x:g}, {start.y:g})"
    log.warning("world '%s' has no ground at %s, where the robot starts; adding a plane", world.name, place)
    return replace(world, bodies=(*world.bodies, _ground_plane(world)))


def _ground_plane(world: World) -> Body:
    """Return a plane at z = 0 with a name that is free in the world.

    If the world has a model `ground_plane`, the plane becomes another body of this model.
    """
    plane = Geometry(Plane((0.0, 0.0, 1.0), (100.0, 100.0)))  # endless, but drawn with edges of 100 m
    is_taken = any(body.name == "ground_plane" for body in world.bodies)
    name = "ground_plane::added" if is_taken else "ground_plane"
    return Body(name, Pose(), collisions=(plane,), visuals=(plane,))


def has_floor(scene: RayScene, point: Vector3) -> bool:
    """Return whether a robot at a point in the world has a floor: any body below the point, or a low slab.

    The top of the slab may be up to MAX_SLAB above the point.
    """
    x, y, z = point
    return isfinite(_drop(scene, (x, y, z + MAX_SLAB)))


def floor_height(scene: RayScene, pose_on_ground: Pose) -> float:
    """Return the height at which the robot is put on the floor, relative to a level pose [m].

    - On a level floor, the result is the height of the floor, which may be above or below the pose.
    - On uneven ground, the result is _CLEARANCE above the highest point under the robot, so that no part of
      the robot is inside the ground.
    - Without a floor under all wheels, the result is 0, so that the robot is put at the pose itself. This is
      so if a wheel has no body below it, if the pose is in an obstacle, or at the edge of a floor.
    """
    # height above the pose at which the rays begin [m], and drop from there under each wheel
    ray_height, drops = _drops_at_wheels(scene, pose_on_ground)
    # [m] height of the floor under the first wheel; -inf if this wheel has no body below it
    height = ray_height - drops[0]
    is_put_lower = height < 0.0
    if is_put_lower:
        # An object that stands on the lower floor between the wheels would be inside the robot's hull there,
        # but not at the pose. The drop to such an object is shorter than the drops at the wheels. So with the
        # drops in the middle, this floor counts as uneven. If the robot is not put lower, an object between
        # the wheels is in its way at the pose, too, and causes a PlacementError later.
        drops += _drops(scene, pose_on_ground, _MIDDLE_POINTS, ray_height)
    if not _all_meet_floor(drops):
        return 0.0
    unevenness = max(drops) - min(drops)
    if unevenness >= _MAX_UNEVENNESS:
        return 0.0  # the pose is at the edge of a floor, or above a high object
    if unevenness >= _LEVEL_TOLERANCE:
        height_of_highest_point = ray_height - min(
            _drops(scene, pose_on_ground, _POINTS_UNDER_ROBOT, ray_height)
        )
        return height_of_highest_point + _CLEARANCE
    # if the pose is on the floor except for rounding, the result is 0, so that the pose stays as it is
    return height if abs(height) > _LEVEL_TOLERANCE else 0.0


def _all_meet_floor(drops: Sequence[float]) -> bool:
    """Return whether no ray begins inside a body (drop 0), and every ray meets a body (drop not inf)."""
    return 0.0 not in drops and inf not in drops


def _drops_at_wheels(scene: RayScene, pose_on_ground: Pose) -> Tuple[float, List[float]]:
    """Return a height above a pose, and the distances (drops) from there to the floor at the four wheels [m].

    The height is MAX_SLAB, so that the rays meet a low slab from above. But if the pose is inside a wide
    body, such as a thick floor, the height is above the top of this body. If the pose is inside a smaller
    body, which is an obstacle, the drops are 0.
    """
    wheels = _corners(_WHEEL_REACH)
    drops = _drops(scene, pose_on_ground, wheels, MAX_SLAB)
    # a drop is 0 if its ray begins inside a body; in a wide body, all drops at the wheels and at the corners
    # of a larger square are 0
    is_in_body = not any(drops)
    is_in_wide_body = is_in_body and not any(_drops(scene, pose_on_ground, _corners(_FLOOR_REACH), MAX_SLAB))
    if not is_in_wide_body:
        return MAX_SLAB, drops
    # the rays begin higher in each round, until all of them begin above the top of the wide body
    for step in range(1, round(MAX_RISE / _RISE_STEP)):
        height_above = MAX_SLAB + _RISE_STEP * step
        drops_above = _drops(scene, pose_on_ground, wheels, height_above)
        if all(drops_above):
            return height_above, drops_above
    return MAX_SLAB, drops  # the top is more than MAX_RISE above the pose; all drops are 0


def _corners(reach: float) -> List[Tuple[float, float]]:
    """Return the corners of a square around the origin: x and y are `reach` or -`reach` [m]."""
    return [(x, y) for x in (-reach, reach) for y in (-reach, reach)]


def _drops(
    scene: RayScene, pose_on_ground: Pose, points: Sequence[Tuple[float, float]], height: float
) -> List[float]:
    """Return the distances (drops) from points down to the first body [m].

    A point has x and y in the frame of the pose [m], and is `height` m above the pose.
    """
    return [_drop(scene, transform_point(pose_on_ground, (x, y, height))) for x, y in points]


def _drop(scene: RayScene, point: Vector3) -> float:
    """Return the distance from a point down to the first body [m]; 0 in a solid body, inf without a body."""
    one_beam = even_beams(0.0, 0.0, 1)  # along the x axis of the pose, which points down
    return float(cast_rays(scene, Pose(point, _LOOKING_DOWN), one_beam, _SEARCH_DEPTH)[0])
