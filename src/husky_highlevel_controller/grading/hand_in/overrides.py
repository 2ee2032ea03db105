"""What a teacher sets for single students in marking.yaml: what to start, points by hand, late penalties.

In: the file in the folder of hand-ins. Out: an `Override` for each student. Must not know: ROS, rubrics.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Sequence, Tuple

import yaml

from husky_highlevel_controller.config import ConfigError
from husky_highlevel_controller.grading.isolation.files import UnreadableFileError, read_text
from husky_highlevel_controller.grading.reports.tables import Result
from husky_highlevel_controller.grading.rubrics.items import Item

FILE = "marking.yaml"
ROBOTS = ("husky", "husky_melodic", "smb")


@dataclass(frozen=True)
class GivenPoints:
    """Points of one item, given by a person."""

    item: str
    points: float
    word: str  # why


@dataclass(frozen=True)
class Override:
    """What is set for one student; an empty field is left to marking."""

    launch: str = ""  # place of a launch file in the hand-in, or the end of it
    node: Tuple[str, ...] = ()  # package and type of a node
    arguments: Tuple[str, ...] = ()  # of the launch file or node
    robot: str = ""
    exercise: int = 0  # the number in its folders' and files' names that is meant
    points: Tuple[GivenPoints, ...] = ()
    late_percent: float = 0.0  # of the points, taken away
    late_word: str = ""  # why

    def apply(self, result: Result) -> Result:
        """The result with the points given by hand, and without the late penalty.

        Raises:
            ConfigError: points are given for an item that the rubric does not have, or more than it has.
        """
        items = list(result.items)
        names = [item.name for item in items]
        for given in self.points:
            source = f"{FILE}: students/{result.name}/points/{given.item}"
            if given.item not in names:
                raise ConfigError(f"{source} is not an item; there are: {', '.join(names)}")
            item = items[names.index(given.item)]
            if given.points > item.max_points:
                raise ConfigError(f"{source} = {given.points:g} is more than the item's {item.max_points:g}")
            items[names.index(given.item)] = replace(
                item, points=given.points, evidence=f"by hand: {given.word}"
            )
        if self.late_percent:
            before = sum(item.points or 0.0 for item in items)
            words = f"{self.late_percent:g} % of {before:g} points: {self.late_word}"
            items.append(Item("late", -round(before * self.late_percent / 100.0, 1), 0.0, words))
        return replace(result, items=tuple(items))


def read_overrides(folder: Path, students: Sequence[str]) -> Dict[str, Override]:
    """The overrides in a folder's marking.yaml, by student; none without the file.

    Raises:
        ConfigError: it cannot be read, names an unknown student or key, or a value is not allowed.
    """
    path = folder / FILE
    if not path.exists():
        return {}
    try:
        content = yaml.safe_load(read_text(path)) or {}
    except (UnreadableFileError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: {' '.join(str(error).split())}") from error
    entries = _mapping(
        _mapping(content, str(path), ("students",)).get("students", {}), f"{path}: students", students
    )
    return {name: _override(entry, f"{path}: students/{name}") for name, entry in entries.items()}


def _override(entry: Any, source: str) -> Override:
    readers: Dict[str, Callable[[Any, str], Any]] = {
        "launch": _text, "node": _node, "arguments": _words, "robot": _robot, "exercise": _exercise,
        "points": _points, "late": _late,
    }  # fmt: skip
    entry = _mapping(entry, source, list(readers))
    values = {key: readers[key](value, f"{source}/{key}") for key, value in entry.items()}
    percent, word = values.pop("late", (0.0, ""))
    if "launch" in values and "node" in values:
        raise ConfigError(f"{source} has both launch and node")
    return Override(late_percent=percent, late_word=word, **values)


def _mapping(value: Any, source: str, known: Sequence[str]) -> Mapping[str, Any]:
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise ConfigError(f"{source} = {value!r} is not a mapping")
    for key in value:
        if key not in known:
            raise ConfigError(f"{source}: {key!r} is not known; there are: {', '.join(known)}")
    return value


def _text(value: Any, source: str) -> str:
    if not isinstance(value, str) or not value:
        raise ConfigError(f"{source} = {value!r} is not a text")
    return value


def _words(value: Any, source: str) -> Tuple[str, ...]:
    if not isinstance(value, list):
        raise ConfigError(f"{source} = {value!r} is not a list of texts")
    return tuple(_text(word, source) for word in value)


def _node(value: Any, source: str) -> Tuple[str, ...]:
    words = tuple(_text(value, source).split())
    if len(words) != 2:
        raise ConfigError(f"{source} = {value!r} is not a package and a type")
    return words


def _robot(value: Any, source: str) -> str:
    if value not in ROBOTS:
        raise ConfigError(f"{source} = {value!r} is not one of: {', '.join(ROBOTS)}")
    return str(value)


def _exercise(value: Any, source: str) -> int:
    return int(_number(value, source, 1, 99))


def _number(value: Any, source: str, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
        raise ConfigError(f"{source} = {value!r} is not a number in {low:g}..{high:g}")
    return float(value)


def _late(value: Any, source: str) -> Tuple[float, str]:
    entry = _complete(value, source, ("percent", "word"))
    return _number(entry["percent"], f"{source}/percent", 0, 100), _text(entry["word"], f"{source}/word")


def _points(value: Any, source: str) -> Tuple[GivenPoints, ...]:
    if not isinstance(value, dict):
        raise ConfigError(f"{source} = {value!r} is not a mapping of items to points")
    found: List[GivenPoints] = []
    for item, given in value.items():
        place = f"{source}/{item}"
        entry = _complete(given, place, ("points", "word"))
        points = _number(entry["points"], f"{place}/points", 0, 1000)
        found.append(GivenPoints(str(item), points, _text(entry["word"], f"{place}/word")))
    return tuple(found)


def _complete(value: Any, source: str, keys: Sequence[str]) -> Mapping[str, Any]:
    entry = _mapping(value, source, keys)
    for key in keys:
        if key not in entry:
            raise ConfigError(f"{source}/{key} is missing")
    return entry
