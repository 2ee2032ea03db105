"""Settings of a teacher: a rubric file for all, and marking.yaml for single students."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Dict, Mapping, Sequence

import yaml

from husky_grading.isolation.files import UnreadableFileError, read_text
from husky_grading.records import Item, MarkingResult, Override, Rules
from husky_highlevel_controller.config import ConfigError, from_plain

# YAML's types of a text, and of the key << that includes another mapping
TEXT, MERGE = "tag:yaml.org,2002:str", "tag:yaml.org,2002:merge"
FILE = "marking.yaml"  # file with the teacher's settings, in the folder of submissions


class PointsError(ConfigError):
    """Points by hand do not fit the rubric."""


@dataclass(frozen=True)
class _MarkingFile:
    """Content of marking.yaml."""

    students: Mapping[str, Override] = field(default_factory=dict)


def load_rules(path: Path, items: Sequence[str]) -> Rules:
    """Return the rules in a rubric file.

    The file has tolerances by name, `weights` with the points of items, and `by_person` with the items that
    are graded by hand. `items` are the names of all items of the exercise.

    Raises:
        ConfigError: the file cannot be read, or a key or value is not allowed.
    """
    rules = from_plain(Rules, read_settings(path), f"{path}: ")
    for name in [*rules.weights, *rules.by_person]:
        _check_known(name, items, f"{path}: '{name}' is not an item")
    return rules


def read_overrides(folder: Path, students: Sequence[str]) -> Dict[str, Override]:
    """Return the overrides in a folder's marking.yaml, by student; none without the file.

    `students` are the names that the file may use.

    Raises:
        ConfigError: the file cannot be read, names an unknown student or key, or a value is not allowed.
    """
    path = folder / FILE
    overrides = from_plain(_MarkingFile, read_settings(path) if path.exists() else {}, f"{path}: ").students
    for name in overrides:
        _check_known(name, students, f"{path}: students: {name!r} is not known")
    return dict(overrides)


class _TextKeyLoader(yaml.SafeLoader):
    """Loader that takes each key of a mapping as it is written, because a student may be called 1_2 or no."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> Dict[Any, Any]:
        """Return the mapping of a node, with texts as keys."""
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.tag != MERGE:
                key.tag = TEXT
        return super().construct_mapping(node, deep)


def read_settings(path: Path) -> Any:
    """Return the content of a teacher's YAML file; {} if it is empty.

    Raises:
        ConfigError: the file cannot be read.
    """
    try:
        # `resolve`, because `read_text` rejects a link, but a teacher's file may be a link
        return yaml.load(read_text(path.resolve()), _TextKeyLoader) or {}
    except (LookupError, TypeError, AttributeError) as error:
        # YAML raises these errors for a wrong tag, such as `!!bool x`
        raise ConfigError(f"{path}: a value is not of the type that its tag names: {error}") from error
    except (UnreadableFileError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: {' '.join(str(error).split())}") from error


def _check_known(name: str, names: Sequence[str], refusal: str) -> None:
    """Check that a name is among the known `names`.

    Raises:
        ConfigError: the name is not among them; the text of this error begins with `refusal`.
    """
    if name not in names:
        raise ConfigError(f"{refusal}; there are: {', '.join(names)}")


def with_override(result: MarkingResult, override: Override) -> MarkingResult:
    """Return the result with points by hand and a late penalty, and held back if the teacher has set `hold`.

    Raises:
        PointsError: points are given for an unknown item, or more points than the item has.
    """
    items = {item.name: item for item in result.items}
    for name, entry in override.points.items():
        source = f"{FILE}: students/{result.name}/points/{name}"
        if name not in items:
            raise PointsError(f"{source} is not an item; there are: {', '.join(items)}")
        if entry.points > items[name].max_points:
            limit = items[name].max_points
            raise PointsError(f"{source} = {entry.points:g} is more than the item's {limit:g}")
        # an item with all points has no fault, so it has no hint
        hint = "" if entry.points == items[name].max_points else items[name].hint
        items[name] = replace(items[name], points=entry.points, evidence=f"by hand: {entry.word}", hint=hint)
    penalty = []  # one item if the submission came late, otherwise empty
    if override.late:
        # the penalty is in percent of these points; an item that is still to be graded by hand counts as 0
        before = sum(item.points or 0.0 for item in items.values())
        evidence = f"{override.late.percent:g} % of {before:g} points: {override.late.word}"
        # The points of this item are negative. `0.0 - x` is used because `-x` would be -0.0 for a penalty of
        # 0.
        penalty = [Item("late", 0.0 - round(before * override.late.percent / 100.0, 1), 0.0, evidence)]
    return replace(result, items=(*items.values(), *penalty), held=override.hold)
