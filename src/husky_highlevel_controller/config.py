"""Typed records from ROS parameters, YAML or JSON: one reader, whose errors name file, key and value.

A field's `metadata` describes it: "min" and "max" bound a number, "help" says what it is, "choices" lists the
texts that are allowed, "length" is the length of a tuple, "shape" is the shape of an array, and with
"optional" a text may be empty. A field without `metadata` is not a ROS parameter, but a file may set it.
A record raises ValueError in its `__post_init__` if two of its values do not fit together.
"""

from __future__ import annotations

import json
import sys
import typing
from collections import abc
from dataclasses import MISSING, Field, field, fields, is_dataclass, replace
from enum import Enum
from functools import lru_cache
from math import isfinite
from pathlib import Path
from typing import Any, Dict, List, Mapping, Sequence, Set, Type, TypeVar

import numpy as np

from husky_highlevel_controller.datatypes import HuskyError

Record = TypeVar("Record")
# names of types in errors about files; errors about parameters use Python's names, such as float
_TYPE_NAMES = {str: "text", int: "whole number", float: "number", bool: "truth value"}


class ConfigError(HuskyError):
    """A parameter that is missing, unknown, or not allowed."""


def setting(help_text: str, default: Any = MISSING, **limits: Any) -> Any:
    """Field of a record that a user may set; it must be given if it has no default."""
    return field(default=default, metadata={**limits, "help": help_text})


def number(low: float, high: float, help_text: str, default: Any = MISSING) -> Any:
    """Field of a record for a number from `low` to `high`, that a user may set; otherwise like `setting`."""
    return setting(help_text, default, min=low, max=high)


def read_config(values: Mapping[str, Any], source: str, *records: Type) -> List[Any]:
    """Make one instance of each record class from one set of parameters, all of which must be given.

    Fields without `metadata` are not parameters, so they keep their defaults.

    Args:
        values: parameter names and values; nested records are nested mappings.
        source: origin of the values for error texts, such as a file or a namespace ending in '/'.
        *records: dataclasses.

    Raises:
        ConfigError: a parameter is missing, unknown to all records, of the wrong type or out of range.
    """
    known_names: Set[str] = set()
    results = []
    for record in records:
        known_names |= {item.name for item in fields(record) if item.metadata}
        results.append(_record(record, values, source, from_parameters=True))
    unknown = sorted(set(values) - known_names)
    if unknown:
        there_are = ", ".join(sorted(known_names))
        raise ConfigError(f"{source}{unknown[0]} is not a parameter; there are: {there_are}")
    return results


def replace_parameters(record: Record, values: Mapping[str, Any], source: str = "") -> Record:
    """Return a record with changed parameters.

    Args:
        record: a dataclass, which stays as it is.
        values: new values by paths such as "lidar/noise", for fields of nested records. A path that is not a
            field is ignored, so the caller must check the paths.
        source: origin of the values for error texts, such as a namespace ending in '/'.

    Raises:
        ConfigError: a value is not allowed.
    """
    # new values by field name, then by the path inside the field; for example, {"lidar/noise": 1.0} becomes
    # {"lidar": {"noise": 1.0}}. The path is empty if the value is for the field itself.
    values_by_field: Dict[str, Dict[str, Any]] = {}
    for path, value in values.items():
        name, _, path_inside = path.partition("/")
        values_by_field.setdefault(name, {})[path_inside] = value
    hints, changed = _hints(typing.cast(Any, type(record))), {}  # `hints` has the type of each field
    for item in fields(record):  # type: ignore[arg-type]
        full_name, new_values = source + item.name, values_by_field.get(item.name, {})
        if "" in new_values:
            changed[item.name] = _value(
                hints[item.name], new_values[""], full_name, item.metadata, from_parameters=True
            )
        elif new_values:
            nested = getattr(record, item.name)
            changed[item.name] = replace_parameters(nested, new_values, full_name + "/")
    try:
        return typing.cast(Record, replace(record, **changed))  # type: ignore[type-var]
    except ValueError as error:  # the record's own check found two values that do not fit together
        raise ConfigError(f"{source}{error}") from None


def from_plain(kind: Type[Record], value: Any, source: str) -> Record:
    """Make a record from the content of a YAML or JSON file; fields with a default may be absent.

    Args:
        kind: a dataclass; its fields are plain values, arrays, records, sequences, mappings, or optional.
        value: mappings, lists and plain values.
        source: origin of the values for error texts, such as "marking.yaml: ".

    Raises:
        ConfigError: a key is missing or unknown, or a value does not suit its field.
    """
    if not isinstance(value, abc.Mapping):
        raise ConfigError(f"{source}{_short(value)} is not a mapping")
    names = [item.name for item in fields(kind)]  # type: ignore[arg-type]
    for key in value:
        if key not in names:
            raise ConfigError(f"{source}{key!r} is not known; there are: {', '.join(names)}")
    return typing.cast(Record, _record(kind, value, source, from_parameters=False))


def to_plain(value: Any) -> Any:
    """Convert a record to JSON's types: mappings, lists and plain values; arrays rounded to four decimals."""
    if type(value) in _TYPE_NAMES:  # most values of a recording are plain, so they are tested first
        return value
    if is_dataclass(value):
        return {item.name: to_plain(getattr(value, item.name)) for item in fields(value)}
    if isinstance(value, np.ndarray):
        return np.round(value, 4).tolist()
    if isinstance(value, abc.Mapping):
        return {key: to_plain(each) for key, each in value.items()}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, (list, tuple)):
        return [to_plain(each) for each in value]
    return value


def to_json(record: Any, **more: Any) -> str:
    """Return a record as the text of a JSON file, which `load` reads.

    `more` has further keys and values, for other programs that read the file. NaN and infinity become null.
    """
    text = json.dumps({**to_plain(record), **more})
    # Python writes NaN, Infinity and -Infinity, which are not allowed in JSON. They are the only words for
    # which `loads` calls `parse_constant`.
    without_nan = json.loads(text, parse_constant=lambda _: None)
    return json.dumps(without_nan, indent=2) + "\n"


def load(kind: Type[Record], path: Path, *ignored: str) -> Record:
    """Return a record from its JSON file; the keys `ignored` are not read, because other programs need them.

    Raises:
        ConfigError: the file cannot be read, or has another kind of record.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:  # `strerror` is the reason without the path, which the text has already
        raise ConfigError(f"{path}: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:  # the text is not JSON, or is nested too deeply
        raise ConfigError(f"{path}: {error}") from None
    if isinstance(content, dict):
        content = {key: value for key, value in content.items() if key not in ignored}
    return from_plain(kind, content, f"{path}: ")


def _record(kind: Any, values: Mapping[str, Any], source: str, from_parameters: bool) -> Any:
    """Make an instance of a record class from the values of its fields by name.

    Keys that are not fields are ignored, so the caller checks them.

    Args:
        kind: the record class.
        values: plain values, by the names of the fields.
        source: beginning of the name of each value in messages, such as "/husky_simulator/" or "FILE: ".
        from_parameters: true if the values are ROS parameters. Fields with metadata are parameters, and must
            all be given; the other fields keep their defaults. If false, the values are from a file, and each
            field with a default may be absent.
    """
    hints, values_by_field = _hints(kind), {}
    for item in fields(kind):
        if from_parameters and not item.metadata:
            continue
        if item.name in values:
            name = source + item.name
            values_by_field[item.name] = _value(
                hints[item.name], values[item.name], name, item.metadata, from_parameters
            )
        elif from_parameters or _is_required(item):
            raise ConfigError(f"{source}{item.name} is missing{_help_text(item.metadata)}")
    try:
        return kind(**values_by_field)
    except ValueError as error:  # the record rejects two values that do not fit together
        raise ConfigError(f"{source}{error}") from None


@lru_cache(maxsize=None)
def _hints(kind: Any) -> Dict[str, Any]:
    """Return the type of each field of a record; kept, because it takes long and a file has many records."""
    return typing.get_type_hints(kind)


def _is_required(item: Field) -> bool:
    """Return whether a field has no default, so that a file must give it."""
    return item.default is MISSING and item.default_factory is MISSING


def _value(kind: Any, value: Any, name: str, metadata: Mapping[str, Any], from_parameters: bool) -> Any:
    """Return a value from YAML or JSON as the type of a field; ConfigError if it does not fit.

    Args:
        kind: type of the field, such as float, Optional[int], a record or a tuple of types.
        value: plain value.
        name: path of the value, for messages.
        metadata: limits of the field, such as `min`, `max` and `choices`.
        from_parameters: true for parameters, all of which must be given; false for a YAML or JSON file, in
            which fields with a default may be absent.
    """
    if type(value) is kind and kind in _TYPE_NAMES and not metadata:
        return value  # most values of a recording are plain values without limits, so they are tested first
    # for example, Tuple[float, ...] has the origin tuple and the arguments (float, ...)
    origin, args = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Union:  # Optional[X] is a short form of Union[X, None]
        return None if value is None else _value(args[0], value, name, metadata, from_parameters)
    if is_dataclass(kind):
        return _nested_record(typing.cast(Type, kind), value, name, from_parameters)
    if hasattr(kind, "_fields"):  # a named tuple
        hints = list(_hints(kind).values())
        return kind(*_items(hints, value, name, metadata, from_parameters))
    # a list or tuple of any length, whose elements have one type
    if origin is abc.Sequence or (origin is tuple and args[-1] is Ellipsis):
        kinds: Sequence[Any] = [args[0]] * len(_checked_list(value, name, metadata))
        return _items(kinds, value, name, metadata, from_parameters)
    if origin is tuple:
        return _items(args, value, name, metadata, from_parameters)
    if origin in (dict, abc.Mapping):
        return _mapping(args[1], value, name, metadata, from_parameters)
    if isinstance(kind, type) and issubclass(kind, Enum):
        choices = {"choices": [each.value for each in kind]}
        # a parameter never has an Enum type, so the value comes from a file
        return kind(_plain_value(str, value, name, choices, from_parameters=False))
    if kind is np.ndarray:
        return _array(value, name, metadata["shape"])
    if kind is Path:
        return Path(_plain_value(str, value, name, metadata, from_parameters))
    return _plain_value(kind, value, name, metadata, from_parameters)


def _nested_record(kind: Type[Record], value: Any, name: str, from_parameters: bool) -> Record:
    """Return a record inside another one from its value; ConfigError if it does not fit.

    `name` is the path of the record, for messages. `from_parameters` is true for parameters, and false for a
    YAML or JSON file.
    """
    if from_parameters:
        if not isinstance(value, abc.Mapping):
            raise ConfigError(f"{name} = {value!r} is not a set of parameters")
        (record,) = read_config(value, name + "/", kind)
        return typing.cast(Record, record)
    has_defaults_only = all(not _is_required(item) for item in fields(kind))  # type: ignore[arg-type]
    if value is None and has_defaults_only:
        value = {}  # a YAML key with nothing after it has the value None; the record then gets its defaults
    # `source` is the start of each error: "name/key is missing" for a key of the record, but "name = 3 is not
    # a mapping" for a value that cannot be a record
    source = f"{name}/" if isinstance(value, dict) else f"{name} = "
    return from_plain(kind, value, source)


def _mapping(
    kind: Any, value: Any, name: str, metadata: Mapping[str, Any], from_parameters: bool
) -> Dict[str, Any]:
    """Return a mapping whose values have the type `kind`; ConfigError if one does not fit.

    Args:
        kind: type of each value.
        value: the mapping.
        name: path of the mapping, for messages.
        metadata: limits of the field, which count for each value.
        from_parameters: true for parameters; false for a YAML or JSON file.
    """
    if value is None and not from_parameters:
        value = {}  # a YAML key with nothing after it has the value None; it counts as an empty mapping
    if not isinstance(value, abc.Mapping):
        raise ConfigError(f"{name} = {_short(value)} is not a mapping")
    return {
        str(key): _value(kind, each, f"{name}/{key}", metadata, from_parameters)
        for key, each in value.items()
    }


def _items(kinds: Any, value: Any, name: str, metadata: Mapping[str, Any], from_parameters: bool) -> Any:
    """Return the entries of a list as a tuple; ConfigError if one is wrong, or their number is wrong.

    Args:
        kinds: a type for each entry. For Tuple[X, ...] and Sequence[X], the caller repeats X for each entry,
            so the list may have any number of entries.
        value: the list.
        name: path of the list, for messages.
        metadata: limits of the field, which count for each entry; "length" is the number of entries.
        from_parameters: true for parameters; false for a YAML or JSON file.
    """
    entries = _checked_list(value, name, metadata)
    length = metadata.get("length", len(kinds))
    has_type_for_each = len(entries) == len(kinds)
    if len(entries) != length or not has_type_for_each:
        raise ConfigError(f"{name} has {len(entries)} entries, not {length}{_help_text(metadata)}")
    values = []
    for index, (kind, entry) in enumerate(zip(kinds, entries)):
        values.append(_value(kind, entry, f"{name}/{index}", metadata, from_parameters))
    return tuple(values)


def _checked_list(value: Any, name: str, metadata: Mapping[str, Any]) -> Any:
    """Return a value that is a list or tuple; ConfigError if it is not."""
    if not isinstance(value, (list, tuple)):
        raise ConfigError(f"{name} = {_short(value)} is not a list{_help_text(metadata)}")
    return value


def _array(value: Any, name: str, shape: Any) -> np.ndarray:
    """Return a list of numbers, which may be nested, as a read-only array; ConfigError if they do not fit."""
    try:
        array = np.array(value, dtype=float).reshape(shape)
    except (ValueError, TypeError) as error:
        raise ConfigError(f"{name}: {error}") from None
    array.setflags(write=False)
    return array


def _plain_value(kind: Any, value: Any, name: str, metadata: Mapping[str, Any], from_parameters: bool) -> Any:
    """Return a number, text or truth value as its type; ConfigError if it does not fit.

    Args:
        kind: type of the field.
        value: the number, text or truth value.
        name: path of the value, for messages.
        metadata: limits of the field, such as `min`, `max` and `choices`.
        from_parameters: true for parameters; false for a YAML or JSON file.
    """
    help_text = _help_text(metadata)
    if kind is Any:
        return value
    # YAML reads 1 as an int, so an int is accepted for a float
    is_int_for_float = kind is float and type(value) is int
    if type(value) is not kind and not is_int_for_float:
        # an error about a parameter calls the type "float", and an error about a file calls it "number"
        type_name = kind.__name__ if from_parameters else _TYPE_NAMES[kind]
        raise ConfigError(f"{name} = {_short(value)} is not a {type_name}{help_text}{_exponent_hint(value)}")
    if "min" in metadata and kind in (int, float):
        low, high = metadata["min"], metadata["max"]
        # this condition also rejects NaN, and an int too large for a float, such as 10**400
        if not (abs(value) <= sys.float_info.max and low <= value <= high):
            raise ConfigError(f"{name} = {value} is out of range {low}..{high}{help_text}")
    if "choices" in metadata and value not in metadata["choices"]:
        raise ConfigError(f"{name} = {value!r} is not one of: {', '.join(metadata['choices'])}")
    # an empty text is a mistake, unless the field is optional or has no metadata
    if kind is str and not value and metadata and not metadata.get("optional"):
        raise ConfigError(f"{name} is empty{help_text}")
    if kind is float:
        return float(value) + 0.0  # -0.0 becomes 0.0, because NumPy rejects -0.0 as a standard deviation
    return kind(value)


def _exponent_hint(value: Any) -> str:
    """Return the end of an error about a text such as 1e-1; empty if the text is not such a number.

    The user means a number, but YAML 1.1 reads it as text, because it has no decimal point, or its exponent
    has no sign.
    """
    if not (isinstance(value, str) and "e" in value.lower()):
        return ""
    try:
        number_meant = float(value)
    except ValueError:
        return ""
    return f"; YAML reads it as text, write {number_meant!r}" if isfinite(number_meant) else ""


def _help_text(metadata: Mapping[str, Any]) -> str:
    """Return the help of a field in brackets, for the end of an error; empty if it has none."""
    return f" ({metadata['help']})" if "help" in metadata else ""


def _short(value: Any) -> str:
    """Return a value as text for an error, without the end of a long one."""
    text = repr(value)
    return text if len(text) <= 100 else text[:100] + "..."
