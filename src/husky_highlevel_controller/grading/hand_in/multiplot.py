"""Curves in the configuration files of rqt_multiplot in a package."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Tuple

from defusedxml import ElementTree
from defusedxml.common import DefusedXmlException

from husky_highlevel_controller.grading.isolation.files import UnreadableFileError, read_regular, walk

MAX_FILE = 1_000_000  # [bytes]
UNREADABLE = (  # no XML, entities, an unknown encoding, elements nested deeper than any such file's
    UnreadableFileError, ElementTree.ParseError, DefusedXmlException, ValueError, LookupError, RecursionError,
)  # fmt: skip
MAX_CURVES, MAX_NAME = 100, 200  # of a package; letters of a topic or field


def curves_in(package: Path) -> Tuple[Tuple[str, str], ...]:
    """Quantities of each curve on x and on y, as /topic/field."""
    curves = []
    for path in walk(package):
        if path.suffix == ".xml":
            with contextlib.suppress(*UNREADABLE):
                root = ElementTree.fromstring(read_regular(path, MAX_FILE))
                for axes in root.iter("axes") if root.tag == "rqt_multiplot" else ():
                    sides = [axes.find(side) for side in ("x_axis", "y_axis")]
                    names = [
                        (side.findtext("topic"), side.findtext("field")) for side in sides if side is not None
                    ]
                    if len(names) == 2 and all(map(all, names)):
                        x, y = (f"/{topic.strip('/')}/{field}"[:MAX_NAME] for topic, field in names)
                        curves.append((x, y))
    return tuple(curves[:MAX_CURVES])
