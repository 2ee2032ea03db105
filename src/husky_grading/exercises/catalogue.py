"""Exercises by their numbers: each module `exercise_N` of this folder is one, and no list names them."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Dict

from husky_grading.exercises.exercise import Exercise


def _find_exercises() -> Dict[int, Exercise]:
    """Return the constant EXERCISE of each module `exercise_N`, by the number N, in ascending order."""
    numbers = []
    for path in Path(__file__).parent.glob("exercise_*.py"):
        number = path.stem[len("exercise_") :]
        if number.isdecimal():
            numbers.append(int(number))
    return {number: import_module(f"{__package__}.exercise_{number}").EXERCISE for number in sorted(numbers)}


EXERCISES = _find_exercises()
