"""Parameters of other nodes in the page: their fields, groups and files."""

from dataclasses import fields

import pytest

from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig
from husky_highlevel_controller.datatypes import HuskyError
from husky_web.parameters import (
    by_group,
    from_yaml,
    parameters,
    shown_value,
    to_yaml,
)


def entry(name, kind, low, high, default, description="", **more):
    shown = dict(name=name, type=kind, min=low, max=high, default=default, description=description)
    return {**shown, **more}


DESCRIPTION = {
    "parameters": [
        entry("p_gain", "double", 0.0, 10.0, 2.0, description="forward speed for each metre [1/s]"),
        entry("beams", "int", 1, 720, 2),
        entry("search", "bool", False, True, True),
    ],
    "groups": {"more": {"parameters": [entry("name", "str", "", "", "x")], "groups": {}}},
}


def test_parameters_of_all_groups_with_their_units():
    found = parameters(DESCRIPTION)
    labels = ["p_gain [1/s]", "beams", "search (default on)", "name (default x)"]
    assert [item.label for item in found] == labels
    assert [item.has_slider for item in found] == [True, True, False, False]
    assert [found[0].step, found[1].step] == [0.01, 1]


def test_the_controller_s_parameters_are_grouped_and_another_server_s_are_as_it_says():
    records = (*fields(ControlConfig), *fields(PillarConfig))
    ours = parameters({"parameters": [entry(item.name, "double", 0.0, 1.0, 0.5) for item in records]})
    groups = by_group(ours)
    assert list(groups) == ["Gains", "Limits", "Search", "Detection"]
    assert [item.name for item in groups["Gains"]] == ["p_gain_vel", "p_gain_ang"]
    assert {item.name for item in groups["Detection"]} == {item.name for item in fields(PillarConfig)}
    named = {"more": {**DESCRIPTION["groups"]["more"], "name": "more"}}
    assert list(by_group(parameters({**DESCRIPTION, "groups": named}))) == ["", "Search", "more"]


def test_an_enumeration_has_choices_and_shows_its_values_by_name():
    method = "{'enum': [{'name': 'Low', 'value': 0}, {'name': 'High', 'value': 2}]}"
    (found,) = parameters({"parameters": [entry("level", "int", 0, 2, 0, edit_method=method)]})
    assert found.choices == (("Low", 0), ("High", 2))
    assert not found.has_slider
    # its field has the names as options; a value among them would be sent again at each update
    assert [shown_value(found, value) for value in (0, 2, 7)] == ["Low", "High", 7]


def test_yaml_goes_round():
    known = {"/node": parameters(DESCRIPTION)}
    values = {"/node": {"p_gain": 3.5, "beams": 4, "search": False, "name": "y"}}
    assert from_yaml(to_yaml(values), known) == values


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "not valid YAML"),
        ("3", "names of nodes"),
        ("/other: {p_gain: 1}", "/other"),
        ("/node: {q_gain: 1}", "q_gain"),
        ("/node: {p_gain: 11}", "p_gain = 11 is not within 0.0..10.0"),
        ("/node: {p_gain: fast}", "p_gain = 'fast'"),
        ("/node: {beams: 2.5}", "beams = 2.5"),
        ("/node: {search: 1}", "search = 1"),
        ("/node: {p_gain: .nan}", "p_gain"),
    ],
)
def test_a_file_that_cannot_be_is_refused_in_words(text, words):
    with pytest.raises(HuskyError) as error:
        from_yaml(text, {"/node": parameters(DESCRIPTION)})
    assert words in str(error.value)
