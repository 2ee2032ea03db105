"""`./dev run`: what `./dev launch` finds, a command finds too."""

import yaml
from network import make_package, wait_until

from husky_highlevel_controller.paths import share_folder

DEV = str(share_folder() / "dev")
CRATE = """<robot name="crate"><link name="crate">
  <collision><geometry><box size="0.3 0.3 1.2"/></geometry></collision>
</link></robot>"""
TEST = '<launch><test test-name="passes" pkg="lab_robot" type="passes"/></launch>'
PASSES = """#!/usr/bin/env python3
import unittest
import rostest

class Passes(unittest.TestCase):
    def test_that_it_runs(self):
        pass

rostest.rosrun("lab_robot", "passes", Passes)
"""


def test_spawn_model_of_the_stand_in_adds_a_box_while_it_runs(launch, ros, tmp_path):
    (tmp_path / "crate.urdf").write_text(CRATE)
    launch("simulator.launch", "gui:=false", "paused:=true").says("simulating")
    pose = ("-x", "3", "-z", "0.6", "-reference_frame", "map", "-unpause")
    words = (
        "gazebo_ros",
        "spawn_model",
        "-urdf",
        "-file",
        str(tmp_path / "crate.urdf"),
        "-model",
        "crate",
        *pose,
    )
    ran = ros.start(DEV, "run", "rosrun", *words)
    assert ran.wait() == 0, ran.output
    assert "crate" in yaml.safe_load(ros.call("/husky_simulator/list", "world"))["model_names"]
    wait_until(
        lambda: yaml.safe_load(ros.call("/gazebo/get_world_properties"))["sim_time"] > 0.0, "time passes"
    )


def test_rostest_takes_a_package_and_a_file(ros, tmp_path, monkeypatch):
    files = {"test/passes.test": TEST, "scripts/passes": PASSES}
    make_package(tmp_path / "catkin_ws" / "src" / "lab_repo" / "lab_robot", "lab_robot", files)
    monkeypatch.chdir(tmp_path / "catkin_ws")
    ran = ros.start(DEV, "run", "rostest", "lab_robot", "passes.test")
    assert ran.wait() == 0, ran.output
    assert "TESTS: 1" in ran.output
