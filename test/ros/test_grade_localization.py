"""Marking of exercise 4: a bag is played into each launch file, and it gets what it deserves."""

import json
import os
import subprocess

import pytest
from localization import VARIANTS, make_localization

GRADE = ["rosrun", "husky_highlevel_controller", "grade", "--exercise", "4"]
# points of plot, path, cloud, its style, top view, two bonuses; RViz shows a cloud in odom by the filter's TF
DESERVED = {
    "right": ((20, 30, 10, 10, 10, 5, 5), "m from the true path of"),
    "no_filter": ((20, 0, 0, 10, 10, 5, 5), "no node subscribes to the bag's wheel odometry"),
    "wrong_topics": ((20, 0, 0, 10, 10, 5, 5), "it subscribes to /wheels, where nothing is published"),
    "no_top_view": ((20, 30, 10, 10, 0, 5, 5), "no transform from base_link to smb_top_view"),
    "other_top_view": ((20, 30, 10, 10, 0, 5, 5), "top_view is at the right place, but it must be called"),
    "still_top_view": ((20, 30, 10, 10, 0, 5, 5), "(-"),
    "no_launch_file": ((), "no launch file starts ekf_localization_node; launch files: none"),
}


def run(*arguments, **more):
    return subprocess.run([*GRADE, *map(str, arguments)], capture_output=True, text=True, check=False, **more)


def machine_points(folder):
    """The points of all items but the explanations."""
    result = json.loads((folder / "result.json").read_text())
    return tuple(item["points"] for item in result["items"][2:]), json.dumps(result)


def test_a_filter_s_path_of_our_bag_and_the_top_view_earn_their_points(tmp_path):
    folder = make_localization("right", tmp_path / "class").parent
    env = {**os.environ, "ROS_PACKAGE_PATH": f"{folder}:{os.environ['ROS_PACKAGE_PATH']}"}
    out = tmp_path / "out"
    short = ("--deadline", "15", "--pace", "8")
    done = run("--launch", "right", "exercise_4.launch", *short, "--out", out, env=env)
    assert done.returncode == 0, done.stdout + done.stderr
    assert machine_points(out)[0] == DESERVED["right"][0]
    assert "the SMB's bag is played, because exercise_4.launch names smb_description" in done.stdout
    assert (out / "drive.png").read_bytes().startswith(b"\x89PNG")
    assert 'title="replay of run 1"' in (out / "feedback.html").read_text()


@pytest.mark.slow
def test_a_class_gets_what_it_deserves_and_is_told_why(tmp_path):
    for name in VARIANTS:
        make_localization(name, tmp_path / "class")
    done = run("--all", tmp_path / "class", "--seed", "0", "--jobs", "2", "--out", tmp_path / "out")
    assert done.returncode == 2, done.stdout + done.stderr
    for name, (points, words) in DESERVED.items():
        found, text = machine_points(tmp_path / "out" / "hand_ins" / name)
        assert found == points, (name, text)
        assert words in text
