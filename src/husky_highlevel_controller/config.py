"""Typed parameter records: reads and checks ROS parameters or YAML.

In: a mapping from the parameter server or a YAML file. Out: frozen records.

A record's fields with `metadata` are parameters: "min" and "max" bound them, "help" says what they are. A
field that is itself a record is a nested namespace; a tuple is a list of names, "length" of them; text that
is "optional" may be empty. Other fields are not for users.
"""

from __future__ import annotations

import sys
import typing
from dataclasses import Field, fields, is_dataclass
from typing import Any, Dict, List, Mapping, Set, Tuple, Type

from husky_highlevel_controller.datatypes import HuskyError


class ConfigError(HuskyError):
    """A parameter that is missing, unknown, or not allowed."""


def read_config(values: Mapping[str, Any], source: str, *records: Type) -> List[Any]:
    """Make one instance of each record class from one flat set of parameters.

    Args:
        values: parameter names and values; nested records are nested mappings.
        source: where they come from, for error texts: a file or a namespace ending in '/'.
        *records: dataclasses.

    Raises:
        ConfigError: a parameter is missing, unknown to all records, of the wrong type or out of range.
    """
    known: Set[str] = set()
    made = []
    for record in records:
        hints = typing.get_type_hints(record)
        taken: Dict[str, Any] = {}
        for item in _parameters(record):
            known.add(item.name)
            if item.name not in values:
                raise ConfigError(
                    f"{source}{item.name} is missing ({item.metadata.get('help', 'a namespace')})"
                )
            taken[item.name] = _checked(values[item.name], item, hints[item.name], source)
        try:
            made.append(record(**taken))
        except ValueError as error:  # two parameters that do not go together
            raise ConfigError(f"{source}{error}") from None
    unknown = sorted(set(values) - known)
    if unknown:
        raise ConfigError(f"{source}{unknown[0]} is not a parameter; there are: {', '.join(sorted(known))}")
    return made


def _parameters(record: Type) -> List[Field]:
    return [item for item in fields(record) if item.metadata]


def _checked(value: Any, item: Field, kind: Type, source: str) -> Any:
    name = source + item.name
    if is_dataclass(kind):
        if not isinstance(value, Mapping):
            raise ConfigError(f"{name} = {value!r} is not a set of parameters")
        return read_config(value, name + "/", kind)[0]
    if kind == Tuple[str, ...]:
        return _names(value, item, name)
    if type(value) is not kind and not (kind is float and type(value) is int):  # YAML's 1 is a fine 1.0
        raise ConfigError(f"{name} = {value!r} is not a {kind.__name__} ({item.metadata['help']})")
    if kind in (int, float):
        least, most = item.metadata["min"], item.metadata["max"]
        if not (abs(value) <= sys.float_info.max and least <= value <= most):  # NaN and 10**400 are not
            raise ConfigError(f"{name} = {value} is out of range {least}..{most} ({item.metadata['help']})")
    if kind is str and not value and not item.metadata.get("optional"):
        raise ConfigError(f"{name} is empty ({item.metadata['help']})")
    return kind(value)


def _names(value: Any, item: Field, name: str) -> Tuple[str, ...]:
    """A list of names as a tuple."""
    told = item.metadata["help"]
    if not (isinstance(value, (list, tuple)) and value and all(type(v) is str and v for v in value)):
        raise ConfigError(f"{name} = {value!r} is not a list of names ({told})")
    if len(value) != item.metadata.get("length", len(value)):
        raise ConfigError(f"{name} has {len(value)} names, not {item.metadata['length']} ({told})")
    return tuple(value)
