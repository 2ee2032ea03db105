"""The master of ./dev launch tells of a parameter that is set and not read, if a like one was asked for."""

import pytest

pytest.importorskip("rosmaster")

import rosmaster.master
import rosmaster.master_api
from rosgraph_server import end

from husky_highlevel_controller.ros import parameter_master
from husky_highlevel_controller.ros.master_graph import read_unread_parameters
from husky_highlevel_controller.ros.parameter_master import ParameterMaster
from husky_highlevel_controller.ros.simulator.wrong_topics import (
    AbsentService,
    UnreadParameter,
    absent_services,
    mistake_sentence,
    unread_parameters,
)
from husky_highlevel_controller.xml_rpc import ask


@pytest.fixture
def master(monkeypatch):
    """Addresses of a running master of a class."""
    running = []

    def start(kind=ParameterMaster):
        monkeypatch.setattr(rosmaster.master_api, "ROSMasterHandler", kind)
        running.append(rosmaster.master.Master(0))
        running[0].start()
        return running[0].uri

    yield start
    end(running[0].master_node)


HAS, GETS, SEARCHES, CACHES = "hasParam", "getParam", "searchParam", "subscribeParam"


def asks(uri, node, method, name):
    ask(uri, method, node, *(("http://localhost:9/",) if method == CACHES else ()), name)


def launched(uri, *names):
    for name in names:
        assert ask(uri, "setParam", "/roslaunch", name, 0.5) is not None


@pytest.mark.parametrize("method", [HAS, GETS, SEARCHES, CACHES])
@pytest.mark.parametrize(
    ("name", "asked"),
    [
        ("/drive/sped", "/drive/speed"),
        ("/drive/Speed", "/drive/speed"),
        ("/drive/speed", "/speed"),  # without ~
        ("/drive/pgain", "/drive/p_gain"),
        ("/drive/gains/k_p", "/drive/gains/kp"),
    ],
)
def test_a_parameter_that_is_never_read_is_told_with_the_one_that_was_asked_for(name, asked, method, master):
    uri = master()
    launched(uri, name, "/drive/other")
    assert unread_parameters(uri) == []
    asks(uri, "/drive", method, asked)
    assert unread_parameters(uri) == [UnreadParameter("/drive", name, asked)]
    told = mistake_sentence(unread_parameters(uri)[0])
    assert told.startswith(f"/drive asked for the parameter {asked}, which is not set, but {name} is set")


@pytest.mark.parametrize(
    ("node", "method", "name"),
    [
        ("/drive", GETS, "/drive/sped"),
        ("/drive", GETS, "/drive"),
        ("/drive", GETS, "/drive/"),
        ("/other", GETS, "/drive/sped"),
        ("/other", HAS, "/drive/sped"),
        ("/drive", CACHES, "/drive/sped"),
    ],
)
def test_a_parameter_that_was_read_is_told_no_more(node, method, name, master):
    uri = master()
    launched(uri, "/drive/sped")
    asks(uri, "/drive", GETS, "/drive/speed")
    assert unread_parameters(uri)
    asks(uri, node, method, name)
    assert unread_parameters(uri) == []


def test_a_parameter_that_was_deleted_is_told_no_more(master):
    uri = master()
    launched(uri, "/drive/sped")
    asks(uri, "/drive", GETS, "/drive/speed")
    assert unread_parameters(uri)
    ask(uri, "deleteParam", "/rosparam", "/drive/sped")
    assert unread_parameters(uri) == []


@pytest.mark.parametrize("tool", ["/rosparam-12", "/roslaunch", "/rqt_gui_py_node_1", "/husky_simulator"])
def test_a_tool_that_reads_everything_is_no_reader(tool, master):
    uri = master()
    launched(uri, "/drive/sped")
    asks(uri, "/drive", GETS, "/drive/speed")
    asks(uri, tool, GETS, "/")
    assert len(unread_parameters(uri)) == 1


@pytest.mark.parametrize(
    ("name", "asked"),
    [
        ("/drive/max_range", "/drive/min_range"),
        ("/drive/gain1", "/drive/gain2"),
        ("/drive/sped", "/drive/turn"),
        ("/drive/sped", "/other/speed"),
        ("/drive_fast/sped", "/drive/speed"),
        ("/sped", "/drive/speed"),
    ],
)
def test_a_parameter_that_is_not_like_is_not_told(name, asked, master):
    uri = master()
    launched(uri, name)
    asks(uri, "/drive", GETS, asked)
    assert unread_parameters(uri) == []


def test_a_name_that_is_set_later_and_what_a_node_sets_itself_are_not_told(master):
    uri = master()
    launched(uri, "/drive/sped")
    asks(uri, "/drive", GETS, "/drive/speed")
    launched(uri, "/drive/speed")
    asks(uri, "/drive", GETS, "/drive/speed")
    assert unread_parameters(uri) == []
    asks(uri, "/drive", GETS, "/drive/turns")
    assert ask(uri, "setParam", "/drive", "/drive/turn", 1) is not None
    assert unread_parameters(uri) == []


def test_a_node_that_asks_for_any_number_of_names_fills_nothing(master, monkeypatch):
    monkeypatch.setattr(parameter_master, "MAX_REQUESTS", 3)
    uri = master()
    for number in range(5):
        asks(uri, "/drive", GETS, f"/drive/a{number}")
    launched(uri, "/drive/sped")
    asks(uri, "/drive", GETS, "/drive/speed")
    assert unread_parameters(uri) == []


def test_a_plain_master_knows_nothing(master):
    uri = master(rosmaster.master_api.ROSMasterHandler)
    launched(uri, "/drive/sped")
    asks(uri, "/drive", GETS, "/drive/speed")
    assert read_unread_parameters(uri) == []


@pytest.mark.parametrize(
    ("service", "remedy"),
    [
        ("/gazebo/get_link_state", "call /gazebo/get_model_state, or use TF"),
        ("/robot1/gazebo/set_link_state", "call /robot1/gazebo/set_model_state"),
        ("/gazebo/get_light_properties", "see docs/gazebo_launch_files.md"),
    ],
)
def test_a_node_that_waits_for_a_service_of_gazebo_is_told_once_what_to_use(service, remedy, master):
    uri = master()
    for _ in range(3):  # as wait_for_service does
        ask(uri, "lookupService", "/learner", service)
    ask(uri, "lookupService", "/learner", "/lab/open_door")  # some other simulator's, or one that comes later
    ask(uri, "lookupService", "/rosservice", "/gazebo/get_world_list")
    assert absent_services(uri) == [AbsentService("/learner", service)]
    told = mistake_sentence(AbsentService("/learner", service))
    assert told.startswith(
        f"/learner asks for the service {service}, which this simulator does not have: {remedy}"
    )


def test_a_service_that_came_later_is_told_no_more(master):
    uri = master()
    ask(uri, "lookupService", "/learner", "/gazebo/set_model_state")
    ask(
        uri,
        "registerService",
        "/sim",
        "/gazebo/set_model_state",
        "rosrpc://localhost:9",
        "http://localhost:9/",
    )
    assert absent_services(uri) == []


def test_another_master_tells_of_no_services(master):
    assert absent_services(master(rosmaster.master_api.ROSMasterHandler)) == []
