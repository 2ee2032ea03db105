"""Runs of the marking program: one that dies, that is stopped, that is on another machine."""

import os
import pickle
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from packages import put

from husky_grading import run_jobs as run_jobs_module
from husky_grading.batch import job_of
from husky_grading.hand_in.archives import PackedPath
from husky_grading.hand_in.class_folder import HandIn
from husky_grading.isolation import files as files_module
from husky_grading.isolation import process as process_module
from husky_grading.records import MarkingConfig, Override
from husky_grading.reports.files import FINGERPRINT
from husky_grading.review import open_items
from husky_grading.run_jobs import run_program, run_there, write_outputs

pytestmark = pytest.mark.usefixtures("launch_files_read_here")


def test_a_hand_in_is_marked_where_it_was_sent_and_its_results_come_back_but_not_what_it_made(
    ann, batch, monkeypatch
):
    job = job_of(HandIn("ann", ann, "ann"), Override(), MarkingConfig(), batch)

    def marked(job):
        run_program(job)
        for place in ("unpacked", "ws", "drive_1/submission"):  # as if made by it
            for number in range(60):
                put(Path(job.out, place, str(number)))

    monkeypatch.setattr(run_jobs_module, "run_program", marked)
    monkeypatch.setattr(files_module, "MAX_ENTRIES", 50)
    files = run_there(pickle.loads(pickle.dumps((job, PackedPath(ann)))))
    assert not [place for place in files if place.startswith(("unpacked", "ws", "drive_1"))]
    result = write_outputs(files, job)
    assert "has no catkin package" in result.problem
    assert result.settings["exercise"] == 3
    assert open_items(batch.out)[1] == batch.folder
    assert (Path(job.out) / FINGERPRINT).read_text() == job.fingerprint


@pytest.mark.parametrize(
    ("shows_errors", "words"), [(False, "no_such_module"), (True, "(exit code 1): its errors are above")]
)
def test_a_marking_that_dies_is_a_problem_of_its_hand_in(job, monkeypatch, shows_errors, words):
    monkeypatch.setattr(run_jobs_module, "PROGRAM", "no_such_module")
    result = run_program(job, shows_errors)
    assert result.problem.startswith("the grader failed on ")
    assert words in result.problem
    assert not Path(job.out, FINGERPRINT).exists()


def test_marking_and_reviewing_import_nothing_of_the_folder_they_are_called_in_or_write_to(
    job, tmp_path, monkeypatch
):
    for folder in (tmp_path, Path(job.out)):
        put(folder / "yaml.py", "raise SystemExit('imported')")
    monkeypatch.chdir(tmp_path)
    assert "has no catkin package" in run_program(job).problem
    command = [sys.executable, Path(__file__).parents[3] / "scripts" / "grade", "--review", "nothing"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert str(tmp_path / "nothing") in done.stderr
    assert "imported" not in done.stderr


def test_a_marking_that_is_stopped_may_clean_up(job, tmp_path, monkeypatch):
    put(
        tmp_path / "module" / "slow_marking.py",
        # a suite that runs in the background of a script inherits an ignored SIGINT
        "import pathlib, signal, sys, time\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "up = pathlib.Path(sys.argv[1]).with_name('up')\n"
        "try:\n    up.touch()\n    time.sleep(1000.0)\nfinally:\n    up.unlink()\n",
    )
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path / 'module'}:{os.environ['PYTHONPATH']}")
    monkeypatch.setattr(run_jobs_module, "PROGRAM", "slow_marking")
    up = Path(job.out, "up")
    monkeypatch.setattr(process_module, "STOP_REQUESTED", SimpleNamespace(is_set=up.exists))
    with pytest.raises(process_module.StoppedError):
        run_program(job)
    assert not up.exists()
