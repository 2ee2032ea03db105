"""Clocks that differ are told from messages that are late."""

import pytest

from husky_highlevel_controller.controller.sensor_faults import (
    ClockOffset,
    clock_sentence,
    frame_sentence,
)

TOLERANCE = 0.05  # [s]


def offset_of(ahead, scan_rate=20, odometry_rate=50, late=0.0, speed=1.0, seconds=3.0, phase=0.003):
    """Offset told of scans stamped `ahead` seconds ahead of odometry; `speed` is the real-time factor.

    `late` [s] of wall time is how long every second odometry message is kept back.
    """
    offset = ClockOffset(TOLERANCE)
    events = [(k / odometry_rate + phase + late * speed * (k % 2), 0, k / odometry_rate + phase)
              for k in range(int(seconds * speed * odometry_rate))]  # fmt: skip
    events += [(k / scan_rate, 1, k / scan_rate + ahead) for k in range(int(seconds * speed * scan_rate))]
    newest = -1.0
    for at, is_scan, stamp in sorted(events):
        if is_scan:
            offset.add(stamp, at / speed)
        elif stamp > newest:  # TF keeps the newest
            newest = stamp
            offset.add_reference(stamp)
    return offset.seconds


@pytest.mark.parametrize("scan_rate", [10, 20, 50])
@pytest.mark.parametrize("ahead", [0.1, 0.3, 0.5, 2.0, 3600.0, -0.3, -2.5, -3600.0])
def test_clocks_that_differ_are_told_to_a_period(ahead, scan_rate):
    assert offset_of(ahead, scan_rate) == pytest.approx(ahead, abs=0.021)


@pytest.mark.parametrize("rates", [(10, 10), (10, 50), (20, 50), (50, 10), (400, 50), (5, 50)])
@pytest.mark.parametrize("phase", [0.0, 0.003, 0.05, 0.09])
def test_clocks_alike_have_no_offset_at_any_rates(rates, phase):
    assert offset_of(0.0, *rates, phase=phase) == 0.0


def test_messages_that_are_late_now_and_then_are_no_offset():
    assert offset_of(0.0, late=0.4) == 0.0
    assert offset_of(0.3, late=0.4) == pytest.approx(0.3, abs=0.041)


def test_lateness_at_twenty_times_real_time_is_no_offset():
    assert offset_of(0.6, speed=20.0) == 0.0
    assert offset_of(1.5, speed=20.0) == pytest.approx(1.5, abs=0.021)


def test_an_offset_ends_with_the_clocks_set_and_with_odometry():
    offset = ClockOffset(TOLERANCE)
    parts = ((0.3, True, 0.3), (0.0, True, 0.0), (0.3, True, 0.3), (0.3, False, 0.0))
    for part, (ahead, odometry, expected) in enumerate(parts):
        for step in range(60):
            moment = 3.0 * part + 0.05 * step
            if odometry:
                offset.add_reference(moment)
            offset.add(moment + ahead, moment)
        assert offset.seconds == pytest.approx(expected, abs=0.01)


def test_the_sentences_name_the_remedy():
    assert clock_sentence("scans are", 0.3, "odometry") == (
        "scans are stamped 0.30 s ahead of odometry; set the clocks (chrony)"
    )
    assert "0.30 s behind odometry" in clock_sentence("scans are", -0.3, "odometry")
    assert "no frame_id; set it in the driver of the lidar" in frame_sentence("")
    assert "no transform from 'laser' to 'base_link'" in frame_sentence("laser")
