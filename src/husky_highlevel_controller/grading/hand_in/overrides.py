"""A teacher's settings for single students: marking.yaml in the folder of hand-ins."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Dict, Mapping, Sequence

import yaml

from husky_highlevel_controller.config import ConfigError, from_plain
from husky_highlevel_controller.grading.isolation.files import UnreadableFileError, read_text
from husky_highlevel_controller.grading.records import Item, Override, Result

FILE = "marking.yaml"


@dataclass(frozen=True)
class _MarkingFile:
    students: Mapping[str, Override] = field(default_factory=dict)


def read_overrides(folder: Path, students: Sequence[str]) -> Dict[str, Override]:
    """The overrides in a folder's marking.yaml, by student; none without the file.

    Raises:
        ConfigError: it cannot be read, names an unknown student or key, or a value is not allowed.
    """
    path = folder / FILE
    if not path.exists():
        return {}
    try:
        content = yaml.safe_load(read_text(path.resolve())) or {}
    except (UnreadableFileError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: {' '.join(str(error).split())}") from error
    overrides = from_plain(_MarkingFile, content, f"{path}: ").students
    for name in overrides:
        if name not in students:
            known = ", ".join(students)
            raise ConfigError(f"{path}: students: {name!r} is not known; there are: {known}")
    return dict(overrides)


def with_override(result: Result, override: Override) -> Result:
    """The result with the points given by hand, and less the late penalty.

    Raises:
        ConfigError: points are given for an item that the rubric does not have, or more than it has.
    """
    items = list(result.items)
    names = [item.name for item in items]
    for name, given in override.points.items():
        source = f"{FILE}: students/{result.name}/points/{name}"
        if name not in names:
            raise ConfigError(f"{source} is not an item; there are: {', '.join(names)}")
        item = items[names.index(name)]
        if given.points > item.max_points:
            raise ConfigError(f"{source} = {given.points:g} is more than the item's {item.max_points:g}")
        items[names.index(name)] = replace(item, points=given.points, evidence=f"by hand: {given.word}")
    if override.late:
        before = sum(item.points or 0.0 for item in items)
        words = f"{override.late.percent:g} % of {before:g} points: {override.late.word}"
        items.append(Item("late", -round(before * override.late.percent / 100.0, 1), 0.0, words))
    return replace(result, items=tuple(items))
