"""The one command that `pip install .` brings."""

import pytest

from husky_evaluation import command_line, sweep


def test_it_hands_the_arguments_to_the_command_that_they_name(monkeypatch):
    seen = []
    monkeypatch.setattr(sweep, "main", seen.append)
    command_line.main(["sweep", "p_gain_vel=1,2", "--help"])
    assert seen == [["p_gain_vel=1,2", "--help"]]


def test_an_unknown_command_is_an_error_that_lists_the_others(capsys):
    with pytest.raises(SystemExit, match="2"):
        command_line.main(["sweeep"])
    told = capsys.readouterr().err
    assert all(name in told for name in ("sweeep", *command_line.COMMANDS))
