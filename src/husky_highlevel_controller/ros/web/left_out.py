"""Items of the page that cannot be shown: left out, with one warning for each source."""

from __future__ import annotations

from contextlib import contextmanager
from typing import Iterator, Set

import rospy


class LeftOut:
    """Catches the errors of single items, so that none of them ends the page and its emergency stop."""

    def __init__(self) -> None:
        self._warned: Set[str] = set()

    @contextmanager
    def item(self, source: str) -> Iterator[None]:
        """Run a block that shows something of a source, such as a topic; log its first error as a warning."""
        try:
            yield
        except Exception as error:  # whatever a message holds, the page goes on
            if source not in self._warned:
                self._warned.add(source)
                rospy.logwarn(f"{source} is not shown: {type(error).__name__}: {error}")
