"""Faults of a sensor's stamps and frames: clocks that differ, frames that are unknown to TF.

In: stamps as messages come, names of frames. Out: the offset between two clocks, sentences with the remedy.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple, Optional

# Two clocks are compared in windows of time, each of which gives one offset. A window ends as soon as it has
# lasted for this wall time [s] and has this many messages.
WINDOW, MIN_MESSAGES = 0.5, 5
# [s] the window in which two clocks are compared ends after this wall time at the latest, even if no
# reference message has come
MAX_WINDOW = 2.0
# [s] The robot stands still if the lidar's clock is measured to be ahead of odometry's clock by more than
# this. An offset of 0.5 s is allowed, and the measured offset may be too large by a period of odometry, up to
# 0.05 s.
MAX_OFFSET = 0.55


class _WindowBegin(NamedTuple):
    """Times at the beginning of a window, in which two clocks are compared."""

    wall_time: float  # [s] wall time at which the first message came
    message: float  # [s] stamp of the first message
    reference: float  # [s] newest stamp of the reference when the first message came


class ClockOffset:
    """Measurement of the offset between the clocks that stamp two streams of messages.

    An example is the lidar's clock for scans, and the clock of odometry as the reference. The stamp of each
    message is compared with the newest stamp of the reference. The difference also depends on how late the
    message or the reference comes, but in a window some messages come in time. So the smallest difference
    counts if the clock of the messages is ahead, and the largest difference counts if it is behind.
    """

    def __init__(self, tolerance: float) -> None:
        """Begin without an offset; an offset below `tolerance` [s] counts as 0."""
        self.seconds = 0.0  # [s] time by which the messages' clock is ahead of the reference's clock
        self._tolerance = tolerance
        self._newest_reference: Optional[float] = None  # [s] newest stamp of the reference
        self._new_references = 0  # number of new stamps of the reference in this window
        # number of messages in this window; if it is 0, the next message begins a new window
        self._message_count = 0
        self._window_begin = _WindowBegin(0.0, 0.0, 0.0)
        # [s] smallest and largest difference between the stamp of a message and the newest stamp of the
        # reference, in this window
        self._smallest_difference, self._largest_difference = inf, -inf

    def add_reference(self, stamp: float) -> None:
        """Take a stamp [s] of the reference; the same stamp may come several times."""
        if self._newest_reference is not None and stamp < self._newest_reference:
            self._message_count = 0  # time has gone back, so the next message begins a new window
        if stamp != self._newest_reference:
            self._new_references += 1
        self._newest_reference = stamp

    def add(self, stamp: float, now: float) -> None:
        """Take the stamp [s] of a message that comes at the wall time `now` [s].

        If this message ends a window, `seconds` becomes the offset in this window.
        """
        if self._newest_reference is None:
            return  # no reference has come yet, so there is nothing to compare the stamp with
        if self._message_count == 0:
            self._window_begin = _WindowBegin(now, stamp, self._newest_reference)
            self._new_references = 0
            self._smallest_difference, self._largest_difference = inf, -inf
        self._message_count += 1
        difference = stamp - self._newest_reference
        self._smallest_difference = min(self._smallest_difference, difference)
        self._largest_difference = max(self._largest_difference, difference)
        age = now - self._window_begin.wall_time
        is_full = age >= WINDOW and self._message_count >= MIN_MESSAGES and self._new_references > 0
        if is_full or age >= MAX_WINDOW:
            self.seconds = self._offset(stamp, now)
            self._message_count = 0  # the next message begins a new window

    def _offset(self, stamp: float, now: float) -> float:
        """Return the offset of the clocks in this window [s]; 0 if late messages alone can explain it.

        `stamp` is the stamp of the window's last message [s], and `now` is the wall time at its end [s].
        """
        begin = self._window_begin
        # [s] time that has passed in the window by the clock of the reference
        progress = (self._newest_reference or 0.0) - begin.reference
        # without two messages and a new stamp of the reference, the periods are unknown
        if progress <= 0.0 or not self._new_references or self._message_count < 2:
            return 0.0
        period = progress / self._new_references  # [s] period of the reference
        message_period = abs(stamp - begin.message) / (self._message_count - 1)
        # If the clocks are equal, the differences lie between 0 and `period`. For example, if a reference
        # comes every 0.1 s, the message of 0.53 s is compared with the reference of 0.5 s, and the difference
        # is 0.03 s. If messages come more often than references, the first message after a reference comes
        # within `message_period`, and the last message before the next reference comes within
        # `message_period` of it. So with equal clocks, the smallest difference is at most `uncertainty`, and
        # the largest difference is at least `period` minus `uncertainty`.
        uncertainty = min(period, message_period)
        # Delays in wall time also change the differences. If simulated time passes faster than wall time, the
        # same delay is longer in simulated time.
        clock_rate = max(progress / (now - begin.wall_time), 1.0)
        tolerance = self._tolerance * clock_rate + uncertainty
        # the messages are ahead by at most this, because with equal clocks no difference is below 0
        ahead = self._smallest_difference
        if ahead > tolerance:
            return ahead
        # the messages are behind by at most this, because with equal clocks no difference is above `period`
        behind = period - self._largest_difference
        if behind > tolerance:
            return -behind
        return 0.0


def clock_sentence(who: str, seconds: float, reference: str) -> str:
    """Return a sentence for the user on stamps that differ from those of a reference.

    Args:
        who: subject of the sentence with its verb, such as "scans are".
        seconds: time by which the stamps are ahead of the reference [s]; negative if they are behind it.
        reference: name of the reference.
    """
    side = "ahead of" if seconds > 0.0 else "behind"
    return f"{who} stamped {abs(seconds):.2f} s {side} {reference}; set the clocks (chrony)"


def zero_sentence(who: str) -> str:
    """Return a sentence for the user on messages without stamps; `who` is as for `clock_sentence`."""
    return f"{who} stamped 0; set the stamps in their driver"


def frame_sentence(frame: str) -> str:
    """Return a sentence for the user on scans whose frame TF does not connect with base_link."""
    if not frame:
        return "scans have no frame_id; set it in the driver of the lidar"
    return (
        f"no transform from '{frame}' to 'base_link'; check that robot_state_publisher is running "
        f"and that its robot has the frame '{frame}'"
    )
