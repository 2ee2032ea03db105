"""The tab of parameters: every dynamic_reconfigure server on the network as a folder of fields."""

from __future__ import annotations

import threading
from typing import Any, Callable, Dict, List, Optional, Tuple

import rospy
import viser
from dynamic_reconfigure.encoding import decode_config, decode_description, encode_config
from dynamic_reconfigure.msg import Config, ConfigDescription
from dynamic_reconfigure.srv import Reconfigure

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.ros.web.actions import Actions, answer_of
from husky_highlevel_controller.ros.web.parameters import Parameter, from_yaml, parameters, to_yaml

DESCRIPTION = "dynamic_reconfigure/ConfigDescription"
SUFFIX = "/parameter_descriptions"
QUIET: Tuple[int, int, int] = (95, 102, 110)  # of a button that is seldom needed


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
            known = {name: server.parameters for name, server in self._servers.items()}
            try:
                changes = from_yaml(text.decode(), known)
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
        self._wanted: Dict[str, Any] = {}
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
            is_waiting = bool(self._wanted)
            self._wanted.update(values)
        if not is_waiting:
            self._actions.do(self._send, client, self._name)

    def _send(self) -> Optional[str]:
        with self._turn:
            wanted, self._wanted = self._wanted, {}
        try:
            answer = answer_of(f"{self._name}/set_parameters", Reconfigure, encode_config(wanted))
        except HuskyError:
            self._show(self.values)
            raise
        taken = decode_config(answer.config, self._description)
        self._show(taken)
        refused = [name for name, value in wanted.items() if taken.get(name) != value]
        return (
            f"refused: {', '.join(f'{name} stays {taken.get(name)}' for name in refused)}"
            if refused
            else None
        )

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
                if field is None or name not in self.values or name in self._wanted:
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
