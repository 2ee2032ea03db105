"""`./dev bench --against`: how pairs are compared, and which folders are refused."""

import json
import math
import subprocess
import sys

import pytest

from husky_highlevel_controller.paths import share_folder

BENCHMARKS = share_folder() / "tools" / "benchmarks"
sys.path.append(str(BENCHMARKS))
import against  # noqa: E402
from checkouts import CheckoutError, run_in  # noqa: E402

SECONDS = ("start", "s")


def readings(**values):
    return {(what, "s"): against.Reading(value, False) for what, value in values.items()}


def test_a_time_that_became_longer_in_each_of_seven_pairs_is_worse():
    runs = [(1.0 + 0.01 * n, 0.9) for n in range(7)]
    found = against.compare_runs(*SECONDS, runs, more_is_better=False)
    assert found.worse
    assert not found.better
    assert found.ratio == pytest.approx(1.03 / 0.9)
    assert found.spread == pytest.approx((1.0 / 0.9, 1.06 / 0.9))
    assert found.runs == runs


def test_a_speed_is_worse_when_it_became_smaller():
    slower, faster = [(20.0, 25.0)] * 7, [(25.0, 20.0)] * 7
    assert against.compare_runs("stack", "x real time", slower, more_is_better=True).ratio == 1.25
    assert against.compare_runs("stack", "x real time", slower, more_is_better=True).worse
    assert against.compare_runs("stack", "x real time", faster, more_is_better=True).better


def test_one_pair_of_seven_that_says_the_contrary_keeps_a_figure_from_being_worse():
    found = against.compare_runs(*SECONDS, [(1.2, 1.0)] * 6 + [(0.99, 1.0)], more_is_better=False)
    assert found.ratio == 1.2
    assert not found.worse
    assert not found.better


def test_ratios_are_those_of_pairs_whatever_the_pace_of_the_machine():
    pace = (1.0, 2.0, 1.5, 3.0, 1.0, 0.5, 2.0)
    found = against.compare_runs(*SECONDS, [(1.1 * p, p) for p in pace], more_is_better=False)
    assert found.spread == pytest.approx((1.1, 1.1))
    assert found.worse


def test_fewer_than_seven_pairs_are_shown_but_not_judged():
    for pairs in range(1, against.PAIRS):
        found = against.compare_runs(*SECONDS, [(2.0, 1.0)] * pairs, more_is_better=False)
        assert (found.ratio, found.worse, found.judged) == (2.0, False, False)
        assert against.cells([found])[-1][-1] == "too few pairs"


@pytest.mark.parametrize("pairs", [7, 10, 11, 14, 25])
def test_the_spread_leaves_out_as_many_outliers_as_one_percent_of_chance_allows(pairs):
    out = against.dropped(pairs)

    def chance(k):
        return sum(math.comb(pairs, i) for i in range(k + 1)) / 2**pairs

    assert chance(out) <= against.CHANCE < chance(out + 1)
    tossed = [(1.2, 1.0)] * (pairs - out) + [(0.5, 1.0)] * out
    assert against.compare_runs(*SECONDS, tossed, more_is_better=False).worse
    tossed = [(1.2, 1.0)] * (pairs - out - 1) + [(0.5, 1.0)] * (out + 1)
    assert not against.compare_runs(*SECONDS, tossed, more_is_better=False).worse


def test_a_row_that_only_one_checkout_has_is_named_and_the_others_are_compared():
    found, missing = against.compare_readings(
        [(readings(start=1.0, jump=1.0), readings(start=2.0, dance=1.0))]
    )
    assert [(row.what, row.new, row.old, row.ratio) for row in found] == [("start", 1.0, 2.0, 0.5)]
    assert missing == [("jump", "s"), ("dance", "s")]


def test_a_checkout_of_before_the_directions_is_read_and_two_yardsticks_are_one_row(tmp_path):
    row = {"what": "rollout", "unit": "x real time", "runs": [[42.0, 10.0]]}
    file = tmp_path / "bench.json"
    file.write_text(json.dumps({"figures": {"rollout": [row, {**row, "runs": [[42.0, 20.0]]}]}}))
    found = against.readings_of(file, "rollout", tmp_path)
    assert found == {("rollout", "x real time"): against.Reading(42.0, False)}


@pytest.mark.parametrize(
    "text",
    ["", "[]", '{"figures": {}}', '{"figures": {"start": [{"what": "a", "unit": "s", "runs": [[0, 1]]}]}}'],
)
def test_figures_that_cannot_be_compared_name_the_checkout(text, tmp_path):
    file = tmp_path / "bench.json"
    file.write_text(text)
    with pytest.raises(CheckoutError, match=f"{tmp_path}.*"):
        against.readings_of(file, "start", tmp_path)


def test_a_command_that_fails_in_a_checkout_names_checkout_command_and_last_words(tmp_path):
    (tmp_path / "dev").write_text("#!/bin/sh\necho no master\nexit 3\n")
    (tmp_path / "dev").chmod(0o755)
    with pytest.raises(CheckoutError, match=rf"{tmp_path}/dev bench failed with exit code 3: no master"):
        run_in(tmp_path, "bench")


def bench(folder):
    done = subprocess.run(
        [sys.executable, BENCHMARKS / "bench.py", "--only", "clutter", "--against", folder],
        stderr=subprocess.PIPE, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2  # before anything is measured
    return done.stderr.splitlines()[-1]


def test_a_folder_that_is_not_a_checkout_is_refused_by_a_sentence(tmp_path):
    assert f"'{tmp_path}/none' is not a folder. Name the folder of another checkout" in bench(
        tmp_path / "none"
    )
    assert f"Cannot read '{tmp_path}/package.xml'" in bench(tmp_path)
    (tmp_path / "package.xml").write_text("<package><name>my_robot</name></package>")
    assert f"'{tmp_path}' is the package 'my_robot'." in bench(tmp_path)
    (tmp_path / "package.xml").write_text("<package><name>husky_highlevel_controller</name></package>")
    assert f"'{tmp_path}' has no dev, so it cannot be measured." in bench(tmp_path)
