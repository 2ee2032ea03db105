"""Tune tab: the values of a server after a change, as they are saved."""

import copy
import sys
from types import SimpleNamespace

import pytest
from page_elements import Element

pytest.importorskip("rospy")
pytest.importorskip("viser")

import rospy
import yaml
from dynamic_reconfigure.encoding import (
    decode_config,
    encode_config,
    encode_description,
    get_tree,
    initial_config,
)
from dynamic_reconfigure.parameter_generator_catkin import ParameterGenerator, double_t

from husky_web import tuning
from husky_web.parameters import to_yaml
from husky_web.tuning import _Server


@pytest.fixture
def config_type(monkeypatch):
    """Module as dynamic_reconfigure makes it from a .cfg file with a parameter in a group."""
    # the generator reads the folders of its files from the command line; no file is written here
    monkeypatch.setattr(sys, "argv", ["", "", "", "", ""])
    generator = ParameterGenerator()
    generator.add_group("Gains").add("p_gain", double_t, 0, "gain", 0.5, 0.0, 1.0)
    description = generator.group.to_dict()
    parameters = description["groups"][0]["parameters"]
    return SimpleNamespace(
        config_description=description,
        defaults={item["name"]: item["default"] for item in parameters},
        min={item["name"]: item["min"] for item in parameters},
        max={item["name"]: item["max"] for item in parameters},
    )


def test_the_values_can_be_saved_after_a_change(config_type, monkeypatch):
    description = encode_description(config_type)
    values = initial_config(
        encode_config({**config_type.defaults, "groups": get_tree(description)}),
        config_type.config_description,
    )

    def answer(_service, _kind, request):
        """Change the values as dynamic_reconfigure's server does."""
        values.update(decode_config(request, config_type.config_description))
        return SimpleNamespace(config=encode_config(copy.deepcopy(values)))

    monkeypatch.setattr(tuning, "answer_of", answer)
    monkeypatch.setattr(rospy, "Subscriber", lambda *_, **__: None)
    changes, actions = [], SimpleNamespace(do=lambda work, *_: work())
    server = _Server("/node", Element(), actions, changes.append)
    server._on_description(description)
    server._on_update(encode_config(copy.deepcopy(values)))
    for value in (0.6, 0.7):
        server.request({"p_gain": value}, None)
    assert yaml.safe_load(to_yaml({"/node": server.values})) == {"/node": {"p_gain": 0.7}}
    assert changes == ["p_gain 0.5 \u2192 0.6", "p_gain 0.6 \u2192 0.7"]
