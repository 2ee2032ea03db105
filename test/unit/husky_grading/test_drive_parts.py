"""When a drive is over, and how the truth comes."""

import json
import socket
import subprocess
import threading
import time
from math import inf
from pathlib import Path
from types import SimpleNamespace

import pytest
import rospy
from packages import put

from husky_grading.drive import bring_up
from husky_grading.drive.bring_up import SIMULATOR_LAUNCH, simulate
from husky_grading.drive.drive_end import DriveEnd
from husky_grading.drive.trials import draw_trials
from husky_grading.drive.truth_feed import READ, TruthFeed
from husky_grading.hand_in.package_files import find_setup
from husky_grading.hand_in.plan import package_path, plan
from husky_grading.isolation.sandbox import Workspace
from husky_grading.notes import Kind, Note
from husky_grading.records import Launchable, MarkingConfig
from husky_grading.submission import SIMULATOR_NODES, Event, Plan, RvizNode, notes_on
from husky_highlevel_controller.datatypes import Pose, TrueState
from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.ros.simulator.truth_log import VARIABLE, TruthLog


def end_of(states, abandoned_at=inf):
    """The first moment at which a drive of (stamp, x, speed) is over, and why."""
    end = DriveEnd((10.0, 0.0), "husky")
    for stamp, x, speed in states:
        end.update(TrueState(stamp, Pose((x, 0.0, 0.1)), speed, 0.0))
        reason = end.reason(stamp >= abandoned_at)
        if reason:
            return stamp, reason.text
    return None, ""


def standing(x, start, seconds, speed=0.0):
    return [(start + 0.1 * n, x, speed) for n in range(int(10 * seconds))]


MOVES = (1.0, 5.0, 1.0)
ABANDONED = "its nodes had ended, and it stood still for 3 s"


@pytest.mark.parametrize(
    ("states", "abandoned_at", "ends_at", "why"),
    [
        ([MOVES, *standing(9.2, 2.0, 5.0)], inf, 5.0, "it stands at the pillar"),
        ([MOVES, *standing(9.4, 2.0, 5.0, speed=1.0)], inf, 5.0, "it reached the pillar and touched it"),
        (standing(0.0, 0.0, 30.0), inf, 12.0, "it did not move for 12 s"),  # of which it may sleep 10
        ([MOVES, *standing(5.0, 1.1, 30.0)], inf, 16.0, "it stood still for 15 s"),
        # its nodes have ended: it rolls out
        ([MOVES, (2.0, 5.5, 0.2), *standing(5.6, 2.1, 30.0)], 1.0, 5.0, ABANDONED),
        (standing(0.0, 0.0, 30.0), 0.0, 3.0, ABANDONED),
        ([(1.0, 9.2, 1.0), *standing(9.2, 1.1, 5.0)], 2.0, 4.1, "it stands at the pillar"),
    ],
)
def test_when_a_drive_is_over(states, abandoned_at, ends_at, why):
    stamp, said = end_of(states, abandoned_at)
    assert (stamp, said) == (pytest.approx(ends_at, abs=0.2), why)


def test_each_state_is_answered_once_it_is_read(tmp_path):
    rows, events = [], []
    TruthFeed(tmp_path / "truth", rows.append, lambda *event: events.append(event))
    with socket.socket(socket.AF_UNIX) as simulator:
        simulator.settimeout(20.0)
        simulator.connect(str(tmp_path / "truth"))
        for stamp in (0.02, 0.04):
            for broken in (b"{]\n", b"[1]\n", b'{"trith": [1]}{\n'):
                simulator.sendall(broken)
            numbers = (stamp, 1.0, 2.0, 0.1, 0.0, 0.0, 1.0, 0.0, 0.3, -0.2)
            for line in ({"changed": "moved"}, {"truth": numbers}):
                simulator.sendall((json.dumps(line) + "\n").encode())
            assert simulator.recv(10) == READ
            row = rows[-1]
            assert (row.stamp, row.pose_in_world.position) == (stamp, (1.0, 2.0, 0.1))
            assert (row.speed, row.yaw_rate, row.to_numbers()) == (0.3, -0.2, numbers)
    assert events == [("changed", "moved")] * 2


def test_the_names_kept_for_the_simulator_are_those_of_its_launch_file():
    command = ["roslaunch", "--nodes", str(SIMULATOR_LAUNCH), "rviz:=false"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    printed = done.stdout.split()
    assert tuple(word for word in printed if word.startswith("/")) == SIMULATOR_NODES


def test_start_and_seed_from_which_the_pillar_could_be_drawn_are_no_parameters_of_a_drive(
    tmp_path, monkeypatch
):
    trial, parameters, config = draw_trials(2, 7)[1], {}, MarkingConfig(robot="husky")
    monkeypatch.setattr(bring_up, "_SETUPS", {config.simulator_arguments: ({}, [])})
    monkeypatch.setattr(bring_up, "set_parameters", lambda _, values: parameters.update(values))
    monkeypatch.setattr(bring_up, "has_service", lambda *_: True)
    seen = []

    def start(*_, **__):
        seen.append(dict(parameters))
        return SimpleNamespace(running=True)

    simulate(SimpleNamespace(folder=tmp_path, uri="", start=start), trial, config)
    secrets = {trial.start.x, trial.start.y, trial.start.yaw, trial.seed}
    assert secrets <= set(seen[0].values()), "the simulator reads them"
    assert secrets.isdisjoint(parameters.values())


RAISES = """[ERROR] [1700000000.12, 0.340000]: bad callback: <function on_scan at 0x7f00>
Traceback (most recent call last):
  File "/usr/lib/python3/dist-packages/rospy/topics.py", line 750, in _invoke_callback
    cb(msg)
  File "/ws/src/husky/scripts/controller", line 23, in on_scan
    nearest = minimum(scan.ranges)
NameError: name 'minimum' is not defined
"""


@pytest.mark.parametrize(
    ("path", "read"),
    [
        ("/ws/src/husky", True),
        ("/more/husky", True),
        ("/ws/src/../../home", False),
        ("/", False),
        ("", False),
    ],
)
def test_no_folder_that_a_submission_invents_is_read(path, read, monkeypatch):
    monkeypatch.setenv("ROS_PACKAGE_PATH", "/ros")
    workspace = Workspace((Path("/ws/devel/setup.bash"),), (Path("/more"),))
    found = package_path([Event("started"), Event("package", path=path)], workspace)
    assert found == (Path(path) if read else None)


def test_an_exception_in_a_callback_is_named_with_its_line():
    (note,) = notes_on([], RAISES * 7)
    said = "callback on_scan raises NameError: name 'minimum' is not defined (controller:23), "
    said += "first at 0.34 s, 7 times"
    assert note == Note(Kind.EXCEPTION, said, 0.34)
    assert notes_on([], "all is well\nTraceback of a path\n") == []


def test_the_view_of_the_simulators_own_launch_file_is_nobody_elses(tmp_path):
    view = share_folder() / "rviz" / "controller.rviz"
    node = RvizNode("husky_rviz", f"-d {view}", ())
    assert not find_setup(Plan(("a/b",), rviz=(node,), package_path=tmp_path)).started
    (tmp_path / "links").mkdir()
    (tmp_path / "links" / "package.xml").symlink_to(share_folder() / "package.xml")
    for place in (share_folder(), tmp_path / "links"):
        own = find_setup(Plan(("a/b",), rviz=(node,), package_path=place))
        assert own.source == "its rviz node, controller.rviz"


def planned(folder, files, tmp_path):
    """The plan of a.launch of a package of these files."""
    for path, text in files.items():
        put(folder / path, text)
    launchable = Launchable("launch", "a", str(folder / "a.launch"))
    return plan(launchable, Workspace(packages=(folder,)), tmp_path / "plan")


NODE = '<node name="n" pkg="p" type="t"/>'


def test_a_launch_file_gets_its_arguments(tmp_path):
    for arguments, node in (((), "husky_controller"), (("naive:=true",), "naive_controller")):
        what = Launchable("launch", "husky_highlevel_controller", "controller.launch", arguments)
        assert plan(what, Workspace(), tmp_path / node).nodes == (f"husky_highlevel_controller/{node}",)


def test_aliases_in_a_parameter_file_are_refused(tmp_path):
    load = '<rosparam command="load" file="$(dirname)/a.yaml"/>'
    files = {"a.yaml": "a: &a [1, 2]\nb: [*a, *a]\n", "a.launch": f"<launch>{load}{NODE}</launch>"}
    made = planned(tmp_path / "aliases", files, tmp_path)
    assert not made.nodes
    assert "YAML aliases are refused" in made.notes[0].text


def test_files_of_a_copy_are_found_but_what_starts_a_simulator_is_left_out(tmp_path):
    files = {
        "package.xml": "<package><name>husky_gazebo</name></package>",
        "config/mine.yaml": "gain: 1",
        "launch/spawn_husky.launch": "<launch/>",  # without arguments
        "launch/mine.launch": f"<launch>{NODE}</launch>",
        "a.launch": """<launch>
          <node name="gazebo" pkg="gazebo_ros" type="gzserver" args="$(find husky_gazebo)/a.world"/>
          <node name="post" pkg="gazebo_ros" type="spawn_model" args="-sdf -file post.sdf -model post"/>
          <include file="$(find husky_gazebo)/launch/spawn_husky.launch"><arg name="x" value="1"/></include>
          <include file="$(find husky_gazebo)/launch/mine.launch"/>
          <rosparam command="load" file="$(find husky_gazebo)/config/mine.yaml"/>
        </launch>""",
    }
    made = planned(tmp_path / "husky_gazebo", files, tmp_path)
    assert made.nodes == ("p/t",), made
    assert made.left_out == ("gazebo_ros/gzserver", "gazebo_ros/spawn_model")
    assert made.notes == ()


def test_the_simulator_answers_calls_until_the_recorder_lets_time_begin(tmp_path, monkeypatch):
    feed = TruthFeed(tmp_path / "truth", lambda state: None, lambda *event: None)
    monkeypatch.setenv(VARIABLE, str(tmp_path / "truth"))
    monkeypatch.setattr(rospy, "is_shutdown", lambda: len(calls) == 500)
    log, calls = TruthLog(), []
    log.wait_to_begin(lambda: calls.append(1) or (len(calls) == 3 and feed.begin()))
    assert 3 <= len(calls) < 500
    assert log.is_open
    log._socket.close()


def test_lines_of_the_truth_are_whole_when_threads_write_at_once(tmp_path, monkeypatch):
    class Socket:
        """Sends byte by byte, as a full buffer does."""

        sent = bytearray()

        def sendall(self, content):
            for each in content:
                self.sent.append(each)
                time.sleep(0)

    log = TruthLog()
    log._socket = Socket()
    threads = [threading.Thread(target=log.write_line, args=("changed", "x" * 2000)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [json.loads(line) for line in bytes(Socket.sent).splitlines()] == [{"changed": "x" * 2000}] * 8
