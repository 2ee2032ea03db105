"""Parameters of dynamic_reconfigure as fields of a page, and as YAML.

In: descriptions decoded by dynamic_reconfigure, YAML text. Out: records and values.
"""

from __future__ import annotations

import ast
import re
from math import floor, isfinite, log10
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Tuple

import yaml

from husky_highlevel_controller.datatypes import HuskyError

WIDEST_SLIDER = 1e4  # from min to max; a slider of a wider range cannot be set to anything sensible
STEPS = 1000  # of a slider, at least


class Parameter(NamedTuple):
    """Value that can be changed while its node runs."""

    name: str
    kind: str  # double, int, bool or str
    default: Any
    min: Any
    max: Any
    help: str
    choices: Tuple[Tuple[str, Any], ...] = ()  # of an enumeration: name and value

    @property
    def label(self) -> str:
        """The name with its unit, where the help text ends with one in brackets."""
        unit = re.search(r"\[[^\]]+\]\s*$", self.help)
        return f"{self.name} {unit.group().strip()}" if unit else self.name

    @property
    def has_slider(self) -> bool:
        """Whether its range is one that a slider can show."""
        return (
            self.kind in ("int", "double")
            and not self.choices
            and all(isfinite(limit) for limit in (self.min, self.max))
            and 0 < self.max - self.min <= WIDEST_SLIDER
        )

    @property
    def step(self) -> float:
        """Step of the slider: 1 for whole numbers, else a power of ten that divides the range finely."""
        if self.kind == "int":
            return 1
        return float(10.0 ** floor(log10((self.max - self.min) / STEPS)))

    def checked(self, value: Any) -> Any:
        """The value in this parameter's type.

        Raises:
            HuskyError: it is not of that type, or not within the range.
        """
        if self.kind in ("int", "double"):
            is_number = isinstance(value, (int, float)) and not isinstance(value, bool) and isfinite(value)
            if not is_number or (self.kind == "int" and value != int(value)):
                raise HuskyError(f"{self.name} = {value!r} is not a number of type {self.kind}")
            if not self.min <= value <= self.max:
                raise HuskyError(f"{self.name} = {value} is not within {self.min}..{self.max}")
            return int(value) if self.kind == "int" else float(value)
        if not isinstance(value, bool if self.kind == "bool" else str):
            raise HuskyError(f"{self.name} = {value!r} is not of type {self.kind}")
        return value


def parameters(description: Mapping[str, Any]) -> List[Parameter]:
    """Parameters of all groups of a description."""
    result = [_parameter(entry) for entry in description.get("parameters", ())]
    groups = description.get("groups", {})
    for group in groups.values() if isinstance(groups, Mapping) else groups:
        known = {parameter.name for parameter in result}
        result += [parameter for parameter in parameters(group) if parameter.name not in known]
    return result


def to_yaml(values: Mapping[str, Mapping[str, Any]]) -> str:
    """Values by node as a file that `from_yaml` reads and a person can edit."""
    return str(yaml.safe_dump({node: dict(of_node) for node, of_node in values.items()}, sort_keys=True))


def from_yaml(text: str, known: Mapping[str, List[Parameter]]) -> Dict[str, Dict[str, Any]]:
    """Checked values by node.

    Args:
        text: of the file.
        known: the parameters of every node there is.

    Raises:
        HuskyError: it is no such file, or names an unknown node or parameter, or a value cannot be.
    """
    try:
        data = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise HuskyError(f"this is no YAML: {error}") from None
    if not isinstance(data, dict) or not all(isinstance(item, dict) for item in data.values()):
        raise HuskyError("the file must name nodes, and below each its parameters")
    return {node: _checked(node, values, known) for node, values in data.items()}


def _checked(node: str, values: Dict[str, Any], known: Mapping[str, List[Parameter]]) -> Dict[str, Any]:
    if node not in known:
        raise HuskyError(f"node '{node}' has no parameters to tune; there are {', '.join(known) or 'none'}")
    by_name = {parameter.name: parameter for parameter in known[node]}
    for name in values:
        if name not in by_name:
            raise HuskyError(f"{node} has no parameter '{name}'; there are {', '.join(by_name)}")
    return {name: by_name[name].checked(value) for name, value in values.items()}


def _parameter(entry: Mapping[str, Any]) -> Parameter:
    return Parameter(
        entry["name"],
        entry["type"],
        entry["default"],
        entry["min"],
        entry["max"],
        str(entry.get("description", "")),
        _choices(entry.get("edit_method")),
    )


def _choices(edit_method: Optional[Any]) -> Tuple[Tuple[str, Any], ...]:
    """An enumeration travels as the text of a Python dictionary."""
    if isinstance(edit_method, str) and edit_method:
        try:
            edit_method = ast.literal_eval(edit_method)
        except (ValueError, SyntaxError):
            return ()
    if not isinstance(edit_method, dict):
        return ()
    return tuple((item["name"], item["value"]) for item in edit_method.get("enum", ()))
