"""Models that the services of the world read from XML."""

import pytest

pytest.importorskip("rospy")
pytest.importorskip("husky_highlevel_controller.srv")

from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.ros.simulator.world_services import bodies_of_xml
from husky_highlevel_controller.simulator.spawn_request import ObjectError

SHAPE = '<collision name="c"><geometry><sphere><radius>0.1</radius></sphere></geometry></collision>'
LINKS = "".join(f'<link name="{name}">{SHAPE}</link>' for name in ("my link", "b"))
MODEL = f'<sdf version="1.6"><model name="m"><static>1</static>{LINKS}</model></sdf>'


def test_links_have_the_names_that_they_may_have_in_a_world_file():
    assert [body.name for body in bodies_of_xml(MODEL, "m", Pose())] == ["m::my link", "m::b"]
    with pytest.raises(ObjectError, match="model_name 'a b' is not a name"):
        bodies_of_xml(MODEL, "a b", Pose())
