"""Readings to estimates: order, mounting, and bad numbers."""

from math import cos, pi, sin

import numpy as np
import pytest

from husky_highlevel_controller.config import ConfigError
from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.estimation.filter_config import read_filter_config
from husky_highlevel_controller.estimation.localization import Localization
from husky_highlevel_controller.estimation.readings import Mounting, Reading, ReadingError
from husky_highlevel_controller.geometry import quat_from_rpy

F = False
HUSKY = {  # as husky_control/config/localization.yaml has it
    "odom_frame": "odom",
    "base_link_frame": "base_link",
    "world_frame": "odom",
    "two_d_mode": True,
    "predict_to_current_time": True,
    "frequency": 50,
    "odom0": "husky_velocity_controller/odom",
    "odom0_config": [F] * 6 + [True] * 3 + [F, F, True, F, F, F],
    "imu0": "imu/data",
    "imu0_config": [F] * 3 + [True] * 3 + [F] * 3 + [True] * 3 + [F] * 3,
    "imu0_differential": True,
    "imu0_remove_gravitational_acceleration": True,
}
AT_BASE = Mounting()
SMALL = 1e-4 * np.eye(6)


def localization(**changes):
    return Localization(read_filter_config({**HUSKY, **changes}, "/ekf/")[0])


def reading(stamp, velocity, attitude=(0.0, 0.0, 0.0, 1.0)):
    return Reading(stamp, Pose(quat_xyzw=attitude), SMALL, np.array(velocity), SMALL)


def wheels(stamp, speed=1.0, rate=0.5):
    return reading(stamp, [speed, 0, 0, 0, 0, rate])


def imu(stamp, rate=0.5):
    attitude = quat_from_rpy(0.0, 0.0, rate * stamp)
    felt = np.array([0, 0, 9.8])
    return reading(stamp, [0, 0, 0, 0, 0, rate], attitude)._replace(specific_force=felt)


def drive(seconds=4.0):
    """Readings of a circle: wheels ten times a second, an IMU fifty times."""
    readings = [("odom0", wheels(k / 10)) for k in range(round(10 * seconds))]
    readings += [("imu0", imu(0.003 + k / 50)) for k in range(round(50 * seconds))]
    return sorted(readings, key=lambda item: item[1].stamp)


def path(filter_, readings, silent=None):
    """Rows of stamp and state of all estimates; by default any sensor may be silent."""
    due = [estimate for name, reading in readings for estimate in filter_.add(name, reading, AT_BASE, silent)]
    return np.array([(estimate.stamp, *estimate.state) for estimate in due])


def test_it_follows_a_circle_at_a_steady_rate():
    rows = path(localization(), drive())
    assert np.diff(rows[:, 0]) == pytest.approx(0.02)
    stamp, x, y, yaw = rows[-1, :4]
    assert (x, y, yaw) == pytest.approx((2 * sin(stamp / 2), 2 - 2 * cos(stamp / 2), stamp / 2), abs=0.02)


@pytest.mark.parametrize("ahead", [0.1, 0.4])
def test_the_order_of_arrival_changes_no_bit(ahead):
    readings = drive()
    wheels_first = sorted(readings, key=lambda item: item[1].stamp - (ahead if item[0] == "odom0" else 0.0))
    imu_first = sorted(readings, key=lambda item: item[1].stamp - (ahead if item[0] == "imu0" else 0.0))
    assert wheels_first != imu_first
    rows = path(localization(), readings)
    assert len(rows) > 150
    for order in (wheels_first, imu_first):
        assert path(localization(), order).tobytes() == rows.tobytes()


def test_a_sensor_that_dies_or_never_comes_is_not_waited_for():
    only_imu = [item for item in drive() if item[0] == "imu0"]
    assert path(localization(), only_imu)[-1, 0] > 3.9
    died = [item for item in drive() if item[0] == "imu0" or item[1].stamp < 1.0]
    assert path(localization(), died)[-1, 0] > 3.9


def test_a_sensor_that_is_late_but_not_silent_is_waited_for():
    readings, filter_ = drive(), localization()
    early, late = (
        path(filter_, [item for item in readings if item[0] == sensor], ()) for sensor in ("imu0", "odom0")
    )
    assert early.size == 0
    assert late.tobytes() == path(localization(), readings).tobytes()


def test_without_prediction_an_estimate_is_of_the_last_measurement():
    filter_ = localization(predict_to_current_time=False, sensor_timeout=0.5, frequency=200)
    stamps = path(filter_, drive())[:, 0]
    assert set(np.round(stamps * 1000).astype(int) % 20) <= {0, 3}
    assert len(set(stamps)) == len(stamps)


def test_a_pause_of_an_hour_is_no_burst_of_estimates():
    readings = drive(1.0)
    later = [(name, reading._replace(stamp=reading.stamp + 3600.0)) for name, reading in readings]
    assert len(path(localization(), readings + later)) < 150


def test_a_turned_imu_and_wheels_off_the_centre_count_as_base_link_s():
    sensor = Mounting(Pose((0.3, 0.2, 0.5), quat_from_rpy(-pi / 2, 0.0, pi / 2)))
    centre = Mounting(Pose((0.3, 0.2, 0.0)))
    filter_ = localization(imu0_differential=False, odom0_config=[F] * 6 + [True] * 2 + [F] * 7)
    for k in range(100):
        # the axis y of that IMU points down; its attitude is its mounting and the robot's yaw
        turned = quat_from_rpy(-pi / 2, 0.0, pi / 2 + 0.5 * k / 50)
        filter_.add("imu0", reading(k / 50, [0, 0, 0, 0, -0.5, 0], turned), sensor)
        # a point at (0.3, 0.2) of a robot that turns in place
        due = filter_.add("odom0", reading(k / 50, [-0.2 * 0.5, 0.3 * 0.5, 0, 0, 0, 0]), centre)
    assert due[-1].state[:6] == pytest.approx((0.0, 0.0, 0.99, 0.0, 0.0, 0.5), abs=0.01)


def test_gravity_and_the_centripetal_force_are_no_acceleration():
    used = [F] * 11 + [True] * 3 + [F]
    filter_ = localization(imu0_config=used)
    at = Mounting(Pose((0.3, 0.0, 0.5)))
    for k in range(100):
        filter_.add("odom0", wheels(k / 50), at)
        force = np.array([-(0.5**2) * 0.3, 0.0, 9.80665])
        felt = imu(k / 50)._replace(specific_force=force, force_covariance=SMALL[:3, :3])
        due = filter_.add("imu0", felt, at)
    assert due[-1].state[6:] == pytest.approx((0.0, 0.0), abs=1e-3)


def test_poses_count_in_odom_and_relative_ones_from_the_first():
    used = [True, True, F, F, F, True] + [F] * 9
    for relative, place in ((False, (1.0, 5.0, pi / 2)), (True, (0.0, 0.0, 0.0))):
        filter_ = localization(odom0_config=used, odom0_relative=relative)
        turned = Mounting(pose_frame_in_odom=Pose((1.0, 3.0, 0.0), quat_from_rpy(0, 0, pi / 2)))
        due = []
        for k in range(120):
            filter_.add("imu0", imu(k / 50, rate=0.0), AT_BASE)
            due = filter_.add("odom0", wheels(k / 50)._replace(pose=Pose((2.0, 0.0, 0.0))), turned)
        expected = place if not relative else (1.0, 3.0, pi / 2)
        assert due[-1].state[:3] == pytest.approx(expected, abs=0.02)


def test_a_bad_reading_is_left_out_and_the_rest_counts():
    filter_, complaints, due = localization(), [], []
    nan = np.full((6, 6), np.nan)
    readings = drive()
    readings[50:50] = [("odom0", wheels(0.05)), ("imu0", imu(0.0))]
    readings = [
        (name, reading._replace(velocity_covariance=nan) if number == 100 else reading)
        for number, (name, reading) in enumerate(readings)
    ]
    for name, reading in readings:
        try:
            due += filter_.add(name, reading, AT_BASE)
        except ReadingError as error:
            complaints.append(str(error))
    assert len(complaints) == 3
    assert "its stamp 0.050000 s is not later than the last stamp, 0.8" in complaints[0]
    assert "its velocity's covariance is [[nan" in complaints[2]
    assert due[-1].state[:3] == pytest.approx(path(localization(), drive())[-1, 1:4], abs=0.02)


def test_a_set_pose_holds_against_older_readings():
    filter_, readings = localization(), drive(2.0)
    path(filter_, readings)
    filter_.set_pose(2.5, np.array([10.0, 20.0, 0.0]), 1e-6 * np.eye(3))
    sure = wheels(2.4)._replace(velocity_covariance=1e-9 * np.eye(6))
    assert path(filter_, [("imu0", imu(2.3)), ("odom0", sure)]).size == 0
    rows = path(filter_, [("odom0", wheels(3.5, 0.0, 0.0)), ("imu0", imu(3.51, 0.0))])
    assert rows[-1, 1:4] == pytest.approx((10.0, 20.0, 0.0), abs=0.05)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"two_d_mode": False}, "/ekf/two_d_mode = False is not supported, because the filter is planar"),
        ({"world_frame": "map"}, "/ekf/world_frame = 'map' is not supported; use odom_frame"),
        ({"odom0_config": [True] * 3}, "/ekf/odom0_config has 3 entries, not 15"),
        ({"odom0_config": 3}, "/ekf/odom0_config = 3 is not a list"),
        ({"frequency": 0}, "/ekf/frequency = 0 is out of range 0.1..1000"),
        ({"odom0": 3}, "/ekf/odom0 = 3 is not a topic"),
        ({"odom0_config": [F] * 15, "imu0_config": [F] * 15}, "/ekf/ has no input"),
    ],
)
def test_what_it_does_not_do_is_refused_by_name_and_value(changes, sentence):
    with pytest.raises(ConfigError, match="^" + sentence.replace("[", r"\[")):
        read_filter_config({**HUSKY, **changes}, "/ekf/")


def test_a_matrix_of_the_wrong_size_and_an_unknown_parameter_are_told_and_left_aside():
    wrong = {"process_noise_covariance": [0.1] * 200, "freqency": 1, "odom0x": "nonsense", "odom1": "b"}
    config, remarks = read_filter_config({**HUSKY, **wrong}, "/ekf/")
    assert config.process_noise is None
    assert set(config.inputs) == {"odom0", "imu0"}
    assert config.inputs["odom0"].topic == HUSKY["odom0"]
    assert [remark.split(":")[0].split(";")[0] for remark in remarks] == [
        "/ekf/freqency is not a parameter",
        "/ekf/odom0x is not a parameter",
        "/ekf/process_noise_covariance has 200 numbers, not 225",
        "/ekf/odom1_config measures nothing",
    ]


def test_a_covariance_of_all_variables_counts_on_the_plane():
    numbers = np.diag(np.arange(15.0)).ravel().tolist()
    config, remarks = read_filter_config({**HUSKY, "process_noise_covariance": numbers}, "/ekf/")
    assert config.process_noise.diagonal().tolist() == [0, 1, 5, 6, 7, 11, 12, 13]
    assert not remarks


def test_nan_that_does_not_count_changes_nothing():
    nan = float("nan")
    pose_config = [True, True, F, F, F, True] + [True, True, F, F, F, True] + [F] * 3  # of x, y and yaw
    covariance, velocity = SMALL.copy(), np.array([1.0, 0, nan, nan, nan, 0.5])
    covariance[2, :] = covariance[:, 3] = nan
    broken = Reading(2.0, Pose((0.0, 0.0, nan)), covariance, velocity, covariance)
    ends = []
    for middle in (wheels(2.0), broken):
        filter_ = localization(imu0_config=[F] * 15, odom0_config=pose_config)
        ends.append(path(filter_, [("odom0", reading) for reading in (wheels(1.0), middle, wheels(3.0))])[-1])
    assert np.isfinite(ends[0]).all()
    assert ends[1].tolist() == ends[0].tolist()


def test_gravity_is_not_taken_away_by_an_attitude_that_is_none():
    filter_ = localization(imu0_config=[F] * 12 + [True] * 3)
    attitude = Pose(quat_xyzw=(float("nan"),) * 4)
    with pytest.raises(ReadingError, match="its pose is"):
        filter_.add("imu0", imu(1.0)._replace(pose=attitude), AT_BASE)
