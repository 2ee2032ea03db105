"""The SMB: it obeys its published limits, measures as its sensors do, and finds the pillar."""

from functools import partial

import numpy as np
import pytest
from stage import body, drive

from husky_evaluation.metrics import run_scenario
from husky_evaluation.rollout import model_of
from husky_evaluation.scenarios import course_scenario, random_starts
from husky_evaluation.setup import setup_of
from husky_highlevel_controller.datatypes import Cylinder
from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.simulator.simulator_config import simulator_config

SMB = simulator_config("smb")


@pytest.fixture
def simulate(simulate):
    return partial(simulate, robot=model_of(SMB.robot), config=SMB)


def test_it_stands_on_its_wheels_and_keeps_its_limits(simulate):
    simulation = simulate()
    snapshots = drive(simulation, 2.0, 9.0, 0.0)
    assert snapshots[-1].robot.pose_in_world.position[2] == pytest.approx(0.19 + 0.0185, abs=2e-3)
    speeds = [snapshot.robot.velocity_in_base[0] for snapshot in snapshots]
    assert max(speeds) == pytest.approx(1.1, abs=0.01)
    assert speeds[round(0.25 / simulation.dt)] == pytest.approx(2.0 * 0.25, abs=0.05), "2.0 m/s^2"
    assert drive(simulation, 2.0, 0.0, 9.0)[-1].command.angular == 1.1


def test_a_pillar_on_the_left_is_at_a_positive_angle_of_half_a_circle(simulate):
    (scan,) = (
        s.scan for s in drive(simulate(body("post", Cylinder(0.2, 2.0), 4.0, 2.0, 1.0)), 0.1) if s.scan
    )
    assert (scan.frame, len(scan.ranges)) == ("rslidar", 362)
    assert (scan.angle_min, scan.angle_max) == (-1.5708, 1.5708)
    assert scan.angle_increment == pytest.approx(0.0087, abs=1e-5)
    nearest = int(np.argmin(scan.ranges))
    assert scan.bearings[nearest] == pytest.approx(np.arctan2(2.0, 4.0), abs=0.02)
    assert scan.ranges[nearest] == pytest.approx(np.hypot(4.0, 2.0) - 0.2, abs=0.05)


def test_its_imu_feels_that_it_is_ahead_of_the_middle(simulate):
    snapshots = drive(simulate(), 4.0, 0.0, 1.0)
    steady = [snapshot for snapshot in snapshots if snapshot.imu][-400:]
    rate = np.mean([snapshot.imu.angular_velocity[2] for snapshot in steady])
    force = np.mean([snapshot.imu.specific_force for snapshot in steady], axis=0)
    centre = np.mean([snapshot.robot.velocity_in_base[1] for snapshot in steady]) * rate
    assert force[0] == pytest.approx(-(rate**2) * 0.2554 - centre, abs=0.02)
    assert len([snapshot for snapshot in snapshots if snapshot.imu]) == 1600, "400 Hz"
    assert not any(snapshot.gps for snapshot in snapshots)


SCENARIOS = [
    pytest.param(course_scenario(0), id="course"),
    *[pytest.param(start, id=start.name, marks=pytest.mark.slow) for start in random_starts(2, 0)],
]


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_the_controller_drives_it_to_the_pillar(scenario):
    result = run_scenario(setup_of(robot="smb"), scenario)
    assert result.good, result.summary


def test_its_outline_leaves_room_between_the_wheels():
    outline = load_robot("smb").footprint
    assert outline.clearance(np.array([(0.45, 0.0), (0.45, 0.3)])) == pytest.approx([0.12, 0.0441])
