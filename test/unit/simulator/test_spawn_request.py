"""What may be asked for as an object, and what the refusal says."""

from __future__ import annotations

import re
from dataclasses import replace
from math import inf, nan

import pytest

from husky_highlevel_controller.datatypes import Box, Cylinder, Pose, Sphere
from husky_highlevel_controller.simulator.spawn_request import ObjectError, checked, checked_pose, make_object

HERE = Pose((1.0, 2.0, 0.5))


@pytest.mark.parametrize(
    ("shape", "size", "made"),
    [
        ("box", (0.1, 0.2, 0.3), Box((0.1, 0.2, 0.3))),
        ("cylinder", (0.4, 0.4, 2.0), Cylinder(0.2, 2.0)),
        ("sphere", (0.4, 0.4, 0.4), Sphere(0.2)),
    ],
)
def test_a_shape_has_the_extents_asked_for(shape, size, made):
    body = make_object("it", shape, size, 2.0, HERE)
    assert (body.name, body.mass, body.pose_in_world) == ("it", 2.0, HERE)
    assert [part.shape for part in (*body.collisions, *body.visuals)] == [made, made]


@pytest.mark.parametrize("name", ["", "two words", "a/b", "a\nb", "<b>"])
def test_a_name_is_a_name(name):
    with pytest.raises(ObjectError, match="model_name '"):
        make_object(name, "box", (1.0, 1.0, 1.0), 1.0, HERE)


@pytest.mark.parametrize("value", [nan, inf, -inf, 1e308, -1.0, 0.0])
def test_a_size_is_finite_positive_and_of_this_world(value):
    with pytest.raises(ObjectError, match=f"size {re.escape(str(value))} is not within"):
        make_object("it", "box", (1.0, value, 1.0), 1.0, HERE)


@pytest.mark.parametrize("value", [nan, inf, 1e308, -1.0, 1e-9])
def test_a_mass_is_zero_or_something_that_can_be_pushed(value):
    with pytest.raises(ObjectError, match=f"mass {re.escape(str(value))} is not within"):
        make_object("it", "box", (1.0, 1.0, 1.0), value, HERE)


@pytest.mark.parametrize(("shape", "size"), [("cylinder", (1.0, 2.0, 1.0)), ("sphere", (1.0, 1.0, 2.0))])
def test_what_is_round_is_round(shape, size):
    with pytest.raises(ObjectError, match="diameters must be equal"):
        make_object("it", shape, size, 1.0, HERE)


def test_an_unknown_shape_is_answered_with_the_known_ones():
    with pytest.raises(ObjectError, match="shape 'cone' is not one of box, cylinder, sphere"):
        make_object("it", "cone", (1.0, 1.0, 1.0), 1.0, HERE)


@pytest.mark.parametrize("value", [nan, inf, 1e308, -1e5])
def test_a_position_is_finite_and_near(value):
    with pytest.raises(ObjectError, match=f"position {re.escape(str(value))} is not within"):
        checked_pose(Pose((0.0, value, 0.0)))


@pytest.mark.parametrize("value", [nan, inf, 1e17])
def test_a_shape_of_a_body_is_near_it(value):
    body = make_object("it", "box", (1.0, 1.0, 1.0), 1.0, HERE)
    part = replace(body.collisions[0], pose_in_body=Pose((value, 0.0, 0.0)))
    for change in ({"collisions": (part,)}, {"visuals": (part,)}):
        with pytest.raises(
            ObjectError, match=f"position of a shape in it {re.escape(str(value))} is not within"
        ):
            checked(replace(body, **change))


@pytest.mark.parametrize(
    "quat", [(0.0,) * 4, (nan,) * 4, (inf, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0), (1e308,) * 4]
)
def test_an_orientation_is_a_unit_quaternion(quat):
    with pytest.raises(ObjectError, match="is not a unit quaternion"):
        checked_pose(Pose((0.0, 0.0, 0.0), quat))


def test_a_quaternion_rounded_by_hand_is_made_whole():
    quat = checked_pose(Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.7071, 0.7071))).quat_xyzw
    assert sum(value**2 for value in quat) == pytest.approx(1.0, abs=1e-12)
