"""ROS master as a program that can be forked; it also counts which nodes look a service up, and how often.

A call of a service goes directly from node to node. But before each call, a node looks the service up at the
master.
"""

from __future__ import annotations

import sys
from collections import Counter, defaultdict
from typing import Any, Dict, Tuple

import rosmaster.master_api
from rosmaster.main import rosmaster_main

# lookups are counted for at most MAX_SERVICES services, and for at most MAX_CALLERS callers of each service
MAX_SERVICES, MAX_CALLERS = 100, 20


class CountingMaster(rosmaster.master_api.ROSMasterHandler):
    """Master whose public methods are its XML-RPC methods."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        # number of lookups of a service by each caller; the first key is the service, the second key is the
        # caller
        self._lookups: Dict[str, Counter[str]] = defaultdict(Counter)

    def lookupService(self, caller_id: str, service: str) -> Tuple[int, str, str]:  # noqa: N802
        """Return the URI of a service, and count the lookup for `countLookups`."""
        code, message, uri = super().lookupService(caller_id, service)
        is_found = code == 1
        if is_found and (service in self._lookups or len(self._lookups) < MAX_SERVICES):
            callers = self._lookups[service]
            if caller_id in callers or len(callers) < MAX_CALLERS:
                callers[caller_id] += 1
        return code, message, uri

    def countLookups(self, _caller_id: str, service: str) -> Tuple[int, str, Dict[str, int]]:  # noqa: N802
        """Return how often each node has looked a service up."""
        return 1, "", dict(self._lookups[service]) if service in self._lookups else {}


def main() -> None:
    """Run the master; arguments are `--core -p PORT`."""
    rosmaster.master_api.ROSMasterHandler = CountingMaster
    rosmaster_main(sys.argv)
