"""Driving for as long as something is held: commands of several pages become one, which expires.

In: commands with their moments. Out: the twist to send.
"""

from __future__ import annotations

from math import inf
from typing import Any, Optional

from husky_highlevel_controller.datatypes import STOP, Twist2D

EXPIRY = 0.25  # [s] without a word from the page; it repeats itself every 0.05 s while a key is held


def clamp_axis(value: Any) -> Optional[float]:
    """Axis of a joystick, clamped to -1..1; None for what is no finite number."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value != value:
        return None
    return float(max(-1, min(1, value))) if abs(value) != inf else None


class HoldToDrive:
    """The page that took hold first drives until it lets go or is silent."""

    def __init__(self) -> None:
        self._holder: Optional[int] = None
        self._twist, self._heard_at = STOP, 0.0
        self._has_to_stop = False

    @property
    def is_active(self) -> bool:
        """Whether there is something to send."""
        return self._holder is not None or self._has_to_stop

    def hold(self, page: int, twist: Twist2D, now: float) -> None:
        """A page commands a twist at `now` [s]; no motion at all is to let go."""
        if self._holder not in (None, page) and now - self._heard_at < EXPIRY:
            return
        if twist == STOP:
            self.release(page)
        else:
            self._holder, self._twist, self._heard_at = page, twist, now

    def release(self, page: int) -> None:
        """A page lets go, or is gone."""
        if page == self._holder:
            self._holder, self._has_to_stop = None, True

    def command(self, now: float) -> Optional[Twist2D]:
        """The twist to send at `now` [s]: one STOP after the last, then None."""
        if self._holder is not None and now - self._heard_at >= EXPIRY:
            self.release(self._holder)
        if self._holder is not None:
            return self._twist
        if self._has_to_stop:
            self._has_to_stop = False
            return STOP
        return None
