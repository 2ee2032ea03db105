"""Habits of the nodes that command the robot: each fault is found once, and a healthy node has none."""

import pytest

from husky_highlevel_controller.simulator.command_habits import (
    CommandHabits,
    Finding,
    Habit,
    habit_sentence,
)

TIMEOUT = 0.25  # [s]


def found(commands):
    """Findings of commands (stamp, sender, whether it is zero, stronger topic)."""
    habits = CommandHabits(TIMEOUT, may_stand=lambda node: node == "/guard")
    return [
        finding
        for stamp, sender, is_zero, stronger in commands
        for finding in habits.note(stamp, "cmd_vel", sender, is_zero, stronger)
    ]


def commands(rate, seconds, is_zero=False, sender="/drive", begin=0.0):
    return [(begin + n / rate, sender, is_zero, None) for n in range(int(rate * seconds) + 1)]


def test_a_healthy_node_is_told_once_with_its_rate():
    (finding,) = found([*commands(50.0, 20.0), *commands(50.0, 60.0, is_zero=True, begin=20.0)])
    assert finding == Finding(Habit.DRIVES, "/drive", "cmd_vel", pytest.approx(50.0))
    assert habit_sentence(finding) == "/drive drives the robot by cmd_vel, 50 commands per second"


def test_a_node_that_is_overruled_does_not_drive_the_robot_also_after_a_pause():
    overruled = [(5.0 + n / 10.0, "/drive", False, "joy_teleop/cmd_vel") for n in range(60)]
    assert found([(0.0, "/drive", True, None), *overruled]) == []


@pytest.mark.parametrize(("rate", "is_slow"), [(1.0, True), (3.0, True), (4.5, False), (10.0, False)])
def test_commands_that_expire_before_the_next_one_are_told_with_their_rate(rate, is_slow):
    slow = [finding for finding in found(commands(rate, 30.0)) if finding.habit is Habit.SLOW]
    assert len(slow) == is_slow
    for finding in slow:
        assert finding.rate == pytest.approx(rate)
        assert f"sends {rate:.1f} commands per second" in habit_sentence(finding)


def test_a_person_who_presses_a_key_now_and_then_is_not_slow():
    stamps = [0.0, 0.5, 1.1, 5.0, 5.6, 6.0, 6.5, 12.0, 12.4, 13.0, 13.5]
    assert all(
        finding.habit is Habit.DRIVES for finding in found([(t, "/keys", False, None) for t in stamps])
    )


@pytest.mark.parametrize(
    ("seconds", "sender", "count"), [(9.0, "/drive", 0), (11.0, "/drive", 1), (11.0, "/guard", 0)]
)
def test_a_node_that_never_commands_motion_is_told_after_ten_seconds(seconds, sender, count):
    assert [finding.habit for finding in found(commands(20.0, seconds, True, sender))] == [
        Habit.ZEROS
    ] * count


def test_a_node_that_has_driven_and_stands_after_a_pause_is_not_told_that_it_sent_zeros_only():
    drive_and_stand = [*commands(20.0, 5.0), *commands(20.0, 12.0, is_zero=True, begin=12.0)]
    assert [finding.habit for finding in found(drive_and_stand)] == [Habit.DRIVES]


def test_a_gamepad_that_holds_the_robot_with_zeros_is_told_and_one_that_drives_it_is_not():
    for pad_is_zero, count in ((True, 1), (False, 0)):
        habits = CommandHabits(TIMEOUT, may_stand=lambda _: True)
        findings = []
        for n in range(150):
            stamp = n / 50.0
            findings += habits.note(stamp, "joy_teleop/cmd_vel", "/pad", pad_is_zero, None)
            findings += habits.note(stamp, "cmd_vel", "/drive", False, "joy_teleop/cmd_vel")
        overruled = [finding for finding in findings if finding.habit is Habit.OVERRULED]
        assert len(overruled) == count
        for finding in overruled:
            told = habit_sentence(finding)
            assert told.startswith("/pad holds the robot with zero commands on joy_teleop/cmd_vel")
            assert "so /drive does not drive it" in told
