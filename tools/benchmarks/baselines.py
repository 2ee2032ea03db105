"""Baselines of the benchmark: PyBullet alone, without this package.

As a program it runs the bare loop in a process of its own: `baselines.py RESULT.json SECONDS`.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Dict, Sequence, Tuple

import numpy as np
import pybullet
from network import peak_megabytes

from husky_evaluation.rollout import model_of
from husky_evaluation.scenarios import course_scenario
from husky_highlevel_controller.datatypes import Box, Cylinder, Plane, Pose, Shape, Sphere, even_beams
from husky_highlevel_controller.geometry import matrix_from_quat
from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.simulator.models.robot_model import RobotModel
from husky_highlevel_controller.simulator.simulator_config import simulator_config

STEP_RATE, SCAN_RATE = 240, 50  # [Hz]
WHEEL_SPEED, WHEEL_TORQUE = 3.0, 100.0  # [rad/s], [N m]
OUTSIDE = 0.15  # [m] distance from the optical centre at which rays are out of the lidar's own hull


def bare_loop(seconds: float, tuned: bool = False, paced: bool = False) -> Dict[str, float]:
    """Simulate the Husky in the course's world as in PyBullet's quick start.

    A second has 240 steps and 50 batches of 720 rays. The robot drives all the time, whatever the rays hit.

    Args:
        seconds: simulated time [s].
        tuned: true for wheels that are true cylinders, 20 solver iterations, and rays that start outside of
            the robot, because Bullet takes three times as long for a ray that starts within a hull.
        paced: true for real time, by a sleep after each scan.

    Returns:
        Simulated seconds per second of wall time ("factor") and CPU seconds per simulated second ("cpu").
    """
    client = pybullet.connect(pybullet.DIRECT)
    pybullet.setTimeStep(1.0 / STEP_RATE, client)
    pybullet.setGravity(0.0, 0.0, -9.8, physicsClientId=client)
    for body in course_scenario().world.bodies:
        for geometry in body.collisions:
            put(client, geometry.shape, body.pose_in_world)
    flags = pybullet.URDF_USE_INERTIA_FROM_FILE
    if tuned:
        flags |= pybullet.URDF_USE_IMPLICIT_CYLINDER
        pybullet.setPhysicsEngineParameter(numSolverIterations=20, physicsClientId=client)
    robot = _load_husky(client, flags)
    lidar, reach = simulator_config().lidar, simulator_config().lidar.range_max
    x, y = even_beams(-lidar.angle_max, lidar.angle_max, lidar.beams).directions
    beams = np.column_stack([x, y, np.zeros(lidar.beams)])
    mount = model_of(load_robot()).fixed_poses[model_of(load_robot()).laser_frame]
    info = pybullet.getDynamicsInfo(robot, -1, physicsClientId=client)
    # Bullet gives the pose of the robot's centre of mass; `info` has the centre's pose in the base
    base_in_inertial = pybullet.invertTransform(info[3], info[4])
    laser = pybullet.multiplyTransforms(*base_in_inertial, mount.position, mount.quat_xyzw)
    begin, cpu_begin = time.perf_counter(), time.process_time()
    for step in range(1, round(seconds * STEP_RATE) + 1):
        pybullet.stepSimulation(client)
        if step * SCAN_RATE % STEP_RATE < SCAN_RATE:  # true in SCAN_RATE of STEP_RATE steps
            body = pybullet.getBasePositionAndOrientation(robot, client)
            center, quat = pybullet.multiplyTransforms(*body, *laser)
            turned = beams @ matrix_from_quat(quat).T
            cast(client, center + (OUTSIDE if tuned else 0.0) * turned, center + reach * turned)
            if paced:
                time.sleep(max(begin + step / STEP_RATE - time.perf_counter(), 0.0))
    took, cpu = time.perf_counter() - begin, time.process_time() - cpu_begin
    pybullet.disconnect(client)
    return {"factor": seconds / took, "cpu": cpu / seconds}


def cast(client: int, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return the distance to the hit of each ray as a fraction of the ray, 1 without a hit.

    Starts and ends are arrays, because PyBullet reads arrays faster than lists.
    """
    return np.array([hit[2] for hit in pybullet.rayTestBatch(starts, ends, physicsClientId=client)])


def put(client: int, shape: Shape, pose: Pose) -> int:
    """Add a body of one shape that does not move, and return its number in Bullet."""
    if isinstance(shape, Box):
        size = {"shapeType": pybullet.GEOM_BOX, "halfExtents": [edge / 2.0 for edge in shape.size]}
    elif isinstance(shape, Cylinder):
        size = {"shapeType": pybullet.GEOM_CYLINDER, "radius": shape.radius, "height": shape.length}
    elif isinstance(shape, Sphere):
        size = {"shapeType": pybullet.GEOM_SPHERE, "radius": shape.radius}
    elif isinstance(shape, Plane):
        size = {"shapeType": pybullet.GEOM_PLANE, "planeNormal": shape.normal}
    collision = pybullet.createCollisionShape(physicsClientId=client, **size)
    body: int = pybullet.createMultiBody(
        0.0, collision, basePosition=pose.position, baseOrientation=pose.quat_xyzw, physicsClientId=client
    )
    return body


class BulletRays:
    """Shapes in a Bullet server of their own, and rays that hit them."""

    def __init__(self, shapes: Sequence[Tuple[Shape, Pose]]) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)
        for shape, pose in shapes:
            put(self._client, shape, pose)

    def scan(self, pose_laser_in_world: Pose, angles: np.ndarray, reach: float) -> np.ndarray:
        """Return the distances of one scan [m]."""
        beams = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])
        beams = beams @ matrix_from_quat(pose_laser_in_world.quat_xyzw).T
        starts = np.broadcast_to(pose_laser_in_world.position, beams.shape)
        return reach * cast(self._client, np.ascontiguousarray(starts), starts + reach * beams)

    def close(self) -> None:
        """Give the server's memory back."""
        pybullet.disconnect(self._client)


def _load_husky(client: int, flags: int) -> int:
    """Put the Husky on the ground with motors that turn its wheels, and return its number in Bullet."""
    handle, path = tempfile.mkstemp(suffix=".urdf")
    with os.fdopen(handle, "w") as file:
        file.write(_with_joints(model_of(load_robot())))
    height = model_of(load_robot()).wheels[0].radius - model_of(load_robot()).wheels[0].position[2]
    robot: int = pybullet.loadURDF(path, (0.0, 0.0, height), flags=flags, physicsClientId=client)
    os.remove(path)
    joints = range(pybullet.getNumJoints(robot, client))
    wheels = [j for j in joints if pybullet.getJointInfo(robot, j, client)[2] == pybullet.JOINT_REVOLUTE]
    pybullet.setJointMotorControlArray(
        robot, wheels, pybullet.VELOCITY_CONTROL, targetVelocities=[WHEEL_SPEED] * len(wheels),
        forces=[WHEEL_TORQUE] * len(wheels), physicsClientId=client,
    )  # fmt: skip
    return robot


def _with_joints(robot: RobotModel) -> str:
    """Return the robot's URDF with wheels that turn on joints, as PyBullet needs it without traction.py."""
    root = ET.fromstring(robot.physics_urdf)
    base = root.find("link")
    assert base is not None
    mass = robot.mass - sum(wheel.mass for wheel in robot.wheels)
    base.find("inertial/mass").set("value", repr(mass))  # type: ignore[union-attr]
    for wheel in robot.wheels:
        link = ET.SubElement(root, "link", name=wheel.link)
        solid = ET.SubElement(link, "inertial")
        ET.SubElement(solid, "mass", value=repr(wheel.mass))
        axial = repr(wheel.axial_inertia)
        across = repr(wheel.axial_inertia / 1.8)  # ratio of the two inertias in the published URDF
        ET.SubElement(solid, "inertia", ixx=across, ixy="0", ixz="0", iyy=axial, iyz="0", izz=across)
        joint = ET.SubElement(root, "joint", name=wheel.joint, type="continuous")
        place = " ".join(map(repr, wheel.position))
        ET.SubElement(joint, "origin", xyz=place)
        ET.SubElement(joint, "parent", link="base_link")
        ET.SubElement(joint, "child", link=wheel.link)
        ET.SubElement(joint, "axis", xyz="0 1 0")
        for collision in base.findall("collision"):
            origin = collision.find("origin")
            if collision.find("geometry/cylinder") is not None and origin.get("xyz") == place:  # type: ignore[union-attr]
                base.remove(collision)
                origin.set("xyz", "0 0 0")  # type: ignore[union-attr]
                link.append(collision)
    return ET.tostring(root, encoding="unicode")


if __name__ == "__main__":
    cpu, paced_cpu = (bare_loop(float(sys.argv[2]), paced=paced)["cpu"] for paced in (False, True))
    Path(sys.argv[1]).write_text(json.dumps({"cpu": cpu, "paced": paced_cpu, "memory": peak_megabytes()}))
