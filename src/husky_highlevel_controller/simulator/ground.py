"""Ground of a world: what carries the robot where it starts.

In: a `World`, a start pose. Out: that world, or one with a plane.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from math import isfinite, pi

from husky_highlevel_controller.datatypes import Body, Geometry, Plane, Pose, Pose2D, World, even_beams
from husky_highlevel_controller.geometry import compose, quat_from_rpy
from husky_highlevel_controller.simulator.sensors.raycast import cast_rays, make_scene

FALL_DEPTH = 10.0  # [m], a robot this far below its start has fallen off the world
_EYE_HEIGHT = 0.05  # [m], from where a ray looks down: below the robot's hull

log = logging.getLogger("rosout.world")  # a child of rospy's logger: reaches /rosout without rospy


def with_ground(world: World, start: Pose2D) -> World:
    """The world, with a plane at z = 0 if there is nothing to fall on within FALL_DEPTH below `start`."""
    parts = [(body.pose_in_world, part) for body in world.bodies for part in body.collisions]
    scene = make_scene([(part.shape, compose(pose, part.pose_in_body)) for pose, part in parts])
    eye = Pose((start.x, start.y, _EYE_HEIGHT), quat_from_rpy(0.0, pi / 2.0, 0.0))
    if isfinite(cast_rays(scene, eye, even_beams(0.0, 0.0, 1), FALL_DEPTH)[0]):
        return world
    place = f"({start.x:g}, {start.y:g})"
    log.warning("world '%s' has no ground at %s, where the robot starts: it gets a plane", world.name, place)
    plane = Geometry(Plane((0.0, 0.0, 1.0), (100.0, 100.0)))
    name = (
        "ground_plane" if all(body.name != "ground_plane" for body in world.bodies) else "ground_plane::added"
    )
    return replace(world, bodies=(*world.bodies, Body(name, Pose(), (plane,), (plane,))))
