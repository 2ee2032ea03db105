"""The ROS master of marking: who looks a service up is counted."""

import pytest
import rosmaster.master
import rosmaster.master_api
from rosgraph_server import end

from husky_grading.drive.ros_graph import MAX_CALLERS, callers
from husky_grading.nodes import master
from husky_grading.nodes.master import CountingMaster
from husky_highlevel_controller.xml_rpc import ask


@pytest.fixture
def uri(monkeypatch):
    """A master with a service /go, over XML-RPC."""
    monkeypatch.setattr(rosmaster.master_api, "ROSMasterHandler", CountingMaster)
    running = rosmaster.master.Master(0)
    running.start()
    ask(running.uri, "registerService", "/offers", "/go", "rosrpc://localhost:9", "http://localhost:9/")
    yield running.uri
    end(running.master_node)


def test_who_looks_a_service_up_is_counted_but_for_our_own_nodes(uri):
    assert callers(uri, "/go", ()) == {}
    for caller in ("/often", "/ours", "/often", "/once", "/often"):
        assert ask(uri, "lookupService", caller, "/go") == "rosrpc://localhost:9"
    assert ask(uri, "lookupService", "/waits", "/other") is None, "no such service"
    assert callers(uri, "/go", ["/ours"]) == {"/often": 3, "/once": 1}
    assert callers(uri, "/other", ()) == {}


def test_a_node_that_looks_up_under_any_number_of_names_fills_nothing(uri, monkeypatch):
    monkeypatch.setattr(master, "MAX_CALLERS", 8)
    for number in range(10):
        ask(uri, "lookupService", f"/name_{number}", "/go")
    assert len(ask(uri, "countLookups", "/marking", "/go")) == 8
    assert len(callers(uri, "/go", ())) == MAX_CALLERS
