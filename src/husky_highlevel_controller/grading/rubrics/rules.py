"""Rubric files: tolerances, weights, and the items that a person judges."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Sequence

import yaml

from husky_highlevel_controller.config import ConfigError, from_plain
from husky_highlevel_controller.grading.records import Rules


def read_rules(content: Any, source: str, items: Sequence[str]) -> Rules:
    """The rules of a rubric file's content.

    Args:
        content: tolerances by name, `weights` (item: points) and `by_person` (a list of items).
        source: of the content, for error texts.
        items: names of the exercise's items.

    Raises:
        ConfigError: a key is unknown or a value is not allowed.
    """
    rules = from_plain(Rules, content, f"{source}: ")
    for name in [*rules.weights, *rules.by_person]:
        if name not in items:
            raise ConfigError(f"{source}: '{name}' is not an item; there are: {', '.join(items)}")
    return rules


def load_rules(path: Path, items: Sequence[str]) -> Rules:
    """The rules of a rubric file, in YAML.

    Raises:
        ConfigError: it cannot be read, or a key or value is not allowed.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: not a rubric file: {error}") from error
    return read_rules(content, str(path), items)
