"""Tune tab: the parameters of every dynamic_reconfigure server as groups of fields, and as YAML."""

from __future__ import annotations

import threading
from contextlib import suppress
from typing import Any, Callable, Dict, List, Optional, Tuple

import rospy
import viser
from dynamic_reconfigure.encoding import decode_config, decode_description, encode_config
from dynamic_reconfigure.msg import Config, ConfigDescription
from dynamic_reconfigure.srv import Reconfigure

from husky_highlevel_controller.datatypes import HuskyError
from husky_web.actions import Actions, answer_of, notify
from husky_web.parameters import (
    Parameter,
    by_group,
    from_yaml,
    parameters,
    shown_value,
    to_yaml,
)

# a topic with this type of message and this end of its name belongs to a server of dynamic_reconfigure
DESCRIPTION = "dynamic_reconfigure/ConfigDescription"
SUFFIX = "/parameter_descriptions"
FOLDED = ("Detection",)  # groups of parameters whose folder is closed at the start
SMALL = '<i class="husky-small" hidden></i>'  # invisible element; viser.css makes the button after it small


class Tuning:
    """Shows the values of the servers in fields, and sends the values of changed fields to the servers."""

    def __init__(self, server: viser.ViserServer, actions: Actions, tab: Any) -> None:
        self._page, self._actions, self._tab = server, actions, tab
        gui = server.gui
        # function that is called after a change with a text such as "p_gain_vel 0.5 \u2192 0.6"
        self.on_change: Callable[[str], None] = lambda change: None
        self._servers: Dict[str, _Server] = {}  # servers by name, each with the fields of its parameters
        buttons = gui.add_button_group(
            "Parameters", ("Save", "Default values"), hint="Save: download all as YAML"
        )
        buttons.on_click(self._on_button)
        gui.add_html(SMALL)  # makes the upload button after it small
        upload = gui.add_upload_button("Load YAML", mime_type=".yaml,.yml")
        upload.on_upload(self._on_upload)

    def follow(self, published: List[Tuple[str, str]]) -> None:
        """Add the fields of new servers to the tab, and remove the fields of servers that have gone.

        `published` has the name and the message type of each topic that the ROS master knows; an empty list
        removes all fields. A server publishes its description on SERVER/parameter_descriptions.
        """
        names = {topic[: -len(SUFFIX)] for topic, kind in published if kind == DESCRIPTION}
        for name in set(self._servers) - names:
            self._servers.pop(name).close()
        for name in sorted(names - set(self._servers)):
            with self._tab:
                self._servers[name] = _Server(name, self._page, self._actions, self.on_change)

    def _on_button(self, event: Any) -> None:
        """Send all values to the browser as a file, or set every parameter to its default."""
        if event.target.value == "Save":
            values = {name: server.values for name, server in self._servers.items()}
            event.client.send_file_download(
                "parameters.yaml", to_yaml(values).encode(), save_immediately=True
            )
        else:
            # a copy, because the thread that draws may add a server meanwhile
            for server in list(self._servers.values()):
                server.request({item.name: item.default for item in server.parameters}, event.client)

    def _on_upload(self, event: Any) -> None:
        """Request the values of an uploaded YAML file from their servers."""
        text, client = event.target.value.content, event.client

        def load() -> str:
            """Return a sentence on the requested values."""
            servers = {name: server.parameters for name, server in self._servers.items()}
            try:
                changes = from_yaml(text.decode(), servers)
            except UnicodeDecodeError:
                raise HuskyError("the file is not a text file in UTF-8") from None
            # `follow` runs in another thread, so it may have removed a server since `servers` was made
            for name in changes:
                if name not in self._servers:
                    raise HuskyError(f"node '{name}' has gone; load the file again")
            for name, values in changes.items():
                self._servers[name].request(values, client)
            count = sum(len(values) for values in changes.values())
            return f"{count} values of {', '.join(changes)}"

        self._actions.do(load, client, "Load YAML")


class _Server:
    """Server of dynamic_reconfigure and its fields."""

    def __init__(
        self, name: str, page: viser.ViserServer, actions: Actions, on_change: Callable[[str], None]
    ) -> None:
        self._name, self._gui, self._actions, self._on_change = name, page.gui, actions, on_change
        # event loop in which viser receives the values that a person enters
        self._loop = page.get_event_loop()
        self.parameters: List[Parameter] = []  # empty until the server has sent its description
        self.values: Dict[str, Any] = {}  # last value of each parameter that the server has sent
        # names, types and limits of the parameters, as the dynamic_reconfigure server has sent them
        self._description: Dict[str, Any] = {}
        self._fields: Dict[str, Any] = {}  # field of each parameter in the page
        # requested value of each parameter; removed as soon as the value is sent
        self._unsent: Dict[str, Any] = {}
        # value of each parameter that is sent, but not answered yet
        self._sent: Dict[str, Any] = {}
        self._is_closed = False  # true as soon as the fields are removed, because the server has gone
        # lock of the values and fields, because callbacks of ROS and of viser come in several threads; a
        # thread that holds the lock may take it again, because `_show` is called with and without the lock
        self._lock = threading.RLock()
        self._folder = self._gui.add_folder(name.strip("/"))
        self._subscribers = (
            rospy.Subscriber(name + SUFFIX, ConfigDescription, self._on_description),
            rospy.Subscriber(f"{name}/parameter_updates", Config, self._on_update),
        )

    def close(self) -> None:
        """Unsubscribe from the server, and remove its fields."""
        for subscriber in self._subscribers:
            subscriber.unregister()
        # the lock is held, so that a late message does not change fields that are removed here
        with self._lock:
            self._is_closed = True
            self._fields.clear()
            self._folder.remove()

    def request(self, values: Dict[str, Any], client: Optional[viser.ClientHandle]) -> None:
        """Request values; if several requests for one parameter wait, only the last one is sent."""
        with self._lock:
            is_first = not self._unsent
            self._unsent.update(values)
        if is_first:  # otherwise the queued call of `_send` sends these values, too
            self._actions.do(self._send, client, self._name)

    def _send(self) -> Optional[str]:
        """Send the waiting values, show the answer, and return a sentence on rejected values, or None.

        Raises:
            HuskyError: the server does not answer.
        """
        with self._lock:
            request, self._unsent = self._unsent, {}  # values that are sent now, by name
            self._sent = request
        # the call is made without the lock, so that updates of the server can be shown meanwhile
        try:
            answer = answer_of(f"{self._name}/set_parameters", Reconfigure, encode_config(request))
        except HuskyError:
            # the fields show the server's values again, and not the requested ones
            self._end_request(self.values)
            raise
        values = self._decoded(answer.config)  # values that the server has now
        self._end_request(values)
        refused = []
        for name, value in request.items():
            if values.get(name) != value:
                refused.append(f"{name} stays {values.get(name)}")
        return f"rejected by {self._name}: {', '.join(refused)}" if refused else None

    def _end_request(self, values: Dict[str, Any]) -> None:
        """Show the values that the server has after a request."""
        # the lock is held for both lines, so that `_fill_fields` does not run between them, because it would
        # show the values from before the request
        with self._lock:
            self._sent = {}
            self._show(values)

    def _on_description(self, msg: ConfigDescription) -> None:
        """Make the fields of the server's parameters; they are made once."""
        with self._lock:
            if self._fields or self._is_closed:
                return
            self._description = decode_description(msg)
            self.parameters = parameters(self._description)
            # The parameters without a group have the group "". For the label None, viser draws no folder, so
            # these parameters are directly in the folder of the server.
            for group, members in by_group(self.parameters).items():
                is_open = group not in FOLDED
                with self._folder, self._gui.add_folder(group or None, expand_by_default=is_open):
                    for parameter in members:
                        self._fields[parameter.name] = self._field(parameter)
            self._show(self.values)

    def _on_update(self, msg: Config) -> None:
        """Show the values that the server has now, after a change by anyone."""
        with self._lock:
            self._show(self._decoded(msg))

    def _decoded(self, msg: Config) -> Dict[str, Any]:
        """Return the value of each parameter in a message of the server."""
        # without a description, `decode_config` needs None, because it fails with an empty description
        values: Dict[str, Any] = decode_config(msg, self._description or None)
        # the message also has the state of each group of parameters, which is not a parameter
        values.pop("groups", None)
        return values

    def _show(self, values: Dict[str, Any]) -> None:
        """Keep new values of the server, and show them in the fields soon."""
        with self._lock:
            for name, value in values.items():
                if self.values.get(name, value) != value:  # a first value is not a change
                    self._on_change(change_text(name, self.values[name], value))
            self.values = {**self.values, **values}
        with suppress(RuntimeError):  # raised after the end of the page, because its loop is closed
            self._loop.call_soon_threadsafe(self._fill_fields)

    def _fill_fields(self) -> None:
        """Show the kept values, except in fields whose request waits to be sent or answered.

        Only viser's event loop calls this function. In the same loop, viser puts the value that a person has
        entered into the field, and `_on_field` reads it at once. Another thread that filled the fields could
        overwrite the person's value before `_on_field` reads it, and the value would be lost.
        """
        with self._lock:
            for parameter in self.parameters:
                name, field = parameter.name, self._fields.get(parameter.name)
                is_requested = name in self._unsent or name in self._sent
                if field is None or name not in self.values or is_requested:
                    continue
                field.value = shown_value(parameter, self.values[name])

    def _field(self, parameter: Parameter) -> Any:
        """Add a field that fits the kind and the range of a parameter, and return it."""
        gui, label, hint = self._gui, parameter.label, parameter.help
        value = shown_value(parameter, self.values.get(parameter.name, parameter.default))
        low, high, default = parameter.min, parameter.max, parameter.default
        hint_with_range = f"{hint} ({low} to {high}, default {default})"
        if parameter.choices:
            names = [name for name, _ in parameter.choices]
            # the first choice is shown if the value is not one of the choices, because viser would reject the
            # value
            initial = value if value in names else names[0]
            field: Any = gui.add_dropdown(label, names, initial_value=initial, hint=hint)
        elif parameter.kind == "bool":
            field = gui.add_checkbox(label, value, hint=hint)
        elif parameter.kind == "str":
            field = gui.add_text(label, value, hint=hint)
        elif parameter.has_slider:
            clamped = min(max(value, low), high)  # viser rejects a slider whose value is outside of its range
            field = gui.add_slider(
                label, low, high, parameter.step, clamped, marks=(default,), hint=hint_with_range
            )
        else:
            field = gui.add_number(label, value, hint=hint_with_range)

        async def on_update(event: Any) -> None:
            """Read the value at once; viser would call an ordinary function later, in another thread."""
            self._on_field(parameter, event)

        field.on_update(on_update)
        return field

    def _on_field(self, parameter: Parameter, event: Any) -> None:
        """Request the value that a person has entered in a field."""
        # `event.client` is None if `_fill_fields` has changed the field, and not a page
        if event.client is None:
            return
        # a choice of an enumeration is shown by its name, but sent by its value
        value = dict(parameter.choices).get(event.target.value, event.target.value)
        try:
            self.request({parameter.name: parameter.checked(value)}, event.client)
        except HuskyError as error:
            self._show(self.values)  # the field shows the server's value again
            notify(event.client, self._name, str(error), is_good=False)


def change_text(name: str, old: Any, new: Any) -> str:
    """Return a short text on the change of a parameter, such as "p_gain_vel 0.5 \u2192 0.6"."""

    def short(value: Any) -> str:
        return f"{value:g}" if isinstance(value, float) else str(value)

    return f"{name} {short(old)} \u2192 {short(new)}"
