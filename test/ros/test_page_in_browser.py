"""The page in a real browser: seen and driven by mouse and keys alone."""

import json
import re
import shutil
import subprocess
import sys
import time
from math import dist
from pathlib import Path

import pytest
import yaml
from network import Ros

CHROMIUM = shutil.which("chromium-headless-shell") or shutil.which("chromium")
if CHROMIUM is None:
    pytest.skip("needs Debian's chromium-headless-shell or chromium", allow_module_level=True)
sync_api = pytest.importorskip("playwright.sync_api")

SOFTWARE_WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox")
SIZE = {"width": 900, "height": 560}
COARSENESS = 0.25  # drawn pixels for each of the page's, along x and y: 16 times as fast by software
ADDRESS = re.compile(r"\]: (http://127\.0\.0\.1:\d+)\n")
DRAW_TIMEOUT = 90.0  # [s] of wall time for anything that a browser without a graphics card draws


class Robot:
    """What other nodes see of the robot."""

    def __init__(self, path):
        self._path = path

    def __getattr__(self, name):
        return json.loads(self._path.read_text())[name]


def wait_until(condition, what):
    end = time.monotonic() + DRAW_TIMEOUT
    while not condition():
        assert time.monotonic() < end, f"waited {DRAW_TIMEOUT} s until {what}"
        time.sleep(0.05)


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    network = Ros(tmp_path_factory.mktemp("page"))
    yield network
    network.end()


@pytest.fixture(scope="module")
def launched(network):
    process = network.roslaunch("controller.launch", "web:=true", "world_name:=empty.world", "seed:=1")
    wait_until(lambda: ADDRESS.search(process.output), "the page's address is printed")
    return ADDRESS.search(process.output).group(1)


@pytest.fixture(scope="module")
def robot(network, launched):
    path = network.folder / "robot.json"
    network.start(sys.executable, str(Path(__file__).with_name("watch_robot.py")), str(path))
    wait_until(lambda: path.exists() and Robot(path).speed is not None, "there is odometry")
    return Robot(path)


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(SOFTWARE_WEBGL))
        yield browser
        browser.close()


def opened(browser, address):
    page = browser.new_page(viewport=SIZE, device_scale_factor=COARSENESS)
    page.set_default_timeout(1000.0 * DRAW_TIMEOUT)
    page.complaints, page.hosts = [], set()
    page.on("console", lambda msg: msg.type == "error" and page.complaints.append(msg.text))
    page.on("pageerror", lambda error: page.complaints.append(str(error)))
    page.on("request", lambda request: page.hosts.add(request.url))
    page.goto(address)
    page.wait_for_selector("text=EMERGENCY STOP")
    return page


@pytest.fixture(scope="module")
def page(browser, launched):
    return opened(browser, launched)


def show(page, tab):
    page.get_by_role("tab", name=tab, exact=True).click()


def press(page, name):
    page.get_by_role("button", name=name, exact=True).click()


def test_the_page_opens_without_a_complaint_and_asks_no_other_host(page, launched):
    wait_until(lambda: "no diagnostics" not in page.inner_text("body"), "the page shows the diagnostics")
    assert page.complaints == []
    foreign = [url for url in page.hosts if not url.startswith((launched, "data:", "blob:"))]
    assert foreign == []


def test_a_key_drives_while_it_is_held(page, robot):
    press(page, "Stop")
    page.keyboard.down("w")
    wait_until(lambda: robot.speed > 0.4, "the robot drives")
    page.keyboard.up("w")
    wait_until(lambda: abs(robot.speed) < 0.01, "the robot stands again")
    assert robot.commanded == 0.0
    sent = robot.commands
    page.keyboard.type("q")
    assert robot.commands == sent


def test_the_pad_drives_while_it_is_dragged(page, robot):
    box = page.locator(".husky-pad").bounding_box()
    x, y = box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y + 60.0)
    wait_until(lambda: robot.speed < -0.3, "the robot drives backwards")
    page.mouse.up()
    wait_until(lambda: abs(robot.speed) < 0.01, "the robot stands again")


def test_the_emergency_stop_locks_and_releases(page, robot):
    page.click("text=EMERGENCY STOP")
    wait_until(lambda: robot.is_locked, "e_stop is sent")
    page.wait_for_selector("text=RELEASE")
    page.keyboard.down("w")
    wait_until(lambda: robot.commanded > 0.0, "the key is still sent")
    assert abs(robot.speed) < 0.01
    page.keyboard.up("w")
    page.click("text=RELEASE")
    wait_until(lambda: not robot.is_locked, "e_stop is released")
    page.wait_for_selector("text=EMERGENCY STOP")


@pytest.fixture
def objects(network):
    """A function that lists positions of the world's objects by name."""

    def listed():
        call = ["rosservice", "call", "/husky_simulator/list", "reference_frame: world"]
        answer = yaml.safe_load(
            subprocess.run(call, check=True, stdout=subprocess.PIPE, env=network.env).stdout
        )
        poses = (pose["position"] for pose in answer["poses"])
        return {name: (pose["x"], pose["y"]) for name, pose in zip(answer["model_names"], poses)}

    return listed


def test_a_click_on_the_ground_puts_a_box_there(page, robot, objects):
    before = objects()
    show(page, "World")
    press(page, "Put")
    page.wait_for_selector("text=Click the ground")
    page.mouse.click(300, 400)
    wait_until(lambda: objects().keys() - before.keys(), "there is a new object")
    ((name, position),) = [item for item in objects().items() if item[0] not in before]
    assert name.startswith("box")
    assert dist(position, robot.position) < 8.0  # near what is seen
    press(page, "Look")
    show(page, "Drive")
