"""Files of results: for one student, and for a class."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from husky_grading.isolation.files import (
    UnreadableFileError,
    read_regular,
    read_text,
    write_whole,
)
from husky_grading.isolation.places import hide_places
from husky_grading.recording import ADD, Recording, drive_folders
from husky_grading.records import Item, MarkingResult, printable
from husky_grading.reports.exports import exports
from husky_grading.reports.page import class_page, feedback_page, replay_title
from husky_grading.reports.tables import (
    to_csv,
    to_junit,
    to_markdown,
    to_moodle,
    to_result,
)
from husky_highlevel_controller.config import load, to_json
from husky_highlevel_controller.drawing.replay import Replay, to_html
from husky_highlevel_controller.robot import load_robot

RUNS_PICTURE, MOMENT_PICTURE = "drive.png", "moment.png"  # all runs from above; one moment of a run
PICTURES = (RUNS_PICTURE, MOMENT_PICTURE)
# file with a hash of everything that the runs depend on: submission, settings and our code. It is written
# last, so the other files are complete if this file exists.
FINGERPRINT = "fingerprint"
LOGS = (("build log", "build.log"), ("marking log", "mark.log"))
HAND_INS = "hand_ins"  # folder of the class's results, with one folder for each submission
RESULT = "result.json"  # file with the result of a student, in the folder of the student's results
JOB = "job.json"  # file with the student's `Job`, which the program `husky_grading.mark` reads
MAX_LOG = 5000  # the feedback shows the last MAX_LOG characters of a log
COLOURS = re.compile(r"\x1b\[[0-9;]*m")  # pattern of the colour codes in rospy's warnings and errors
REPLAY = "replay.html"  # file with the replay, in the folder of a run
# keys of result.json with sums of points for other programs; `load_result` ignores these keys
SUMS = ("points", "max_points", "full")
# environment variable with the path of a Markdown file that GitHub Actions shows on the page of the job
STEP_SUMMARY = "GITHUB_STEP_SUMMARY"


def write_result(result: MarkingResult, out: Path, packages: Sequence[str] = ()) -> None:
    """Write every file of one student's result; result.json comes last, so if it exists, all files exist.

    Args:
        result: result of the student.
        out: folder for the files.
        packages: folders of packages that were started in place; the logs in the feedback do not show the
            paths of these folders and of `out`.

    Raises:
        OSError: a file cannot be written, for example on a full disk.
    """
    # time of this result in UTC, such as 2026-06-01T14:32:01Z
    moment = datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
    # other programs find the sums of points in result.json, too
    sums = {name: getattr(result, name) for name in SUMS}
    # text of each file, in the order in which they are written; an empty text means that there is no file
    texts = {
        "table.txt": f"{to_result(result)}\n",
        "junit.xml": to_junit([result]),
        # `held` means that the teacher holds the page back
        "feedback.html": "" if result.held else _feedback(result, out, packages),
        **exports(result, os.environ, moment),
        RESULT: to_json(result, **sums),
    }
    for name, text in texts.items():
        if text:
            (out / name).parent.mkdir(exist_ok=True)
            write_whole(out / name, text)
        else:  # a file of an earlier result must not stay
            (out / name).unlink(missing_ok=True)


def _feedback(result: MarkingResult, out: Path, packages: Sequence[str]) -> str:
    """Return the page for the student, with the pictures, replays and logs in `out`."""
    # HTML of each run's replay, by the number of the run
    pages = {number: path.read_text(encoding="utf-8") for number, path in replays(out).items()}
    return feedback_page(result, _read_pictures(out), pages, _ends_of_logs(out, packages))


def load_result(path: Path) -> MarkingResult:
    """Return a result from its result.json.

    Raises:
        HuskyError: the file does not exist, or is not a result.
    """
    return load(MarkingResult, path, *SUMS)  # SUMS are keys of the file that are not fields of the result


def write_class(results: Sequence[MarkingResult], folders: Mapping[str, str], out: Path) -> None:
    """Write the table, the page and the test report of a class.

    Args:
        results: results of the students.
        folders: name of each student's folder, by the student's name.
        out: folder for the files; the students' folders are in out/hand_ins.

    Raises:
        OSError: a file cannot be written, for example on a full disk.
    """
    places = {result.name: Path(HAND_INS, folders[result.name]) for result in results}
    # one picture for each student, because the page of a class is long
    pictures = {name: _read_pictures(out / place)[:1] for name, place in places.items()}
    files = {name: _files_of_student(place, out) for name, place in places.items()}
    out.mkdir(parents=True, exist_ok=True)
    write_whole(out / "results.csv", to_csv(results))
    write_whole(out / "moodle.csv", to_moodle(results))
    write_whole(out / "junit.xml", to_junit(results))
    write_whole(out / "index.html", class_page(results, pictures, files))
    write_whole(out / "summary.md", to_markdown(results))
    add_step_summary(results)


def write_pictures(recordings: Sequence[Recording], name: str, out: Path, cause: Optional[Item]) -> None:
    """Write two pictures of a student's runs, and a replay of each run; nothing if there was no run.

    The second picture shows the moment of `cause`, the first item that lost points. Without such a moment, it
    shows the middle of the first run. In exercise 4 there is only one picture, of the estimated path.
    """
    first = recordings[0]
    estimate = first.estimate
    if estimate is None and not len(first.times):
        return
    # imported only here, because matplotlib takes long to load, and other reports do not need it
    from husky_grading.reports import plots

    if estimate is not None:
        (out / RUNS_PICTURE).write_bytes(plots.draw_estimate(first, estimate, name))
    else:
        (out / RUNS_PICTURE).write_bytes(plots.draw_drives(recordings, name))
        shown, at = _moment_to_show(recordings, cause)
        (out / MOMENT_PICTURE).write_bytes(plots.draw_moment(shown, at))
    for number, recording in enumerate(recordings, 1):
        if len(recording.times):
            _write_replay(recording, f"{name}, run {number}", out / f"drive_{number}")


def _moment_to_show(recordings: Sequence[Recording], cause: Optional[Item]) -> Tuple[Recording, float]:
    """Return the run and the simulated time [s] at which `cause` lost points, if both are known.

    Otherwise, they are the first run and the middle of its time.
    """
    if cause is not None and cause.at is not None and cause.drive <= len(recordings):
        return recordings[cause.drive - 1], cause.at  # the first run has the number 1
    first = recordings[0]
    return first, float(first.times[-1]) / 2.0


def _write_replay(recording: Recording, title: str, folder: Path) -> None:
    """Write a page that replays a run with its markers as they came."""
    # time [s], x and y [m] of each cross in the replay; the crosses are markers, or points of an estimated
    # path
    marks = [(marker.at, *marker.position[:2]) for marker in recording.markers if marker.action == ADD]
    pillars = [recording.pillar]
    if recording.estimate is not None:  # an estimate comes from a recorded bag, whose world has no pillar
        marks, pillars = list(map(tuple, recording.estimate.points)), []
    page = to_html(
        Replay(
            title=title,
            summary=recording.ended.text if recording.ended else "no end was recorded",
            times=recording.times,
            poses=recording.poses,
            pillars=np.array(pillars).reshape(-1, 2),
            pillar_radius=recording.pillar_size.radius,
            robot=load_robot(recording.robot),
            marks=np.array(marks, float).reshape(-1, 3),
        )
    )
    write_whole(folder / REPLAY, page)


def add_step_summary(results: Sequence[MarkingResult]) -> None:
    """Append the tables to the page of the job in GitHub Actions; elsewhere, do nothing."""
    if os.environ.get(STEP_SUMMARY):
        with open(os.environ[STEP_SUMMARY], "a", encoding="utf-8") as file:
            file.write(to_markdown(results))


def _read_pictures(out: Path) -> List[bytes]:
    """Return the pictures that `write_pictures` wrote, as PNGs."""
    pictures = []
    for name in PICTURES:
        with suppress(UnreadableFileError):  # a submission without a run has no picture
            pictures.append(read_regular(out / name))
    return pictures


def replays(out: Path) -> Dict[int, Path]:
    """Return the replays of a student by the number of the run, in order."""
    paths = {number: folder / REPLAY for number, folder in drive_folders(out).items()}
    return {number: path for number, path in paths.items() if path.is_file()}


def _ends_of_logs(out: Path, packages: Sequence[str]) -> Dict[str, str]:
    """Return the end of each log of the build and of the nodes; the key is the title of the log.

    The texts do not show the path of `out` and the paths of `packages`.
    """
    logs = {"Output of the build": out / "build.log"}
    for number, folder in drive_folders(out).items():
        logs[f"Output of your nodes in run {number}"] = folder / "submission.log"
    texts = {}
    hidden_folders = [out, *map(Path, packages)]
    for title, path in logs.items():
        with suppress(UnreadableFileError):  # a log is left out if it does not exist
            text = COLOURS.sub("", read_text(path)[-MAX_LOG:].strip())
            if text:
                lines = hide_places(text, hidden_folders).splitlines()
                texts[title] = "\n".join(printable(line) for line in lines)
    return texts


def _files_of_student(place: Path, out: Path) -> List[Tuple[str, str]]:
    """Return title and address of each file of a student, for the page of the class.

    `place` is the path of the student's folder. The path and the addresses are relative to `out`.
    """
    # title of each file that may exist, and its path in the student's folder
    logs = [*LOGS, ("feedback", "feedback.html"), ("plan", "plan/plan.log")]
    for number, folder in drive_folders(out / place).items():
        logs.append((replay_title(number), f"{folder.name}/{REPLAY}"))
        logs.append((f"log of run {number}", f"{folder.name}/submission.log"))
    return [(title, f"{place}/{path}") for title, path in logs if (out / place / path).is_file()]
