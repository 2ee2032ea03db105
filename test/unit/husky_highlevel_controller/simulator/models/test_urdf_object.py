"""URDF of an object: its shapes as one body, what is left out, what is refused."""

import pytest

from husky_highlevel_controller.datatypes import Box, Cylinder, HuskyError, Pose, Sphere
from husky_highlevel_controller.simulator.models.urdf_object import is_urdf, parse_urdf_object

CYLINDER = (
    '<collision><origin xyz="0 0 0.5"/><geometry><cylinder radius="0.2" length="1"/></geometry></collision>'
)
SPHERE = '<collision><geometry><sphere radius="0.3"/></geometry></collision>'
MESH = '<collision><geometry><mesh filename="package://x/y.stl"/></geometry></collision>'
MASS = '<inertial><mass value="{}"/></inertial>'
POSE = Pose((3.0, 1.0, 0.0))


def urdf(*parts):
    return f"<?xml version='1.0'?><robot name='post'>{''.join(parts)}</robot>"


def link(name, *parts):
    return f'<link name="{name}">{"".join(parts)}</link>'


def joint(parent, child, xyz="0 0 0", rpy="0 0 0"):
    return (
        f'<joint name="{parent}_{child}" type="revolute"><origin xyz="{xyz}" rpy="{rpy}"/>'
        f'<parent link="{parent}"/><child link="{child}"/></joint>'
    )


def test_the_shapes_of_all_links_are_one_body():
    text = urdf(
        link("top", SPHERE, MASS.format(2)), link("base", CYLINDER, MASS.format(3)),
        link("arm", '<collision><geometry><box size="1 2 3"/></geometry></collision>'),
        joint("base", "top", "0 0 1.2", "0 0 1.5707963267948966"), joint("top", "arm", "1 0 0"),
    )  # fmt: skip
    body = parse_urdf_object(text, "post", POSE)
    assert (body.name, body.pose_in_world, body.mass) == ("post", POSE, 5.0)
    assert {part.shape: part.pose_in_body.position for part in body.collisions} == {
        Cylinder(0.2, 1.0): (0.0, 0.0, 0.5),
        Sphere(0.3): (0.0, 0.0, 1.2),
        Box((1.0, 2.0, 3.0)): pytest.approx((0.0, 1.0, 1.2)),
    }


@pytest.mark.parametrize(
    "parts",
    [
        (link("base", CYLINDER),),
        (link("base", CYLINDER, MASS.format(3)), "<gazebo><static>true</static></gazebo>"),
        (link("world"), link("base", CYLINDER, MASS.format(3)), joint("world", "base")),
    ],
)
def test_without_mass_or_said_to_be_static_it_never_moves(parts):
    assert parse_urdf_object(urdf(*parts), "post", POSE).mass == 0.0


def test_a_mesh_is_left_out_with_a_warning(caplog):
    assert len(parse_urdf_object(urdf(link("base", MESH, SPHERE)), "post", POSE).collisions) == 1
    assert "link 'base'" in caplog.text


@pytest.mark.parametrize("text", ["", '<sdf version="1.6"><model name="robot"/></sdf>'])
def test_an_sdf_is_no_urdf(text):
    assert not is_urdf(text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (urdf(link("base")), "nothing in 'post' has a <collision>"),
        (urdf(link("base", MESH)), "nothing in 'post' has a <collision>"),
        (urdf(link("a", SPHERE), link("b", SPHERE)), "a, b"),
        (urdf(link("a", SPHERE), link("b"), joint("a", "b"), joint("b", "a")), "none"),
        (urdf(link("a", SPHERE), joint("a", "nowhere")), "'nowhere' is not a link"),
        (urdf(link("a", SPHERE.replace("0.3", "nan"))), "radius is 'nan'"),
        ("<robot><link name='a'></robot>", "is not valid XML"),
        ("<!DOCTYPE r [<!ENTITY a 'b'>]><robot><link name='&a;'/></robot>", "EntitiesForbidden"),
    ],
)
def test_what_is_broken_is_refused_by_name(text, words):
    assert is_urdf(text)
    with pytest.raises(HuskyError, match=words):
        parse_urdf_object(text, "post", POSE)


def test_a_long_chain_of_links_is_no_deep_recursion():
    names = [f"l{number}" for number in range(5000)]
    chain = [joint(parent, child) for parent, child in zip(names, names[1:])]
    body = parse_urdf_object(
        urdf(*map(link, names), link("l5000", SPHERE), joint("l4999", "l5000"), *chain), "p", POSE
    )
    assert len(body.collisions) == 1
