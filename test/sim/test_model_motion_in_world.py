"""Models and the robot are put somewhere with a velocity, as Gazebo's set_model_state does."""

from dataclasses import replace
from math import pi

import pytest
from stage import HUSKY, body, drive

from husky_highlevel_controller.datatypes import Box, ModelMotion, Pose
from husky_highlevel_controller.geometry import compose, quat_from_rpy, yaw_from_quat
from husky_highlevel_controller.simulator.bullet.world import PlacementError
from husky_highlevel_controller.simulator.models.sdf_world import parse_world

CART = """<sdf version='1.6'><world name='w'>
  <include><uri>model://ground_plane</uri></include>
  <model name='cart'><pose>4 1 0 0 0 1.570796</pose>
    <link name='front'><pose>1 0 0.5 0 0 0</pose>
      <collision name='c'><geometry><box><size>0.4 0.4 1</size></box></geometry></collision></link>
    <link name='rear'><pose>-1 0 0.5 0 0 0</pose>
      <collision name='c'><geometry><box><size>0.4 0.4 1</size></box></geometry></collision></link>
  </model></world></sdf>"""


@pytest.fixture
def simulate(simulate):
    return lambda *bodies, **how: simulate(*bodies, robot=HUSKY, seed=1, **how)


def crate(x=3.0, **more):
    return body("crate", Box((0.4, 0.4, 0.4)), x=x, z=0.2, mass=5.0, **more)


def test_a_model_of_several_links_has_the_pose_of_its_file_and_moves_as_a_whole(simulate):
    simulation = simulate(parse_world(CART, "cart.world"))
    assert simulation.models == ["ground_plane", "cart", "husky"]
    at = simulation.motion_of("cart").pose
    assert at.position == pytest.approx((4.0, 1.0, 0.0), abs=1e-3)
    assert yaw_from_quat(at.quat_xyzw) == pytest.approx(pi / 2.0, abs=1e-3)
    target = Pose((-3.0, -2.0, 0.0), quat_from_rpy(0.0, 0.0, pi))
    simulation.place_model("cart", ModelMotion(target))
    front, rear = (simulation.pose_of(f"cart::{link}") for link in ("front", "rear"))
    assert front.position == pytest.approx((-4.0, -2.0, 0.5), abs=2e-3)
    assert rear.position == pytest.approx((-2.0, -2.0, 0.5), abs=2e-3)
    assert simulation.motion_of("cart").pose.position == pytest.approx(target.position, abs=2e-3)


SIGN = """<sdf version='1.6'><world name='w'>
  <include><uri>model://ground_plane</uri></include>
  <model name='sign'><static>1</static><pose>3 0 0 0 0 0</pose>
    <link name='board'><pose>0 0 1.5 0 0 0</pose>
      <visual name='v'><geometry><box><size>0.1 1 1</size></box></geometry></visual></link>
    <link name='pole'><pose>0 0 0.5 0 0 0</pose>
      <collision name='c'>
        <geometry><cylinder><radius>0.1</radius><length>1</length></cylinder></geometry></collision>
    </link>
  </model></world></sdf>"""


def test_a_part_that_is_only_drawn_moves_with_its_model(simulate):
    simulation = simulate(parse_world(SIGN, "sign.world"))
    for x in (4.0, 5.0):
        simulation.place_model("sign", ModelMotion(Pose((x, 1.0, 0.0))))
        assert simulation.motion_of("sign").pose.position == pytest.approx((x, 1.0, 0.0), abs=1e-6)
        assert simulation.pose_of("sign::pole").position == pytest.approx((x, 1.0, 0.5), abs=1e-6)
        assert simulation.pose_of("sign::board").position == pytest.approx((x, 1.0, 1.5), abs=1e-6)
    simulation.reset_poses()
    assert simulation.pose_of("sign::board").position == pytest.approx((3.0, 0.0, 1.5))


def test_a_model_gets_its_velocity_and_physics_takes_over(simulate):
    simulation = simulate(crate())
    simulation.place_model("crate", ModelMotion(Pose((3.0, 0.0, 2.0)), (0.5, 0.0, 0.0), (0.0, 0.0, 1.0)))
    motion = simulation.motion_of("crate")
    assert motion.velocity == pytest.approx((0.5, 0.0, 0.0))
    assert motion.angular_velocity == pytest.approx((0.0, 0.0, 1.0))
    drive(simulation, 0.4)
    x, _, z = simulation.motion_of("crate").pose.position
    assert x == pytest.approx(3.2, abs=0.01)
    assert z == pytest.approx(2.0 - 9.8 * 0.4**2 / 2.0, abs=0.03)


def test_the_robot_s_velocity_is_that_of_base_link_in_the_world(simulate):
    simulation = simulate()
    facing_y = Pose((1.0, 1.0, 0.9), quat_from_rpy(0.0, 0.0, pi / 2.0))
    simulation.place_model("husky", ModelMotion(facing_y, (0.0, 0.7, 0.0), (0.0, 0.0, 0.5)))
    motion = simulation.motion_of("husky")
    assert motion.pose.position == pytest.approx((1.0, 1.0, 0.9))
    assert motion.velocity == pytest.approx((0.0, 0.7, 0.0), abs=1e-9)
    assert motion.angular_velocity == pytest.approx((0.0, 0.0, 0.5), abs=1e-9)
    assert simulation.step().robot.velocity_in_base[0] == pytest.approx(0.7, abs=0.01)


@pytest.mark.parametrize(("z", "height"), [(0.0, 0.13), (0.132, 0.13), (0.5, 0.5), (7.0, 0.13)])
def test_the_robot_stands_on_the_floor_or_falls_from_near_above_it(simulate, z, height):
    simulation = simulate()
    simulation.place_model("husky", ModelMotion(Pose((2.0, 0.0, z))))
    assert simulation.motion_of("husky").pose.position == pytest.approx((2.0, 0.0, height), abs=0.01)
    drive(simulation, 1.0)
    assert simulation.motion_of("husky").pose.position == pytest.approx((2.0, 0.0, 0.13), abs=0.01)


def test_the_same_call_at_the_same_time_gives_the_same_trace(simulate):
    def trace():
        simulation = simulate(crate())
        before = drive(simulation, 1.0, 0.5)
        simulation.place_model("husky", ModelMotion(Pose((-1.0, 2.0, 0.3)), (0.2, 0.0, 0.0)))
        simulation.place_model("crate", ModelMotion(Pose((0.5, 2.0, 0.6)), (0.0, 0.1, 0.0), (0.3, 0.0, 0.0)))
        after = drive(simulation, 3.0, 0.5)
        return [snapshot.robot for snapshot in (*before, *after)], simulation.motion_of("crate")

    assert trace() == trace()


def test_what_cannot_be_placed_is_refused_by_name_and_nothing_changes(simulate):
    drawn = replace(body("lines", Box((1.0, 0.1, 0.1)), x=5.0), collisions=())
    simulation = simulate(crate(), drawn, body("wall", Box((0.2, 4.0, 1.0)), x=6.0, z=0.5))
    before = [simulation.motion_of(name) for name in simulation.models]
    for model, x, words in (
        ("ghost", 0.0, "no body named 'ghost'"),
        ("ground", 0.0, "'ground' is a plane"),
        ("lines", 0.0, "'lines' has no collision shape"),
        ("crate", 6.0, "'crate' would stand inside 'wall'"),
        ("husky", 6.0, "'husky' would stand inside 'wall'"),
    ):
        with pytest.raises(PlacementError, match=words):
            simulation.place_model(model, ModelMotion(Pose((x, 0.0, 0.2))))
    assert [simulation.motion_of(name) for name in simulation.models] == before


def test_a_static_model_is_moved_and_stays_there(simulate):
    simulation = simulate(body("wall", Box((0.2, 4.0, 1.0)), x=6.0, z=0.5))
    simulation.place_model("wall", ModelMotion(Pose((8.0, 0.0, 0.5)), (1.0, 0.0, 0.0)))
    drive(simulation, 0.5)
    assert simulation.motion_of("wall") == ModelMotion(compose(Pose((8.0, 0.0, 0.5)), Pose()))
