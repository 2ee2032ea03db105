"""Gains and limits that a user may change while the node runs, with dynamic_reconfigure.

The node keeps them in frozen dataclasses (records), so a change replaces the records.
"""

from __future__ import annotations

from dataclasses import fields, replace
from math import isfinite
from typing import Any, Dict, Tuple

import rospy
from dynamic_reconfigure.server import Server


class ReconfigureServer:
    """Keeps gains and limits in records; every change by a user replaces all records at once."""

    def __init__(self, kind: Any, *records: Any) -> None:
        """Serve the parameters of records; `kind` is the module that catkin makes from the .cfg."""
        self._records = records
        # The server calls `_apply` with the start values in its constructor. `_serving` is false then, so
        # that the start values are not logged as changes.
        self._serving = False
        self._server = _Server(kind, self._apply)
        self._serving = True

    @property
    def records(self) -> Tuple[Any, ...]:
        """The records as they are now."""
        return self._records

    def _apply(self, config: Dict[str, Any], _level: int) -> Dict[str, Any]:
        """Put new values into the records, and return the whole configuration: all values by name.

        dynamic_reconfigure calls this to answer a request of rqt_reconfigure. This method must not raise an
        error, because an error would end the thread of rqt_reconfigure that sends requests. No value causes
        an error, because the node has checked the start values, and `_Server.update_configuration` has put
        all later values into their limits.
        """
        changed = []
        for record in self._records:
            # only the fields with metadata are parameters
            old = {item.name: getattr(record, item.name) for item in fields(record) if item.metadata}
            # a new value gets the type of the old value, because YAML may give 1 for 1.0; a value that the
            # configuration does not have stays as it is
            new = {name: type(value)(config.get(name, value)) for name, value in old.items()}
            changed.append(replace(record, **new))
            config.update(new)
            for name in new:
                if self._serving and new[name] != old[name]:
                    rospy.loginfo(f"{name}: {old[name]} becomes {new[name]}")
        self._records = tuple(changed)
        return config


class _Server(Server):
    """Server of dynamic_reconfigure that warns of values out of range, and ignores NaN.

    The server of dynamic_reconfigure itself puts values into their limits without a warning, and accepts NaN.
    """

    def update_configuration(self, changes: Dict[str, Any]) -> Dict[str, Any]:
        """Apply changed values by name, and return the whole configuration; dynamic_reconfigure calls this.

        A value out of range becomes the nearest allowed one, and NaN or inf becomes the old value. Both cause
        a warning.
        """
        accepted = dict(changes)
        for name, value in changes.items():
            # only numbers have limits; `self.type` is the module that catkin makes from the .cfg
            if self.type.type.get(name) not in ("double", "int"):
                continue
            smallest, largest = self.type.min[name], self.type.max[name]
            allowed = self.config[name]  # the old value, which stays if the new one is NaN or inf
            if isfinite(value):
                allowed = min(max(value, smallest), largest)  # the nearest value within the limits
            if allowed != value:
                accepted[name] = allowed
                rospy.logwarn(
                    f"{rospy.get_name()}/{name} = {value} is out of range {smallest}..{largest}: "
                    f"clamped to {allowed}"
                )
        return super().update_configuration(accepted)
