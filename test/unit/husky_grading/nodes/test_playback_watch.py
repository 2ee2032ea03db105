"""What marking keeps of a filter while a bag is played to it, and asks the ROS master."""

from types import SimpleNamespace
from xmlrpc.client import Fault

import pytest
import rospy
from nav_msgs.msg import Odometry

from husky_grading.nodes import exercise_driver, playback_watch
from husky_grading.nodes.playback_watch import PlaybackWatch
from husky_grading.recording import Playback


@pytest.fixture
def watch(monkeypatch):
    monkeypatch.setattr(playback_watch.rospy, "Subscriber", lambda *_, **__: None)
    return watch_of({"smb_top_view": (0.0, 0.0, 2.0)})


def watch_of(places):
    """A watch of a filter whose frames are at these places of base_link."""
    return PlaybackWatch(SimpleNamespace(place=places.get, places=lambda: places), Playback())


def come(watch, *stamps, topic="/odometry/filtered"):
    watch.follow(topic, "nav_msgs/Odometry")
    for stamp in stamps:
        msg = Odometry()
        msg.header.stamp = rospy.Time.from_sec(stamp)
        watch._on_odometry(msg, topic)


def test_while_the_clock_stands_a_place_is_kept_once(watch):
    for now in (0.0, 0.0, 0.0, 1.0, 1.0, 2.0):
        watch.look(now)
    assert watch.playback.top_view.tolist() == [[1.0, 0.0, 0.0, 2.0], [2.0, 0.0, 0.0, 2.0]]


def test_where_the_top_view_never_comes_the_places_of_other_frames_are_kept(watch):
    other = watch_of({"top_view": (0.0, 0.0, 2.0)})
    for each in (watch, other):
        each.look(1.0)
    assert watch.playback.places == {}
    assert other.playback.places == {"top_view": (0.0, 0.0, 2.0)}


def test_the_longest_path_is_kept_unless_the_sheets_topic_has_one_and_only_odometry_is_followed(watch):
    come(watch, 1.0, 2.0, 3.0, topic="/other")
    assert watch.playback.topic == "/other"
    come(watch, 1.0, 2.0)
    watch.follow("/imu/data", "sensor_msgs/Imu")
    assert watch.playback.topic == "/odometry/filtered"
    assert watch.playback.path.tolist() == [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]


def test_it_waits_for_the_last_estimate_or_until_none_comes(watch, monkeypatch):
    assert watch.is_over(90.0), "there is no filter"
    come(watch, 50.0)
    assert not watch.is_over(90.0)
    later = watch._came_at + playback_watch.SILENCE + 1.0
    monkeypatch.setattr(playback_watch, "time", SimpleNamespace(monotonic=lambda: later))
    assert watch.is_over(90.0)
    watch._came_at = later
    assert not watch.is_over(90.0)
    come(watch, 89.5)
    assert watch.is_over(90.0)


def test_a_parameter_that_the_master_cannot_send_ends_no_recording(monkeypatch):
    def get_param(name, _):
        raise Fault(1, "int exceeds XML-RPC limits")

    monkeypatch.setattr(exercise_driver.rospy, "get_param_names", lambda: ["/big", "/robot_description"])
    monkeypatch.setattr(exercise_driver.rospy, "get_param", get_param)
    driver = exercise_driver.ExerciseDriver("", "/scan", set())
    assert driver.parameters() == ((), ())
    assert driver.descriptions({"base_link"}) == ()
