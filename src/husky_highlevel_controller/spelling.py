"""Likeness of names, to find the name that a person probably means. Only the standard library."""

from __future__ import annotations

from difflib import SequenceMatcher
from typing import Iterable, Optional


def likeness(name: str, other: str, separator: str) -> float:
    """Return how similar two names are (0 to 1): the least similarity of their parts between separators.

    Parts are compared by difflib's ratio, which is 1 if they are equal. Names with different numbers of parts
    are compared as a whole, so front_scan is similar to front/scan.
    """
    parts, other_parts = name.split(separator), other.split(separator)
    if len(parts) != len(other_parts):
        parts, other_parts = ["_".join(parts)], ["_".join(other_parts)]
    return min(
        SequenceMatcher(None, part, other_part).ratio() for part, other_part in zip(parts, other_parts)
    )


def nearest(name: str, others: Iterable[str], separator: str, least: float) -> Optional[str]:
    """Return the other name that is most similar to `name`; None if its likeness is below `least`."""
    rated = [(likeness(name, other, separator), other) for other in others]
    if not rated:
        return None
    best, nearest_name = max(rated)
    return nearest_name if best >= least else None
