"""Tasks on this machine: the same results in order, no work done twice; exit codes of commands."""

from __future__ import annotations

import argparse
import gc
import os
import signal
from dataclasses import dataclass
from enum import Enum
from functools import partial
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from noisy_tasks import noise, noise_after_a_death

from husky_evaluation.tasks import local
from husky_evaluation.tasks.command import STOPPED, exit_codes, seed_value
from husky_evaluation.tasks.fingerprint import code_version, fingerprint, machine
from husky_evaluation.tasks.workers import Workers
from husky_highlevel_controller.datatypes import HuskyError, Pose2D


def kill_at_seven(number):
    if number == 7:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def note(folder, number):
    (folder / f"{number} {os.getpid()}").write_text("")
    return number**2


def note_and_fail(folder, number):
    if number == 6:
        raise HuskyError("six is not a world")
    return note(folder, number)


@pytest.mark.parametrize(("jobs", "chunk"), [(1, 1), (2, 1), (3, 1), (3, 7)])
def test_results_are_in_order_and_their_hash_is_the_same_for_any_number_of_processes(jobs, chunk):
    expected = [noise(number) for number in range(40)]
    with Workers(jobs) as workers:
        assert workers.map(noise, range(40), chunk=chunk) == expected
        assert workers.results_hash == sha256(fingerprint(expected).encode()).hexdigest()


def test_a_process_that_is_killed_costs_nothing_but_time(tmp_path):
    with Workers(2) as undisturbed, Workers(2) as workers:
        undisturbed.map(noise, range(20))
        workers.map(partial(noise_after_a_death, tmp_path), range(20))
        assert (tmp_path / "died").exists()
        assert workers.results_hash == undisturbed.results_hash


def test_what_is_kept_is_not_computed_again(tmp_path):
    notes, file = tmp_path / "notes", tmp_path / "results"
    notes.mkdir()
    with Workers(1, resume=file) as workers, pytest.raises(HuskyError, match="six is not a world"):
        workers.map(partial(note_and_fail, notes), range(10))
    kept = {path.name.split()[0] for path in notes.iterdir()}
    assert kept >= {"0", "1", "2", "3", "4", "5"}
    for _ in range(2):
        with Workers(2, resume=file) as workers:
            assert workers.map(partial(note, notes), range(10)) == [n**2 for n in range(10)]
    assert len([path for path in notes.iterdir() if path.name.startswith("9 ")]) == 1 + ("9" in kept)


def test_an_interrupted_map_goes_on_where_it_was(tmp_path):
    task = partial(note, tmp_path)
    with Workers(1, resume=tmp_path / "file") as workers:
        results = workers.as_completed(task, list(range(30)))
        first = [next(results) for _ in range(4)]
        results.close()
    assert all(result == number**2 for number, result in first)
    begun = len(list(tmp_path.glob("* *")))
    assert begun < 30, "what has not begun is cancelled"
    with Workers(1, resume=tmp_path / "file") as workers:
        assert workers.map(task, range(30)) == [number**2 for number in range(30)]
    assert all(len(list(tmp_path.glob(f"{number} *"))) == 1 for number, _ in first)


def test_a_file_that_is_none_of_ours_is_refused(tmp_path):
    (tmp_path / "file").write_text("no results " * 100)
    with pytest.raises(HuskyError, match="file cannot keep results"):
        Workers(resume=tmp_path / "file")
    gc.collect()  # at which Python 3.13 complains of a file that was left open


def test_tasks_that_start_programs_run_in_threads_of_this_process(tmp_path):
    with Workers(2) as workers:
        assert set(workers.map(lambda _: os.getpid(), range(8), starts_programs=True)) == {os.getpid()}


def test_the_words_tell_hash_and_machine(tmp_path, monkeypatch):
    with Workers(1, resume=tmp_path / "kept") as workers:
        workers.map(noise, range(2))
        assert workers.summary == f"results {workers.results_hash} by {machine()}"
    monkeypatch.setattr(local, "machine", lambda: "another one")
    with Workers(1, resume=tmp_path / "kept") as workers:
        workers.map(noise, range(3))
        assert "by 2 kinds of machines, whose last bits may differ: another one; " in workers.summary
    assert "numpy" in machine()


class Color(Enum):
    RED = 1


@dataclass(frozen=True, eq=False)
class Record:
    values: np.ndarray
    path: Path = Path("a")


DIFFERENT = [
    None, True, 1, 1.0, "1", b"1", (1,), (1, 2), ((1,), 2), {"a": 1}, {"a": 2}, {1, 2}, Color.RED, Path("1"),
    Pose2D(), Pose2D(1.0), Record(np.zeros(2)), Record(np.zeros((2, 1))), Record(np.ones(2)), noise, note,
    partial(noise, 1), partial(noise, 2), float("nan"), -0.0, 0.0, np.float64(2.5),
]  # fmt: skip


def test_equal_values_have_equal_fingerprints_and_no_others():
    assert len({fingerprint(value) for value in DIFFERENT}) == len(DIFFERENT)
    assert fingerprint({"a": 1, "b": {1, 2, 3}}) == fingerprint({"b": {3, 2, 1}, "a": 1})
    assert fingerprint(float("nan")) == fingerprint(np.float64("nan"))
    assert fingerprint([1, 2]) == fingerprint((1, 2))
    with pytest.raises(TypeError, match="a object has no fingerprint"):
        fingerprint(object())


def test_the_version_tells_number_and_sources():
    number, _, digest = code_version().partition("+")
    assert number.count(".") == 2
    assert len(digest) == 12


def test_a_failed_task_may_have_a_result_of_its_own(tmp_path):
    with Workers(2) as workers:
        task = partial(note_and_fail, tmp_path)
        results = workers.as_completed(task, list(range(9)), on_error=lambda item, error: f"{item}: {error}")
        assert dict(results) == {**{number: number**2 for number in range(9)}, 6: "6: six is not a world"}


def test_a_task_that_ends_every_process_is_named_and_may_have_a_result_of_its_own():
    with Workers(2) as workers:
        results = dict(
            workers.as_completed(kill_at_seven, list(range(20)), on_error=lambda _, error: str(error))
        )
    assert results[7] == "task 8 of 20 ended its process 3 times"
    assert sorted(results) == list(range(20))


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (HuskyError("no such file"), 2, "mark: no such file"),
        (OSError(28, "No space left on device"), 2, "No space left"),
        (KeyError("seed"), 2, "mark: this is a bug: KeyError: 'seed'"),
        (KeyboardInterrupt(), STOPPED, "mark: stopped"),
        (SystemExit(1), 1, ""),
    ],
)
def test_only_a_figure_that_is_missed_ends_with_1(error, code, words, capsys):
    with pytest.raises(SystemExit) as end, exit_codes("mark"):
        raise error
    assert end.value.code == code
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("text", ["-1", "2147483648"])
def test_a_seed_is_a_number_that_every_generator_takes(text):
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=seed_value)
    assert parser.parse_args(["--seed", "7"]).seed == 7
    with pytest.raises(SystemExit) as end:
        parser.parse_args(["--seed", text])
    assert end.value.code == 2
