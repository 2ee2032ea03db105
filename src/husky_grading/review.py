"""Review of the items that are graded by hand: a page on which keys give points.

Each item has pictures, replays and an excerpt of the code. The page saves the points as marking.yaml.
"""

from __future__ import annotations

import re
import sys
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import List, NamedTuple, Sequence, Tuple

from husky_grading.hand_in.class_folder import find_hand_ins
from husky_grading.isolation.files import (
    UnreadableFileError,
    texts_in,
    write_whole,
)
from husky_grading.notes import Subject
from husky_grading.recording import RECORDING, Recording
from husky_grading.records import Item, Job, MarkingResult
from husky_grading.reports.files import (
    HAND_INS,
    JOB,
    REPLAY,
    RESULT,
    RUNS_PICTURE,
    load_result,
    replays,
)
from husky_grading.reports.page import moment_of
from husky_grading.reports.plots import draw_moment
from husky_grading.settings import FILE, read_overrides, read_settings
from husky_highlevel_controller.config import ConfigError, load
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.drawing.templates import render

PAGE = "review.html"
KEYS = 9  # number of keys for points; key 1 gives no points, key 9 gives all points
MAX_CODE = 200_000  # [bytes] largest source file that is searched
MAX_SOURCES = 500  # at most this number of source files of a submission is searched
MAX_LINE = 500  # only the first characters of a line, at most this number, are searched and shown
BEFORE, AFTER = 6, 18  # number of lines of an excerpt before and after the line that was found
SOURCES = {"", ".py", ".cpp", ".cc", ".cxx", ".hpp", ".h", ".launch"}
# pattern of the line of code that the page shows for an item, by the subject of the item; for displays, the
# line is the start of RViz, or the end of a launch file without RViz
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
        """Return each key, 1 to KEYS, with the points that it gives.

        The points are rounded to halves. But the last key gives exactly all points, which need not be a
        multiple of a half.
        """
        full = self.item.max_points
        choices = []
        for key in range(1, KEYS):
            points = full * (key - 1) / (KEYS - 1)
            rounded = round(2.0 * points) / 2.0
            # no key may give more than all points; for example, 0.35 of 0.4 points would be rounded to 0.5
            choices.append((key, min(rounded, full)))
        return [*choices, (KEYS, full)]

    @property
    def alike(self) -> str:
        """Return the reason why the item is open, if other submissions may share it; otherwise empty."""
        return f"{self.item.name}: {self.item.reason.value}" if self.item.reason else ""

    @property
    def moment(self) -> bytes:
        """Return a PNG of robot, scan and marker at the item's moment; empty if there was no run.

        The picture shows the middle of the run if the item is about no single moment.
        """
        with suppress(HuskyError):  # the run has no recording
            recording: Recording = load(Recording, self.out / f"drive_{self.item.drive}" / RECORDING)
            if len(recording.times):
                middle = recording.times[-1] / 2.0  # [s]
                return draw_moment(recording, middle if self.item.at is None else self.item.at)
        return b""

    @property
    def files(self) -> List[Tuple[str, str]]:
        """Return titles and addresses, relative to the page, of the picture and the replays.

        A replay begins at the item's moment.
        """
        place = f"{HAND_INS}/{self.out.name}"  # folder of the student's result, relative to the page
        start = moment_of(self.item)  # [s] time at which a replay begins
        shown = [(f"replay of run {n}", f"{place}/drive_{n}/{REPLAY}#{start:.2f}") for n in replays(self.out)]
        if (self.out / RUNS_PICTURE).is_file():
            shown.insert(0, ("the runs from above", f"{place}/{RUNS_PICTURE}"))
        return shown

    @property
    def code(self) -> Tuple[str, str]:
        """Return the place of the first line of code that fits the item's subject, and the lines around it.

        The place is such as "src/node.cpp:12". Both are empty if no line fits.
        """
        pattern = CODE[self.item.subject]
        sources = self.out / "ws" / "src"  # folder with the student's packages, as they were built
        with suppress(UnreadableFileError):  # this error means that the build has made too many files
            for path, text in islice(texts_in(sources, SOURCES, MAX_CODE), MAX_SOURCES):
                lines = [line[:MAX_LINE] for line in text.splitlines()]
                for number, line in enumerate(lines):
                    if re.search(pattern, line):
                        first = max(number - BEFORE, 0)
                        place = f"{path.relative_to(sources)}:{number + 1}"
                        return place, "\n".join(lines[first : number + AFTER])
        return "", ""


class Marked(NamedTuple):
    """Submission that was graded."""

    result: MarkingResult
    job: Job
    place: Path  # folder of the submission's results


class Review(NamedTuple):
    """Decisions that a teacher has to make in a class."""

    items: List[OpenItem]  # items without points
    folder: Path  # folder of the submissions
    students: List[str]  # names of all students


def _marked_submissions(out: Path) -> List[Marked]:
    """Return the submissions whose results are in a folder, without those that the teacher has removed."""
    marked: List[Marked] = []
    # each submission has a folder of results, with its result and its job
    for path in sorted((out / HAND_INS).glob(f"*/{RESULT}")):
        try:
            result, job = load_result(path), load(Job, path.with_name(JOB))
        except ConfigError as error:
            print(f"a result is left out: {error}", file=sys.stderr)
            continue
        if Path(job.hand_in).exists():  # otherwise, the teacher has removed the submission from the class
            marked.append(Marked(result, job, path.parent))
    return marked


def open_items(out: Path) -> Review:
    """Return the items without points in the results of a class, the folder of the class, and its students.

    Raises:
        HuskyError: there are no results of one class, or its folder is itself a submission.
    """
    marked = _marked_submissions(out)
    folder = _folder_of_class([each.job for each in marked], out)
    hand_ins = find_hand_ins(folder)
    # names of the folders of results that belong to the present submissions. Other folders are old. For
    # example, a student's folder gets another name if two students have the same name.
    current_folders = {each.folder for each in hand_ins}
    items: List[OpenItem] = []
    students: List[str] = []
    for each in marked:
        if each.place.name in current_folders:
            students.append(each.result.name)
            open_ones = [item for item in each.result.items if item.points is None]
            items += [OpenItem(each.result.name, item, each.place) for item in open_ones]
    # students without a result are in the class, too
    students += [each.name for each in hand_ins]
    return Review(items, folder, list(dict.fromkeys(students)))  # each student once


def _folder_of_class(jobs: Sequence[Job], out: Path) -> Path:
    """Return the single folder that contains the submissions of all jobs, the results of which are in `out`.

    Raises:
        HuskyError: there is no such folder, or it is itself a submission.
    """
    folders = {Path(job.hand_in).parent for job in jobs}
    if len(folders) != 1:
        raise HuskyError(
            f"{out} has no results of one class; write them by `grade --all FOLDER --out {out}` first"
        )
    for job in jobs:
        # `grade --all FOLDER` writes FOLDER into `hidden`, because the sandbox hides the other submissions.
        # If FOLDER is itself a package, it is also the only submission. Then the file marking.yaml in it is
        # from a student, and not from the teacher.
        if job.hand_in in job.hidden:
            raise HuskyError(
                f"{job.hand_in} is itself a package, so its {FILE} does not count; put the package into "
                "a folder of your own, and run `grade --all` with that folder"
            )
    return folders.pop()


def write_review(out: Path) -> Path:
    """Write the page of a class into its folder of results, and return its path.

    Raises:
        HuskyError: there are no results, or marking.yaml is wrong.
    """
    items, folder, students = open_items(out)
    # check marking.yaml first, so that no page is written if the file has a fault
    read_overrides(folder, students)
    path = folder / FILE
    # settings that the file has already; the page keeps them and adds the points
    content = read_settings(path) if path.exists() else {}
    write_whole(out / PAGE, render("review.html", items=items, content=content, path=str(path), file=FILE))
    return out / PAGE
