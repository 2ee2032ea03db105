"""The camera follows the robot, and keeps what the mouse has turned."""

from contextlib import contextmanager
from math import pi
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_web import camera


class Browser:
    """A page's camera as its server sees it: what is sent to it, and what it reports some updates later."""

    def __init__(self, monkeypatch):
        self.camera = SimpleNamespace()
        self.sent = []
        monkeypatch.setattr(camera, "look", lambda _, position, target: self.sent.append((position, target)))
        self.report((3.0, 3.0, 3.0), (0.0, 0.0, 0.0))

    @contextmanager
    def atomic(self):
        yield

    def report(self, position, look_at):
        z = np.array(look_at) - position
        z /= np.linalg.norm(z)
        x = np.cross(z, (0.0, 0.0, 1.0))
        x /= np.linalg.norm(x)
        rotation = np.eye(4)
        rotation[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
        self.camera.wxyz = trimesh.transformations.quaternion_from_matrix(rotation)
        self.camera.position, self.camera.look_at = np.array(position), np.array(look_at)


def pose(x, y=0.0, yaw=0.0):
    return Pose((x, y, 0.0), quat_from_rpy(0.0, 0.0, yaw))


def test_the_camera_comes_to_stand_behind_a_robot_that_turns_though_the_page_reports_late(monkeypatch):
    browser = Browser(monkeypatch)
    follow = camera.Camera(browser)
    for update in range(200):
        follow.update(pose(0.05 * update, yaw=min(0.02 * update, pi / 2.0)), None)
        browser.report(*browser.sent[max(0, update - 10)])
    (x, y, z), (at_x, at_y, at_z) = browser.sent[-1]
    behind, left, above = camera.OFFSETS[camera.FOLLOW]
    assert (x - at_x, y - at_y, z - at_z) == pytest.approx((-left, behind, above), abs=0.05)


def test_the_camera_keeps_the_side_that_the_mouse_has_turned_it_to(monkeypatch):
    browser = Browser(monkeypatch)
    follow = camera.Camera(browser)
    follow.update(pose(0.0), None)
    browser.report(*browser.sent[-1])
    follow.update(pose(0.05), None)
    browser.report((0.05, 6.0, 1.0), (0.05, 0.0, 0.0))  # by the mouse
    for update in range(2, 50):
        follow.update(pose(0.05 * update), None)
        browser.report(*browser.sent[-1])
    position, target = browser.sent[-1]
    assert np.subtract(position, target) == pytest.approx((0.0, 6.0, 1.0), abs=0.01)


def test_the_camera_is_sent_nothing_while_the_robot_stands(monkeypatch):
    browser = Browser(monkeypatch)
    follow = camera.Camera(browser)
    for _ in range(10):
        follow.update(pose(1.0), None)
    assert len(browser.sent) == 1


def test_a_camera_that_is_chosen_during_an_update_counts_in_the_next_update(monkeypatch):
    browser = Browser(monkeypatch)
    moving = camera.Camera(browser)
    pillar = (9.0, 0.0, 1.0)

    def choose_meanwhile(name):
        monkeypatch.setattr(camera, "yaw_from_quat", lambda _: moving.choose(name) or 0.0)
        moving.update(pose(0.0), pillar)

    choose_meanwhile(camera.FREE)
    moving.choose(camera.FOLLOW)
    choose_meanwhile(camera.PILLAR)
    moving.update(pose(0.0), pillar)
    _, target = browser.sent[-1]
    assert target[:2] == pillar[:2]
