"""ROS master as a program that can be forked; it also tells which nodes look a service up, and how often.

A call of a service goes from node to node, past everybody else. But who calls asks the master first.
"""

from __future__ import annotations

import sys
from collections import Counter, defaultdict
from typing import Any, Dict, Tuple

import rosmaster.master_api
from rosmaster.main import rosmaster_main

MAX_SERVICES, MAX_CALLERS = 100, 20  # that are counted, and of one service


class CountingMaster(rosmaster.master_api.ROSMasterHandler):
    """Master whose public methods are its XML-RPC methods."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._lookups: Dict[str, Counter[str]] = defaultdict(Counter)  # by service and caller

    def lookupService(self, caller_id: str, service: str) -> Tuple[int, str, str]:  # noqa: N802
        """Tell the URI of a service, and count who has asked."""
        code, message, uri = super().lookupService(caller_id, service)
        if code == 1 and (service in self._lookups or len(self._lookups) < MAX_SERVICES):
            callers = self._lookups[service]
            if caller_id in callers or len(callers) < MAX_CALLERS:
                callers[caller_id] += 1
        return code, message, uri

    def countLookups(self, _caller_id: str, service: str) -> Tuple[int, str, Dict[str, int]]:  # noqa: N802
        """Tell how often each node has been told the URI of a service."""
        return 1, "", dict(self._lookups[service]) if service in self._lookups else {}


def main() -> None:
    """Run it: `--core -p PORT`."""
    rosmaster.master_api.ROSMasterHandler = CountingMaster
    rosmaster_main(sys.argv)
