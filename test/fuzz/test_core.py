"""Random worlds, robots, scans, parameters, requests: each is taken or refused, and nothing becomes NaN."""

import math
from functools import lru_cache
from pathlib import Path

import pytest
import tf2_ros
import yaml
from damage import ODD, damaged, mutated, number, renumbered
from genpy import Time
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header

from husky_highlevel_controller.config import read_config
from husky_highlevel_controller.controller.behaviour import ControllerState, Observation, decide
from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.crash_detection import CrashConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig
from husky_highlevel_controller.controller.safety import ProximityConfig, too_close
from husky_highlevel_controller.datatypes import HuskyError, Pose, Pose2D, Twist2D
from husky_highlevel_controller.geometry import pose_to_2d
from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.ros.conversions import scan_from_msg
from husky_highlevel_controller.ros.transforms import lookup_pose
from husky_highlevel_controller.simulator.models.description import robot_description
from husky_highlevel_controller.simulator.models.robot_model import robot_model
from husky_highlevel_controller.simulator.models.sdf_world import parse_model, parse_world
from husky_highlevel_controller.simulator.simulation import Simulation
from husky_highlevel_controller.simulator.simulator_config import SimulatorConfig, simulator_config
from husky_highlevel_controller.simulator.spawn_request import checked, checked_pose, make_object

ROOT = Path(__file__).parents[2]
WORLDS = [(ROOT / "worlds" / f"{name}.world").read_text() for name in ("singlePillar", "ramp", "empty")]
DATA = ("everything", "frames", "saved")
DAMAGED = [*WORLDS, *((ROOT / "test" / "data" / f"{name}.world").read_text() for name in DATA)]
EMPTY = parse_world(WORLDS[2], "empty.world")
STEPS = 12  # of physics; the third scan is the last
SIMULATED = 10  # of so many cases that are taken, one is simulated: an engine takes long to start
MODEL = (
    '<sdf version="1.6"><model name="a"><pose>3 1 0.5 0 0 0.3</pose><link name="l"><inertial><mass>2</mass>'
    '</inertial><collision name="c"><geometry><box><size>0.4 0.3 1</size></box></geometry></collision>'
    '<collision name="d"><pose>0 0 1 0 0 0</pose><geometry><sphere><radius>0.2</radius></sphere></geometry>'
    "</collision></link></model></sdf>"
)
CONTROL = read_config(
    {name: value for name, value in yaml.safe_load((ROOT / "config" / "controller.yaml").read_text()).items()
     if name in ControlConfig.__dataclass_fields__},
    "", ControlConfig,
)[0]  # fmt: skip


@lru_cache(maxsize=1)
def husky():
    """Its description, and the robot."""
    text = robot_description(meshes="")
    return text, robot_model(text)


def simulate(world=EMPTY, robot=None, config=None, act=lambda simulation: None):
    """Some steps, of which nothing may be NaN."""
    simulation = Simulation(world, robot or husky()[1], config or simulator_config(), Pose2D(), 0)
    try:
        act(simulation)
        simulation.command(Twist2D(1.0, 0.5))
        for _ in range(STEPS):
            snapshot = simulation.step()
            state = snapshot.robot.pose_in_world
            assert all(map(math.isfinite, (*state.position, *state.quat_xyzw))), state
            if snapshot.scan is not None:
                assert not any(map(math.isnan, snapshot.scan.ranges.tolist()))
        for name in simulation.bodies:
            pose = simulation.pose_of(name)
            assert all(map(math.isfinite, (*pose.position, *pose.quat_xyzw))), (name, pose)
    finally:
        simulation.close()


def simulate_each(cases, make, share=10):
    """Simulate what is made of each case (None: nothing is); more than one in `share` is not refused."""
    found = 0
    for rng in cases:
        try:
            made = make(rng)
            found += 1
            if made and (len(cases) < 100 or found % SIMULATED == 0):
                simulate(**made)
        except (HuskyError, yaml.YAMLError):
            continue
    assert found > len(cases) // share


def test_worlds_are_simulated_or_refused(cases):
    def world(rng):
        text = rng.choice(DAMAGED)
        text = damaged(rng, text) if rng.random() < 0.3 else renumbered(rng, text)
        return {"world": parse_world(text, "fuzz.world")}

    simulate_each(cases, world)


def test_robots_are_simulated_or_refused(cases):
    def robot(rng):
        text = husky()[0]
        return {"robot": robot_model((damaged if rng.random() < 0.2 else renumbered)(rng, text))}

    simulate_each(cases, robot)


def scan_message(rng, stamp):
    """A scan of a pillar, a wall, noise or anything, with an odd header now and then."""
    beams = rng.choice([0, 1, 2, 3, 40, 180, 720])
    kind, far = rng.randrange(4), rng.uniform(0.3, 15.0)
    ranges = [math.inf] * beams
    for beam in range(beams):
        if kind == 0 and abs(beam - beams / 2) < 0.2 / far * beams / 4.7:
            ranges[beam] = far
        elif kind == 1:
            ranges[beam] = far / max(math.cos((beam / beams - 0.5) * 2.9), 0.05)
        elif kind == 2:
            ranges[beam] = abs(rng.gauss(far, 0.3))
        elif kind == 3:
            ranges[beam] = number(rng)
        if rng.random() < 0.01:
            ranges[beam] = number(rng)
    odd = [number(rng) if rng.random() < 0.05 else None for _ in range(6)]
    normal = (-2.35619, 4.71238 / max(beams - 1, 1), 0.1, 30.0, 0.0, 0.0)
    values = [there if each is None else each for each, there in zip(odd, normal)]
    return LaserScan(
        header=Header(stamp=Time.from_sec(stamp), frame_id="front_laser"), angle_min=values[0],
        angle_increment=values[1], range_min=values[2], range_max=values[3], time_increment=values[4],
        scan_time=values[5], ranges=ranges,
    )  # fmt: skip


def place(rng):
    """Where TF says the robot is; now and then by a transform that is not a pose."""
    msg = TransformStamped(child_frame_id="base_link")
    msg.header.frame_id = "odom"
    t, r, yaw = msg.transform.translation, msg.transform.rotation, rng.gauss(0.0, 1.0)
    usual = (*(rng.gauss(0.0, 3.0) for _ in range(3)), math.sin(yaw), math.cos(yaw))
    numbers = (rng.choice(ODD) if rng.random() < 0.1 else value for value in usual)
    t.x, t.y, t.z, r.z, r.w = numbers
    transforms = tf2_ros.Buffer(debug=False)
    transforms.set_transform_static(msg, "fuzz")
    pose = lookup_pose(transforms, "odom", "base_link")
    return pose and pose_to_2d(pose)


def test_every_scan_is_answered_by_a_command_within_its_limits(cases):
    detector, proximity = PillarConfig(), ProximityConfig()
    laser_in_base = husky()[1].fixed_poses["front_laser"]
    state, stamp, placed = ControllerState(), 0.0, 0
    for rng in cases:
        stamp += rng.choice([0.02, 0.02, 0.02, 0.0, 1.0, -stamp / 2])
        try:
            scan = scan_from_msg(scan_message(rng, max(stamp, 0.0)))
        except HuskyError:
            continue
        base_in_odom = place(rng)
        placed += base_in_odom is not None
        assert base_in_odom is None or all(map(math.isfinite, base_in_odom)), base_in_odom
        state, output = decide(state, Observation(scan, laser_in_base, base_in_odom), True, CONTROL, detector)
        assert abs(output.twist.linear) <= CONTROL.max_linear
        assert abs(output.twist.angular) <= CONTROL.max_angular
        gap = too_close(scan, laser_in_base, Twist2D(number(rng), number(rng)), proximity, load_robot())
        assert gap is None or not math.isnan(gap)
    assert placed > len(cases) // 5


@pytest.mark.parametrize(
    ("file", "records"),
    [
        ("controller.yaml", (ControlConfig, PillarConfig)),
        ("../config/robots/husky.yaml", (SimulatorConfig,)),
        ("proximity_stop.yaml", (ProximityConfig,)),
        ("crash_stop.yaml", (CrashConfig,)),
    ],
)
def test_parameters_are_within_their_bounds_or_refused(cases, file, records):
    fields = [each for record in records for each in record.__dataclass_fields__.items()]
    names = {name for name, each in fields if each.metadata}
    whole = yaml.safe_load((ROOT / "config" / file).read_text())
    whole = {name: value for name, value in whole.items() if name in names}

    def parameters(rng):
        text = renumbered(rng, yaml.safe_dump(whole)) if rng.random() < 0.8 else yaml.safe_dump(whole)
        values = yaml.safe_load(text) if rng.random() < 0.7 else mutated(rng, whole)
        config = read_config(values if isinstance(values, dict) else {}, "/node/", *records)[0]
        return {"config": config} if isinstance(config, SimulatorConfig) else None

    simulate_each(cases[: len(cases) // 2], parameters)


def test_requests_change_the_world_or_are_refused(cases):
    def pose(rng):
        angle = rng.uniform(-3.0, 3.0)
        turn = (0.0, 0.0, math.sin(angle / 2.0), math.cos(angle / 2.0))
        if rng.random() < 0.2:
            turn = tuple(number(rng) for _ in range(4))
        return Pose(tuple(number(rng) for _ in range(3)), turn)

    def requests(rng):
        if rng.random() < 0.5:
            kind, size = rng.choice(["box", "cylinder", "sphere", "cone", ""]), [abs(number(rng))] * 3
            if rng.random() < 0.5:
                size = [number(rng) for _ in range(3)]
            name, mass = rng.choice(["a", "husky", "", "a/b"]), rng.choice([0.0, 1.0, number(rng)])
            bodies = [make_object(name, kind, tuple(size), mass, pose(rng))]
        else:
            text = damaged(rng, MODEL) if rng.random() < 0.3 else renumbered(rng, MODEL)
            bodies = [checked(body) for body in parse_model(text, "a", checked_pose(pose(rng)))]

        def act(simulation):
            simulation.spawn(bodies)
            simulation.move(rng.choice([bodies[0].name, "husky", "nobody"]), checked_pose(pose(rng)))

        return {"act": act}

    simulate_each(cases, requests, share=20)
