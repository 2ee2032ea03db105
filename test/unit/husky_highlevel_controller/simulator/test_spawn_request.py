"""What may be asked for as an object, and what the refusal says."""

import re
from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest

from husky_highlevel_controller.datatypes import Box, Cylinder, Geometry, Pose, Sphere, TriangleMesh
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


def box(name="it", size=1.0, mass=1.0):
    return name, "box", (1.0, size, 1.0), mass


@pytest.mark.parametrize(
    ("request_", "sentence"),
    [
        *[(box(name=name), f"model_name '{name}'") for name in ("", "two words", "a/b", "<b>")],
        (box(name="a\nb"), "model_name '"),
        *[(box(size=size), f"size {size} is not within") for size in (nan, inf, -inf, 1e308, -1.0, 0.0)],
        *[(box(mass=mass), f"mass {mass} is not within") for mass in (nan, inf, 1e308, -1.0, 1e-9)],
        (("it", "cylinder", (1.0, 2.0, 1.0), 1.0), "diameters must be equal"),
        (("it", "sphere", (1.0, 1.0, 2.0), 1.0), "diameters must be equal"),
        (("it", "cone", (1.0, 1.0, 1.0), 1.0), "shape 'cone' is not one of box, cylinder, sphere"),
    ],
)
def test_what_is_no_object_is_refused_by_name_and_value(request_, sentence):
    with pytest.raises(ObjectError, match=re.escape(sentence)):
        make_object(*request_, HERE)


@pytest.mark.parametrize(
    ("pose", "sentence"),
    [
        *[(Pose((0.0, x, 0.0)), f"position {x} is not within") for x in (nan, inf, 1e308, -1e5)],
        *[
            (Pose((0.0, 0.0, 0.0), quat), "is not a unit quaternion")
            for quat in ((0.0,) * 4, (nan,) * 4, (inf, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0), (1e308,) * 4)
        ],
    ],
)
def test_a_pose_is_finite_near_and_a_rotation(pose, sentence):
    with pytest.raises(ObjectError, match=re.escape(sentence)):
        checked_pose(pose)


@pytest.mark.parametrize("value", [nan, inf, 1e17])
@pytest.mark.parametrize("parts", ["collisions", "visuals"])
def test_a_shape_of_a_body_is_near_it(parts, value):
    body = make_object(*box(), HERE)
    part = replace(body.collisions[0], pose_in_body=Pose((value, 0.0, 0.0)))
    with pytest.raises(ObjectError, match=re.escape(f"position of a shape in it {value} is not within")):
        checked(replace(body, **{parts: (part,)}))


def test_a_quaternion_rounded_by_hand_is_made_whole():
    quat = checked_pose(Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.7071, 0.7071))).quat_xyzw
    assert sum(value**2 for value in quat) == pytest.approx(1.0, abs=1e-12)


def test_a_flat_mesh_may_be_spawned_as_it_may_stand_in_a_world():
    poster = TriangleMesh(
        np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]]), np.array([[0, 1, 2]])
    )
    body = replace(make_object(*box()[:3], 0.0, HERE), collisions=(Geometry(poster),))
    assert checked(body) is body
    large = TriangleMesh(1000.0 * poster.vertices, poster.faces)
    with pytest.raises(ObjectError, match=r"size 2000\.0 is not within"):
        checked(replace(body, collisions=(Geometry(large),)))
