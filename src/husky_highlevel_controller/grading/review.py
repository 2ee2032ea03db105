"""Review of the items that marking leaves to a person: a page on loopback that writes marking.yaml.

Each item has a page of its own with picture, replay and an excerpt of the code; a key gives the points. The
address holds a token, so that no other page of the browser and no other user of the machine can write.
"""

from __future__ import annotations

import fcntl
import json
import re
import secrets
import sys
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, List, Tuple

import yaml

from husky_highlevel_controller.config import ConfigError
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.grading.isolation.files import (
    UnreadableFileError,
    read_text,
    walk,
    write_whole,
)
from husky_highlevel_controller.grading.notes import Subject
from husky_highlevel_controller.grading.recording import RECORDING
from husky_highlevel_controller.grading.recording import load as load_recording
from husky_highlevel_controller.grading.records import Item, Job, load
from husky_highlevel_controller.grading.reports.files import (
    HAND_INS,
    JOB,
    PICTURES,
    REPLAY,
    RESULT,
    load_result,
    replays,
)
from husky_highlevel_controller.grading.reports.page import moment_of
from husky_highlevel_controller.grading.reports.plots import draw_moment
from husky_highlevel_controller.grading.settings import FILE, read_overrides
from husky_highlevel_controller.tasks.command import exit_codes
from husky_highlevel_controller.templates import render

LOCK = f".{FILE}.lock"  # beside it; a lock of the file itself would end where it is replaced
KEYS = 9  # 1 gives nothing, 9 all points
MAX_BODY = 10_000  # [bytes] of a request
MAX_CODE = 200_000  # [bytes] of a source file that is looked into
MAX_LINE = 500  # letters of a line that are looked at
BEFORE, AFTER = 6, 18  # lines of an excerpt around the line that fits
SOURCES = {"", ".py", ".cpp", ".cc", ".cxx", ".hpp", ".h", ".launch"}
# the code that an item is about
CODE = {
    Subject.DISPLAYS: r"pkg=.rviz|</launch>",
    Subject.MARKER_DISPLAY: r"pkg=.rviz|</launch>",
    Subject.MARKER: r"Marker(?!Array)[^A;(=]{0,80}[;(=]",
    Subject.SERVICE: r"SetBool",
    Subject.DRIVE: r"linear\.x",
    Subject.CODE: r"NodeHandle|init_node",
}


@dataclass(frozen=True)
class OpenItem:
    """Item of one student without points."""

    student: str
    item: Item
    out: Path  # folder of the student's result

    @property
    def choices(self) -> List[Tuple[int, float]]:
        """(key, points) of each key."""
        return [
            (key, round(2.0 * self.item.max_points * (key - 1) / (KEYS - 1)) / 2.0)
            for key in range(1, KEYS + 1)
        ]

    @property
    def pictures(self) -> List[bytes]:
        """PNGs: robot, scan and marker at the item's moment, else in mid-drive; the drives."""
        moment = []
        with suppress(HuskyError):
            recording = load_recording(self.out / f"drive_{self.item.drive}" / RECORDING, "")
            if len(recording.times):
                at = recording.times[-1] / 2.0 if self.item.at is None else self.item.at
                moment = [draw_moment(recording, at)]
        paths = [self.out / PICTURES[0]]
        return moment + [path.read_bytes() for path in paths if path.is_file()]

    @property
    def start(self) -> float:
        """Moment at which the replays begin [s]."""
        return moment_of(self.item)

    @property
    def replays(self) -> List[int]:
        """Numbers of the drives with a replay."""
        return list(replays(self.out))

    @property
    def code(self) -> Tuple[str, str]:
        """Place and lines of the code that the item is about; empty: there is none."""
        pattern = CODE[self.item.subject]
        sources = self.out / "ws" / "src"
        for path in walk(sources) if sources.is_dir() else ():
            if path.suffix in SOURCES and path.name != "CMakeLists.txt":
                with suppress(UnreadableFileError):
                    lines = [line[:MAX_LINE] for line in read_text(path, MAX_CODE).splitlines()]
                    for number, line in enumerate(lines):
                        if re.search(pattern, line):
                            first = max(number - BEFORE, 0)
                            place = f"{path.relative_to(sources)}:{number + 1}"
                            return place, "\n".join(lines[first : number + AFTER])
        return "", ""


class Review:
    """Open items of a class, and the points that a person gives them."""

    def __init__(self, out: Path) -> None:
        """Read the results of `grade --all`.

        Raises:
            HuskyError: there are none.
        """
        self.items: List[OpenItem] = []
        self.students: List[str] = []
        folders = set()
        for path in sorted((out / HAND_INS).glob(f"*/{RESULT}")):
            try:
                result, job = load_result(path), load(Job, path.with_name(JOB))
            except ConfigError as error:
                print(f"left out: {error}", file=sys.stderr)
                continue
            if not Path(job.hand_in).exists():
                continue  # a student who is gone
            self.students.append(result.name)
            folders.add(Path(job.hand_in).parent)
            open_items = [item for item in result.items if item.points is None]
            self.items += [OpenItem(result.name, item, path.parent) for item in open_items]
        if len(folders) != 1:
            raise HuskyError(
                f"{out}: no results of one class, as `grade --all FOLDER --out {out}` writes them"
            )
        self.folder = folders.pop()

    @property
    def given(self) -> List[bool]:
        """Whether each item has points in marking.yaml.

        Raises:
            ConfigError: the file is wrong.
        """
        overrides = read_overrides(self.folder, self.students)
        return [
            each.student in overrides and each.item.name in overrides[each.student].points
            for each in self.items
        ]

    def alike(self, number: int) -> List[OpenItem]:
        """The item, and the open ones of its name that are open for the same reason."""
        each = self.items[number]
        if each.item.reason is None:
            return [each]
        subject = each.item.name, each.item.reason
        return [other for other in self.items if (other.item.name, other.item.reason) == subject]

    def give(self, number: int, points: float, word: str, to_all_alike: bool = False) -> None:
        """Write the points of an item into marking.yaml; its other entries stay, comments do not.

        Raises:
            ConfigError: the points are not allowed, or the file is wrong.
        """
        each = self.items[number]
        if not 0.0 <= points <= each.item.max_points:
            raise ConfigError(f"{each.item.name}: {points!r} is not in 0..{each.item.max_points:g}")
        path = self.folder / FILE
        with (self.folder / LOCK).open("a") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # another review of this class may write
            read_overrides(self.folder, self.students)  # or its error, before anything is written
            before = path.read_text(encoding="utf-8") if path.exists() else ""
            content: Any = yaml.safe_load(before) or {}
            given = {"points": points, "word": word or "seen by a person"}
            for other in self.alike(number) if to_all_alike else [each]:
                _below(content, "students", other.student, "points")[other.item.name] = dict(given)
            if "#" in before and not path.with_suffix(".yaml.before").exists():
                write_whole(path.with_suffix(".yaml.before"), before)
            write_whole(path, yaml.safe_dump(content, sort_keys=False, allow_unicode=True))


def _below(content: Any, *keys: str) -> Any:
    """The mapping at a path of keys, made where there is none or nothing after a key."""
    for key in keys:
        content[key] = content.get(key) or {}
        content = content[key]
    return content


def make_server(review: Review) -> Tuple[ThreadingHTTPServer, str]:
    """A server on a free port of loopback, and the address of its first page."""
    token = secrets.token_urlsafe(24)

    class Handler(BaseHTTPRequestHandler):
        def log_message(self, *_: Any) -> None:
            """Print nothing."""

        def parts(self) -> List[str]:
            """Parts of the path behind the token; refused without it, or from another page."""
            hosts = {f"127.0.0.1:{server.server_port}", f"localhost:{server.server_port}"}
            origin = self.headers.get("Origin")
            head, *parts = self.path.lstrip("/").split("/")
            known = secrets.compare_digest(head.encode(), token.encode())
            if not known or self.headers.get("Host") not in hosts:
                raise PermissionError
            if origin is not None and origin.partition("://")[2] not in hosts:
                raise PermissionError
            return [part for part in parts if part]

        def answer(self, status: HTTPStatus, text: str, kind: str = "text/html") -> None:
            content = text.encode("utf-8", "backslashreplace")
            self.send_response(status)
            for name, value in (
                ("Content-Type", f"{kind}; charset=utf-8"), ("Content-Length", str(len(content))),
                ("Referrer-Policy", "no-referrer"), ("Cache-Control", "no-store"),
            ):  # fmt: skip
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(content)

        def do_GET(self) -> None:
            """Show an item, or the replay of one of its drives."""
            self.serve(self.show)

        def do_POST(self) -> None:
            """Take the points of an item."""
            self.serve(self.take)

        def serve(self, act: Any) -> None:
            try:
                act(self.parts())
            except PermissionError:
                self.answer(HTTPStatus.FORBIDDEN, "forbidden")
            except (
                ValueError,
                KeyError,
                IndexError,
                TypeError,
                RecursionError,
                OSError,
                HuskyError,
            ) as error:
                self.answer(HTTPStatus.BAD_REQUEST, str(error), "text/plain")

        def show(self, parts: List[str]) -> None:
            flags = review.given
            if not parts:
                parts = [str(flags.index(False) if False in flags else len(flags))]
            number = int(parts[0])
            if len(parts) == 2:
                self.answer(
                    HTTPStatus.OK, read_text(review.items[number].out / f"drive_{int(parts[1])}" / REPLAY)
                )
                return
            each = review.items[number] if number < len(flags) else None
            self.answer(
                HTTPStatus.OK,
                render(
                    "review.html", each=each, index=number, count=len(flags), given=sum(flags),
                    alike=len(review.alike(number)) if each else 0,
                    base=f"/{token}", file=str(review.folder / FILE),
                ),
            )  # fmt: skip

        def take(self, parts: List[str]) -> None:
            length = int(self.headers.get("Content-Length", "0"))
            if not 0 < length <= MAX_BODY:
                raise ValueError(f"a request of {length} bytes")
            body = json.loads(self.rfile.read(length))
            review.give(
                int(parts[0]), float(body["points"]), str(body["word"])[:200], body.get("alike") is True
            )
            self.answer(HTTPStatus.OK, "{}", "application/json")

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    return server, f"http://127.0.0.1:{server.server_port}/{token}/"


def serve(out: Path) -> None:
    """Serve the review of a class until Ctrl-C.

    Raises:
        HuskyError: there are no results.
    """
    review = Review(out)
    server, address = make_server(review)
    print(f"{len(review.items)} items to review: {address}", flush=True)
    print("Ctrl-C ends it; then `grade --all` with the same options judges again", flush=True)
    with suppress(KeyboardInterrupt):
        server.serve_forever()
    server.server_close()


if __name__ == "__main__":
    with exit_codes("grade"):
        serve(Path(sys.argv[1]))
