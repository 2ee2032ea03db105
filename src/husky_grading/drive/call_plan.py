"""Drivers of a drive: the call plan of exercise 5's service, the speed of exercise 2's robot."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Optional

from husky_grading.notes import Kind, Note

# drivers: command the robot, call the start/stop service, play a bag in the simulator's place
FORWARD, SERVICE, BAG = "forward", "service", "bag"
EX2_SPEED, EX2_FROM, EX2_SECONDS = 0.5, 2.0, 10.0  # [m/s], [s], [s]
CALM = 4.0  # [s], simulated, from one call's answer to the next call
CALLS = (False, True, False, True)  # stop and start, twice; the other way round where True stops
DRIVES = 0.1  # [m/s]
FIRST_CALL, LATEST_FIRST_CALL = (1.0, 8.0)  # [s]: after it drives; where it waits for a call to drive at all
NO_SERVICE = 25.0  # [s], simulated, without a service


def exercise_2_speed(now: float) -> float:
    """Commanded speed [m/s] at a time [s]."""
    return EX2_SPEED if EX2_FROM <= now < EX2_FROM + EX2_SECONDS else 0.0


def exercise_2_over(now: float) -> bool:
    """Whether that drive has ended and the robot stands."""
    return now > EX2_FROM + EX2_SECONDS + 1.0


@dataclass
class CallPlan:
    """The calls of one drive of exercise 5."""

    made: int = 0
    answered_at: float = -inf  # [s], the last call
    drove_at: float = inf  # [s], for the first time

    def due(self, now: float, speed: float) -> Optional[bool]:
        """The value to call with now, or None; time in s, speed in m/s."""
        if abs(speed) > DRIVES:
            self.drove_at = min(self.drove_at, now)
        begin = min(self.drove_at + FIRST_CALL, LATEST_FIRST_CALL)
        if self.made >= len(CALLS) or now < max(begin, self.answered_at + CALM):
            return None
        value = CALLS[self.made]
        self.made, self.answered_at = self.made + 1, inf
        return value

    def answered(self, now: float) -> None:
        """Call when the last call has been answered, or will not be; time in s."""
        self.answered_at = now

    def reason(self, now: float, offered: bool) -> Optional[Note]:
        """Reason why the drive is over; None: it is not."""
        if not offered and now > NO_SERVICE:
            return Note(Kind.NO_SERVICE, f"no start/stop service for {NO_SERVICE:g} s")
        if self.made >= len(CALLS) and now >= self.answered_at + CALM:
            return Note(Kind.PLAN_DONE, "all calls are made")
        return None
