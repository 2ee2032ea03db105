"""The bag of exercise 4, and the picture of its path."""

import numpy as np
import pytest
import rosbag
from sensor_msgs.msg import Imu

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.robot import ROBOTS
from husky_highlevel_controller.ros.estimation import plot_path
from husky_highlevel_controller.ros.simulator import record_bag


@pytest.fixture(params=ROBOTS, scope="module")
def bags(request, tmp_path_factory):
    """The bags of a short drive, twice: robot and folders."""
    folders = tmp_path_factory.mktemp("a") / "made" / "here", tmp_path_factory.mktemp("b")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(record_bag, "DURATION", 10.0)
        for folder in folders:
            record_bag.record(request.param, "hard", 0, folder)
    return request.param, *folders


def test_the_same_arguments_give_the_same_bytes_and_nothing_is_overwritten(bags):
    robot, *folders = bags
    for name in (f"{robot}_navigation.bag", f"{robot}_navigation_truth.bag"):
        first, second = ((folder / name).read_bytes() for folder in folders)
        assert first == second
        assert 10_000 < len(first) < 1_000_000
    with pytest.raises(HuskyError, match="already exists; move it"):
        record_bag.record(robot, "hard", 0, folders[1])
    sensors = folders[1] / f"{robot}_navigation.bag"
    sensors.unlink()
    with pytest.raises(HuskyError, match=r"_truth\.bag already exists; move it"):
        record_bag.record(robot, "hard", 0, folders[1])
    assert not sensors.exists(), "nothing half written is left"


def test_a_bag_holds_what_the_sheet_s_has_and_the_truth_lies_beside_it(bags, capsys, monkeypatch):
    robot, folder, _ = bags
    sensors, truth = folder / f"{robot}_navigation.bag", folder / f"{robot}_navigation_truth.bag"
    with rosbag.Bag(str(sensors)) as bag:
        topics = bag.get_type_and_topic_info().topics
        (cloud,) = [msg for _, msg, _ in bag.read_messages(topics=["/rslidar_points"])][:1]
        (fixed,) = bag._get_connections(["/tf_static"])
    wheels = f"/{robot}_velocity_controller/odom"
    assert set(topics) == {wheels, "/imu/data", "/joint_states", "/rslidar_points", "/tf_static"}
    assert topics["/imu/data"].message_count == 500
    assert cloud.width * cloud.height == 7040
    assert fixed.header["latching"] == b"1", "rosbag play keeps it for nodes that start later"

    picture = folder / "path.png"
    monkeypatch.setattr("sys.argv", ["plot_path", str(sensors), str(truth), "-o", str(picture)])
    plot_path.main()
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert f"{wheels}: 1." in capsys.readouterr().out
    paths = [np.array(path) for file in (sensors, truth) for path in plot_path.paths_of_bag(file).values()]
    assert paths[0][-1] != pytest.approx(paths[1][-1], abs=0.05), "wheels alone are off"


@pytest.mark.parametrize(
    ("content", "sentence"), [(None, "No such file"), (b"text", "not appear to be a bag"), (b"", "")]
)
def test_what_is_no_bag_is_told_by_its_name(tmp_path, capsys, monkeypatch, content, sentence):
    file = tmp_path / "some.bag"
    if content is not None:
        file.write_bytes(content)
    monkeypatch.setattr("sys.argv", ["plot_path", str(file)])
    with pytest.raises(SystemExit, match="2"):
        plot_path.main()
    told = capsys.readouterr().err
    assert str(file) in told
    assert sentence in told


def test_a_bag_without_odometry_is_told_with_its_topics(tmp_path):
    with rosbag.Bag(str(tmp_path / "x.bag"), "w") as bag:
        bag.write("/imu/data", Imu())
    with pytest.raises(HuskyError, match=r"x\.bag has no nav_msgs/Odometry; its topics: /imu/data"):
        plot_path.paths_of_bag(tmp_path / "x.bag")


def test_a_seed_that_is_none_is_refused_and_a_drive_that_fails_leaves_no_bag(tmp_path, monkeypatch, capsys):
    arguments = ["record_bag", "--folder", str(tmp_path), "--seed"]
    monkeypatch.setattr("sys.argv", [*arguments, "-1"])
    with pytest.raises(SystemExit) as end:
        record_bag.main()
    assert end.value.code == 2
    assert "argument --seed: -1 is not in 0.." in capsys.readouterr().err

    def drive(*_):
        yield from ()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(record_bag, "messages_of_drive", drive)
    monkeypatch.setattr("sys.argv", [*arguments, "1"])
    with pytest.raises(SystemExit) as end:
        record_bag.main()
    assert end.value.code == 1
    assert "No space left on device" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [], "otherwise the next call refuses to write"
