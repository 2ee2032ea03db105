"""What a teacher may set about a rubric: tolerances, weights, and which items a person judges.

In: a mapping from a rubric file. Out: `Rules`. Must not know: ROS, an exercise's items.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Dict, List, Mapping, Sequence, Tuple

import yaml

from husky_highlevel_controller.config import ConfigError, read_config
from husky_highlevel_controller.grading.rubrics.items import Item

RAMMING_MARGIN = 0.05  # [m/s], a measured speed is not exact: a robot commanded to `gentle` does not ram


def _number(default: float, high: float, help_text: str) -> Any:
    return field(default=default, metadata={"min": 0.0, "max": high, "help": help_text})


_NAMED = ("weights", "by_person")  # fields that are no tolerances


@dataclass(frozen=True)
class Rules:
    """Numbers of the rubric; the defaults are the course's sheet."""

    reached: float = _number(0.35, 5.0, "from the robot's outline to the pillar that it has reached [m]")
    ramming_costs: float = _number(0.0, 30.0, "points that ramming the pillar costs")
    gentle: float = _number(0.5, 5.0, "a robot that touches the pillar faster than this rams it [m/s]")
    marker_full: float = _number(0.3, 5.0, "from the marker to the pillar's axis for all points [m]")
    marker_half: float = _number(0.65, 5.0, "from the marker to the pillar's axis for half of the points [m]")
    marker_per_metre: float = _number(0.01, 1.0, "added to both for each metre between robot and pillar")
    weights: Tuple[Tuple[str, float], ...] = ()  # (name of an item, its points)
    by_person: Tuple[str, ...] = ()  # names of items that a person judges

    def rams(self, speed: float) -> bool:
        """Whether touching the pillar at this speed [m/s] is ramming that costs points."""
        return self.ramming_costs > 0.0 and speed > self.gentle + RAMMING_MARGIN

    def apply(self, items: Sequence[Item]) -> List[Item]:
        """Items with the teacher's weights, and without points where a person judges."""
        weights = dict(self.weights)
        return [self._weighted(item, weights) for item in items]

    def _weighted(self, item: Item, weights: Dict[str, float]) -> Item:
        weight = weights.get(item.name, item.max_points)
        if item.name in self.by_person:
            return replace(item, points=None, max_points=weight, evidence=f"for a person: {item.evidence}")
        if item.points is None or weight == item.max_points:
            return replace(item, max_points=weight)
        return replace(item, points=round(item.points * weight / item.max_points, 1), max_points=weight)


DEFAULT = Rules()


def read_rules(content: Mapping[str, Any], source: str, items: Sequence[str]) -> Rules:
    """The rules of a rubric file's content.

    Args:
        content: tolerances by name, `weights` (item: points) and `by_person` (a list of items).
        source: of the content, for error texts.
        items: names of the exercise's items.

    Raises:
        ConfigError: a key is unknown or a value is not allowed.
    """
    rest = dict(content)
    weights, by_person = rest.pop("weights", {}), rest.pop("by_person", [])
    if not isinstance(weights, Mapping) or not isinstance(by_person, list):
        raise ConfigError(f"{source}: weights is not a mapping, or by_person is not a list")
    for name in [*weights, *by_person]:
        if name not in items:
            raise ConfigError(f"{source}: '{name}' is not an item; there are: {', '.join(items)}")
    for name, weight in weights.items():
        if isinstance(weight, bool) or not isinstance(weight, (int, float)) or not 0.0 <= weight <= 1000.0:
            raise ConfigError(f"{source}: weights/{name} = {weight!r} is not a number in 0..1000")
    given = {name: getattr(DEFAULT, name) for name in Rules.__dataclass_fields__ if name not in _NAMED}
    (rules,) = read_config({**given, **rest}, f"{source}: ", Rules)
    return replace(
        rules,
        weights=tuple((name, float(weight)) for name, weight in weights.items()),
        by_person=tuple(by_person),
    )


def load_rules(path: Path, items: Sequence[str]) -> Rules:
    """The rules of a rubric file, in YAML.

    Raises:
        ConfigError: it cannot be read, or a key or value is not allowed.
    """
    try:
        content = yaml.safe_load(path.read_text())
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: not a rubric file: {error}") from error
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: not a mapping of names to values")
    return read_rules(content, str(path), items)
