"""An arrival at a pillar is found once, and again only after the robot was away or was put elsewhere."""

from math import pi

import pytest

from husky_highlevel_controller.datatypes import Body, Box, Cylinder, Geometry, Pose, TrueState
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.simulator.arrival_watch import (
    AWAY,
    Arrival,
    ArrivalWatch,
    PillarPlace,
    arrival_sentence,
    pillar_of,
)

PILLAR = PillarPlace("unit_cylinder", 10.0, 0.0, 0.2)
FRONT = load_robot().footprint.half_length  # [m]


class Drive:
    """A robot that faces a pillar."""

    def __init__(self, pillar=PILLAR):
        self.watch, self.now, self.pillar = ArrivalWatch(load_robot().footprint), 0.0, pillar

    def spend(self, seconds, gap, speed=0.0):
        """Arrivals within a time at a gap to the pillar [m]."""
        found = []
        pose = Pose((self.pillar.x - self.pillar.radius - FRONT - gap, 0.0, 0.1))
        for _ in range(round(50.0 * seconds)):
            self.now += 0.02
            found.append(self.watch.update(TrueState(self.now, pose, speed, 0.0), lambda: [self.pillar]))
        return [arrival for arrival in found if arrival]


def test_a_robot_that_has_driven_and_stands_at_the_pillar_has_arrived_once():
    drive = Drive()
    assert drive.spend(2.0, 5.0, speed=1.0) == []
    assert drive.spend(0.4, 0.25) == []
    (arrival,) = drive.spend(10.0, 0.25)
    assert arrival == Arrival(pytest.approx(2.02), "unit_cylinder", pytest.approx(0.25))
    told = "the robot has arrived after 2.02 s of simulated time: it stands 0.250 m from 'unit_cylinder'"
    assert arrival_sentence(arrival) == told


@pytest.mark.parametrize("gap", [0.5, 5.0])
def test_a_robot_that_stands_elsewhere_has_not_arrived(gap):
    drive = Drive()
    assert drive.spend(2.0, 5.0, speed=1.0) == drive.spend(5.0, gap) == []


def test_a_robot_that_was_put_at_the_pillar_has_not_arrived():
    assert Drive().spend(5.0, 0.25) == []


@pytest.mark.parametrize(("gap", "is_again"), [(AWAY + 0.1, True), (AWAY - 0.1, False), (0.3, False)])
def test_only_a_robot_that_was_away_arrives_again(gap, is_again):
    drive = Drive()
    drive.spend(1.0, 5.0, speed=1.0)
    assert drive.spend(1.0, 0.25)
    drive.spend(1.0, gap, speed=-1.0)
    assert len(drive.spend(2.0, 0.25)) == is_again


def test_a_reset_lets_it_arrive_again():
    drive = Drive()
    for _ in range(2):
        drive.spend(1.0, 0.4, speed=1.0)
        assert len(drive.spend(2.0, 0.25)) == 1
        drive.watch.forget()


def test_only_a_single_cylinder_is_a_pillar():
    cylinder, box = Geometry(Cylinder(0.2, 2.0)), Geometry(Box((1.0, 1.0, 1.0)))
    place = Pose((1.0, 2.0, 0.0))
    assert pillar_of(Body("a", Pose(), (cylinder,), ()), place) == PillarPlace("a", 1.0, 2.0, 0.2)
    assert pillar_of(Body("a", Pose(), (box,), ()), place) is None
    assert pillar_of(Body("a", Pose(), (cylinder, box), ()), place) is None


@pytest.mark.parametrize(("roll", "is_pillar"), [(0.1, True), (pi, True), (0.5, False), (pi / 2, False)])
def test_a_cylinder_that_was_pushed_over_is_not_a_pillar(roll, is_pillar):
    body = Body("a", Pose(), (Geometry(Cylinder(0.2, 2.0)),), ())
    place = Pose((1.0, 2.0, 0.2), quat_from_rpy(roll, 0.0, 0.0))
    assert (pillar_of(body, place) is not None) == is_pillar


def test_a_pillar_stands_at_its_shape_and_not_at_the_origin_of_its_body():
    shape = Geometry(Cylinder(0.2, 2.0), Pose((3.0, 0.0, 1.0)))
    place = Pose((1.0, 2.0, 0.0), quat_from_rpy(0.0, 0.0, pi / 2))
    pillar = pillar_of(Body("a", Pose(), (shape,), ()), place)
    assert (pillar.x, pillar.y) == pytest.approx((1.0, 5.0))
