"""Exercises by their numbers: each module `exercise_N` of this folder is one, and no list names them."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Dict

from husky_grading.exercises.exercise import Exercise

_NUMBERS = [path.stem[len("exercise_") :] for path in Path(__file__).parent.glob("exercise_*.py")]
EXERCISES: Dict[int, Exercise] = {
    number: import_module(f"{__package__}.exercise_{number}").EXERCISE
    for number in sorted(map(int, filter(str.isdecimal, _NUMBERS)))
}
