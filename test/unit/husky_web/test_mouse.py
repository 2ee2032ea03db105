"""The mouse in the scene: clicks on the ground, and drags, by which an object stays under the mouse."""

import asyncio
from math import inf
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from husky_highlevel_controller.datatypes import IDENTITY, Pose
from husky_web.mouse import Drag, Mouse, point_on_level
from husky_web.objects import ObjectKey
from husky_web.pages import MOVE
from husky_web.state_bar import Moving


@pytest.mark.parametrize(
    ("down", "level", "point"),
    [(-1, 0.5, (1.5, 0.0, 0.5)), (1, 0.0, None), (0, 0.0, None), (-1e-4, 0.0, None)],
)
def test_a_click_meets_the_ground_below_the_horizon_only(down, level, point):
    assert point_on_level((0, 0, 2), (1, 0, down), level) == (point and pytest.approx(point))


def test_a_drag_ends_when_its_page_is_closed(monkeypatch):
    monkeypatch.setattr(Drag, "on_event", lambda drag, _: drag._show(IDENTITY))
    shape, node = Mock(), Mock(position=(0.0, 0.0, 0.0), wxyz=(1.0, 0.0, 0.0, 0.0))
    box = Mock(node=node, shapes=[shape], is_movable=True)
    objects = Mock(shown={ObjectKey("t", "box"): box}, dragged={})
    moving = Moving()
    mouse = Mouse(Mock(robot_shapes=[]), objects, None, moving, {7: SimpleNamespace(tool=MOVE)})
    mouse.bind()
    (on_drag,) = shape.on_drag.return_value.call_args.args
    asyncio.run(on_drag(Mock(phase="start", client=Mock(client_id=7))))
    assert objects.dragged
    mouse.release(8)
    assert objects.dragged, "another page"
    assert moving.text(0.0, inf) == "box"
    mouse.release(7)
    assert not objects.dragged
    assert moving.text(0.0, inf) == ""


EYE = np.array((-6.0, 0.0, 1.2))  # as behind the robot, before a pillar of 3 m
PILLAR = Pose((0.0, 0.0, 1.5))


def dragged(grasp, *rays):
    """Where an object is that was grasped at a point, and the mouse followed these rays from the camera."""
    shown, dropped = [], []
    drag = Drag(7, PILLAR, lambda pose: shown.append(pose.position), dropped.append)
    client = SimpleNamespace(camera=SimpleNamespace(position=EYE))
    for phase, ray in zip(("start", "update", "end"), (np.subtract(grasp, EYE), *rays)):
        drag.on_event(
            SimpleNamespace(phase=phase, client=client, start_position=grasp, end_position=EYE + 0.3 * ray)
        )
    assert dropped[-1].position == shown[-1]
    return np.array(shown[-1])


@pytest.mark.parametrize("height", [0.1, 0.7, 1.19, 1.21, 2.5])
@pytest.mark.parametrize("sideways", [-0.5, 1.5])
def test_an_object_stays_under_the_mouse_at_whatever_height_it_is_taken(height, sideways):
    grasp = np.array((-0.2, 0.1, height))
    ray = np.array((5.0, 0.1 + sideways, height - EYE[2]))
    moved = dragged(grasp, ray, ray) - PILLAR.position
    assert moved[2] == 0.0
    held = grasp + moved - EYE
    assert held[1] / held[0] == pytest.approx(ray[1] / ray[0]), "to the side"
    if height < 1.0:
        assert held / held[0] == pytest.approx(ray / ray[0]), "and in height"
    assert np.hypot(*moved[:2]) < 3.0


@pytest.mark.parametrize("height", [1.19, 1.5, 2.5])
def test_what_is_taken_near_the_horizon_or_above_does_not_fly_away(height):
    grasp = np.array((-0.2, 0.0, height))
    down = np.array((5.8, 0.0, -1.0))
    assert np.hypot(*(dragged(grasp, down, down) - PILLAR.position)[:2]) < 0.5
