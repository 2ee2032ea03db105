"""The world changes under way: objects come, go and are moved, and so is the robot."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from math import hypot, inf, nan, pi
from multiprocessing import get_context

import numpy as np
import psutil
import pybullet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stage import GROUND, HUSKY, body, drive

from husky_highlevel_controller.datatypes import (
    Body,
    Box,
    Cylinder,
    Geometry,
    HuskyError,
    ModelMotion,
    Pose,
    Pose2D,
    Sphere,
    Twist2D,
    World,
)
from husky_highlevel_controller.geometry import compose, quat_from_rpy, yaw_from_quat
from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.simulator.bullet.world import PlacementError
from husky_highlevel_controller.simulator.models.sdf_world import load_world, parse_model
from husky_highlevel_controller.simulator.simulation import Simulation
from husky_highlevel_controller.simulator.simulator_config import simulator_config

EXACT = replace(simulator_config(), lidar=replace(simulator_config().lidar, noise=0.0))
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


@pytest.fixture
def simulate(simulate):
    def make(*bodies, driven=0.0, **how):
        simulation = simulate(*bodies, robot=HUSKY, config=EXACT, seed=1, **how)
        drive(simulation, driven)
        return simulation

    return make


POST = body("post", Cylinder(0.1, 1.0), x=3.0, z=0.5)
LINES = replace(body("lines", Box((1.0, 0.1, 0.1)), x=2.0), collisions=())


def crate(x=2.0):
    """A box that can be moved and pushed."""
    return body("box", Box((0.4, 0.4, 1.0)), x=x, z=0.5, mass=5.0)


def refused(words, act, *arguments):
    with pytest.raises(PlacementError, match=words):
        act(*arguments)


def ahead(simulation):
    """What the lidar reads straight ahead, from base_link's origin [m]."""
    scan = next(s.scan for s in iter(simulation.step, None) if s.scan is not None)
    return 0.337 + float(np.interp(0.0, scan.bearings, scan.ranges))


def place(simulation):
    x, y, _ = simulation.step().robot.pose_in_world.position
    return x, y


def block(name, x, model, mass=2.0):
    return replace(body(name, Box((0.6, 0.6, 0.6)), x=x, z=0.3, mass=mass), model=model)


def height(simulation, name):
    return simulation.pose_of(name).position[2]


@pytest.mark.parametrize("model", ["m", ""])
def test_links_of_one_model_push_one_another_apart_only_if_they_collide(simulate, model):
    simulation = simulate(
        block("m::a", 4.0, model), block("m::b", 4.3, model), block("m::c", 4.3, model, 0.0)
    )
    drive(simulation, 3.0)
    xs = [simulation.pose_of(f"m::{each}").position[0] for each in "ab"]
    assert (xs == pytest.approx([4.0, 4.3], abs=1e-3)) == bool(model)


def test_links_of_a_spawned_model_may_overlap_and_what_comes_after_them_collides_again(simulate):
    simulation = simulate()
    simulation.spawn([block("m::a", 4.0, "m"), block("m::b", 4.3, "m")])
    simulation.move("m::b", Pose((4.1, 0.0, 0.3)))
    simulation.delete("m::b")
    simulation.spawn([replace(body("n", Box((0.2, 0.2, 0.2)), x=4.0, z=0.72, mass=1.0))])  # has b's id
    drive(simulation, 2.0)
    assert height(simulation, "n") == pytest.approx(0.7, abs=0.01)
    refused("'k' would stand inside 'm::a'", simulation.spawn, [block("k", 4.2, "")])


def test_a_spawned_thing_is_seen_bumped_into_and_gone_when_deleted(simulate):
    simulation = simulate()
    drive(simulation, 0.5)
    assert ahead(simulation) == inf
    simulation.spawn([body("wall", Box((0.1, 2.0, 1.0)), x=1.55, z=0.5)])
    assert ahead(simulation) == pytest.approx(1.5, abs=0.01)
    assert drive(simulation, 3.0, 0.5)[-1].contacts == ("wall",)
    simulation.delete("wall")
    assert ahead(simulation) == inf
    x, _ = place(simulation)
    drive(simulation, 3.0, 0.5)
    assert place(simulation)[0] > x + 1.0


WALL = body("wall", Box((1.0, 1.0, 1.0)), 0.0, 0.0, 0.5)
BLOCKED = World("blocked", (GROUND, WALL), (0.0, 0.0, -1.6))


def new(x, mass):
    return [body("new", Box((0.2,) * 3), x=x, z=0.15, mass=mass)]


@pytest.mark.parametrize(
    ("request_name", "arguments", "words"),
    [
        ("spawn", ([replace(POST, mass=2.0)],), "a body named 'post' exists already; choose another name"),
        ("spawn", ([replace(POST, name="husky")],), "'husky' is the name of the robot"),
        *[("spawn", (new(3.0, mass),), "'new' would stand inside 'post'") for mass in (0.0, 1.0)],
        *[("spawn", (new(x, 1.0),), "'new' would stand inside 'husky'") for x in (0.0, 0.45)],
        ("move", ("box", Pose((3.0, 0.1, 0.5), UPRIGHT)), "'box' would stand inside 'post'"),
        ("move", ("husky", Pose((3.0, 0.3, 0.0), UPRIGHT)), "'husky' would stand inside 'post'"),
        ("move", ("ghost", Pose()), "ghost"),
        ("move", ("ground", Pose()), "ground"),
        ("move", ("lines", Pose((5.0, 0.0, 0.5), UPRIGHT)), "'lines' has no collision shape"),
        ("delete", ("ghost",), "no body named 'ghost'; there are: box, ground, lines, post"),
        ("delete", ("husky",), "'husky' is the robot, which cannot be deleted"),
        ("load_world", (BLOCKED,), "'husky' would stand inside 'wall'"),
    ],
)
def test_a_request_is_refused_by_name_and_changes_nothing(request_name, arguments, words, simulate):
    simulation = simulate(crate(1.5), POST, LINES, driven=0.5)
    before = {name: simulation.pose_of(name) for name in simulation.bodies}
    refused(words, getattr(simulation, request_name), *arguments)
    assert {name: simulation.pose_of(name) for name in simulation.bodies} == before
    assert before["lines"] == LINES.pose_in_world
    simulation.spawn(new(2.5, 1.0))
    force = next(s.imu.specific_force for s in iter(simulation.step, None) if s.imu)
    assert force == pytest.approx((0.0, 0.0, 9.8), abs=0.1)


def test_a_model_comes_and_goes_with_all_its_parts_or_not_at_all(simulate):
    simulation = simulate(POST)
    gate = [body(f"gate::{x}", Box((0.2,) * 3), x=2.0 + x, z=0.1) for x in range(3)]
    refused("'gate::1' would stand inside 'post'", simulation.spawn, gate)
    assert set(simulation.bodies) == {"ground", "post"}
    simulation.delete("post")
    simulation.spawn(gate)
    refused("already", simulation.spawn, [body("gate", Box((0.2,) * 3), x=9.0, z=0.1)])
    simulation.delete("gate")
    assert set(simulation.bodies) == {"ground"}


def test_a_movable_thing_that_is_put_half_into_the_ground_stands_on_it(simulate):
    simulation = simulate()
    simulation.spawn([body("box", Box((0.4,) * 3), x=2.0, mass=1.0)])
    drive(simulation, 0.5)
    assert simulation.pose_of("box").position == pytest.approx((2.0, 0.0, 0.2), abs=2e-3)


@pytest.mark.parametrize("mass", [0.0, 5.0])
def test_a_moved_thing_stands_still_where_it_was_put_and_is_seen_there(mass, simulate):
    simulation = simulate(replace(crate(), mass=mass), driven=0.5)
    simulation.move("box", Pose((4.0, 0.0, 0.5), UPRIGHT))
    assert ahead(simulation) == pytest.approx(3.8, abs=0.01)
    drive(simulation, 0.5)
    assert simulation.pose_of("box").position == pytest.approx((4.0, 0.0, 0.5), abs=2e-3)


# ---------------------------------------------------------------------------- the robot


def test_the_robot_is_put_down_at_rest_and_odom_stays_where_it_is_in_the_world(simulate):
    simulation = simulate(start=Pose2D(1.0, 2.0, 0.5))
    drive(simulation, 3.0, 1.0, 0.2)
    before = simulation.pose_world_in_odom
    simulation.move("husky", Pose((5.0, -3.0, 0.0), quat_from_rpy(0.0, 0.0, 2.0)))
    snapshot = next(snapshot for snapshot in iter(simulation.step, None) if snapshot.odometry)
    assert snapshot.robot.pose_in_world.position == pytest.approx((5.0, -3.0, 0.1323), abs=2e-3)
    assert yaw_from_quat(snapshot.robot.pose_in_world.quat_xyzw) == pytest.approx(2.0, abs=1e-3)
    assert hypot(*snapshot.robot.velocity_in_base) < 0.05
    after = simulation.pose_world_in_odom
    assert after.position == pytest.approx(before.position, abs=1e-3)
    base_in_odom = compose(before, snapshot.robot.pose_in_world)
    believed = snapshot.odometry.filtered.pose_base_in_odom
    assert (believed.x, believed.y) == pytest.approx(base_in_odom.position[:2], abs=1e-3)
    felt = [s.imu for s in drive(simulation, 0.5) if s.imu is not None]
    assert max(hypot(*sample.specific_force[:2]) for sample in felt) < 0.5, "no crash is felt"


def test_odom_is_as_high_as_base_link_on_a_deck_and_beside_it(simulate):
    deck = body("deck", Box((6.0, 6.0, 1.0)), z=0.5)
    simulation = simulate(deck, driven=0.1)
    assert simulation.ground_height == pytest.approx(1.0, abs=2e-3)
    assert simulation.pose_world_in_odom.position[2] == pytest.approx(-1.1323, abs=2e-3)
    simulation.move("husky", Pose((10.0, 0.0, 0.0), UPRIGHT))
    assert simulation.ground_height == pytest.approx(0.0, abs=2e-3)
    assert simulation.pose_world_in_odom.position[2] == pytest.approx(-0.1323, abs=2e-3)


@pytest.mark.parametrize("height", [-0.3, -5.0])
def test_a_robot_that_is_put_below_the_ground_stands_on_it(simulate, height):
    simulation = simulate()
    simulation.move("husky", Pose((3.0, 0.0, height), UPRIGHT))
    *_, last = drive(simulation, 1.0)
    assert last.robot.pose_in_world.position == pytest.approx((3.0, 0.0, 0.1323), abs=2e-3)
    started = simulate(start_height=height)
    assert started.ground_height == pytest.approx(0.0, abs=2e-3)


def test_a_robot_that_falls_beside_its_floor_is_put_back_on_it(simulate):
    simulation = simulate(World("w", (body("island", Box((6.0, 6.0, 1.0)), z=-0.5),)))
    drive(simulation, 5.0, 1.0)
    assert simulation.ground_height < -1.0
    simulation.move_robot_level(Pose2D())
    assert simulation.ground_height == pytest.approx(0.0, abs=2e-3)
    assert not simulation.has_fallen
    drive(simulation, 8.0, 1.0)
    assert simulation.has_fallen


def test_a_start_inside_something_is_refused_and_frees_the_engine(simulate):
    """It holds 35 MB; a sweep over starts would run out of memory."""
    before = [client for client in range(64) if pybullet.isConnected(client)]
    refused("'husky' would stand inside 'post'", simulate, body("post", Cylinder(0.2, 1.0), z=0.5))
    assert [client for client in range(64) if pybullet.isConnected(client)] == before


def test_everything_goes_back_to_where_it_was_put_and_a_reset_leaves_nothing_of_what_was_changed(simulate):
    simulation = simulate(crate(1.5))
    simulation.spawn([body("ball", Sphere(0.1), x=-2.0, z=0.1, mass=0.1)])
    drive(simulation, 4.0, 0.5)
    simulation.move("ball", Pose((-4.0, 0.0, 0.1), UPRIGHT))
    assert simulation.pose_of("box").position[0] > 1.7
    simulation.reset_poses()
    assert place(simulation) == pytest.approx((0.0, 0.0), abs=2e-3)
    assert simulation.pose_of("box").position == pytest.approx((1.5, 0.0, 0.5), abs=2e-3)
    assert simulation.pose_of("ball").position[:2] == pytest.approx((-2.0, 0.0), abs=2e-3)
    simulation.delete("box")
    simulation.reset()
    assert set(simulation.bodies) == {"ground", "box"}
    assert ahead(simulation) == pytest.approx(1.3, abs=0.01)


def test_a_static_object_that_was_moved_goes_back_too(simulate):
    simulation = simulate(POST)
    before = ahead(simulation)
    simulation.move("post", Pose((5.0, 0.0, 0.5), UPRIGHT))
    assert ahead(simulation) == pytest.approx(before + 2.0, abs=0.01)
    simulation.reset_poses()
    assert simulation.pose_of("post").position == pytest.approx((3.0, 0.0, 0.5))
    assert ahead(simulation) == pytest.approx(before, abs=0.01)


@pytest.mark.parametrize(("model", "words"), [("box", "exists already"), ("husky", "the name of the robot")])
def test_a_model_of_several_parts_takes_no_name_of_another(model, words, simulate):
    simulation = simulate(crate())
    parts = [body(f"{model}::{part}", Sphere(0.1), x=x, z=0.1) for part, x in (("a", -3.0), ("b", -4.0))]
    refused(f"'{model}'.* {words}; choose another name", simulation.spawn, parts)
    assert set(simulation.bodies) == {"ground", "box"}


def house(count):
    """A body of boxes far away; the last one is a wall across the robot's way at x = 2."""
    boxes = [
        Geometry(Box((0.5, 0.5, 1.0)), Pose((10.0 + number, 20.0, 0.0), UPRIGHT))
        for number in range(count - 1)
    ]
    wall = Geometry(Box((0.2, 4.0, 1.0)), Pose((2.0, 0.0, 0.0), UPRIGHT))
    return Body("house", Pose((0.0, 0.0, 0.5), UPRIGHT), (*boxes, wall), ())


@pytest.mark.parametrize("count", [16, 17, 40])
def test_each_shape_of_a_body_is_solid_however_many_there_are(count, simulate):
    simulation = simulate(house(count))
    snapshots = drive(simulation, 4.0, 1.0)
    assert snapshots[-1].robot.pose_in_world.position[0] < 1.6
    assert "house" in {name for each in snapshots for name in each.contacts}
    simulation.reset_poses()
    simulation.move("house", Pose((0.0, 8.0, 0.5), UPRIGHT))
    assert simulation.pose_of("house").position == pytest.approx((0.0, 8.0, 0.5))
    assert drive(simulation, 4.0, 1.0)[-1].robot.pose_in_world.position[0] > 2.5
    refused("'house' would stand inside 'husky'", simulation.move, "house", Pose((1.5, 0.0, 0.5), UPRIGHT))
    simulation.delete("house")


def test_a_movable_body_of_many_shapes_is_one_rigid_body(simulate):
    row = tuple(
        Geometry(Box((0.2, 0.2, 0.4)), Pose((0.2 * number, 0.0, 0.0), UPRIGHT)) for number in range(20)
    )
    simulation = simulate(
        replace(body("row", Box((0.2, 0.2, 0.4)), x=2.0, y=-1.9, z=0.2, mass=4.0), collisions=row)
    )
    drive(simulation, 1.0)
    assert simulation.pose_of("row").position == pytest.approx((2.0, -1.9, 0.2), abs=2e-3), "it stands"
    simulation.move("row", Pose((2.0, -1.9, 0.2), quat_from_rpy(0.0, 0.0, pi / 2.0)))
    drive(simulation, 3.0, 1.0)  # into its eleventh box
    place = simulation.pose_of("row")
    assert place.position[0] > 2.2
    assert place.position[2] == pytest.approx(0.2, abs=0.02)


@pytest.mark.parametrize("mass", [0.0, 5.0])
def test_parts_of_a_model_may_overlap_when_it_comes_and_when_it_is_moved(mass, simulate):
    model = f"""<sdf version="1.6"><model name="m"><static>{str(not mass).lower()}</static>
      <link name="a"><pose>0 0 0.5 0 0 0</pose>
        <collision name="c"><geometry><box><size>4 0.15 1</size></box></geometry></collision></link>
      <link name="b"><pose>2 1.9 0.5 0 0 0</pose>
        <collision name="c"><geometry><box><size>0.15 4 1</size></box></geometry></collision></link>
      </model></sdf>"""
    simulation = simulate()
    simulation.spawn(list(parse_model(model, "m", Pose((5.0, 0.0, 0.0), UPRIGHT))))
    assert set(simulation.bodies) == {"ground", "m::a", "m::b"}
    simulation.place_model("m", ModelMotion(Pose((8.0, 0.0, 0.0), UPRIGHT)))
    assert simulation.pose_of("m::a").position == pytest.approx((8.0, 0.0, 0.5), abs=1e-6)
    refused(
        "would stand inside 'husky'", simulation.place_model, "m", ModelMotion(Pose((0.0, 0.0, 0.0), UPRIGHT))
    )


PLACES = st.tuples(st.floats(-1.0, 3.0), st.floats(-1.0, 1.0))
NAMES = st.sampled_from(["post", "box", "screen", "ground", "husky", "ball", "nothing"])
NEW = st.lists(st.tuples(NAMES, PLACES), min_size=1, max_size=3)
REQUESTS = st.one_of(
    st.tuples(st.just("spawn"), NEW),
    st.tuples(st.just("move"), st.tuples(NAMES, PLACES)),
    st.tuples(st.just("delete"), NAMES),
    st.tuples(st.just("reset_poses"), st.none()),
    st.tuples(st.just("reset"), st.sampled_from([-1, 5])),
    st.tuples(st.just("command"), st.sampled_from([Twist2D(nan, 0.0), Twist2D(0.0, inf), Twist2D(0.5, 0.2)])),
)


def grant(simulation, name, argument):
    if name == "spawn":
        simulation.spawn([body(new, Sphere(0.15), x=x, y=y, z=0.15, mass=0.5) for new, (x, y) in argument])
    elif name == "move":
        simulation.move(argument[0], Pose((*argument[1], 0.3)))
    elif argument is None:
        simulation.reset_poses()
    else:
        getattr(simulation, name)(argument)


@pytest.mark.parametrize("examples", [5, pytest.param(200, marks=pytest.mark.slow)])
def test_a_refused_request_changes_nothing_and_a_granted_one_all(examples, simulate):
    """Beside a twin that gets the granted requests alone, every later state is the same to the last bit."""
    screen = replace(body("screen", Box((0.1, 0.1, 0.1)), x=2.0), collisions=())
    asked, twin = (simulate(POST, crate(1.2), screen) for _ in range(2))

    @settings(derandomize=True, max_examples=examples, deadline=None)
    @given(st.lists(REQUESTS, min_size=1, max_size=6))
    def hold(requests):
        for simulation in (asked, twin):
            simulation.reset(1)
            drive(simulation, 1.5, 0.8, 0.1)  # into the box, which slides
        for name, argument in requests:
            try:
                grant(asked, name, argument)
            except (HuskyError, ValueError):
                pass
            else:
                grant(twin, name, argument)
            assert dict(asked.bodies) == dict(twin.bodies)
            for _ in range(20):
                assert asked.step().robot == twin.step().robot
                assert all(asked.pose_of(each) == twin.pose_of(each) for each in asked.bodies)

    hold()


def memory_after_a_thousand_things():
    """Memory of this process [kB] after each of two rounds in which a thousand bodies come and go."""
    simulation = Simulation(World("w", (GROUND,)), HUSKY, EXACT, Pose2D(), 1)
    drive(simulation, 0.2)
    grid = [(2.0 + i // 32, i % 32 - 16.0) for i in range(1000)]
    shapes = (Box((0.3, 0.3, 0.6)), Cylinder(0.2, 0.6), Sphere(0.3))
    sizes = []
    for _ in range(2):
        for i, (x, y) in enumerate(grid):
            simulation.spawn([body(f"t{i}", shapes[i % 3], x=x, y=y, z=0.3, mass=float(i % 2))])
        assert len(simulation.bodies) == 1001
        drive(simulation, 0.02)
        for i in range(1000):
            simulation.delete(f"t{i}")
        assert set(simulation.bodies) == {"ground"}
        assert ahead(simulation) == inf
        sizes.append(psutil.Process().memory_info().rss // 1024)
    return sizes


def test_a_thousand_things_come_and_go_and_leave_no_body_and_no_memory_behind():
    with ProcessPoolExecutor(1, get_context("spawn")) as alone:
        first, second = alone.submit(memory_after_a_thousand_things).result()
    assert second - first < 3000, "[kB]; a thousand that stay take about 13 MB"


SLAB = Box((8.0, 8.0, 0.1))


def test_the_robot_starts_moves_and_resets_on_top_of_a_slab(simulate):
    # Clearpath's playpen: half of its asphalt, 0.1 m thick, is in the ground
    simulation, level = simulate(body("asphalt", SLAB, mass=0.0)), simulate()
    height = level.step().robot.pose_in_world.position[2] + 0.05
    for act in (
        lambda: None,
        simulation.reset,
        lambda: simulation.move("husky", Pose((1.0, 1.0, 0.0), UPRIGHT)),
        simulation.reset_poses,
    ):
        act()
        drive(simulation, 0.5)
        assert simulation.step().robot.pose_in_world.position[2] == pytest.approx(height, abs=1e-3)
    simulation.move("husky", Pose((6.0, 0.0, 0.0), UPRIGHT))
    assert simulation.step().robot.pose_in_world.position[2] == pytest.approx(height - 0.05, abs=1e-3)
    # half on it, it comes down calmly, with two wheels on the slab
    simulation.move("husky", Pose((4.0, 0.0, 0.0), UPRIGHT))
    snapshots = drive(simulation, 2.0)
    assert max(hypot(*snapshot.robot.velocity_in_base) for snapshot in snapshots) < 1.0
    assert height - 0.05 < snapshots[-1].robot.pose_in_world.position[2] < height


WORLDS = {path.stem: load_world(path) for path in sorted((share_folder() / "worlds").glob("*.world"))}
WORLDS["moon"] = World("moon", (GROUND,), (0.0, 0.0, -1.62))  # Gazebo writes -9.8 or -9.81, by its version


@pytest.mark.parametrize("world", WORLDS.values(), ids=WORLDS)
def test_in_every_world_the_robot_stands_and_a_loaded_one_is_as_if_begun_in(world, simulate):
    simulation, begun = simulate(body("box", Box((1.0, 1.0, 1.0)), 3.0, 0.0, 0.5)), simulate(world)
    drive(simulation, 1.0, 0.5)
    simulation.load_world(world)
    assert list(simulation.bodies) == list(begun.bodies)
    assert simulation.stamp == 1.0, "time runs on"
    assert ahead(simulation) == ahead(begun)
    for each in (simulation, begun):
        each.spawn([body("drop", Sphere(0.1), x=-5.0, z=5.0, mass=1.0)])
    loaded, last = (drive(each, 0.5)[-1] for each in (simulation, begun))
    assert loaded.imu.specific_force[2] == last.imu.specific_force[2]
    assert last.imu.specific_force[2] == pytest.approx(-world.gravity[2], abs=0.2)
    assert last.contacts == ()
    assert last.robot.pose_in_world.position == pytest.approx((0.0, 0.0, 0.1323), abs=1e-3)
    falls = [5.0 - each.pose_of("drop").position[2] for each in (simulation, begun)]
    assert falls == pytest.approx([-world.gravity[2] * 0.5**2 / 2.0] * 2, rel=0.1)


def test_in_a_world_with_nothing_in_it_nothing_is_seen(simulate):
    assert ahead(simulate(World("w", ()))) == inf


@pytest.mark.parametrize(("top", "start_height"), [(0.5, 0.0), (0.5, 0.2), (-2.0, 0.0), (3.0, 3.0)])
def test_the_robot_stands_on_a_floor_at_any_height(simulate, top, start_height):
    floor = body("floor", Box((10.0, 10.0, 1.0)), z=top - 0.5)
    simulation = simulate(ground=floor, start_height=start_height)
    assert drive(simulation, 0.5, 0.5)[-1].robot.pose_in_world.position[2] == pytest.approx(
        top + 0.132, abs=0.01
    )
    simulation.reset_poses()
    x, _, z = simulation.step().robot.pose_in_world.position
    assert (x, z) == pytest.approx((0.0, top + 0.132), abs=0.01)


@pytest.mark.parametrize(("start_height", "first"), [(0.6, 0.6), (1.0, 1.0), (5.0, 0.132)])
def test_a_robot_falls_from_the_height_at_which_it_starts_but_not_far(simulate, start_height, first):
    simulation = simulate(start_height=start_height)
    heights = [s.robot.pose_in_world.position[2] for s in drive(simulation, 1.5)]
    assert heights[0] == pytest.approx(first, abs=0.01)
    assert heights[-1] == pytest.approx(0.132, abs=0.01)


def test_a_robot_that_would_start_in_something_is_told_what_to_do(simulate):
    refused(
        "'husky' would stand inside 'crate'; choose another x, y or z",
        simulate,
        body("crate", Box((1.0, 1.0, 1.0)), z=0.3),
    )


def test_a_robot_that_would_be_put_into_something_is_told_what_stands_there_only(simulate):
    simulation = simulate(body("crate", Box((1.0, 1.0, 1.0)), x=3.0, z=0.5))
    refused("'husky' would stand inside 'crate'$", simulation.move, "husky", Pose((3.0, 0.0, 0.0), UPRIGHT))
    simulation.move("husky", Pose((-3.0, 0.0, 0.0), UPRIGHT))
    simulation.spawn([body("post", Cylinder(0.2, 1.0), z=0.5)])
    refused("'husky' would stand inside 'post'$", simulation.reset_poses)
