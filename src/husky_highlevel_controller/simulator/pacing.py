"""Real-time pacing: keeps simulated time in step with wall time.

In: simulated time and wall time. Out: the time to wait, and whether the machine is too slow.
"""

from __future__ import annotations

from typing import Optional

# [s] if simulated time lags behind wall time by more than this, the machine is too slow; a shorter lag is
# caught up
MAX_LAG = 0.5


class Pacer:
    """Pace of simulated time: `factor` times real time, or as fast as possible if `factor` is 0."""

    def __init__(self, factor: float, stamp: float, now: float) -> None:
        self._real_time_factor = factor
        self.restart(stamp, now)

    def restart(self, stamp: float, now: float) -> None:
        """Start over at simulated time `stamp` and wall time `now` [s], after a pause or a lag."""
        self._start_stamp, self._start_time = stamp, now

    def delay(self, stamp: float, now: float) -> float:
        """Time to wait before the next step [s]; 0 if it is late or not paced."""
        return max(self._lead(stamp, now), 0.0)

    def lag(self, stamp: float, now: float) -> Optional[float]:
        """Return the reached factor, and restart, if simulated time lags by MAX_LAG; otherwise None."""
        if self._lead(stamp, now) > -MAX_LAG:
            return None
        reached = (stamp - self._start_stamp) / (now - self._start_time)
        self.restart(stamp, now)
        return reached

    def _lead(self, stamp: float, now: float) -> float:
        """Time by which the simulation is ahead of its pace [s]; 0 if it is not paced."""
        if self._real_time_factor == 0.0:
            return 0.0
        return self._start_time + (stamp - self._start_stamp) / self._real_time_factor - now
