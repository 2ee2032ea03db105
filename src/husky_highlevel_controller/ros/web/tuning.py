"""Tune tab: the parameters of every dynamic_reconfigure server as a folder of fields, and as YAML."""

from __future__ import annotations

import ast
import re
import threading
from math import floor, isfinite, log10
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Tuple

import rospy
import viser
import yaml
from dynamic_reconfigure.encoding import decode_config, decode_description, encode_config
from dynamic_reconfigure.msg import Config, ConfigDescription
from dynamic_reconfigure.srv import Reconfigure

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.ros.web.actions import Actions, answer_of

DESCRIPTION = "dynamic_reconfigure/ConfigDescription"
SUFFIX = "/parameter_descriptions"
WIDEST_SLIDER = 1e4  # from min to max; a slider of a wider range cannot be set to anything sensible
STEPS = 1000  # of a slider, at least
QUIET: Tuple[int, int, int] = (95, 102, 110)  # of a button that is seldom needed


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
        names = {parameter.name for parameter in result}
        result += [parameter for parameter in parameters(group) if parameter.name not in names]
    return result


def to_yaml(values: Mapping[str, Mapping[str, Any]]) -> str:
    """Values by node as a file that `from_yaml` reads and a person can edit."""
    return str(yaml.safe_dump({node: dict(of_node) for node, of_node in values.items()}, sort_keys=True))


def from_yaml(text: str, servers: Mapping[str, List[Parameter]]) -> Dict[str, Dict[str, Any]]:
    """Checked values by node.

    Args:
        text: of the file.
        servers: the parameters of every node there is.

    Raises:
        HuskyError: it is no such file, or names an unknown node or parameter, or a value cannot be.
    """
    try:
        data = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise HuskyError(f"this is no YAML: {error}") from None
    if not isinstance(data, dict) or not all(isinstance(item, dict) for item in data.values()):
        raise HuskyError("the file must name nodes, and below each its parameters")
    return {node: _checked(node, values, servers) for node, values in data.items()}


def _checked(node: str, values: Dict[str, Any], servers: Mapping[str, List[Parameter]]) -> Dict[str, Any]:
    if node not in servers:
        raise HuskyError(f"node '{node}' has no parameters to tune; there are {', '.join(servers) or 'none'}")
    by_name = {parameter.name: parameter for parameter in servers[node]}
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


class Tuning:
    """Keeps the fields and the servers equal, both ways."""

    def __init__(self, server: viser.ViserServer, actions: Actions, tab: Any) -> None:
        self._gui, self._actions, self._tab = server.gui, actions, tab
        self.on_change: Callable[[str], None] = lambda change: None  # called with "parameter old \u2192 new"
        self._servers: Dict[str, _Server] = {}
        buttons = self._gui.add_button_group(
            "Parameters", ("Save", "Defaults"), hint="Save: download all as YAML. Defaults: reset all"
        )
        buttons.on_click(self._on_button)
        upload = self._gui.add_upload_button("Load YAML", color=QUIET, mime_type=".yaml,.yml")
        upload.on_upload(self._on_upload)

    def follow(self, published: List[Tuple[str, str]]) -> None:
        """Add folders of servers that are new, drop those of servers that are gone."""
        names = {topic[: -len(SUFFIX)] for topic, kind in published if kind == DESCRIPTION}
        for name in set(self._servers) - names:
            self._servers.pop(name).close()
        for name in sorted(names - set(self._servers)):
            with self._tab:
                self._servers[name] = _Server(name, self._gui, self._actions, self.on_change)

    def close(self) -> None:
        """Listen to no server any more."""
        self.follow([])

    def _on_button(self, event: Any) -> None:
        if event.target.value == "Save":
            values = {name: server.values for name, server in self._servers.items()}
            event.client.send_file_download("parameters.yaml", to_yaml(values).encode())
        else:
            for server in list(self._servers.values()):
                server.request({item.name: item.default for item in server.parameters}, event.client)

    def _on_upload(self, event: Any) -> None:
        text, client = event.target.value.content, event.client

        def load() -> str:
            servers = {name: server.parameters for name, server in self._servers.items()}
            try:
                changes = from_yaml(text.decode(), servers)
            except UnicodeDecodeError:
                raise HuskyError("this is no text file") from None
            for name in changes.keys() - self._servers.keys():
                raise HuskyError(f"{name} is gone")
            for name, values in changes.items():
                self._servers[name].request(values, client)
            return f"{sum(map(len, changes.values()))} values of {', '.join(changes)}"

        self._actions.do(load, client, "Load YAML")


class _Server:
    """Server of dynamic_reconfigure and its fields."""

    def __init__(
        self, name: str, gui: viser.GuiApi, actions: Actions, on_change: Callable[[str], None]
    ) -> None:
        self._name, self._gui, self._actions, self._on_change = name, gui, actions, on_change
        self.parameters: List[Parameter] = []
        self.values: Dict[str, Any] = {}
        self._description: Dict[str, Any] = {}
        self._fields: Dict[str, Any] = {}
        self._waiting: Dict[str, Any] = {}
        self._is_closed = False
        self._turn = threading.RLock()
        self._folder = gui.add_folder(name.strip("/"))
        self._subscribers = (
            rospy.Subscriber(name + SUFFIX, ConfigDescription, self._on_description),
            rospy.Subscriber(f"{name}/parameter_updates", Config, self._on_update),
        )

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.unregister()
        with self._turn:  # a message that is on its way must not change fields that are gone
            self._is_closed = True
            self._fields.clear()
            self._folder.remove()

    def request(self, values: Dict[str, Any], client: Optional[viser.ClientHandle]) -> None:
        """Ask for values; of many requests for one parameter that wait, only the last is sent."""
        with self._turn:
            is_first = not self._waiting
            self._waiting.update(values)
        if is_first:
            self._actions.do(self._send, client, self._name)

    def _send(self) -> Optional[str]:
        with self._turn:
            request, self._waiting = self._waiting, {}
        try:
            answer = answer_of(f"{self._name}/set_parameters", Reconfigure, encode_config(request))
        except HuskyError:
            self._show(self.values)
            raise
        values = decode_config(answer.config, self._description)
        self._show(values)
        refused = [
            f"{name} stays {values.get(name)}" for name, value in request.items() if values.get(name) != value
        ]
        return f"refused: {', '.join(refused)}" if refused else None

    def _on_description(self, msg: ConfigDescription) -> None:
        with self._turn:
            if self._fields or self._is_closed:
                return
            self._description = decode_description(msg)
            self.parameters = parameters(self._description)
            with self._folder:
                for parameter in self.parameters:
                    self._fields[parameter.name] = self._field(parameter)
            self._show(self.values)

    def _on_update(self, msg: Config) -> None:
        with self._turn:
            values = decode_config(msg, self._description or None)
            self._show({name: value for name, value in values.items() if name != "groups"})

    def _show(self, values: Dict[str, Any]) -> None:
        with self._turn:
            for name, value in values.items():
                if self.values.get(name, value) != value:
                    self._on_change(change_text(name, self.values[name], value))
            self.values = {**self.values, **values}
            for parameter in self.parameters:
                name, field = parameter.name, self._fields.get(parameter.name)
                if field is None or name not in self.values or name in self._waiting:
                    continue
                value = shown_value(parameter, self.values[name])
                if field.value != value:
                    field.value = value

    def _field(self, parameter: Parameter) -> Any:
        value = self.values.get(parameter.name, parameter.default)
        hint = f"{parameter.help} ({parameter.min} to {parameter.max})"
        if parameter.choices:
            field: Any = self._choice(parameter, value)
        elif parameter.kind == "bool":
            field = self._gui.add_checkbox(parameter.label, value, hint=parameter.help)
        elif parameter.kind == "str":
            field = self._gui.add_text(parameter.label, value, hint=parameter.help)
        elif parameter.has_slider:
            clamped = min(max(value, parameter.min), parameter.max)
            field = self._gui.add_slider(
                parameter.label, parameter.min, parameter.max, parameter.step, clamped, hint=hint
            )
        else:
            field = self._gui.add_number(parameter.label, value, hint=hint)
        field.on_update(lambda event: self._on_field(parameter, event))
        return field

    def _choice(self, parameter: Parameter, value: Any) -> Any:
        names = [name for name, _ in parameter.choices]
        shown = shown_value(parameter, value)
        initial = shown if shown in names else names[0]
        return self._gui.add_dropdown(parameter.label, names, initial_value=initial, hint=parameter.help)

    def _on_field(self, parameter: Parameter, event: Any) -> None:
        if event.client is None:  # set by _show
            return
        value = dict(parameter.choices).get(event.target.value, event.target.value)
        try:
            self.request({parameter.name: parameter.checked(value)}, event.client)
        except HuskyError as error:
            message = str(error)

            def refuse() -> str:
                self._show(self.values)
                raise HuskyError(message)

            self._actions.do(refuse, event.client, self._name)


def change_text(name: str, old: Any, new: Any) -> str:
    """Change of a parameter in a few letters."""
    before, after = (f"{value:g}" if isinstance(value, float) else str(value) for value in (old, new))
    return f"{name} {before} \u2192 {after}"


def shown_value(parameter: Parameter, value: Any) -> Any:
    """A value as its field shows it: one of an enumeration by its name."""
    return next((name for name, item in parameter.choices if item == value), value)
