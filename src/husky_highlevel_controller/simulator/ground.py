"""Ground under the robot: where its wheels stand, and a plane for worlds that have none.

In: a `World` or the scene of its shapes, a pose. Out: that world, or one with a plane; heights.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from math import isfinite, pi

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

FALL_DEPTH = 10.0  # [m], a robot this far below its start has fallen off the world
MAX_SLAB = 0.12  # [m], of a slab that the robot stands on rather than in: below its hull
_WHEELS = 0.3  # [m], from base_link to about its wheels, along x and y
_DOWN = quat_from_rpy(0.0, pi / 2.0, 0.0)

log = logging.getLogger("rosout.world")  # a child of rospy's logger: reaches /rosout without rospy


def with_ground(world: World, start: Pose2D) -> World:
    """The world, with a plane at z = 0 if there is nothing to fall on within FALL_DEPTH below `start`."""
    parts = [(body.pose_in_world, part) for body in world.bodies for part in body.collisions]
    scene = make_scene([(part.shape, compose(pose, part.pose_in_body)) for pose, part in parts])
    if isfinite(_drop(scene, (start.x, start.y, MAX_SLAB))):
        return world
    place = f"({start.x:g}, {start.y:g})"
    log.warning("world '%s' has no ground at %s, where the robot starts: it gets a plane", world.name, place)
    plane = Geometry(Plane((0.0, 0.0, 1.0), (100.0, 100.0)))
    is_taken = any(body.name == "ground_plane" for body in world.bodies)
    name = "ground_plane::added" if is_taken else "ground_plane"
    return replace(world, bodies=(*world.bodies, Body(name, Pose(), (plane,), (plane,))))


def slab_height(scene: RayScene, pose_on_ground: Pose) -> float:
    """Height [m] of a slab, such as asphalt, on the xy plane of a level pose, under all wheels; 0: none."""
    corners = [(x, y, MAX_SLAB) for x in (-_WHEELS, _WHEELS) for y in (-_WHEELS, _WHEELS)]
    drops = [_drop(scene, transform_point(pose_on_ground, corner)) for corner in corners]
    height = MAX_SLAB - drops[0]
    return height if max(drops) - min(drops) < 1e-3 < height < MAX_SLAB else 0.0


def _drop(scene: RayScene, point: Vector3) -> float:
    """Distance [m] from a point down to the first body; inf beyond FALL_DEPTH."""
    return float(cast_rays(scene, Pose(point, _DOWN), even_beams(0.0, 0.0, 1), FALL_DEPTH)[0])
