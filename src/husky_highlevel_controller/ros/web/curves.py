"""Ring buffers of what is drawn as curves, and a meter of rates.

In: samples with their times. Out: arrays.
"""

from __future__ import annotations

from collections import deque
from typing import Deque, Optional, Tuple

import numpy as np

CAPACITY = 1000  # samples


class Curve:
    """The samples of the last `window` seconds."""

    def __init__(self, series: int, window: float = 30.0) -> None:
        """Begin empty.

        Args:
            series: values of one sample.
            window: how far back the curve goes [s].
        """
        self._window, self._series = window, series
        self._samples: Deque[Tuple[float, ...]] = deque(maxlen=CAPACITY)  # time and values, the newest last

    def add(self, stamp: float, *values: float) -> None:
        """Add a sample; a time that runs backwards begins anew, one that stands still adds nothing."""
        samples = self._samples
        if samples and stamp < samples[-1][0]:
            samples.clear()
        if samples and stamp == samples[-1][0]:
            return
        samples.append((stamp, *values))
        while stamp - samples[0][0] > self._window:
            samples.popleft()

    @property
    def arrays(self) -> Tuple[np.ndarray, ...]:
        """Times and each series, oldest first; NaN where there was no value."""
        return tuple(np.array(list(self._samples), float).reshape(-1, self._series + 1).T)


class Rate:
    """Growth of one number beside another, over a few seconds of the second."""

    def __init__(self, window: float = 2.0) -> None:
        self._window = window
        self._samples: Deque[Tuple[float, float]] = deque()

    def add(self, amount: float, moment: float) -> None:
        """A reading of both; an amount that shrinks begins anew."""
        if self._samples and amount < self._samples[-1][0]:
            self._samples.clear()
        self._samples.append((amount, moment))
        while len(self._samples) > 2 and moment - self._samples[1][1] >= self._window:
            self._samples.popleft()

    @property
    def value(self) -> Optional[float]:
        """Growth of the amount for each second; None before two readings."""
        if len(self._samples) < 2:
            return None
        (first, start), (last, end) = self._samples[0], self._samples[-1]
        return (last - first) / (end - start) if end > start else None


def fixed(value: float, digits: int) -> str:
    """A number with so many digits after the point; what rounds to nothing has no sign."""
    text = f"{value:.{digits}f}"
    return text.lstrip("-") if float(text) == 0.0 else text
