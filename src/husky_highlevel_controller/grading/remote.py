"""Marks a hand-in on another machine: it comes as bytes, its result and files go back as bytes.

In: an `Order`. Out: a `Result`, files by their place. Must not know: who sends it, how one is judged.

The marking is a program of its own there, which keeps the hand-in's network apart and ends with its worker.
"""

from __future__ import annotations

import io
import os
import pickle
import platform
import signal
import sys
import tarfile
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple

from husky_highlevel_controller.grading import batch
from husky_highlevel_controller.grading.hand_in.overrides import Override
from husky_highlevel_controller.grading.hand_in.packages import HandIn
from husky_highlevel_controller.grading.isolation import private_network
from husky_highlevel_controller.grading.isolation.files import UnreadableFileError, read_regular, walk
from husky_highlevel_controller.grading.isolation.process import Process, end_all, request_stop, wait
from husky_highlevel_controller.grading.isolation.sandbox import Workspace
from husky_highlevel_controller.grading.reports.files import HAND_INS
from husky_highlevel_controller.grading.reports.tables import Result

MARKING_DEADLINE = 4.0 * 3600.0  # [s] of wall time for one hand-in; every part of it has one of its own
MAX_FILE = 50_000_000  # [bytes] of a file that is sent back
LEFT_THERE = ("unpacked", "ws")  # folders that are not: they are made of the hand-in
ORDER, RESULT = "order.pickle", "result.pickle"


class Parcel:
    """A file or folder that is read when it is sent, so that a class need not fit into memory."""

    def __init__(self, path: Path) -> None:
        self.path: Optional[Path] = path
        self._content = b""

    def __getstate__(self) -> Dict[str, Any]:
        """What is sent."""
        if self.path is None:
            return {"path": None, "_content": self._content}
        content = io.BytesIO()
        with tarfile.open(fileobj=content, mode="w:gz", compresslevel=1) as archive:
            archive.add(self.path, self.path.name)
        return {"path": None, "_content": content.getvalue()}

    def unpack(self, folder: Path) -> Path:
        """Lay it into an empty folder, with links and permissions as they were; its path."""
        with tarfile.open(fileobj=io.BytesIO(self._content)) as archive:
            names = archive.getnames()
            keep = {"filter": "fully_trusted"} if hasattr(tarfile, "fully_trusted_filter") else {}
            archive.extractall(folder, **keep)  # type: ignore[arg-type]
        return folder / names[0]


@dataclass(frozen=True)
class Order:
    """What to mark, and how."""

    grader: batch.Grader
    hand_in: HandIn
    override: Override
    setups: Tuple[Path, ...]  # setup.bash files that it is built on, which the worker must have
    content: Optional[Parcel]  # None: it is there


Files = Dict[str, bytes]  # content by place in the hand-in's folder of results


def order_for(grader: batch.Grader, hand_in: HandIn, override: Override, what: batch.Batch) -> Order:
    """What is sent to a worker."""
    return Order(grader, hand_in, override, what.underlay.setups, Parcel(hand_in.path))


def mark_there(order: Order) -> Tuple[Result, Files]:
    """Mark a hand-in; a task for `Workers.map`."""
    name = order.hand_in.name
    with tempfile.TemporaryDirectory(prefix="husky_grade_") as place:
        folder = Path(place)
        (folder / "hand_ins").mkdir()
        assert order.content is not None
        path = order.content.unpack(folder / "hand_ins")
        here = replace(order, hand_in=HandIn(name, path), content=None)
        (folder / ORDER).write_bytes(pickle.dumps(here))
        command = [sys.executable, "-m", __name__, str(folder)]
        process = Process(command, folder / "log", dict(os.environ), folder)
        try:
            wait(lambda: not process.running, MARKING_DEADLINE)
        finally:
            end_all([process])
        try:
            result = pickle.loads((folder / RESULT).read_bytes())
        except OSError:
            words = " ".join(process.output.split())[-500:] or f"no end after {MARKING_DEADLINE:g} s"
            problem = f"marking has failed on {platform.node()}: {words}"
            result = Result(name, "", dict(order.grader.settings), (), (), problem)
        return result, _files(folder / "out" / HAND_INS / name)


def _files(folder: Path) -> Files:
    found: List[Path] = []
    if folder.is_dir():
        found = [path for path in walk(folder) if path.relative_to(folder).parts[0] not in LEFT_THERE]
        found += [path for path in [folder / "ws" / "build.log"] if path.is_file()]
    files: Files = {}
    for path in found:
        try:
            files[path.relative_to(folder).as_posix()] = read_regular(path, MAX_FILE)
        except UnreadableFileError:  # too large, or gone
            continue
    return files


def bring_in(files: Files, mark: str, out: Path) -> None:
    """Write what came back into the hand-in's folder of results; the fingerprint last, for then it is done.

    Raises:
        OSError: such as a full disk.
    """
    for place, content in files.items():
        path = out / place
        if place != batch.FINGERPRINT:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
    if batch.FINGERPRINT in files:
        (out / batch.FINGERPRINT).write_text(mark)


def main() -> None:
    """Mark what lies in the folder of the command line."""
    private_network.enter()
    for asked in (signal.SIGINT, signal.SIGTERM):
        signal.signal(asked, lambda *_: request_stop())
    folder = Path(sys.argv[1])
    order = pickle.loads((folder / ORDER).read_bytes())
    what = batch.Batch(folder / "hand_ins", folder / "out", underlay=Workspace(setups=order.setups))
    what.out.mkdir()
    result = batch.mark_one(order.grader, order.hand_in, order.override, what)
    (folder / RESULT).write_bytes(pickle.dumps(result))


if __name__ == "__main__":
    main()
