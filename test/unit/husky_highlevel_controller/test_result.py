"""Results as text, page, JSON and CSV."""

import json
from math import inf

from husky_highlevel_controller.config import load
from husky_highlevel_controller.drawing.templates import write_page
from husky_highlevel_controller.result import PARAMETERS, Cell, Result, Table, every_row


def report(value=inf):
    rows = [("arrived [s]", value, Cell("MISSED", "missed")), ("n", 12, "")]
    tables = [Table("Times", ("figure", "value", ""), rows), every_row("Every <drive>", [{"t": value}])]
    return Result("Title", "seed 0", tables, "missed: t", True, "hash")


TEXT = """\
Title

seed 0

Times
figure       value
arrived [s]  2.000  MISSED
n               12

missed: t"""


def test_the_text_aligns_what_is_not_folded_and_ends_with_the_verdict():
    assert str(report(2.0)).splitlines() == TEXT.splitlines()


def test_a_table_of_parameters_shows_their_significant_digits():
    table = Table("", ("gain", "n"), [(0.00012, 3), (2.0, 3)], number_format=PARAMETERS)
    assert str(table).splitlines() == ["   gain  n", "0.00012  3", "      2  3"]
    assert "| 0.00012 |" in table.to_markdown()


def test_page_and_json_hold_every_table_and_what_is_not_finite_is_null(tmp_path):
    page = write_page(report(), tmp_path).read_text()
    assert "Every &lt;drive&gt;" in page
    assert '<p class="verdict missed">missed: t' in page
    content = json.loads((tmp_path / "report.json").read_text(), parse_constant=refuse)
    assert content["tables"][1]["rows"] == [[None]]
    assert (content["verdict"], content["failed"]) == ("missed: t", True)


def refuse(name):
    raise AssertionError(f"{name} is no JSON")


def test_results_of_the_same_figures_are_equal_and_come_back_from_their_file(tmp_path):
    assert report(1.0) == report(1.0)
    assert report(1.0) != report(2.0)
    write_page(report(1.0), tmp_path)
    assert load(Result, tmp_path / "report.json") == report(1.0)


def test_no_cell_of_a_csv_is_a_formula_and_a_negative_number_stays_one():
    cells = ("=1", "+1", "@a", "-a", "-1.5", -2.5)
    header = ["a", "b", "c", "d", "e", "f"]
    assert Table("", header, [cells]).to_csv() == "a,b,c,d,e,f\n'=1,'+1,'@a,'-a,-1.5,-2.5\n"
