"""The robot's visuals, on the links that move them."""

import pytest

from husky_highlevel_controller.datatypes import HuskyError
from husky_web.robot import rigid_groups

URDF = """<robot name="r"><material name="red"><color rgba="1 0 0 1"/></material>
<link name="base"><visual><geometry><box size="1 2 3"/></geometry><material name="red"/></visual></link>
<link name="plate"><visual><origin xyz="0 0 1"/><geometry><mesh filename="file:///x.stl"/></geometry></visual></link>
<link name="wheel"><visual><geometry><cylinder radius="0.5" length="0.1"/></geometry></visual></link>
<joint name="a" type="fixed"><origin xyz="0 0 2"/><parent link="base"/><child link="plate"/></joint>
<joint name="b" type="continuous"><parent link="plate"/><child link="wheel"/></joint></robot>"""


def test_visuals_hang_on_the_link_that_moves_them():
    name, groups = rigid_groups(URDF)
    assert name == "r"
    assert set(groups) == {"base", "wheel"}
    box, mesh = groups["base"]
    assert box.shape.rgba == (1, 0, 0, 1)
    assert mesh.shape.uri == "file:///x.stl"
    assert mesh.pose_in_frame.position == (0, 0, 3)


@pytest.mark.parametrize("text", ["no xml", URDF.replace("1 2 3", "1 2"), URDF.replace("0.5", "half")])
def test_a_broken_description_is_an_error_in_words(text):
    with pytest.raises(HuskyError, match="robot description"):
        rigid_groups(text)
