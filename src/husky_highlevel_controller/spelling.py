"""Likeness of names, to find the name that a person probably means. Only the standard library."""

from __future__ import annotations

from difflib import SequenceMatcher
from typing import Iterable, Optional


def likeness(name: str, other: str, separator: str) -> float:
    """Return the smallest likeness of the parts of two names, 0 to 1, by difflib's ratio.

    Names with different numbers of parts are compared as a whole: front_scan is like front/scan.
    """
    parts, other_parts = name.split(separator), other.split(separator)
    if len(parts) != len(other_parts):
        parts, other_parts = ["_".join(parts)], ["_".join(other_parts)]
    return min(SequenceMatcher(None, *pair).ratio() for pair in zip(parts, other_parts))


def nearest(name: str, others: Iterable[str], separator: str, least: float) -> Optional[str]:
    """Return the other name that is most like `name`, or None if its likeness is below `least`."""
    best, likest = max(((likeness(name, other, separator), other) for other in others), default=(0.0, ""))
    return likest if best >= least else None
