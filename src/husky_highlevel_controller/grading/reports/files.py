"""Writes the files of results: for one student, and for a class.

In: `Result`s, folders with pictures and logs. Out: files. Must not know: ROS, rubrics.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Dict, List, Sequence, Tuple

from husky_highlevel_controller.grading.isolation.files import write_whole
from husky_highlevel_controller.grading.reports.exports import to_step_summary, write_exports
from husky_highlevel_controller.grading.reports.page import class_page, feedback_page
from husky_highlevel_controller.grading.reports.replays import REPLAY
from husky_highlevel_controller.grading.reports.tables import Result, table, to_csv, to_json, to_junit

PICTURES = ("drive.png", "rviz.png")
LOGS = (("build log", "ws/build.log"), ("traceback", "traceback.txt"))
HAND_INS = "hand_ins"  # folder of the class's results: one folder for each hand-in
STEP_SUMMARY = "GITHUB_STEP_SUMMARY"  # variable with the file that GitHub Actions shows


def write_result(result: Result, out: Path) -> None:
    """Every file of one student's result; result.json is the last: with it, the marking is done.

    Raises:
        OSError: such as a full disk.
    """
    write_whole(out / "table.txt", table(result) + "\n")
    write_whole(out / "junit.xml", to_junit([result]))
    write_whole(out / "feedback.html", feedback_page(result, _pictures(out), _replays(out)))
    write_exports(result, out)
    write_whole(out / "result.json", to_json(result))


def write_class(results: Sequence[Result], out: Path) -> None:
    """The table, the page and the test report of a class.

    Raises:
        OSError: such as a full disk.
    """
    pictures: Dict[str, Sequence[bytes]] = {
        result.name: _pictures(out / HAND_INS / result.name) for result in results
    }
    for result in results:
        folder = out / HAND_INS / result.name
        if result.problem and folder.is_dir():  # the others have theirs
            page = feedback_page(result, pictures[result.name], _replays(folder))
            write_whole(folder / "feedback.html", page)
            write_exports(result, folder)
    files = {result.name: _files(Path(HAND_INS, result.name), out) for result in results}
    write_whole(out / "results.csv", to_csv(results))
    write_whole(out / "junit.xml", to_junit(results))
    write_whole(out / "index.html", class_page(results, pictures, files))
    write_whole(out / "summary.md", to_step_summary(results))
    add_step_summary(results)


def add_step_summary(results: Sequence[Result]) -> None:
    """In a job of GitHub Actions: the table on its page."""
    if os.environ.get(STEP_SUMMARY):
        with open(os.environ[STEP_SUMMARY], "a", encoding="utf-8") as file:
            file.write(to_step_summary(results))


def _pictures(out: Path) -> List[bytes]:
    return [(out / name).read_bytes() for name in PICTURES if (out / name).is_file()]


def _replays(out: Path) -> List[str]:
    return [path.read_text(encoding="utf-8") for path in sorted(out.glob(f"drive_*/{REPLAY}"))]


def _files(name: Path, out: Path) -> List[Tuple[str, str]]:
    """Words and addresses, relative to the class's page, of what there is of a student."""
    logs = [*LOGS, ("feedback", "feedback.html"), ("plan", "plan/plan.log")]
    for folder in sorted((out / name).glob("drive_*")):
        logs.append((f"replay of {folder.name.replace('_', ' ')}", f"{folder.name}/{REPLAY}"))
        logs.append((f"log of {folder.name.replace('_', ' ')}", f"{folder.name}/submission.log"))
    return [(words, f"{name}/{path}") for words, path in logs if (out / name / path).is_file()]
