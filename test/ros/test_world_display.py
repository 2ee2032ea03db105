"""Display of the world in RViz: what cannot be drawn does not hold the world."""

from types import SimpleNamespace
from unittest.mock import Mock

import rospy

from husky_highlevel_controller.ros.simulator.depth_camera import DepthCamera
from husky_highlevel_controller.ros.simulator.world_display import WorldDisplay


def test_a_body_that_cannot_be_drawn_does_not_end_the_simulation(monkeypatch):
    errors = []
    monkeypatch.setattr(rospy, "logerr", errors.append)
    display = object.__new__(WorldDisplay)
    display._transforms, display._server = Mock(), SimpleNamespace(is_watched=True, send=Mock())
    display._draw = Mock(side_effect=KeyError("a shape without a marker"))
    for _ in range(2):
        display.refresh()
    assert display._draw.call_count == 2, "it is tried again"
    (error,) = errors
    assert error.startswith("drawing the world's objects failed")


def test_an_image_that_cannot_be_made_does_not_end_the_simulation(monkeypatch):
    errors = []
    monkeypatch.setattr(rospy, "logerr_throttle", lambda _, text: errors.append(text))
    camera = object.__new__(DepthCamera)
    camera._update = Mock(side_effect=ValueError("cannot reshape"))
    camera.update(None, None)
    assert errors == ["camera/depth: cannot render an image: ValueError: cannot reshape"]
