"""HTML: one page of a class for the teacher, one self-contained feedback for each student."""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple
from urllib.parse import quote

from husky_grading.records import AUTO, Item, MarkingResult, ResultState
from husky_highlevel_controller.drawing.templates import render

LEAD = 1.0  # [s] simulated time by which a replay begins earlier than the moment of the evidence
BARS = 10  # number of bars of the histogram below 100 % of the points; 100 % has one more bar
BAR_HEIGHT = 60  # [pixels] height of the highest bar
# CSS class of a result's state; the page counts the results of each state in this order
COLOURS = {ResultState.MARKED: "ok", ResultState.GRADED_BY_HAND: "person", ResultState.NOT_MARKED: "unmarked"}


@dataclass(frozen=True)
class Row:
    """A result as a template sees it."""

    result: MarkingResult
    # items of the student, one for each column; None if the student does not have the item
    cells: Tuple[Optional[Item], ...]
    pictures: Tuple[bytes, ...]  # PNG
    files: Tuple[Tuple[str, str], ...] = ()  # title and address
    # number of the run, HTML of its replay, and time at which the replay begins [s]
    replays: Tuple[Tuple[int, str, float], ...] = ()

    def replay_of(self, item: Item) -> str:
        """Return the address of the replay of an item's run; empty if there is none."""
        if item.at is None:
            return ""
        # the feedback contains the replay; the template adds the moment to the link
        if item.drive in [number for number, _, _ in self.replays]:
            return f"#drive_{item.drive}"
        # the page of a class links to the file of the replay, with the moment
        address = dict(self.files).get(replay_title(item.drive), "")
        return f"{address}#{moment_of(item):.2f}" if address else ""

    @property
    def open(self) -> float:
        """Return the points that are given by hand."""
        return sum(item.max_points for item in self.result.items if item.points is None)

    @property
    def colour(self) -> str:
        """Return the CSS class of the state's cell."""
        return COLOURS[self.result.state]


def class_page(
    results: Sequence[MarkingResult],
    pictures: Mapping[str, Sequence[bytes]],
    files: Mapping[str, Sequence[Tuple[str, str]]],
) -> str:
    """Return the teacher's page, sorted by name.

    Pictures are PNGs, and files are (title, path relative to the page), both by the student's name.
    """
    ordered = sorted(results, key=lambda result: result.name.casefold())
    # names of the items, in the order in which they first occur
    columns = list(dict.fromkeys(item.name for result in ordered for item in result.items))
    rows = [
        _row_of_class(result, columns, pictures.get(result.name, ()), files.get(result.name, ()))
        for result in ordered
    ]
    # each student's fraction of the points, without items that are graded by hand; used for the median and
    # the histogram
    shares = [result.points / result.max_points for result in ordered if result.max_points]
    counts = [(state.value, sum(result.state == state for result in ordered)) for state in COLOURS]
    return render(
        "class.html",
        rows=rows,
        columns=columns,
        # all submissions of a class are marked with the same settings, so those of the first one are shown
        settings=ordered[0].settings if ordered else {},
        counts=[(state, count) for state, count in counts if count],  # states without students are left out
        # largest sum of points that `grade` can give to the class, so without items that are graded by hand
        decided=sum(result.max_points for result in ordered),
        # largest sum of points with these items, too
        possible=sum(item.max_points for result in ordered for item in result.items),
        # a submission with another robot than the robot of the course is coloured
        course_robot=_course_robot(ordered),
        # number of students that are graded by hand only because of a missing RViz configuration
        lack_rviz_files=sum(result.lacks_rviz_file_only for result in ordered),
        median=round(100.0 * statistics.median(shares), 1) if shares else None,
        bars=histogram(shares),
        # functions that the template calls
        colour_of_points=_colour_of_points,
        moment_of=moment_of,
    )


def _row_of_class(
    result: MarkingResult,
    columns: Sequence[str],
    pictures: Sequence[bytes],
    files: Sequence[Tuple[str, str]],
) -> Row:
    """Return the row of a student in the table of a class, with a cell for each item in `columns`.

    Files are titles and paths. A path becomes an address, in which special characters are escaped.
    """
    items = {item.name: item for item in result.items}
    cells = tuple(items.get(name) for name in columns)  # None for an item that the student does not have
    addresses = tuple((title, quote(path)) for title, path in files)
    return Row(result, cells, tuple(pictures), addresses)


def feedback_page(
    result: MarkingResult,
    pictures: Sequence[bytes],
    replays: Optional[Mapping[int, str]] = None,
    logs: Optional[Mapping[str, str]] = None,
) -> str:
    """Return the page for one student, which needs no other file and names no other student.

    Pictures are PNGs, replays are HTML by the number of the run, and logs are texts by title.
    """
    cause = result.cause  # first item that lost points; None if no item did
    shown = []
    for number, replay in (replays or {}).items():
        # in the run with the first fault, the replay begins shortly before the fault
        start = moment_of(cause) if cause and cause.drive == number else 0.0
        shown.append((number, replay, start))
    # cells are only for the page of a class, which has a column for each item
    row = Row(result, cells=(), pictures=tuple(pictures), replays=tuple(shown))
    return render(
        "feedback.html", row=row, logs=logs or {}, colour_of_points=_colour_of_points, moment_of=moment_of
    )


def histogram(shares: Sequence[float]) -> List[Dict[str, Any]]:
    """Return the bars of a histogram: count, height [px] and label [%] of each.

    `shares` has each student's fraction of the points, without items that are graded by hand. A fraction at
    the border of two bars counts in the higher one; 100 % has a bar of its own.
    """
    counts = [0] * (BARS + 1)
    for share in shares:
        # 1e-9 is a tolerance for rounding; a fraction above 100 % counts in the last bar
        bar = min(int(BARS * share + 1e-9), BARS)
        counts[bar] += 1
    highest = max([*counts, 1])  # at least 1, because the heights are divided by this count
    step = 100 // BARS  # [%] width of a bar
    bars = []
    for bar, count in enumerate(counts):
        label = f"{step * bar}-{step * (bar + 1) - 1}" if bar < BARS else "100"
        bars.append({"count": count, "height": round(BAR_HEIGHT * count / highest), "label": label})
    return bars


def replay_title(number: int) -> str:
    """Return the title of the replay of a run."""
    return f"replay of run {number}"


def moment_of(item: Item) -> float:
    """Return the time [s] at which the replay of an item begins, LEAD before the moment of its evidence."""
    return max((item.at or 0.0) - LEAD, 0.0)


def _course_robot(results: Sequence[MarkingResult]) -> str:
    """Return the usual robot of a class: the robot of the command line, or else of most submissions."""
    # all submissions of a class are marked with the same settings
    robot = str(results[0].settings.get("robot", AUTO)) if results else AUTO
    # robot of each submission that had a run
    simulated = [str(result.settings["simulated"]) for result in results if result.settings.get("simulated")]
    if robot == AUTO and simulated:
        return statistics.mode(simulated)
    return robot


def _colour_of_points(points: float, max_points: float) -> str:
    """Return the CSS class that colours points: full, some or none; empty for an item without points."""
    if not max_points:
        return "none" if points < 0.0 else ""  # a penalty has negative points
    if points >= max_points - 1e-9:
        return "full"
    return "some" if points > 0.0 else "none"
