"""Findings: faults of other nodes that only the simulator can see.

They are logged, and kept for `./dev doctor`. In: sentences on nodes, from any thread. Out: the log, and a
parameter in the simulator's namespace.
"""

from __future__ import annotations

from collections import deque
from typing import Deque, List

import rospy

from husky_highlevel_controller.ros.master_graph import FINDINGS

MAX_FINDINGS = 20  # largest number of findings that are kept; the oldest are dropped


class Findings:
    """Faults of other nodes that were found since the simulator started."""

    def __init__(self) -> None:
        """Begin without a finding."""
        self._findings: Deque[List[str]] = deque(maxlen=MAX_FINDINGS)  # node and sentence
        # true if the findings on the parameter server are out of date; it is true at first, because the
        # parameter may still have the findings of an earlier simulator
        self._is_unpublished = True

    def tell(self, node: str, sentence: str) -> None:
        """Log a sentence on a fault of a node, and keep it for `publish`."""
        rospy.logwarn(sentence)
        self._findings.append([node, sentence])
        self._is_unpublished = True

    def publish(self) -> None:
        """Store new findings as a parameter on the master.

        Only `GraphWatch` calls this, in its thread, because a slow master would delay any other thread.
        """
        if self._is_unpublished:
            self._is_unpublished = False
            rospy.set_param(FINDINGS, list(self._findings))
