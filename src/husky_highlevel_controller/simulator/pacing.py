"""Real-time pacing: keeps simulated time in step with wall time.

In: simulated time and wall time. Out: the time to wait, and whether the machine is too slow.

`factor` is the real-time factor: simulated seconds per second of wall time.
"""

from __future__ import annotations

from typing import Optional

# [s] If a step is late by at least this wall time, the machine is too slow, and the pace starts over. If a
# step is less late, the next steps follow without waiting until they are in time again.
MAX_LAG = 0.5


class Pacer:
    """Pace of simulated time: `factor` times wall time, or as fast as possible if `factor` is 0."""

    def __init__(self, factor: float, stamp: float, now: float) -> None:
        """Begin at simulated time `stamp` and wall time `now` [s]."""
        self._real_time_factor = factor
        self.restart(stamp, now)

    def restart(self, stamp: float, now: float) -> None:
        """Start over at simulated time `stamp` and wall time `now` [s], after a pause or a lag."""
        self._start_stamp, self._start_time = stamp, now

    def delay(self, stamp: float, now: float) -> float:
        """Time to wait before the next step [s]; 0 if the step is late, or if the factor is 0."""
        return max(self._lead(stamp, now), 0.0)

    def lag(self, stamp: float, now: float) -> Optional[float]:
        """Return the factor that the machine has reached if it is too slow for its pace, otherwise None.

        If it is too slow, the pace starts over from now.
        """
        if self._lead(stamp, now) > -MAX_LAG:
            return None
        reached_factor = (stamp - self._start_stamp) / (now - self._start_time)
        self.restart(stamp, now)
        return reached_factor

    def _lead(self, stamp: float, now: float) -> float:
        """Return the wall time until the simulation should have reached `stamp` [s]; negative if it is late.

        The result is 0 if the factor is 0, because there is no pace then.
        """
        if self._real_time_factor == 0.0:
            return 0.0
        due_time = self._start_time + (stamp - self._start_stamp) / self._real_time_factor
        return due_time - now
