"""How a command ends: exit codes that a script can rely on."""

import argparse

import pytest

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.tasks.command import STOPPED, exit_codes, seed_value


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
