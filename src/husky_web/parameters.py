"""Parameters of dynamic_reconfigure servers: kinds, ranges, groups, and YAML files of values.

In: a server's description. Out: records.
"""

from __future__ import annotations

import ast
import re
from math import floor, isfinite, log10
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import yaml

from husky_highlevel_controller.datatypes import HuskyError

WIDEST_SLIDER = 1e4  # largest range of a parameter with a slider; in a wider range, a slider is too coarse
STEPS = 1000  # smallest number of steps of a slider
# groups in which the page shows the controller's parameters, with the prefixes of their names; the controller
# itself has no groups, because the command dynparam needs parameters without groups
GROUPS = {
    "Gains": ("p_gain_",),
    "Limits": ("max_linear", "max_angular", "stop_distance", "arrival_"),
    "Search": ("search",),
    "Detection": ("pillar_", "radius_", "max_residual", "range_noise", "min_beams"),
}


class Parameter(NamedTuple):
    """Value that can be changed while its node runs."""

    name: str
    kind: str  # type of the parameter: double, int, bool or str
    default: Any
    min: Any
    max: Any
    help: str
    choices: Tuple[Tuple[str, Any], ...] = ()  # name and value of each choice of an enumeration
    server_group: str = ""  # group that the dynamic_reconfigure server gives the parameter

    @property
    def group(self) -> str:
        """Return the group in the page; empty if it has none."""
        if self.server_group:
            return self.server_group
        for group, beginnings in GROUPS.items():
            if self.name.startswith(beginnings):
                return group
        return ""

    @property
    def label(self) -> str:
        """Return the text beside the field: the parameter's name, its unit, and its default.

        The unit is left out if the help text does not end with a unit. The default is left out if the field
        is a slider, because a slider marks its default.
        """
        label = self.name
        unit = re.search(r"\[[^\]]+\]\s*$", self.help)  # such as [m/s]
        if unit:
            label += f" {unit.group().strip()}"
        if self.has_slider:
            return label
        on_or_off = "on" if self.default else "off"
        default = on_or_off if self.kind == "bool" else shown_value(self, self.default)
        return f"{label} (default {default})"

    @property
    def has_slider(self) -> bool:
        """Return whether a slider can show its range."""
        return (
            self.kind in ("int", "double")
            and not self.choices
            and all(isfinite(limit) for limit in (self.min, self.max))
            and 0 < self.max - self.min <= WIDEST_SLIDER
        )

    @property
    def step(self) -> float:
        """Return the step of the slider: 1 for whole numbers, otherwise a small power of ten."""
        if self.kind == "int":
            return 1
        return float(10.0 ** floor(log10((self.max - self.min) / STEPS)))

    def checked(self, value: Any) -> Any:
        """Return a value in this parameter's type.

        Raises:
            HuskyError: the value has another type, or is not within the range.
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


def parameters(description: Mapping[str, Any], group_name: str = "") -> List[Parameter]:
    """Return the parameters of a description and of the groups in it.

    If the same name is in several lists, such as in the list of a group and in the list of its subgroup, only
    the first parameter with this name is returned.

    Args:
        description: decoded description of a server, or of one of its groups.
        group_name: name of this group; empty for the whole description.
    """
    result = []
    for entry in description.get("parameters", ()):
        parameter = Parameter(
            name=entry["name"],
            kind=entry["type"],
            default=entry["default"],
            min=entry["min"],
            max=entry["max"],
            help=str(entry.get("description", "")),
            choices=_choices(entry.get("edit_method")),
            server_group=group_name,
        )
        result.append(parameter)
    groups = description.get("groups", {})  # groups by name, or a list of groups
    for group in groups.values() if isinstance(groups, Mapping) else groups:
        names = {parameter.name for parameter in result}
        of_group = parameters(group, str(group.get("name", "")))
        result += [parameter for parameter in of_group if parameter.name not in names]
    return result


def by_group(all_parameters: Sequence[Parameter]) -> Dict[str, List[Parameter]]:
    """Return parameters by their groups: no group first, then GROUPS, then the server's own groups."""
    groups: Dict[str, List[Parameter]] = {name: [] for name in ("", *GROUPS)}
    for parameter in all_parameters:
        groups.setdefault(parameter.group, []).append(parameter)
    return {name: members for name, members in groups.items() if members}


def to_yaml(values: Mapping[str, Mapping[str, Any]]) -> str:
    """Return values by node as YAML for `from_yaml`, which people can edit."""
    return str(yaml.safe_dump({node: dict(of_node) for node, of_node in values.items()}, sort_keys=True))


def from_yaml(text: str, servers: Mapping[str, List[Parameter]]) -> Dict[str, Dict[str, Any]]:
    """Return checked values by node.

    Args:
        text: text of the file.
        servers: parameters of all nodes, by node.

    Raises:
        HuskyError: the text has no parameters, an unknown node or parameter, or a wrong value.
    """
    try:
        data = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise HuskyError(f"the file is not valid YAML: {error}") from None
    if not isinstance(data, dict) or not all(isinstance(item, dict) for item in data.values()):
        raise HuskyError("the file must have names of nodes, and below each node its parameters")
    return {node: _checked(node, values, servers) for node, values in data.items()}


def _checked(node: str, values: Dict[str, Any], servers: Mapping[str, List[Parameter]]) -> Dict[str, Any]:
    """Return the values of a node in the types of its parameters.

    Raises:
        HuskyError: the node or a parameter is unknown, or a value is wrong.
    """
    if node not in servers:
        raise HuskyError(
            f"node '{node}' has no parameters to tune; there are: {', '.join(servers) or 'none'}"
        )
    by_name = {parameter.name: parameter for parameter in servers[node]}
    for name in values:
        if name not in by_name:
            raise HuskyError(f"{node} has no parameter '{name}'; there are: {', '.join(by_name)}")
    return {name: by_name[name].checked(value) for name, value in values.items()}


def _choices(edit_method: Optional[Any]) -> Tuple[Tuple[str, Any], ...]:
    """Return the choices of an enumeration, which is sent as the text of a Python dictionary."""
    if isinstance(edit_method, str) and edit_method:
        try:
            edit_method = ast.literal_eval(edit_method)
        except (ValueError, SyntaxError):
            return ()
    if not isinstance(edit_method, dict):
        return ()
    return tuple((item["name"], item["value"]) for item in edit_method.get("enum", ()))


def shown_value(parameter: Parameter, value: Any) -> Any:
    """Return a value as its field shows it; a choice of an enumeration is shown by its name."""
    for name, value_of_choice in parameter.choices:
        if value_of_choice == value:
            return name
    return value
