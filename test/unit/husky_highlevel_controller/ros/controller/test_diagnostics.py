"""The controller's status names the cause, and the remedy, of what is wrong."""

from dataclasses import replace

import pytest

pytest.importorskip("rospy")

from diagnostic_msgs.msg import DiagnosticStatus

from husky_highlevel_controller.controller.behaviour import State
from husky_highlevel_controller.ros.controller.diagnostics import Health, level_and_message
from husky_highlevel_controller.ros.controller.display import how_to_drive_again

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
WELL = Health(
    paused=False, scan_silence=0.01, scan_age=0.02, scan_stamp=1000.0, scan_rate=50.0, scan_fault="",
    scan_frame="front_laser", has_lidar_transform=True, tf_silence=0.01, tf_age=0.02, scans_ahead=0.0,
    state=State.DRIVING, pillar="seen",
)  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "level", "message"),
    [
        ({}, OK, "driving"),
        ({"scan_silence": None}, ERROR, "no scans"),
        ({"scan_silence": 2.5}, ERROR, "no scans"),
        ({"scan_silence": None, "scan_absence": "no node publishes"}, ERROR, "no node publishes"),
        ({"scan_absence": "no node publishes"}, OK, "driving"),
        ({"scan_stamp": 0.0, "scan_age": 1e9}, WARN, "scans are stamped 0; set the stamps in their driver"),
        ({"scan_age": 5.0}, ERROR, "scans are stamped 5.00 s behind this computer's clock; set the clocks"),
        ({"scan_age": 5.0, "tf_age": 5.0}, ERROR, "scans are stamped 5.00 s behind this computer's clock"),
        ({"scan_age": 3600.0}, ERROR, "scans are stamped 3600.00 s behind this computer's clock"),
        ({"scan_age": -5.0, "tf_age": -5.0}, WARN, "scans are stamped 5.00 s ahead of this computer's clock"),
        ({"tf_age": 5.0}, ERROR, "odometry is stamped 5.00 s behind this computer's clock"),
        (
            {"tf_age": 5.0, "tf_silence": 5.0},
            ERROR,
            "no transform from odom to base_link; check that odometry is running",
        ),
        ({"scans_ahead": 0.3}, WARN, "scans are stamped 0.30 s ahead of odometry; set the clocks (chrony)"),
        (
            {"scans_ahead": 2.0, "scan_age": -2.0},
            ERROR,
            "standing still: scans are stamped 2.00 s ahead of odometry",
        ),
        (
            {"has_lidar_transform": False, "scan_frame": ""},
            ERROR,
            "scans have no frame_id; set it in the driver of the lidar",
        ),
        (
            {"has_lidar_transform": False, "scan_frame": "laser"},
            ERROR,
            "no transform from 'laser' to 'base_link'",
        ),
        (
            {"scan_fault": "a scan has range_max = 0.0 m"},
            ERROR,
            "standing still: a scan has range_max = 0.0 m",
        ),
        ({"scan_age": 0.7}, WARN, "scans come late"),
        ({"tf_age": 0.7}, WARN, "odometry comes late"),
        ({"pillar": "unknown", "state": State.SEARCHING}, WARN, "searching: no pillar"),
        ({"disobedience": "commanded 0.97 m/s"}, WARN, "commanded 0.97 m/s"),
        ({"state": State.WAITING, "reason": "the pillar walked away"}, WARN, "the pillar walked away"),
    ],
)
def test_each_cause_has_its_sentence(changes, level, message):
    got_level, got = level_and_message(replace(WELL, **changes))
    assert got.startswith(message)
    assert got_level == level
    assert "no scans" not in got or message == "no scans"
    assert level_and_message(replace(WELL, paused=True, **changes))[0] == OK, (
        "nothing is an error in a paused world"
    )


@pytest.mark.parametrize(
    ("viewers", "reset_service", "way"),
    [
        (["/husky_web"], "/husky_simulator/reset", "press Drive again in the page;"),
        (["/husky_rviz", "/husky_web"], "/husky_simulator/reset", "in the page or put the robot elsewhere"),
        (["/recorder"], "/a/husky_simulator/reset", "rosservice call /a/husky_simulator/reset;"),
        (["/husky_rviz"], "", "to drive again, move the robot or the pillar;"),  # a real robot
    ],
)
def test_the_hint_at_arrival_names_what_is_there(viewers, reset_service, way):
    assert way in how_to_drive_again(viewers, reset_service)
