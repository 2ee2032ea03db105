"""Options that are common to the commands of many tasks."""

import argparse
import sys

import pytest

from husky_evaluation import compare, evaluate, sweep, tune
from husky_evaluation.tasks.command import add_old_name, name_as_typed, positive
from husky_grading import cli

GRADE = ["--launch", "package", "file.launch"]


def test_the_old_name_of_an_option_sets_the_same_value_and_logs_the_new_name(capsys):
    parser = argparse.ArgumentParser(prog="sweep")
    add_old_name(parser, "--scenes", parser.add_argument("--starts", type=positive, default=20))
    assert vars(parser.parse_args([])) == {"starts": 20}
    assert capsys.readouterr().err == ""
    assert vars(parser.parse_args(["--scenes", "3"])) == {"starts": 3}
    assert capsys.readouterr().err == "sweep: --scenes is now called --starts; the old name still works\n"
    with pytest.raises(SystemExit, match="2"):
        parser.parse_args(["--scenes", "0"])
    assert "--scenes" not in parser.format_help()


@pytest.mark.parametrize(
    ("parse", "words", "old", "new"),
    [
        (evaluate.evaluate_options, [], "--scenes", "--scans"),
        (sweep.sweep_options, ["p_gain_vel=1"], "--scenes", "--starts"),
        (tune.tune_options, ["p_gain_vel"], "--scenes", "--starts"),
        (tune.tune_options, ["p_gain_vel"], "--trials", "--setups"),
        (compare.compare_options, ["a.yaml", "b.yaml"], "--scenes", "--starts"),
        (cli.parse, GRADE, "--trials", "--runs"),
        (cli.parse, GRADE, "--pace", "--real-time-factor"),
    ],
)
def test_each_option_of_an_old_name_means_what_its_new_name_means(parse, words, old, new):
    assert parse([*words, old, "7"]) == parse([*words, new, "7"]) != parse(words)


@pytest.mark.parametrize(
    ("program", "name"), [("/venv/bin/husky", "husky sweep"), ("/opt/ros/lib/package/sweep", "sweep")]
)
def test_a_command_names_itself_as_it_was_typed(program, name, monkeypatch):
    monkeypatch.setattr(sys, "argv", [program])
    assert name_as_typed("sweep") == name
