"""Exercises by their numbers: each module `exercise_N` of this folder is one, and no list names them."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import Dict

from husky_grading.exercises.exercise import Exercise

_MODULE = re.compile(r"exercise_(\d+)")


def _found() -> Dict[int, Exercise]:
    names = sorted(path.stem for path in Path(__file__).parent.glob("exercise_*.py"))
    numbers = {int(match[1]): match[0] for match in map(_MODULE.fullmatch, names) if match}
    return {
        number: import_module(f"{__package__}.{name}").EXERCISE for number, name in sorted(numbers.items())
    }


EXERCISES: Dict[int, Exercise] = _found()
