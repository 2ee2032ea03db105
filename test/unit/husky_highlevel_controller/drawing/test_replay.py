"""The page that plays a drive: what it keeps of it."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from defusedxml import ElementTree

from husky_highlevel_controller.drawing.replay import MAX_POSES, Replay, to_html
from husky_highlevel_controller.drawing.robot_mesh import BODY, robot_mesh
from husky_highlevel_controller.robot import ROBOTS, load_robot
from husky_highlevel_controller.simulator.models.description import robot_description

STANDS = np.array([[20.0, 5.0]])


def content(html):
    (text,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', html)
    return json.loads(text)


def drive(seconds, pillars=STANDS, title="a drive", marks=()):
    times = np.arange(0.0, seconds, 0.005)
    poses = np.column_stack([times, 0.1 * times, 0.01 * times])
    return Replay(title, "it ended", times, poses, pillars, np.array(marks, float).reshape(-1, 3))


def test_start_end_way_and_marks_with_a_place_are_kept_and_a_title_ends_no_script():
    title, nan = "</script><script>alert(1)</script>", float("nan")
    html = to_html(drive(20.0, title=title, marks=((0.5, nan, nan), (1.0, 19.9, 5.1))))
    assert html.count("</script>") == 2
    data = content(html)
    assert data["title"] == title
    assert (data["times"][0], data["times"][-1]) == (0.0, 19.995)
    assert data["poses"][-1] == [19.995, 2.0, 0.2]
    assert 190 <= len(data["times"]) == len(data["poses"]) <= 210
    assert data["pillars"] == STANDS.tolist()
    assert data["marks"] == [[1.0, 19.9, 5.1]]


def test_a_page_stays_small_however_long_the_drive():
    assert len(to_html(drive(20.0))) < 200e3
    assert len(content(to_html(drive(3600.0)))["times"]) <= MAX_POSES + 2


def test_a_pillar_that_is_pushed_moves_with_the_poses():
    replay = drive(2.0)
    pillars = STANDS + np.column_stack([replay.times, replay.times])
    data = content(to_html(drive(2.0, pillars)))
    assert len(data["pillars"]) == len(data["times"])
    assert data["pillars"][-1] == [21.995, 6.995]


def test_the_meshes_are_where_the_robot_description_has_them():
    def numbers(text):
        return tuple(map(float, (text or "0 0 0").split()))

    urdf = ElementTree.fromstring(robot_description())
    joints = {joint.find("child").get("link"): joint.find("origin") for joint in urdf.iter("joint")}
    found = set()
    for link in urdf.iter("link"):
        for mesh in link.iter("mesh"):
            origin = joints.get(link.get("name"))
            x, _, z = numbers(None if origin is None else origin.get("xyz"))
            if "wheel" not in mesh.get("filename"):
                found.add((Path(mesh.get("filename")).name, x, z))
    assert {(file, x, z) for file, _, x, z, _ in BODY} == found


@pytest.mark.parametrize("name", ROBOTS)
def test_the_wheels_stand_on_the_ground_and_the_body_between_them(name):
    robot = load_robot(name)
    body, wheel = (np.concatenate([part.triangles for part in parts]) for parts in robot_mesh(robot))
    assert np.abs(wheel[..., 2]).max() == pytest.approx(robot.drive.wheel_radius, abs=0.006)
    assert np.abs(body[..., 0]).max() <= robot.footprint.half_length + 0.02
    assert 300 < len(wheel) + len(body) < 6000
