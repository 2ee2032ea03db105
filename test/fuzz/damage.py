"""Damages inputs at random, always the same way for the same random generator."""

import math
import random
import re

WORDS = [
    "", " ", "a", "husky", "husky/n", "../../etc", "/dev/zero", "-d", "-d 'my view.rviz", '"', "\\", "nan",
    "1e999", "$(find husky)", "$(find husky)/launch/a.launch", "$(arg x)", "$(eval 1/0)", "$(dirname)/a",
    "none", "ü", "\u202e", "\x7f", "=1+1", "<b>", "&", "singlePillar", "rviz", "true", "false", "9" * 400,
    "x" * 5000,
]  # fmt: skip
VALUES = [None, True, -1, 5, 10**400, 0.5, float("nan"), float("inf"), [], {}, *WORDS]
NUMBERS = [
    "0", "-0.0", "1", "-1", "0.5", "3.2", "1e-300", "5e-324", "1e-12", "1e-4", "1e3", "1e6", "1e12", "3e38",
    "1e300", "-1e300", "nan", "inf", "-inf", "1e999", "9" * 400, "x", "", "0x10", "1 2",
]  # fmt: skip


ODD = [0.0, -0.0, 1.0, -1.0, 5e-324, 1e-9, 1e9, 1e20, 3e38, 1e300, -1e300, math.nan, math.inf, -math.inf]
_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?(?![\w.])")


def damaged(rng, text):
    """Text with some of its parts cut, repeated, replaced or swapped."""
    for _ in range(rng.choice([0, 0, 1, 1, 2, 4])):
        start = rng.randrange(len(text) + 1)
        end = min(len(text), start + rng.choice([1, 3, 20, 200]))
        new = rng.choice([*WORDS, text[start:end] * 3, chr(rng.randrange(1, 0x2FF))])
        text = text[:start] + new + text[end:]
    return text


def renumbered(rng, text):
    """Text with some of its numbers replaced by others, possible and impossible."""
    places = list(_NUMBER.finditer(text))
    chosen = sorted(rng.sample(range(len(places)), min(rng.choice([1, 1, 2, 3, 8]), len(places))))
    for place in (places[index] for index in reversed(chosen)):
        new = rng.choice(NUMBERS)
        if rng.random() > 0.6:
            new = repr(float(place.group()) * 10 ** rng.gauss(0, 2))
        text = text[: place.start()] + new + text[place.end() :]
    return text


def mutated(rng, value):
    """A value of YAML or JSON in which some parts are of another kind."""
    if rng.random() < 0.08:
        return rng.choice(VALUES)
    if isinstance(value, dict):
        return {
            (rng.choice(WORDS) if rng.random() < 0.03 else key): mutated(rng, each)
            for key, each in value.items()
            if rng.random() > 0.03
        }
    if isinstance(value, list):
        return [mutated(rng, each) for each in value for _ in range(rng.choice([0, 1, 1, 1, 1, 2]))]
    return value


def number(rng):
    """A float: mostly an ordinary one."""
    if rng.random() < 0.75:
        return rng.gauss(0.0, 1.0) * 10 ** rng.uniform(-2, 2)
    return rng.choice(ODD)


def generators(name, count):
    """A random generator for each case."""
    return [random.Random(f"{name} {case}") for case in range(count)]
