"""Tune tab: the values of a server after a change, as they are saved, and what its fields show and send."""

import copy
import queue
import sys
import threading
import time
from types import SimpleNamespace

import pytest
from page_elements import Element

pytest.importorskip("rospy")
pytest.importorskip("viser")

import msgspec
import rospy
import viser
import yaml
from dynamic_reconfigure.encoding import (
    decode_config,
    encode_config,
    encode_description,
    get_tree,
    initial_config,
)
from dynamic_reconfigure.parameter_generator_catkin import ParameterGenerator, double_t
from websockets.sync.client import connect

from husky_web import tuning
from husky_web.actions import Actions
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
    server = _Server("/node", SimpleNamespace(gui=Element(), get_event_loop=Element), actions, changes.append)
    server._on_description(description)
    server._on_update(encode_config(copy.deepcopy(values)))
    for value in (0.6, 0.7):
        server.request({"p_gain": value}, None)
    assert yaml.safe_load(to_yaml({"/node": server.values})) == {"/node": {"p_gain": 0.7}}
    assert changes == ["p_gain 0.5 \u2192 0.6", "p_gain 0.6 \u2192 0.7"]


CAMERA = {
    "type": "ViewerCameraMessage",
    **{"wxyz": (1.0, 0.0, 0.0, 0.0), "position": (0.0, 0.0, 0.0)},
    **{"look_at": (1.0, 0.0, 0.0), "up_direction": (0.0, 0.0, 1.0)},
    **{"fov": 1.0, "near": 0.1, "far": 10.0, "image_height": 10, "image_width": 10},
}


def wait_until(condition, what):
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end, f"waited until {what}"
        time.sleep(0.01)


@pytest.fixture
def page():
    page = viser.ViserServer("127.0.0.1", 0, verbose=False)
    yield page
    page.stop()


@pytest.fixture
def enter(page):
    """Enters a value in a field, as a person does in a browser."""
    address, protocol = f"ws://127.0.0.1:{page.get_port()}", f"viser-v{viser.__version__}"
    with connect(address, subprotocols=[protocol], max_size=None) as browser:
        browser.send(msgspec.msgpack.encode(CAMERA))  # viser takes no value before it

        def send(field, value):
            change = {"type": "GuiUpdateMessage", "uuid": field._impl.uuid, "updates": {"value": value}}
            browser.send(msgspec.msgpack.encode(change))

        yield send


def test_a_value_of_a_person_is_sent_although_the_answer_to_an_earlier_one_comes_meanwhile(
    config_type, monkeypatch, page, enter
):
    monkeypatch.setattr(rospy, "Subscriber", lambda *_, **__: None)
    requests, is_ended = [], threading.Event()
    server = _Server("/node", page, SimpleNamespace(do=lambda *_: None), print)
    monkeypatch.setattr(server, "request", lambda values, _client: requests.append(values))
    server._on_description(encode_description(config_type))
    server._on_update(encode_config({"p_gain": 0.5}))
    slow = [page.gui.add_slider("slow", 0, 1, 1, 0) for _ in range(100)]  # more than viser has threads
    slider = server._fields["p_gain"]
    try:
        for element in slow:
            element.on_update(lambda _: is_ended.wait())
            enter(element, 1)
        enter(slider, 0.3)
        wait_until(lambda: slider.value == 0.3, "viser knows the person's value")
        server._on_update(encode_config({"p_gain": 0.6}))  # answer to an earlier value
        wait_until(lambda: slider.value == 0.6, "the answer is shown")
    finally:
        is_ended.set()
    wait_until(lambda: requests, "the person's value is sent")
    assert requests == [{"p_gain": 0.3}]


def test_a_value_is_shown_until_it_is_answered_and_can_be_taken_back_meanwhile(
    config_type, monkeypatch, page, enter
):
    monkeypatch.setattr(rospy, "Subscriber", lambda *_, **__: None)
    requests, answers = [], queue.Queue()

    def answer(_service, _kind, request):
        requests.append(decode_config(request, config_type.config_description)["p_gain"])
        return SimpleNamespace(config=encode_config({"p_gain": answers.get(timeout=60.0)}))

    monkeypatch.setattr(tuning, "answer_of", answer)
    server = _Server("/node", page, Actions(), lambda _: None)
    server._on_description(encode_description(config_type))
    server._on_update(encode_config({"p_gain": 0.5}))
    slider = server._fields["p_gain"]
    enter(slider, 0.6)
    wait_until(lambda: requests == [0.6], "the first value is sent")
    enter(slider, 0.7)
    wait_until(lambda: server._unsent, "the second value waits")
    answers.put(0.6)
    wait_until(lambda: requests == [0.6, 0.7], "the second value is sent")
    server._on_update(encode_config({"p_gain": 0.6}))  # the news of the first comes late
    is_filled = threading.Event()
    page.get_event_loop().call_soon_threadsafe(is_filled.set)  # behind all that fills the fields
    assert is_filled.wait(60.0)
    assert slider.value == 0.7
    enter(slider, 0.6)
    wait_until(lambda: server._unsent, "the first value waits again")
    answers.put(0.7)
    answers.put(0.6)
    wait_until(lambda: requests == [0.6, 0.7, 0.6], "it is sent again")
    wait_until(lambda: server.values["p_gain"] == slider.value == 0.6, "it is shown")
