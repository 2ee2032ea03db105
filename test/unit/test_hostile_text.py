"""Texts of a hand-in that a regular expression could take hours for are read at once."""

import subprocess
import sys

import pytest

SIZE = 1_000_000  # letters; at the square of it a machine is busy for minutes
DEADLINE = 60.0  # [s]
CASES = {
    "build_output.needs_old_boost": ("error: ", "_1 was ", "a:1: error: "),
    "build_output.build_error": ("a:1: error: ", "CMake Error at ", "\n"),
    "submission.exceptions_in": ("Exception in thread ", "[ERROR] [1.1]: bad callback: <function a"),
    "notes_on": ("\n", "ERROR: cannot launch node of type [", "a."),
    "player": ("a", "a/"),
    "traceback": ("a", "/", "a/"),
    "valgrind": ("at 0x1: ", "by 0x1: a (a"),
    "memcheck.may_be_unwritten": ("(a", "/* ", "double a, ", "a)"),
}
CODE = """
import sys
from pathlib import Path
from husky_grading import submission
from husky_grading.drive import memcheck
from husky_grading.hand_in import build_output
from husky_grading.exercises.exercise_4 import Playback, judge_player

def notes_on(text):
    submission.notes_on([], text)

def traceback(text):
    submission.notes_on([submission.Event("died", "n", 1)], "Error\\nFile \\"" + text)

def player(text):
    judge_player(None, Playback(players=(text,)), None)

def valgrind(text):
    memcheck.reads_in("Conditional jump\\n" + text, Path("/no/sources"))

read, size = eval(sys.argv[1]), int(sys.argv[2])
arguments = [Path("/")] if read is build_output.build_error else []
for piece in sys.argv[3:]:
    print(repr(piece), flush=True)
    read((piece * size)[:size - 1] + ")", *arguments)
"""


@pytest.mark.parametrize("name", CASES)
def test_no_text_takes_the_square_of_its_length(name):
    command = [sys.executable, "-c", CODE, name, str(SIZE), *CASES[name]]
    try:
        subprocess.run(command, check=True, timeout=DEADLINE, stdout=subprocess.PIPE)
    except subprocess.TimeoutExpired as error:
        last = (error.stdout or b"?").decode().splitlines()[-1]
        pytest.fail(f"{name} of {SIZE} letters, all of it {last}, takes more than {DEADLINE:g} s")
