"""The simulated Husky: what its motion, grip and lidar mean, and that it repeats itself."""

from dataclasses import replace
from itertools import groupby
from math import cos, dist, hypot, inf, pi, radians, sin, tan

import numpy as np
import pytest
from stage import HUSKY, body, drive

from husky_highlevel_controller.datatypes import (
    Body,
    Box,
    Cylinder,
    Geometry,
    HuskyError,
    Plane,
    Pose,
    Pose2D,
    Sphere,
    Twist2D,
    World,
)
from husky_highlevel_controller.geometry import quat_from_rpy, rotate, yaw_from_quat
from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.simulator.bullet.world import PlacementError
from husky_highlevel_controller.simulator.models.sdf_world import load_world
from husky_highlevel_controller.simulator.profile import RobotProfile
from husky_highlevel_controller.simulator.simulator_config import simulator_config, steps_per

PILLAR_WORLD = load_world(share_folder() / "worlds" / "singlePillar.world")


def place(snapshot):
    x, y, _ = snapshot.robot.pose_in_world.position
    return x, y, yaw_from_quat(snapshot.robot.pose_in_world.quat_xyzw)


# ---------------------------------------------------------------------------- motion


TURNS = [(0.0, 0.25), (0.0, -0.5), (0.0, 1.0), (0.5, -0.5), (0.5, 1.0), (1.0, 0.25), (1.0, 1.0)]


@pytest.mark.parametrize(("linear", "angular"), TURNS)
def test_it_turns_as_commanded_without_ripple_and_in_place_stays_there(linear, angular, simulate):
    simulation = simulate()
    x, y, _ = place(drive(simulation, 1.0)[-1])
    snapshots = drive(simulation, 6.0, linear, angular)
    rates = np.array([snapshot.robot.angular_velocity_in_base[2] for snapshot in snapshots[400:]])
    assert 0.95 < rates.mean() / angular < 1.06
    assert rates.std() / abs(rates.mean()) < 0.01
    assert linear or dist(place(snapshots[-1])[:2], (x, y)) < 0.2


@pytest.mark.parametrize("linear", [1.0, -0.5])
def test_straight_is_straight(linear, simulate):
    simulation = simulate()
    drive(simulation, 1.0)
    snapshots = drive(simulation, 10.0, linear)
    assert max(abs(snapshot.robot.velocity_in_base[1]) for snapshot in snapshots) < 1e-3
    assert snapshots[-1].robot.velocity_in_base[0] == pytest.approx(linear, rel=0.005)
    x, y, yaw = place(snapshots[-1])
    assert x == pytest.approx(linear * 10.0, abs=0.2)
    assert abs(y) < 0.01
    assert abs(yaw) < 1e-3


def test_on_the_top_of_a_box_it_drives_as_on_a_plane(simulate):
    floor = World("w", (body("floor", Box((40.0, 40.0, 1.0)), z=-0.5),))
    ends = [drive(simulate(*bodies), 4.0, 1.0, 0.5)[-1].robot.pose_in_world for bodies in ((), (floor,))]
    on_plane, on_box = ends
    assert on_box.position == pytest.approx(on_plane.position, abs=0.01)
    assert yaw_from_quat(on_box.quat_xyzw) == pytest.approx(yaw_from_quat(on_plane.quat_xyzw), abs=0.01)


def test_it_drives_the_same_way_whichever_way_it_faces(simulate):
    """Bullet's own friction has its axes fixed in the world."""
    ends = []
    for yaw in (0.0, 0.4, 1.0, pi / 2):
        simulation = simulate(start=Pose2D(yaw=yaw))
        drive(simulation, 1.0)
        x, y, _ = place(drive(simulation, 4.0, 0.5, 0.5)[-1])
        ends.append((x * cos(yaw) + y * sin(yaw), y * cos(yaw) - x * sin(yaw)))
    assert np.ptp(np.array(ends), axis=0) == pytest.approx([0.0, 0.0], abs=1e-3)


def test_on_its_side_it_lies(simulate):
    simulation = simulate()
    simulation.move("husky", Pose((0.0, 0.0, 0.6), quat_from_rpy(radians(80.0), 0.0, 0.0)))
    snapshots = drive(simulation, 5.0, 1.0)  # whatever its wheels do
    end = snapshots[-1].robot
    _, _, up = rotate(end.pose_in_world.quat_xyzw, (0.0, 0.0, 1.0))
    assert abs(up) < 0.2
    assert np.linalg.norm(end.velocity_in_base) < 0.02
    assert snapshots[-1].contacts == ("ground",)
    x, y, z = end.pose_in_world.position
    assert hypot(x, y) < 1.0
    assert 0.2 < z < 0.4  # half its width


def test_on_its_side_it_slides_down_a_slope_against_friction(simulate):
    slope = radians(20.0)
    simulation = simulate(ground=body("ramp", Plane((0.0, 0.0, 1.0), (9.0, 9.0)), rpy=(0.0, slope, 0.0)))
    simulation.move("husky", Pose((0.0, 0.0, 0.5), quat_from_rpy(radians(90.0), slope, 0.0)))
    slow, fast = (drive(simulation, 1.0)[-1].robot.velocity_in_base[0] for _ in range(2))
    # 9.8 m/s^2 (sin - 0.25 cos), and nothing of its own
    assert fast - slow == pytest.approx(9.8 * (sin(slope) - 0.25 * cos(slope)), rel=0.15)


def test_coarse_physics_drives_as_fine_physics_does(simulate):
    def places(rate):
        simulation = simulate(config=replace(simulator_config(), physics_rate=rate))
        rng, found = np.random.default_rng(1), []
        for _ in range(14):
            linear, angular = rng.uniform(-0.7, 1.0), rng.uniform(-1.2, 1.2)
            for _ in range(15):
                simulation.command(Twist2D(linear, angular))
                found.append(place([simulation.step() for _ in range(rate // 10)][-1]))
        return np.unwrap(found, axis=0)

    away = places(200) - places(1000)
    assert np.hypot(away[:, 0], away[:, 1]).max() < 0.02  # [m], within 21 s
    assert np.abs(away[:, 2]).max() < 0.02


@pytest.mark.parametrize(("slope", "heading"), [(0.0, 0.0), (5.0, 0.0), (5.0, 90.0), (5.0, 37.0)])
def test_parked_it_creeps_by_the_slip_speed_times_the_slope_and_feels_9_8_upwards(slope, heading, simulate):
    slope, heading = radians(slope), radians(heading)
    ramp = Plane((0.0, 0.0, 1.0), (9.0, 9.0))
    simulation = simulate(ground=body("ramp", ramp, rpy=(slope * sin(heading), slope * cos(heading), 0.0)))
    before = drive(simulation, 3.0)[-1].robot.pose_in_world
    snapshots = drive(simulation, 20.0)
    poses = [snapshot.robot.pose_in_world for snapshot in snapshots]
    creeping = dist(poses[-1].position, before.position) / 20.0
    assert creeping == pytest.approx(0.01 * tan(slope), rel=0.1, abs=5e-6)
    same = pytest.approx(before.quat_xyzw, abs=2e-3 if slope else 5e-5)
    assert all(pose.quat_xyzw == same for pose in poses[::50])
    samples = [snapshot.imu for snapshot in snapshots if snapshot.imu]
    forces = [rotate(sample.quat_xyzw, sample.specific_force) for sample in samples]
    assert np.mean(forces, axis=0) == pytest.approx((0.0, 0.0, 9.8), abs=0.01)
    assert np.mean([sample.specific_force[2] for sample in samples]) == pytest.approx(
        9.8 * cos(slope), abs=1e-3
    )


def test_it_climbs_a_ramp_onto_the_platform(simulate):
    snapshots = drive(simulate(load_world(share_folder() / "worlds" / "ramp.world")), 9.0, 0.8)
    assert snapshots[-1].robot.pose_in_world.position[2] == pytest.approx(0.485 + 0.1323, abs=2e-3)
    assert snapshots[-1].robot.velocity_in_base[0] == pytest.approx(0.8, rel=0.05)
    assert snapshots[-1].contacts == ()


def test_a_wheel_in_the_air_has_no_grip(simulate):
    """On a block under its belly the robot spins its wheels and goes nowhere."""
    pit = body("ground", Plane((0.0, 0.0, 1.0), (100.0, 100.0)), z=-0.2)
    simulation = simulate(body("block", Box((0.4, 0.3, 0.3)), z=-0.05), ground=pit)
    before = place(drive(simulation, 1.0)[-1])
    end = drive(simulation, 2.0, 1.0)[-1]
    assert dist(place(end)[:2], before[:2]) < 0.3
    assert min(end.odometry.wheels.speeds) > 5.0
    assert end.contacts == ("block",)


def test_a_pillar_stops_it_a_light_box_is_pushed_and_both_are_touched(simulate):
    box = body("box", Box((0.3, 0.3, 0.3)), x=1.2, y=0.25, z=0.15, mass=2.0)
    simulation = simulate(box, body("pillar", Cylinder(0.2, 2.0), x=2.0, z=1.0))
    snapshots = drive(simulation, 5.0, 0.5)
    assert [contacts for contacts, _ in groupby(s.contacts for s in snapshots)][:2] == [(), ("box",)]
    assert simulation.pose_of("box").position[0] > 1.5
    assert "pillar" in snapshots[-1].contacts
    assert place(snapshots[-1])[0] == pytest.approx(2.0 - 0.2 - 0.4937, abs=0.02)


# ---------------------------------------------------------------------------- world


def test_the_course_s_sunk_pillar_stands_where_it_should(simulate):
    simulation = simulate(PILLAR_WORLD)
    drive(simulation, 10.0)
    pose = simulation.pose_of("unit_cylinder")
    assert pose.position == pytest.approx((20.0, 5.0, 1.0), abs=1e-3)
    assert abs(pose.quat_xyzw[3]) == pytest.approx(1.0, abs=1e-6)


def test_the_lidar_sees_both_goals_of_the_football_field_and_nothing_else(simulate):
    simulation = simulate(load_world(share_folder() / "worlds" / "robocup14_spl_field.world"), robot=HUSKY)
    (scan,) = scans(simulation, 1)
    seen = scan.ranges[np.isfinite(scan.ranges)]
    assert len(seen) > 50
    assert 4.0 < seen.min() < 4.4
    assert seen.max() < 5.5


def test_a_thing_stays_whole_when_its_shape_is_off_its_origin(simulate):
    box = Geometry(Box((0.2, 0.2, 0.2)), Pose((1.0, 0.0, 0.1)))
    ball = Geometry(Sphere(0.1), Pose((1.0, 0.5, 0.1)))
    simulation = simulate(Body("dumbbell", Pose((3.0, 0.0, 0.0)), (box, ball), (), 1.0))
    assert simulation.pose_of("dumbbell").position == pytest.approx((3.0, 0.0, 0.0))
    drive(simulation, 2.0)
    assert simulation.pose_of("dumbbell").position == pytest.approx((3.0, 0.0, 0.0), abs=5e-3)


def test_a_plane_that_could_move_and_an_unknown_thing_are_refused(simulate):
    with pytest.raises(PlacementError, match=r"'tray' is a plane that can move \(1.0 kg\)"):
        simulate(body("tray", Plane((0.0, 0.0, 1.0), (1.0, 1.0)), mass=1.0))
    with pytest.raises(PlacementError, match="no body named 'pilar'; there are: ground, pillar"):
        simulate(body("pillar", Sphere(0.1))).pose_of("pilar")


# ---------------------------------------------------------------------------- lidar


def scans(simulation, count):
    found = []
    while len(found) < count:
        scan = simulation.step().scan
        if scan is not None:
            found.append(scan)
    return found


@pytest.mark.parametrize("angular", [0.0, 1.0])
def test_it_never_sees_itself_and_without_a_lidar_there_is_no_scan(angular, simulate):
    for snapshot in drive(simulate(robot=HUSKY), 3.0, 0.5, angular):
        assert snapshot.scan is None or np.all(snapshot.scan.ranges == inf)
    assert all(snapshot.scan is None for snapshot in drive(simulate(), 0.5))


# ---------------------------------------------------------------------------- repetition and rates


def trace(simulation):
    """A run with noise, turning, and a body to push, as bytes."""
    rows = []
    for snapshot in drive(simulation, 4.0, 0.7, 0.3):
        rows += [*snapshot.robot.pose_in_world.position, *snapshot.robot.pose_in_world.quat_xyzw]
        rows += [] if snapshot.scan is None else snapshot.scan.ranges.tolist()
        rows += [] if snapshot.imu is None else snapshot.imu.specific_force + snapshot.imu.angular_velocity
        rows += [] if snapshot.mag is None else snapshot.mag.field
        rows += [] if snapshot.power is None else [*snapshot.power.currents, snapshot.power.charge]
    return np.array(rows).tobytes()


GAZEBO = simulator_config()
CONFIGS = {"gazebo": GAZEBO, "robot": replace(GAZEBO, real=RobotProfile().on("hard"))}


@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS)
def test_the_same_seed_gives_the_same_run_to_the_last_bit_also_after_a_reset(config, simulate):
    box = body("box", Box((0.3, 0.3, 1.0)), x=1.5, y=0.4, z=0.5, mass=2.0)
    simulation, twin, other = (simulate(box, robot=HUSKY, seed=seed, config=config) for seed in (5, 5, 6))
    first = trace(simulation)
    assert trace(twin) == first
    assert trace(other) != first
    simulation.step()  # sensors' periods begin anew too
    simulation.reset()
    assert simulation.stamp == pytest.approx(4.005), "time never goes back"
    assert trace(simulation) == first


@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS)
def test_a_look_before_the_first_step_shows_the_pillar_and_changes_nothing(config, simulate):
    pillar = body("pillar", Cylinder(0.2, 2.0), x=3.0, z=1.0)
    first, second = (simulate(pillar, robot=HUSKY, seed=5, config=config) for _ in range(2))
    look = first.look()
    assert look.scan.stamp == look.stamp == 0.0
    assert look.scan.ranges[look.scan.valid].min() == pytest.approx(3.0 - 0.2 - 0.337, abs=0.1)
    assert look.odometry.filtered.pose_base_in_odom == Pose2D()
    assert trace(first) == trace(second)


@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS)
def test_a_look_during_a_drive_agrees_with_the_odometry_and_changes_nothing(config, simulate):
    first, second = (simulate(robot=HUSKY, seed=5, config=config) for _ in range(2))
    (last, *_), _ = (drive(each, 0.1, 0.5, 0.2)[::-1] for each in (first, second))
    look = first.look()
    assert (look.stamp, look.step, look.robot) == (last.stamp, last.step, last.robot)
    assert look.odometry.filtered.pose_base_in_odom == last.odometry.filtered.pose_base_in_odom
    assert trace(first) == trace(second)


@pytest.mark.parametrize(("rate", "steps"), [(50, 4), (200, 1), (1, 200), (40, 5)])
def test_a_period_is_a_whole_number_of_steps(rate, steps):
    assert steps_per(rate, 200, "scan_rate") == steps


@pytest.mark.parametrize("rate", [60, 201, 400, 150])
@pytest.mark.parametrize("name", ["scan_rate", "imu_rate"])
def test_a_rate_that_does_not_divide_that_of_physics_is_refused(name, rate, simulate):
    with pytest.raises(HuskyError, match=f"{name} = {rate} Hz does not divide physics_rate = 200 Hz"):
        simulate(config=replace(simulator_config(), **{name: rate}))


def test_time_goes_on_from_where_it_is_set_and_never_back(simulate):
    simulation, other = simulate(), simulate()
    simulation.set_stamp(1.7e9)
    first, same = simulation.step(), other.step()
    assert first.stamp == pytest.approx(1.7e9 + simulation.dt, abs=1e-6)
    assert first.robot == same.robot
    simulation.set_stamp(5.0)
    assert simulation.step().stamp == pytest.approx(1.7e9 + 2.0 * simulation.dt, abs=1e-6)
