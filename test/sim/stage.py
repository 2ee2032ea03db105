"""Shared by the tests here: Huskies, bodies to put beside them, and driving."""

from husky_highlevel_controller.datatypes import Body, Geometry, Plane, Pose, Twist2D
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_highlevel_controller.simulator.models.description import robot_description
from husky_highlevel_controller.simulator.models.robot_model import robot_model

HUSKY = robot_model(robot_description(meshes=""))
BLIND = robot_model(robot_description(meshes="", laser_enabled=False))


def body(name, shape, x=0.0, y=0.0, z=0.0, rpy=(0.0, 0.0, 0.0), mass=0.0):
    return Body(name, Pose((x, y, z), quat_from_rpy(*rpy)), (Geometry(shape),), (), mass)


GROUND = body("ground", Plane((0.0, 0.0, 1.0), (100.0, 100.0)))


def drive(simulation, seconds, linear=0.0, angular=0.0):
    """Command all the time; every snapshot."""
    snapshots = []
    for step in range(round(seconds / simulation.dt)):
        if step % 20 == 0:
            simulation.command(Twist2D(linear, angular))
        snapshots.append(simulation.step())
    return snapshots
