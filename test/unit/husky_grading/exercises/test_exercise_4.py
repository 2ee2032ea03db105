"""Exercise 4: what a filter's path, its displays and its launch file are worth, by both sheets."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from packages import put

from husky_grading import recording as recordings
from husky_grading.displays import RvizDisplay, RvizView
from husky_grading.exercises import exercise_4
from husky_grading.exercises.exercise_4 import (
    ITEMS,
    FilterWatch,
    Playback,
    curves_in,
    judge_exercise_4,
    named_bag,
)
from husky_grading.exercises.watch import DriveState
from husky_grading.notes import Kind, Note
from husky_grading.recording import EstimatedPath, Recording
from husky_grading.records import Rules, total
from husky_grading.submission import Plan
from husky_highlevel_controller.config import from_plain, to_plain
from husky_highlevel_controller.datatypes import Pose2D

TIMES = np.arange(0.1, 90.0, 0.1)  # [s]
TRUTH = np.column_stack([0.3 * TIMES, 2.0 * np.sin(0.1 * TIMES), 0.0 * TIMES])  # 29 m
PATH = np.column_stack([TIMES, TRUTH[:, :2]])
TOP_VIEW = np.column_stack([TIMES, 0.0 * TIMES, 0.0 * TIMES, 2.0 + 0.0 * TIMES])
POSITION, ODOM = "/odometry/filtered/pose/pose/position/", "/odom/pose/pose/position/"
FILTERED = EstimatedPath("/odometry/filtered", PATH)
PLAYBACK = Playback(TOP_VIEW, ("--clock --rate=0.5 x.bag",), ((POSITION + "x", POSITION + "y"),))
CLOUD = RvizDisplay("rviz/PointCloud2", "/rslidar_points", colouring="AxisColor Z", size=0.05)
VIEW = RvizView("its rviz node", displays=(CLOUD,))


def recording(playback=PLAYBACK, robot="smb", estimate=FILTERED, **more):
    nothing = np.zeros(0)
    drive = Recording(Pose2D(), (0, 0), 90.0, TIMES, TRUTH, np.zeros((len(TIMES), 2)), nothing, **more)
    return replace(drive, robot=robot, estimate=estimate, watched=to_plain(playback), subscribed=True)


def points(drive, view=VIEW, rules=None):
    return {item.name: item.points for item in judge_exercise_4([drive], view, "", rules or Rules())}


def test_both_sheets_are_100_points_and_the_smbs_has_a_bonus_of_10():
    smb, husky = (judge_exercise_4([recording(robot=robot)], VIEW, "") for robot in ("smb", "husky"))
    assert total(smb) == (90.0, 90.0)
    assert {type(item.points) for item in smb} == {float, type(None)}  # JSON knows no number of NumPy
    assert sum(item.max_points for item in smb) == 110.0
    assert [item.name for item in smb] == list(ITEMS)
    by_person = [item.name for item in smb if item.points is None]
    assert by_person == ["explains the filter", "explains its topics"]
    assert {item.name: item.points for item in husky} == {
        PLOT: 30.0,
        WAY: 40.0,
        "RViz shows the point cloud": 30.0,
    }


def at(x, y, z):
    """A top view that stays at a place of the robot."""
    return np.column_stack([TIMES, np.tile((x, y, z), (len(TIMES), 1))])


WAY, TOP, PLOT = "recorded path", "top view moves with the robot", "plots the simulated path"
NOT_MOVING = np.column_stack([TIMES, -TRUTH[:, :2], TOP_VIEW[:, 3]])


@pytest.mark.parametrize(
    ("item", "change", "worth"),
    [
        # the path must come from start to end and be the robot's
        (WAY, {"points": PATH + np.array([0.0, 0.0, 0.9])}, 30.0),
        (WAY, {"points": PATH + np.array([0.0, 0.0, 1.1])}, 15.0),  # it differs
        (WAY, {"points": PATH[TIMES > 4.0]}, 30.0),  # it begins while the robot stands
        (WAY, {"points": PATH[TIMES > 6.0]}, 15.0),
        (WAY, {"points": PATH[TIMES < 80.0]}, 15.0),  # it ends on the way
        (WAY, {"points": PATH[(TIMES < 3.0) | (TIMES > 88.0)]}, 15.0),  # where it stands
        (WAY, {"points": np.where(np.equal(PATH, PATH[500, 1]), np.nan, PATH)}, 30.0),
        (WAY, {"points": np.where((PATH[:, :1] > 40.0) & (PATH[:, :1] < 46.0), np.nan, PATH)}, 15.0),  # a gap
        (WAY, {"points": PATH * (1.0, np.nan, np.nan)}, 0.0),
        (WAY, {"points": PATH[:5]}, 0.0),
        (WAY, {"points": np.zeros((0, 3))}, 0.0),
        # 2 metres above the robot, and moving with it
        (TOP, {"top_view": at(0.0, 0.0, 2.05)}, 10.0),
        (TOP, {"top_view": at(0.0, 0.0, 2.6)}, 0.0),
        (TOP, {"top_view": at(0.2, 0.0, 2.0)}, 0.0),
        (TOP, {"top_view": at(0.0, 0.0, -2.0)}, 0.0),
        (TOP, {"top_view": NOT_MOVING}, 0.0),
        (TOP, {"top_view": TOP_VIEW[:0]}, 0.0),
        # x and y of the filter's odometry
        (PLOT, {"curves": (("/clock/a", "/clock/b"), (POSITION + "x", POSITION + "y"))}, 20.0),
        (PLOT, {"curves": ((ODOM + "x", ODOM + "y"),)}, 10.0),
        (PLOT, {"curves": ((POSITION + "y", POSITION + "x"),)}, 0.0),
        (PLOT, {"curves": ((POSITION + "x", ODOM + "y"),)}, 0.0),
        (PLOT, {"curves": ()}, None),
    ],
)
def test_an_item_is_worth_what_is_right_of_it_and_no_other_changes(item, change, worth):
    if item == WAY:
        judged = points(recording(estimate=replace(FILTERED, **change)))
    else:
        judged = points(recording(replace(PLAYBACK, **change)))
    assert judged == {**points(recording()), item: worth}


@pytest.mark.parametrize(
    ("places", "words"),
    [
        (
            {"lidar": (0.0, 0.0, 0.5), "view": (0.02, 0.0, 2.0)},
            ("view is 2 m above", "frame view is at the right place, but"),
        ),
        ({"lidar": (0.0, 0.0, 0.5)}, ("from base_link to smb_top_view", "publish it by static_transform")),
    ],
)
def test_a_top_view_of_another_name_has_no_points_and_is_told_its_name(places, words):
    judged = judge_exercise_4([recording(replace(PLAYBACK, top_view=TOP_VIEW[:0], places=places))], VIEW, "")
    (item,) = [item for item in judged if item.name == TOP]
    assert item.points == 0.0
    assert words[0] in item.evidence
    assert words[1] in item.hint


def test_a_long_way_may_be_off_by_2_percent_and_one_that_never_began_has_no_points():
    far = EstimatedPath("/odometry/filtered", PATH * (1, 4, 4) + (0, 0, 1.5))
    long = replace(recording(estimate=far), poses=TRUTH * 4)
    assert points(long)["recorded path"] == 30.0
    judged = points(recordings.Recording(Pose2D(), (0, 0), 90.0, robot="smb"), RvizView())
    assert [judged[name] for name in (WAY, TOP)] == [0.0, 0.0]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (
            {"silent_topics": ("/set_pose", "/wrong/odom")},
            "it subscribes to /wrong/odom, where nothing is published",
        ),
        ({"notes": (Note(Kind.NODE_FAILED, "node ekf ends"),), "silent_topics": ("/a",)}, "node ekf ends"),
        ({"subscribed": False}, "no node subscribes to the bag's wheel odometry"),
        ({}, "a node gets the bag's wheel odometry, but none publishes nav_msgs/Odometry"),
    ],
)
def test_it_is_told_why_no_estimate_came(more, words):
    driven = replace(recording(Playback(), estimate=EstimatedPath()), **more)
    items = judge_exercise_4([driven], VIEW, "")
    assert [item.evidence for item in items if item.name == "recorded path"] == [
        f"0 estimates on /odometry/filtered: {words}"
    ]
    assert not any("constructor" in item.hint for item in items if item.name == "recorded path")


def test_a_package_that_does_not_build_gets_the_hint_to_mend_its_error_first():
    broken = replace(
        recording(Playback(), estimate=EstimatedPath()),
        subscribed=False,
        notes=(Note(Kind.BUILD, "it does not build: error in a.cpp"),),
    )
    items = judge_exercise_4([broken], VIEW, "")
    assert ["fix this error first" in item.hint for item in items if item.name == "recorded path"] == [True]


@pytest.mark.parametrize(
    ("arguments", "worth"),
    [
        ((), (0.0, 0.0)),
        (("--clock a.bag",), (5.0, 0.0)),
        (("-r 0.5 a.bag",), (5.0, 5.0)),
        (("--clock -r.5 a.bag",), (5.0, 5.0)),
        (("--rate 0.50 a.bag",), (5.0, 5.0)),
        (("--rate=2 run-r0.5.bag",), (5.0, 0.0)),
        (("/bags/0.5/a.bag", "-r 5"), (5.0, 0.0)),
    ],
)
def test_the_bonus_is_for_a_bag_that_the_launch_file_plays_at_half_speed(arguments, worth):
    judged = points(recording(replace(PLAYBACK, players=arguments)))
    assert (judged["bonus: plays the bag"], judged["bonus: at half speed"]) == worth


@pytest.mark.parametrize(
    ("view", "worth"),
    [
        ({"displays": (replace(CLOUD, source="/points"),)}, (0.0, 10.0)),
        ({"displays": (replace(CLOUD, size=0.01), CLOUD)}, (10.0, 10.0)),
        ({"displays": (replace(CLOUD, size=0.01),)}, (10.0, 5.0)),
        ({"displays": (replace(CLOUD, colouring="AxisColor X"),)}, (10.0, 5.0)),
        ({"displays": (replace(CLOUD, colouring="Intensity Z", size=3),)}, (10.0, 0.0)),
        ({"displays": ()}, (0.0, 0.0)),
        ({"problem": "no transform"}, (0.0, 10.0)),
        ({"source": ""}, (None, None)),
    ],
)
def test_the_cloud_and_its_style_are_seen_in_rviz(view, worth):
    judged = points(recording(), replace(VIEW, **view))
    assert (judged["RViz shows the point cloud"], judged["style of the point cloud"]) == worth


def test_a_recording_with_its_track_comes_back_from_its_text():
    back = from_plain(recordings.Recording, json.loads(recordings.recording_to_json(recording())), "")
    assert back.estimate.points == pytest.approx(PATH, abs=1e-4)
    playback = back.watched_as(Playback)
    assert playback.top_view.shape == TOP_VIEW.shape
    assert (playback.players, playback.curves) == (PLAYBACK.players, PLAYBACK.curves)
    assert points(back) == points(recording())
    rules = Rules(weights={"recorded path": 60.0}, by_person=("bonus: plays the bag",))
    weighed = {"recorded path": 60.0, "bonus: plays the bag": None}
    assert points(back, rules=rules) == {**points(back), **weighed}, "a teacher's weights"


@pytest.mark.parametrize(("folder", "robot"), [("smb_control", "smb"), ("husky_control", "husky")])
def test_the_filter_s_parameters_tell_the_robot(folder, robot, tmp_path):
    (tmp_path / "ekf.launch").write_text(f"$(find {folder})/config/localization.yaml smb_top_view")
    (tmp_path / "view.rviz").write_text("Topic: /rslidar_points")  # in both robots' bags
    named = named_bag(Plan(package_path=tmp_path))
    assert (named.version, named.is_certain) == (robot, True)


AXES = (
    "<axes><x_axis><topic>{0}</topic><field>a/x</field></x_axis>"
    "<y_axis><topic>{1}</topic><field>a/y</field></y_axis></axes>"
)


def test_curves_are_read_from_rqt_multiplot_s_files_and_no_others(tmp_path):
    plot = AXES.format("odom", "/imu/data") + "<axes><axes/></axes>" + AXES.format("", "/b")
    put(tmp_path / "config" / "plot.xml", f"<rqt_multiplot><a>{plot}</a></rqt_multiplot>")
    put(tmp_path / "other.xml", f"<package>{plot}</package>")
    put(tmp_path / "broken.xml", "<rqt_multiplot>")
    put(tmp_path / "bomb.xml", '<!DOCTYPE a [<!ENTITY b "c">]><rqt_multiplot>&b;</rqt_multiplot>')
    assert curves_in(tmp_path) == (("/odom/a/x", "/imu/data/a/y"),)


# ---------------------------------------------------------------------------- the drive


@pytest.fixture
def watch():
    return watch_of({"smb_top_view": (0.0, 0.0, 2.0)})


def watch_of(places):
    """A watch of a filter whose frames are at these places of base_link."""
    ros = SimpleNamespace(place=places.get, places=lambda: places)
    return FilterWatch(Recording(Pose2D(), (0, 0), 90.0, robot="smb"), ros)


def come(watch, *stamps, topic="/odometry/filtered"):
    for stamp in stamps:
        position = SimpleNamespace(x=0.0, y=0.0)
        header = SimpleNamespace(stamp=SimpleNamespace(to_sec=lambda stamp=stamp: stamp))
        pose = SimpleNamespace(pose=SimpleNamespace(position=position))
        watch.on_message(topic, SimpleNamespace(header=header, pose=pose))


def test_while_the_clock_stands_a_place_is_kept_once(watch):
    for now in (0.0, 0.0, 0.0, 1.0, 1.0, 2.0):
        assert watch.look(DriveState(now, 0.0)) is None
    assert watch.kept()["top_view"].tolist() == [[1.0, 0.0, 0.0, 2.0], [2.0, 0.0, 0.0, 2.0]]


def test_where_the_top_view_never_comes_the_places_of_other_frames_are_kept(watch):
    other = watch_of({"top_view": (0.0, 0.0, 2.0)})
    for each in (watch, other):
        each.look(DriveState(1.0, 0.0))
    assert watch.kept()["places"] == {}
    assert other.kept()["places"] == {"top_view": (0.0, 0.0, 2.0)}


def test_the_longest_path_is_kept_unless_the_sheets_topic_has_one(watch):
    come(watch, 1.0, 2.0, 3.0, topic="/other")
    assert watch.estimate.topic == "/other"
    come(watch, 1.0, 2.0)
    assert watch.estimate.topic == "/odometry/filtered"
    assert watch.estimate.points.tolist() == [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]


def test_it_waits_for_the_last_estimate_or_until_none_comes(watch, monkeypatch):
    end = DriveState(90.0, 0.0)
    assert watch.look(end), "there is no filter"
    come(watch, 50.0)
    assert not watch.look(end)
    later = watch._last_estimate_at + exercise_4.SILENCE + 1.0
    monkeypatch.setattr(exercise_4, "time", SimpleNamespace(monotonic=lambda: later))
    assert watch.look(end)
    watch._last_estimate_at = later
    assert not watch.look(end)
    come(watch, 89.5)
    assert not watch.look(DriveState(50.0, 0.0)), "the bag goes on"
    assert watch.look(end)


def test_a_bag_ends_early_where_no_node_is_left_to_listen(watch):
    assert watch.look(DriveState(5.0, 0.0, abandoned=True)).kind is Kind.NODES_ENDED
