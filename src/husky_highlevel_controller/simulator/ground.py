"""Ground under the robot: height of the floor under its wheels, and a plane for worlds without ground.

In: a `World` or the scene of its shapes, a pose. Out: the world, with a plane if it has no ground; heights.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from math import isfinite, pi
from typing import List, Tuple

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
# [m] a floor is searched down to this depth, which is twice the greatest height that the simulator accepts
_SEARCH_DEPTH = 2e4
# [m] if the robot starts on a slab that is not higher than this, the slab is the floor; the robot's hull is
# above it
MAX_SLAB = 0.12
MAX_RISE = 5.0  # [m] up to this height above the start, the top of a thick floor is searched
# [m] the robot falls to the floor from at most this height; if it would start higher, it is put on the floor
MAX_DROP = 1.0
_WHEEL_REACH = 0.3  # [m] approximate distance from base_link to the wheels along x and y
_MIDDLE_POINTS = (
    (0.0, 0.0),
    (-_WHEEL_REACH, 0.0),
    (_WHEEL_REACH, 0.0),
    (0.0, -_WHEEL_REACH),
    (0.0, _WHEEL_REACH),
)
# [m] a body that does not reach this far from the robot along x and y is an obstacle, not a floor
_FLOOR_REACH = 1.0
_RISE_STEP = 0.1  # [m] step of the search for the top of a floor
_LEVEL_TOLERANCE = 1e-3  # [m] a floor is level if its heights differ by less than this
# [m] a floor whose heights under the wheels differ by less than this is uneven ground, such as a terrain or a
# ramp; a greater difference is the edge of a floor
_MAX_UNEVENNESS = 0.3
# points of the robot's outline [m] at which the highest point of uneven ground is searched
_OUTLINE = [(0.1 * i, 0.1 * j) for i in range(-5, 6) for j in range(-4, 5)]
# [m] on uneven ground, the robot is put this much higher, because the ground is higher between those points
_CLEARANCE = 0.02
_LOOKING_DOWN = quat_from_rpy(0.0, pi / 2.0, 0.0)

# rospy's logger is the parent of this logger, so lines reach /rosout although this module does not import
# rospy
log = logging.getLogger("rosout.world")


def with_ground(world: World, start: Pose2D, height: float = 0.0) -> World:
    """Return the world, with a plane at z = 0 if nothing is below the robot's start, or below this plane.

    Args:
        world: the world.
        start: pose in the world at which the robot starts.
        height: height of the start in the world [m].
    """
    parts = [(body.pose_in_world, part) for body in world.bodies for part in body.collisions]
    scene = make_scene([(part.shape, compose(pose, part.pose_in_body)) for pose, part in parts])
    # A robot that starts below a plane is lifted out of it. So a start below 0 needs no new plane if the
    # world has a floor at 0.
    if has_floor(scene, (start.x, start.y, max(height, 0.0))) or has_floor(scene, (start.x, start.y, height)):
        return world
    place = f"({start.x:g}, {start.y:g})"
    log.warning("world '%s' has no ground at %s, where the robot starts; adding a plane", world.name, place)
    plane = Geometry(Plane((0.0, 0.0, 1.0), (100.0, 100.0)))  # endless, but drawn with edges of 100 m
    is_taken = any(body.name == "ground_plane" for body in world.bodies)
    # a taken name makes the plane another body of the model `ground_plane`
    name = "ground_plane::added" if is_taken else "ground_plane"
    ground = Body(name, Pose(), collisions=(plane,), visuals=(plane,))
    return replace(world, bodies=(*world.bodies, ground))


def has_floor(scene: RayScene, point: Vector3) -> bool:
    """Return whether a body is below a point, or is a slab on which a robot at this point stands."""
    x, y, z = point
    return isfinite(_drop(scene, (x, y, z + MAX_SLAB)))


def floor_height(scene: RayScene, pose_on_ground: Pose) -> float:
    """Return the height of the floor under all wheels, over a level pose [m]; 0 if there is none.

    The floor may be a slab, such as asphalt, or lie lower. If the pose is inside a wide body, such as a thick
    slab, the floor is the top of that body. A narrow body is an obstacle and not a floor. The height of
    uneven ground is that of its highest point under the robot, and _CLEARANCE, so that nothing is inside it.
    """
    top, drops = _drops_at_wheels(scene, pose_on_ground)
    # [m] height of the floor under the first corner of the robot; used below only if the floor is level
    height = top - drops[0]
    if height < 0.0:
        # the floor is below the pose, so the hull might stand on an object between the wheels; the drops at
        # the middle points show such an object
        drops += [_drop(scene, transform_point(pose_on_ground, (x, y, top))) for x, y in _MIDDLE_POINTS]
    # a drop of 0 (inside a body) or of inf (no body below) means that there is no floor; then the robot stays
    # at the pose
    if not (all(drops) and isfinite(max(drops))):
        return 0.0
    unevenness = max(drops) - min(drops)
    if unevenness < _LEVEL_TOLERANCE:
        # a floor within the tolerance of the pose counts as 0, so that the pose stays as it is
        return height if abs(height) > _LEVEL_TOLERANCE else 0.0
    if unevenness < _MAX_UNEVENNESS:
        outline = [transform_point(pose_on_ground, (x, y, top)) for x, y in _OUTLINE]
        return top - min(_drop(scene, point) for point in outline) + _CLEARANCE
    return 0.0


def _drops_at_wheels(scene: RayScene, pose_on_ground: Pose) -> Tuple[float, List[float]]:
    """Return a height from which the floor is below, and the drops from there to the floor at the wheels [m].

    The height is relative to the pose. It is MAX_SLAB, or more if the pose is inside a wide body. If the top
    of this body is not found up to MAX_RISE, the drops are 0.
    """
    drops = _drops(scene, pose_on_ground, _WHEEL_REACH, MAX_SLAB)
    # a drop is 0 if it begins inside a body; a wide body also contains the corners of the larger square with
    # _FLOOR_REACH
    is_in_wide_body = not any(drops) and not any(_drops(scene, pose_on_ground, _FLOOR_REACH, MAX_SLAB))
    if is_in_wide_body:
        for step in range(1, round(MAX_RISE / _RISE_STEP)):
            height_above = MAX_SLAB + _RISE_STEP * step
            drops_above = _drops(scene, pose_on_ground, _WHEEL_REACH, height_above)
            if all(drops_above):  # no drop is 0, so this height is above the wide body
                return height_above, drops_above
    return MAX_SLAB, drops


def _drops(scene: RayScene, pose_on_ground: Pose, reach: float, height: float) -> List[float]:
    """Return the drops at four corners: distances down to a body [m]; 0 in a solid, inf without a body.

    The corners are `height` m above the pose, and `reach` m from it along both of its axes.
    """
    corners = [(x, y, height) for x in (-reach, reach) for y in (-reach, reach)]
    return [_drop(scene, transform_point(pose_on_ground, corner)) for corner in corners]


def _drop(scene: RayScene, point: Vector3) -> float:
    """Return the distance from a point down to the first body [m]; inf if there is none."""
    return float(cast_rays(scene, Pose(point, _LOOKING_DOWN), even_beams(0.0, 0.0, 1), _SEARCH_DEPTH)[0])
