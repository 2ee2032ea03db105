"""Collisions are detected on smooth and on rough ground, and rough ground alone is not a collision."""

from collections import deque
from math import cos, pi, radians, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_highlevel_controller.controller.crash_detection import CrashConfig, CrashDetector
from husky_highlevel_controller.datatypes import ImuSample, Twist2D
from husky_highlevel_controller.geometry import quat_from_rpy, quat_inverse, rotate

LEVEL = (0.0, 0.0, 0.0, 1.0)
RATE = 100  # [Hz], of the real Husky's IMU
LOSS = -0.4 / 0.08  # [m/s^2], a loss of 0.4 m/s within 80 ms

# A real A200 while it drives (BorealTC, CC0, arXiv 2403.16877): standard deviation of the horizontal
# acceleration [m/s^2] and the frequencies that carry most of it [Hz]
FLOORING, ASPHALT = 1.0, 1.9


def vibration(seconds, deviation, seed):
    """Accelerations (N, 3) [m/s^2]: noise, most of it between 8 and 30 Hz, and single shocks."""
    rng = np.random.default_rng(seed)
    count = round(seconds * RATE)
    spectrum = np.fft.rfft(rng.standard_normal((count, 3)), axis=0)
    frequencies = np.fft.rfftfreq(count, 1.0 / RATE)
    spectrum *= ((frequencies > 8.0) & (frequencies < 30.0))[:, None] + 0.15
    shaking = np.fft.irfft(spectrum, count, axis=0)
    shaking *= deviation / shaking.std(axis=0)
    shocks = rng.choice(count, max(int(seconds / 5), 1), replace=False)
    shaking[shocks] += rng.choice([-1.0, 1.0], (len(shocks), 3)) * 8.0 * deviation
    return shaking


class Drive:
    """Feeds a detector: accelerations in base_link [m/s^2], wheel speeds and yaw rate, a mount, a slope.

    `wheels_late` and `samples_late` [s] is how long a busy machine keeps messages back.
    """

    def __init__(
        self, mount=LEVEL, slope=LEVEL, config=None, rate=RATE, wheels_rate=10, stamped=float,
        wheels_late=0.0, samples_late=0.0,
    ):  # fmt: skip
        self.detector, self.mount, self.slope = CrashDetector(config or CrashConfig()), mount, slope
        self.rate, self.wheels_every, self.step, self.stamped = rate, rate // wheels_rate, 0, stamped
        self.wheels_late, self.samples_late = wheels_late, samples_late
        self.wheels, self.samples = deque(), deque()  # on their way

    def go(self, accelerations, speed=0.6, yaw_rate=0.0):
        """Stamps and losses of the crashes felt [s], [m/s]; `speed` is a number or one for each sample."""
        felt = []
        speeds = np.broadcast_to(speed, len(accelerations))
        for acceleration, wheels in zip(accelerations, speeds):
            self.step += 1
            now = self.step / self.rate
            if self.step % self.wheels_every == 0:
                self.wheels.append((now, Twist2D(float(wheels), yaw_rate)))
            while self.wheels and self.wheels[0][0] <= now - self.wheels_late:
                self.detector.add_odometry(*self.wheels.popleft())
            gravity = rotate(quat_inverse(self.slope), (0.0, 0.0, 9.8))
            force_in_base = [a + g for a, g in zip(acceleration, gravity)]
            to_imu = quat_inverse(self.mount)
            sample = ImuSample(
                self.stamped(now), LEVEL, rotate(to_imu, (0.0, 0.0, yaw_rate)), rotate(to_imu, force_in_base)
            )
            self.samples.append((now, sample))
            while self.samples and self.samples[0][0] <= now - self.samples_late:
                loss = self.detector.add_sample(self.samples.popleft()[1], self.mount)
                if loss is not None:
                    felt.append((now, loss))
        return felt


def push(seconds, ahead=0.0, left=0.0, up=0.0):
    """Accelerations (N, 3) [m/s^2] of a robot that is pushed, or is not."""
    return np.tile((ahead, left, up), (round(seconds * RATE), 1))


def crash(before=0.0, after=0.3, ahead=LOSS, left=0.0):
    return np.concatenate([push(before), push(0.08, ahead, left), push(after)])


def bump(ahead=LOSS, left=0.0, speed=0.6, more=0.3, **how):
    """Crashes felt while a robot at constant wheel speed loses some, and drives on for `more` seconds."""
    return driven(speed, **how).go(crash(0.0, more, ahead, left), speed)


# ---------------------------------------------------------------------------- smooth ground


def driven(speed=0.6, **how):
    """A drive that has gone on for two seconds."""
    drive = Drive(**how)
    drive.go(push(2.0), speed)
    return drive


@pytest.mark.parametrize(
    ("felt", "how"),
    [
        (True, {"ahead": -0.4 / 0.08}),
        (True, {"ahead": -0.15 / 0.08}),
        (False, {"ahead": -0.09 / 0.08}),
        (True, {"ahead": -0.09 / 0.08, "config": CrashConfig(max_loss=0.05)}),
        (False, {"config": CrashConfig(max_loss=0.5, max_loss_rough=0.5)}),
        (False, {"ahead": -LOSS}),  # it is pushed on
        (True, {"ahead": -LOSS, "speed": -0.6}),
        (True, {"ahead": LOSS, "speed": 0.0}),  # a robot that stands is hit from either side
        (True, {"ahead": -LOSS, "speed": 0.0}),
        (True, {"ahead": -LOSS, "speed": 0.015}),  # with wheels slower than 2 cm/s it stands
        (False, {"ahead": -LOSS, "speed": 0.03}),
        (True, {"ahead": 0.0, "left": LOSS}),
        (True, {"ahead": 0.0, "left": -LOSS}),
        (True, {"wheels_late": 1e9}),  # without odometry
    ],
)
def test_which_losses_of_speed_on_smooth_ground_are_a_crash(felt, how):
    assert bool(bump(**how)) is felt


@pytest.mark.parametrize("window", [0.1, 0.3, 0.5])
def test_a_longer_window_does_not_delay_a_push_from_the_side(window):
    (stamp, _), *_ = bump(0.0, LOSS, more=1.5, config=CrashConfig(window=window))
    assert stamp == pytest.approx(2.23)


def knock(ahead):
    """What a bump from below is felt as, with one ahead."""
    return driven().go(np.concatenate([push(0.03), push(0.03, ahead, up=30.0), push(0.5)]))


def turn(left, yaw_rate):
    """What a push from the side is felt as, while the robot turns."""
    return driven(1.0).go(push(0.5, left=left), 1.0, yaw_rate=yaw_rate)


def braking(loss, late=0.0):
    """What a loss [m/s] is felt as while the robot brakes; the wheels' speeds come late [s]."""
    moving = np.concatenate([push(0.3), push(0.3, -3.0), push(0.5)])
    speeds = np.interp(np.arange(110) - late * RATE, np.arange(110), 1.0 + np.cumsum(moving[:, 0]) / RATE)
    moving[35:43, 0] -= loss / 0.08
    return driven(1.0, wheels_rate=50).go(moving, speeds)


def braked_before():
    """What a crash is felt as, a fifth of a second after the robot braked."""
    moving, speeds = push(1.0), np.full(100, 1.0)
    moving[30:40, 0] = -3.0
    speeds[30:40], speeds[40:] = np.linspace(1.0, 0.7, 10), 0.7
    moving[50:58, 0] = -0.3 / 0.08
    return driven(1.0, wheels_rate=50).go(moving, speeds)


def gap(seconds):
    """What a crash is felt as, soon after a gap between samples."""
    drive = driven()
    drive.step += round(seconds * RATE)
    return drive.go(crash(0.02))


STORIES = {
    "a bump from below is the ground": (False, lambda: knock(0.0)),
    "a bump from below is the ground, also with one ahead": (False, lambda: knock(-30.0)),
    "a curve to the left that begins at once": (False, lambda: turn(2.0, 2.0)),
    "a curve to the right that begins at once": (False, lambda: turn(-2.0, -2.0)),
    "a push to the left": (True, lambda: turn(2.0, 0.0)),
    "a push to the right": (True, lambda: turn(-2.0, 0.0)),
    "braking": (False, lambda: braking(0.0)),
    "braking, by odometry that is late": (False, lambda: braking(0.0, 0.09)),
    "braking, by odometry that is early": (False, lambda: braking(0.0, -0.09)),
    "a small loss while it brakes": (False, lambda: braking(0.1)),
    "a crash while it brakes": (True, lambda: braking(0.25)),
    "a crash soon after it braked is not excused by that": (True, braked_before),
    "it learns the ground for half a second": (False, lambda: Drive().go(crash(0.3))),
    "it has learned the ground": (True, lambda: Drive().go(crash(0.7))),
    "a short gap between samples": (True, lambda: gap(0.15)),
    "a gap of more than a fifth of a second is a new beginning": (False, lambda: gap(0.3)),
}


@pytest.mark.parametrize(("felt", "story"), STORIES.values(), ids=STORIES)
def test_what_is_felt_as_a_crash(felt, story):
    assert bool(story()) is felt


LATE = [{"wheels_late": 1.5}, {"samples_late": 1.5}]


def reversing(seconds):
    """Accelerations and wheel speeds of a robot that brakes from 1 m/s, and goes on backwards."""
    speeds = np.concatenate([np.linspace(1.0, -1.0, 67), np.full(round(seconds * RATE) - 67, -1.0)])
    return np.concatenate([push(0.67, -3.0), push(seconds - 0.67)]), speeds


@pytest.mark.parametrize("late", LATE)
@pytest.mark.parametrize("wheels_rate", [10, 50])
def test_messages_that_a_busy_machine_delivers_late_make_no_crash_of_braking(wheels_rate, late):
    assert not driven(1.0, wheels_rate=wheels_rate, **late).go(*reversing(2.67))


@pytest.mark.parametrize("seconds", [0.1, 0.3])
@pytest.mark.parametrize("shift", [0.1, 0.3, 0.5])
def test_short_braking_is_no_crash_however_long_window_and_shift_of_odometry_are(shift, seconds):
    braking = np.concatenate([push(1.0), push(seconds, -3.0), push(1.5)])
    speeds = 1.0 + np.cumsum(braking[:, 0]) / RATE
    earlier = np.concatenate([speeds[round(shift * RATE) :], np.full(round(shift * RATE), speeds[-1])])
    config = CrashConfig(window=shift, odometry_delay=shift)
    assert not driven(1.0, wheels_rate=50, config=config).go(braking, earlier)


@pytest.mark.parametrize("late", LATE)
def test_with_late_messages_a_crash_is_felt_late(late):
    (first, _), *_ = bump(more=2.0, **late)
    assert max(late.values()) - 0.1 < first - 2.0 < max(late.values()) + 0.3


@pytest.mark.parametrize("late", LATE)
@pytest.mark.parametrize("gap", [0.0, 0.5, 0.7])
def test_braking_soon_after_the_first_sample_is_no_crash_where_one_of_both_comes_late(gap, late):
    drive = Drive(wheels_rate=50, **late)
    if gap:
        drive.go(push(2.0), 1.0)
        drive.step += round(gap * RATE)
    drive.go(push(0.8), 1.0)
    assert not drive.go(*reversing(2.67))


@pytest.mark.parametrize("late", [{}, {"wheels_late": 0.4}, {"samples_late": 1.5}])
@pytest.mark.parametrize("begin", [0.1, 0.3, 0.7, 1.5])
@pytest.mark.parametrize("restarted", [False, True])
def test_speeding_up_before_odometry_begins_is_no_crash(restarted, begin, late):
    """The guard is connected to the IMU, but not yet to odometry, when the robot starts."""
    drive = Drive(wheels_rate=50, **late)
    if restarted:
        drive.go(push(10.0), 0.0)
        drive.step = 0
        drive.wheels.clear()
        drive.samples.clear()
    speeding_up = np.concatenate([push(0.33, 3.0), push(2.67)])
    speeds, lost = np.cumsum(speeding_up[:, 0]) / RATE, round(begin * RATE)
    drive.wheels_every = len(speeds)
    felt = drive.go(speeding_up[:lost], speeds[:lost])
    drive.wheels_every = 2
    assert not felt + drive.go(speeding_up[lost:], speeds[lost:]) + drive.go(push(2.0), 1.0)
    assert drive.go(crash(after=2.0), 1.0)


@pytest.mark.parametrize("late", [*LATE, {"wheels_late": 0.7}])
@pytest.mark.parametrize("gap", [0.5, 0.7])
def test_braking_after_a_gap_in_odometry_is_no_crash_where_one_of_both_comes_late(gap, late):
    drive = driven(1.0, wheels_rate=50, **late)
    drive.wheels_every = round(gap * RATE)
    drive.go(push(gap), 1.0)
    drive.wheels_every = 2
    assert not drive.go(*reversing(2.67))


@pytest.mark.parametrize("stall", [1.0, 5.0])
def test_braking_during_a_stall_is_no_crash_where_odometry_comes_first_afterwards(stall):
    drive = driven(1.0, wheels_rate=50)
    drive.samples_late = stall
    assert not drive.go(*reversing(stall))
    drive.samples_late = 0.0
    assert not drive.go(push(1.0), -1.0)


@pytest.mark.parametrize("wheels_late", [0.3, 1.0])
def test_a_crash_before_a_gap_between_samples_is_felt_where_odometry_comes_late(wheels_late):
    drive = driven(wheels_late=wheels_late)
    felt = drive.go(crash(after=0.2))
    drive.step += round(0.3 * RATE)
    assert felt or drive.go(push(2.0))


@pytest.mark.parametrize("ended_before", [0.0, 1.0])
def test_when_odometry_ends_a_crash_is_felt_within_two_seconds_of_its_end_or_soon(ended_before):
    drive = driven()
    drive.wheels_late = 1e9
    drive.go(push(ended_before))
    felt = drive.go(crash(after=2.5))
    assert felt
    assert felt[0][0] < 2.0 + 2.1
    assert drive.detector.delay == 0.0, "nothing waits any longer"
    assert drive.go(crash(after=0.2)), "and the next one is felt soon"


@pytest.mark.parametrize(("late", "delay"), [(0.0, 0.0), (1.0, 1.0), (3.0, 2.5)])
def test_the_delay_is_that_of_odometry_up_to_two_and_a_half_seconds(late, delay):
    drive = driven(wheels_late=late)
    drive.go(push(4.5))
    assert drive.detector.delay == pytest.approx(delay, abs=0.25 if late else 0.1)
    (first, _), *_ = drive.go(crash(after=3.5))
    assert first - 6.5 < delay + 0.3


def by_clock(now):
    """Stamp of an IMU's node that looks at a clock of 50 Hz."""
    return np.floor(now * 50.0 + 1e-9) / 50.0


def jittered(rate):
    rng = np.random.default_rng(0)
    return lambda now: now + rng.uniform(-0.8, 0.8) / rate  # some come out of order


def slow(*values):
    return [pytest.param(value, marks=pytest.mark.slow) for value in values]


@pytest.mark.parametrize("rate", [50, 100, 200])
def test_a_sharp_crash_is_felt_at_any_rate(rate):
    hit = np.zeros((3 * rate, 3))
    hit[2 * rate + 10] = (-0.2 * rate, 0.0, 0.0)  # 0.2 m/s in one sample
    assert Drive(rate=rate, wheels_rate=10).go(hit)


@pytest.mark.parametrize("loss", [0.2, *slow(0.3, 0.5)])
@pytest.mark.parametrize("stamped", ["exact", "doubled", "jittered"])
@pytest.mark.parametrize("rate", [50, 400, *slow(100, 200)])
def test_a_crash_is_felt_however_the_samples_are_stamped(rate, stamped, loss):
    stamps = {"exact": float, "doubled": by_clock, "jittered": jittered(rate)}[stamped]
    drive = Drive(rate=rate, stamped=stamps)
    assert not drive.go(np.zeros((2 * rate, 3)))
    hit = np.zeros((rate, 3))
    hit[10 : 10 + round(0.06 * rate), 0] = -loss / 0.06
    assert drive.go(hit)


def test_a_crash_is_felt_by_all_samples_of_a_stamp():
    drive = Drive(rate=200, stamped=by_clock)
    assert not drive.go(np.zeros((400, 3)))
    hit = np.zeros((200, 3))
    hit[10:22, 0] = -0.4 / 0.06
    hit[3::4] = 0.0  # the first of each stamp
    assert drive.go(hit)


@pytest.mark.parametrize("odometry_ends", [False, True])
@pytest.mark.parametrize("wheels_late", [0.0, 1.0])
def test_a_jump_of_time_is_a_new_beginning_and_samples_that_waited_are_forgotten(wheels_late, odometry_ends):
    drive = driven(wheels_late=wheels_late)
    assert bool(drive.go(crash(after=0.2))) is (wheels_late == 0.0)
    drive.step, drive.wheels_late = 0, 0.0  # the simulator was started again
    drive.wheels.clear()
    drive.wheels_every = 1  # odometry comes first
    drive.go(push(0.01))
    drive.wheels_late = 1e9 if odometry_ends else 0.0
    assert not drive.go(push(2.0))
    assert drive.go(crash())


def test_a_crash_is_felt_after_a_jump_of_time_without_odometry():
    drive = Drive()
    drive.go(push(60.0), 1.0)
    drive.step, drive.wheels_late = 0, 1e9  # the simulator was started again, and its odometry is silent
    drive.go(push(4.0))
    assert drive.go(crash())


# ---------------------------------------------------------------------------- mount and slope

angles = st.floats(-pi, pi)


@settings(derandomize=True, deadline=None, max_examples=25)
@given(st.builds(quat_from_rpy, angles, angles, angles), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_however_the_imu_is_mounted_and_the_ground_slopes_a_crash_is_felt_and_gravity_is_none(
    mount, roll, pitch
):
    drive = Drive(mount, quat_from_rpy(roll, pitch, 0.0))
    assert not drive.go(push(2.0))
    assert drive.go(crash())


@pytest.mark.parametrize("rate", [0.1, 0.3])
def test_driving_up_a_kerb_is_no_crash(rate):
    """The ramp in a real run: 0.3 rad/s of pitch up to 25 degrees, 4 m/s^2 of gravity along the robot."""
    drive = driven(0.3)
    for step in range(1, round(radians(25.0) / rate * RATE)):
        pitch, now = step * rate / RATE, 2.0 + step / RATE
        if step % 10 == 0:
            drive.detector.add_odometry(now, Twist2D(0.3, 0.0))
        force = (9.8 * sin(pitch), 0.0, 9.8 * cos(pitch))
        assert not drive.detector.add_sample(ImuSample(now, LEVEL, (0.0, -rate, 0.0), force))


# ---------------------------------------------------------------------------- rough ground


@pytest.mark.parametrize("deviation", [FLOORING, ASPHALT])
@pytest.mark.parametrize("seed", [0, *slow(1, 2, 3)])
def test_rough_ground_is_no_crash(deviation, seed):
    assert not Drive().go(vibration(60.0, deviation, seed))


@pytest.mark.parametrize("deviation", [FLOORING, ASPHALT])
@pytest.mark.parametrize("seed", [0, *slow(1)])
def test_on_rough_ground_most_losses_of_0_4_m_s_within_80_ms_are_felt_within_0_3_s(deviation, seed):
    shaking, felt = vibration(60.0, deviation, seed), []
    for start in range(300, len(shaking) - 40, 150):
        piece = shaking[start - 200 : start + 30].copy()
        piece[200:208, 0] += LOSS
        felt.append(any(now > 2.0 for now, _ in Drive().go(piece)))
    assert np.mean(felt) >= 0.95


@pytest.mark.parametrize(("seconds", "felt"), [(0.8, False), (1.3, True)])
def test_rough_ground_is_forgotten_after_a_second_on_smooth_ground(seconds, felt):
    drive = Drive(wheels_rate=50)
    drive.go(0.8 * vibration(3.0, FLOORING, 0))
    assert bool(drive.go(crash(seconds, ahead=-0.15 / 0.08))) is felt


@pytest.mark.parametrize(
    ("amplitude", "ahead", "left", "felt"),
    [
        # 5 mm/s within a window, as under an A200 that stands, 10 and 20 mm/s
        (0.1, -0.2, 0.0, True),
        (0.2, -0.2, 0.0, False),
        (0.4, -0.25, 0.0, False),
        (0.4, -0.35, 0.0, True),
        # sideways it counts twice
        *[(0.1, 0.0, side * 0.2, False) for side in (1.0, -1.0)],
        *[(0.1, 0.0, side * 0.25, True) for side in (1.0, -1.0)],
    ],
)
def test_the_limit_grows_with_the_ground_s_vibration(amplitude, ahead, left, felt):
    """The ground shakes the robot up and down [m/s^2] while its speed changes [m/s]."""
    shaking = np.zeros((340, 3))
    shaking[:, 2] = amplitude * np.sin(2.0 * pi * np.arange(340) / 23.0)
    shaking[300:308, :2] += (ahead / 0.08, left / 0.08)
    assert bool(Drive().go(shaking)) is felt
