"""The page in a real browser: seen and driven by mouse and keys alone."""

import json
import re
import shutil
import socket
import sys
import threading
from contextlib import contextmanager, suppress
from functools import partial
from math import dist
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import imageio.v3 as imageio
import numpy as np
import pytest
import viser
from network import Ros, free_port
from network import wait_until as wait_until_within
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from husky_highlevel_controller.drawing.replay import Replay, to_html
from husky_web.teleop import RELEASE_AFTER

CHROMIUM = shutil.which("chromium-headless-shell") or shutil.which("chromium")
if CHROMIUM is None:
    pytest.skip("needs Debian's chromium-headless-shell or chromium", allow_module_level=True)
sync_api = pytest.importorskip("playwright.sync_api")

SOFTWARE_WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox")
WITHOUT_GPU = "--disable-gpu-compositing"  # SwiftShader draws the scene, not the page around it
SIZE = {"width": 900, "height": 560}
COARSENESS = 0.25  # drawn pixels for each of the page's, along x and y: 16 times as fast by software
ADDRESS = re.compile(r": (http://127\.0\.0\.1:\d+)\n")
# a picture in two seconds, or when it is asked for: an open page would take a whole core all the time
SELDOM = """
const draw = requestAnimationFrame, waiting = new Map();
window.requestAnimationFrame = work => {
  const timer = setTimeout(() => { waiting.delete(timer); draw(work); }, 2000);
  waiting.set(timer, work);
  return timer;
};
window.cancelAnimationFrame = timer => { clearTimeout(timer); waiting.delete(timer); };
window.drawNow = () => waiting.forEach((work, timer) => {
  clearTimeout(timer); waiting.delete(timer); draw(work);
});
"""
TIME_SHOWN = "Number(document.querySelector('[data-time]')?.dataset.time)"  # NaN where none is shown
NEXT_PICTURE = """new Promise(done => {
  const timer = setInterval(drawNow, 20);
  requestAnimationFrame(() => requestAnimationFrame(() => { clearInterval(timer); done(); }));
})"""
E_STOP = ".husky-e-stop:not(.locked):has-text('EMERGENCY STOP')"  # a warning has these words, too
# notes that the state bar said so, for a test that may come too late to see it
NOTE_DRIVING = (
    "() => new MutationObserver((_, observer) => {"
    " if (!document.querySelector('.husky-state')?.textContent.toLowerCase().includes('driving')) return;"
    " window.saidDriving = true; observer.disconnect();"
    "}).observe(document.body, {subtree: true, childList: true, characterData: true})"
)
UNMOVED = "document.getAnimations().every(item => item.playState !== 'running')"
SKY = 20  # row of the view in which nothing is drawn
# keeps each sentence of the state bar, for a test that may come too late to see it
NOTE_STATES = """() => {
  const state = () => document.querySelector('.husky-state b')?.textContent;
  window.states = [state()];
  new MutationObserver(() => { if (state() && state() !== states.at(-1)) states.push(state()); })
    .observe(document.body, {subtree: true, childList: true, characterData: true});
}"""
DRAW_TIMEOUT = 240.0  # [s] of wall time for anything that a browser without a graphics card draws


class Link:
    """Network between a browser and the page's server; while it is down, it takes bytes and loses them."""

    def __init__(self, port):
        self._server = ("127.0.0.1", port)
        self._is_up, self._sockets = True, []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def take_down(self):
        self._is_up = False

    def bring_back(self):
        """End the connections, as a server does that has given them up meanwhile."""
        self._is_up = True
        for end in self._sockets:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
        self._sockets.clear()

    def _accept(self):
        while True:
            browser_end, _ = self._listener.accept()
            server_end = socket.create_connection(self._server)
            self._sockets += [browser_end, server_end]
            for ends in ((browser_end, server_end), (server_end, browser_end)):
                threading.Thread(target=self._carry, args=ends, daemon=True).start()

    def _carry(self, source, target):
        with suppress(OSError), source, target:
            while data := source.recv(65536):
                if self._is_up:
                    target.sendall(data)


class Robot:
    """What other nodes see of the robot."""

    def __init__(self, path):
        self._path = path

    def __getattr__(self, name):
        return json.loads(self._path.read_text())[name]


wait_until = partial(wait_until_within, deadline=DRAW_TIMEOUT)


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    network = Ros(tmp_path_factory.mktemp("page"))
    yield network
    network.end()


@pytest.fixture(scope="module")
def launched(network):
    process = network.roslaunch("controller.launch", "web:=true", "seed:=1")
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
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=[*SOFTWARE_WEBGL, WITHOUT_GPU], timeout=1000.0 * DRAW_TIMEOUT
        )
        yield browser
        browser.close()


def opened(browser, address, selector=E_STOP, size=SIZE, has_touch=False):
    page = browser.new_page(viewport=size, device_scale_factor=COARSENESS, has_touch=has_touch)
    page.context.add_init_script(SELDOM)  # for pages that it opens, too
    page.context.set_default_timeout(1000.0 * DRAW_TIMEOUT)
    page.complaints, page.hosts = [], set()
    page.on("console", lambda msg: msg.type == "error" and page.complaints.append(msg.text))
    page.on("pageerror", lambda error: page.complaints.append(str(error)))
    page.on("request", lambda request: page.hosts.add(request.url))
    page.goto(address)
    page.wait_for_selector(selector)
    return page


@pytest.fixture(scope="module")
def page(browser, launched):
    page = opened(browser, launched)
    wait_until_unfolded(page)
    return page


def wait_until_unfolded(page):
    """A page that has just been opened unfolds its panel from below; until then, its elements move."""
    wait_until(lambda: box_of(page, ".husky-e-stop")["y"] < SIZE["height"] / 2.0, "the panel is unfolding")
    page.wait_for_function(UNMOVED)


@pytest.fixture(autouse=True)
def put_right(request):
    """After a failure, end what the test has left pressed, paused or locked: the next one would fail, too."""
    failed_before = request.session.testsfailed
    yield
    if request.session.testsfailed == failed_before or "page" not in request.fixturenames:
        return
    page, network = (request.getfixturevalue(name) for name in ("page", "network"))
    page.mouse.up()
    for key in ("w", "a", "Meta", "Space"):
        page.keyboard.up(key)
    network.run("rostopic", "pub", "-1", "/e_stop", "std_msgs/Bool", "false")
    for service in ("husky_simulator/resume", "husky_simulator/reset"):
        network.call(f"/{service}")
    network.call("/husky_highlevel_controller/start_stop", "true")
    page.reload()
    page.wait_for_selector(E_STOP)
    wait_until_unfolded(page)


def show(page, tab):
    page.get_by_role("tab", name=tab, exact=True).click()


def press(page, name):
    page.get_by_role("button", name=name, exact=True).click()


def stand(page, network):
    """Stop the controller, whatever it does; a person's command then is the only one."""
    network.call("/husky_highlevel_controller/start_stop", "false")
    page.get_by_role("button", name="Start", exact=True).wait_for()


def release_e_stop(page, by_key=False):
    page.wait_for_selector(".husky-e-stop.locked")
    page.wait_for_timeout(1000 * RELEASE_AFTER)  # a release that comes sooner is part of a double click
    if by_key:
        page.press(".husky-e-stop.locked", "Enter")
    else:
        page.click(".husky-e-stop.locked")


def filled(page, names):
    """The one among these buttons that is filled; None where none is."""
    colors = page.evaluate(
        "names => names.map(name => getComputedStyle("
        "[...document.querySelectorAll('button')].find(item => item.textContent === name)).backgroundColor)",
        names,
    )
    return next((name for name, color in zip(names, colors) if colors.count(color) == 1), None)


def test_a_raised_button_says_which_camera_is_chosen_and_a_toggle_says_what_it_does(page, network):
    show(page, "View")
    for name in ("Above", "Follow"):
        press(page, name)
        wait_until(lambda name=name: filled(page, ["Follow", "Pillar", "Above", "Free"]) == name, name)
    show(page, "Drive")
    button = partial(page.get_by_role, "button", exact=True)
    for request, name, other in (("false", "Start", "Stop"), ("true", "Stop", "Start")):
        network.call("/husky_highlevel_controller/start_stop", request)
        button(name=name).wait_for()
        assert button(name=other).locator("visible=true").count() == 0
    for name, other in (("Pause", "Resume"), ("Resume", "Pause")):
        press(page, name)
        button(name=other).wait_for()
        assert button(name=name).count() == 0


def test_every_control_that_the_keyboard_reaches_has_a_name(page):
    nameless = (
        "[...document.querySelectorAll('button, input, select, textarea, [role=slider]')].filter(item =>"
        " item.offsetParent && item.tabIndex >= 0 && !item.getAttribute('aria-label')"
        " && !item.innerText.trim() && !item.labels?.length).map(item => item.outerHTML)"
    )
    for tab in ("World", "Tune", "Curves", "Log", "View", "Drive"):
        show(page, tab)
        wait_until(lambda: page.evaluate(nameless) == [], f"everything of {tab} has a name")


def yellow(page):
    """Rows and columns of a picture of the view in which the Husky's yellow is seen."""
    page.evaluate(NEXT_PICTURE)
    pads = page.locator(".husky-pad")
    pads.first.wait_for(state="attached")  # or it comes after the mask, and is yellow, too
    image = imageio.imread(page.screenshot(mask=[pads], mask_color="#000000")).astype(int)
    red, green, blue = image[..., 0], image[..., 1], image[..., 2]
    is_yellow = (red > 150) & (green > 120) & (blue < 0.6 * green)
    return np.flatnonzero(is_yellow.any(axis=1)), np.flatnonzero(is_yellow.any(axis=0))


def box_of(page, selector):
    return page.locator(selector).first.bounding_box()


@contextmanager
def touched(page, begin, end):
    """A finger that goes from one point to another, and is lifted behind the block."""
    touch = page.context.new_cdp_session(page)
    for kind, point in (("touchStart", begin), ("touchMove", end)):
        points = [{"x": point[0], "y": point[1]}]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    yield
    touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


@pytest.mark.slow
def test_the_scene_fills_every_window_and_the_robot_is_in_the_middle_of_what_is_free(
    browser, launched, robot
):
    phone = opened(browser, launched, size={"width": 390, "height": 844}, has_touch=True)
    canvas = "[...document.querySelectorAll('canvas')].map(c => c.getBoundingClientRect())"

    def is_filled(width, height):
        return f"{canvas}.every(box => box.width === {width} && box.height === {height})"

    phone.wait_for_function(is_filled(390, 844))
    wait_until(lambda: yellow(phone)[0].size > 0, "the robot is drawn")
    state, e_stop = partial(box_of, phone, ".husky-state"), partial(box_of, phone, ".husky-e-stop")
    wait_until(lambda: 500.0 < state()["y"] < e_stop()["y"] < 844.0 - 48.0, "the panel is below the scene")
    phone.wait_for_function(UNMOVED)
    head = state()["y"]
    assert yellow(phone)[0].max() < head * COARSENESS
    pad = box_of(phone, ".husky-scene-pad")
    assert pad["y"] + pad["height"] < head
    assert phone.get_by_role("button", name="Drive again", exact=True).bounding_box()["height"] >= 44.0
    x, y = pad["x"] + pad["width"] / 2.0, pad["y"] + pad["height"] / 2.0
    with touched(phone, (x, y), (x, y + 50.0)):
        wait_until(lambda: robot.commanded < -0.1, "the pad on the scene drives")
    wait_until(lambda: robot.commanded == 0.0, "a thumb that is lifted stops it")
    phone.click("text=Husky in singlePillar")  # the head of the panel
    phone.wait_for_function("document.querySelector('.husky-state').getBoundingClientRect().top < 400")
    phone.click("text=Husky in singlePillar")
    phone.set_viewport_size({"width": 1280, "height": 800})
    phone.wait_for_function(is_filled(1280, 800))
    free = box_of(phone, "[data-floating-window]")["x"]
    assert free > 800.0
    wait_until(
        lambda: abs(yellow(phone)[1].mean() / COARSENESS - free / 2.0) < 0.1 * free,
        "the robot is in the middle",
    )
    show(phone, "Curves")
    charts = "document.querySelector('.husky-charts').getBoundingClientRect()"
    phone.wait_for_function(f"{charts}.width === 1280 && {charts}.bottom === 800")
    assert phone.locator(".husky-chart").count() == 4
    assert "stop_distance" in phone.locator(".husky-chart").first.text_content()

    def value_at_the_mouse():
        """The time and the value in the chart; no value where the page was not open yet."""
        chart = box_of(phone, ".husky-chart svg")
        phone.mouse.move(chart["x"] + 0.9 * chart["width"], chart["y"] + 0.5 * chart["height"])
        return phone.locator(".husky-cursor").text_content()

    is_value = re.compile(r"-\d+\.\d s: \d+\.\d\d").fullmatch
    wait_until(lambda: is_value(value_at_the_mouse()), "the chart has a value at the mouse")
    top = phone.evaluate(f"{charts}.top")
    wait_until(lambda: yellow(phone)[0].max() < top * COARSENESS, "the robot is above the curves")
    phone.close()


def test_what_is_drawn_stays_close_behind_the_robot(page, robot):
    for _ in range(5):
        page.evaluate(NEXT_PICTURE)
        assert robot.time - page.evaluate(TIME_SHOWN) < 2.0


def test_garbage_to_upload_is_refused_with_a_sentence(page, tmp_path):
    show(page, "Tune")
    for content, words in ((b"\xff\xfe", "is not a text file"), (b"{", "is not valid YAML")):
        (tmp_path / "garbage.yaml").write_bytes(content)
        with page.expect_file_chooser() as chooser:
            press(page, "Load YAML")
        chooser.value.set_files(tmp_path / "garbage.yaml")
        page.wait_for_selector(f"text={words}")
    show(page, "Drive")


def test_the_log_is_filtered_by_text(page, network):
    show(page, "Log")
    publish = ("rostopic", "pub", "-1", "/rosout", "rosgraph_msgs/Log")
    for text in ("one of a kind", "another"):
        network.start(*publish, f"{{level: 2, msg: {text}}}")
    page.wait_for_selector(".husky-log >> text=one of a kind")
    page.wait_for_selector(".husky-log >> text=another")
    label = page.locator("label", has_text=re.compile("^Text$"))
    field = label.locator("xpath=ancestor::div[.//input][1]").locator("input")
    field.fill("ONE OF A KIND")
    lines = page.locator(".husky-log div")

    def are_of_a_kind():
        return {"one of a kind" in line for line in lines.all_inner_texts()}

    wait_until(lambda: are_of_a_kind() == {True}, "this line alone is shown")
    field.fill("smallest range 19.")  # of the first seconds, in which the page's node still starts
    page.wait_for_selector(".husky-log >> text=smallest range 19.")
    field.fill("nothing has said this")
    page.wait_for_selector("text=no lines pass the filter")
    field.fill("")
    show(page, "Drive")


def test_at_arrival_the_page_offers_to_move_the_pillar_and_to_drive_again(page, robot):
    arrived = ".husky-state:has-text('at the pillar')"
    before_arrival = box_of(page, ".husky-e-stop"), box_of(page, "[role=tab]")
    page.wait_for_selector(arrived)
    assert (box_of(page, ".husky-e-stop"), box_of(page, "[role=tab]")) == before_arrival, "nothing jumps"
    before = robot.objects["unit_cylinder"]
    page.evaluate(NOTE_DRIVING)
    press(page, "Move the pillar")
    wait_until(lambda: dist(robot.objects["unit_cylinder"], before) > 3.0, "the pillar is elsewhere")
    page.wait_for_function("window.saidDriving")
    page.wait_for_selector(arrived)
    press(page, "Drive again")
    wait_until(lambda: robot.jumped_to is not None, "the robot is put elsewhere")
    assert dist(robot.jumped_to, (0.0, 0.0)) < 0.1
    wait_until(lambda: robot.fastest > 0.5, "the robot drives")
    # the places of the objects are asked for, so on a busy machine they come later than the odometry
    wait_until(lambda: dist(robot.objects["unit_cylinder"], (20.0, 5.0)) < 0.1, "the pillar is back")


def test_another_world_is_loaded_and_the_first_again(page, robot):
    show(page, "World")
    page.wait_for_selector("text=loaded: singlePillar.world")
    for world, has_pillar in (("ramp.world", False), ("singlePillar.world", True)):
        page.locator("input[aria-label=File]").click()
        page.get_by_role("option", name=world).click()
        press(page, "Load")
        wait_until(lambda has=has_pillar: ("unit_cylinder" in robot.objects) == has, f"{world} is there")
        page.wait_for_selector(f"text=loaded: {world}")
    show(page, "Drive")


def test_a_slider_that_is_moved_slows_the_robot(page, robot, network):
    show(page, "Tune")
    slider = slider_of(page, "max_linear")
    network.call("/husky_simulator/reset")  # 20 s to the pillar from here
    wait_until(lambda: robot.speed > 0.8, "the controller drives")
    network.call("/husky_simulator/pause")  # a slow page must not see it arrive meanwhile
    slider.hover()  # waits until it stands still, and nothing is above it
    track = slider.locator("xpath=..").bounding_box()
    page.mouse.down()
    page.mouse.move(track["x"] + 0.3 * track["width"], track["y"] + track["height"] / 2.0, steps=3)
    page.mouse.up()
    wait_until(lambda: 0.2 < float(slider.get_attribute("aria-valuenow")) < 0.4, "the slider is there")
    network.call("/husky_simulator/resume")
    wait_until(lambda: 0.1 < robot.speed < 0.5, "the robot slows")


def test_a_parameter_that_is_changed_elsewhere_moves_the_slider(page, network):
    node = "/husky_highlevel_controller"
    show(page, "Tune")
    network.run("rosrun", "dynamic_reconfigure", "dynparam", "set", node, "max_linear", "0.8")
    slider = slider_of(page, "max_linear")
    wait_until(lambda: float(slider.get_attribute("aria-valuenow")) == 0.8, "the slider has moved")
    show(page, "Drive")


def slider_of(page, name):
    row = page.locator("label", has_text=name).locator("xpath=ancestor::div[.//*[@role='slider']][1]")
    return row.get_by_role("slider").first


def wait_until_it_stands(page, robot):
    # a page that draws by software hears of the key late
    page.wait_for_function("document.querySelector('.husky-knob').style.transform === 'translate(0px, 0px)'")
    wait_until(lambda: robot.commanded == 0.0 and abs(robot.speed) < 0.01, "the robot stands again")


def test_a_key_drives_while_it_is_held_and_the_pad_while_it_is_dragged(page, robot, network):
    stand(page, network)
    page.keyboard.down("w")
    wait_until(lambda: robot.speed > 0.4, "the robot drives")
    page.keyboard.up("w")
    wait_until_it_stands(page, robot)
    sent = robot.commands
    page.keyboard.type("q")
    assert robot.commands == sent
    box = page.locator(".husky-pad:visible").bounding_box()
    x, y = box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y + 60.0)
    wait_until(lambda: robot.speed < -0.3, "the robot drives backwards")
    page.mouse.up()
    wait_until_it_stands(page, robot)


def test_a_key_whose_release_the_browser_may_not_report_drives_no_more(page, robot, network):
    stand(page, network)
    takers = {
        "Command key": lambda: page.keyboard.down("Meta"),
        "context menu": lambda: page.click("text=Let go to stop", button="right"),
    }
    for taker, take in takers.items():
        page.keyboard.down("w")
        wait_until(lambda: robot.speed > 0.4, f"the robot drives before the {taker}")
        take()
        wait_until_it_stands(page, robot)
        for key in ("Meta", "w"):
            page.keyboard.up(key)


def test_the_emergency_stop_locks_for_every_page_and_released_leaves_the_robot_standing(
    page, robot, browser, launched, network
):
    stand(page, network)
    press(page, "Start")
    show(page, "Log")  # the stop is above the tabs
    page.hover(E_STOP)
    page.mouse.down()
    page.eval_on_selector(E_STOP, "button => button.replaceWith(button.cloneNode(true))")  # drawn anew
    page.mouse.up()
    wait_until(lambda: robot.is_locked, "e_stop is sent")
    page.wait_for_selector(".husky-e-stop.locked")
    page.wait_for_selector("text=emergency stop: the robot obeys no command")
    opened(browser, launched, ".husky-e-stop.locked").close()
    page.reload()
    page.wait_for_selector(".husky-e-stop.locked")
    press(page, "Start")
    page.wait_for_selector("text=the emergency stop is on; release it first")
    page.keyboard.down("w")
    wait_until(lambda: robot.commanded > 0.0, "the key is still sent")
    assert abs(robot.speed) < 0.01
    page.keyboard.up("w")
    release_e_stop(page)
    wait_until(lambda: not robot.is_locked, "e_stop is released")
    page.wait_for_selector(E_STOP)
    page.wait_for_selector(".husky-state:has-text('standing still until Start is pressed')")
    begin = robot.time
    wait_until(lambda: robot.time > begin + 2.0, "two seconds pass")
    assert abs(robot.speed) < 0.01
    assert page.locator(".husky-banner:not(:empty)").count() == 0, "the stop was confirmed"


def test_a_double_click_on_the_emergency_stop_does_not_release_it(page, robot):
    page.dblclick(E_STOP)
    wait_until(lambda: robot.is_locked, "e_stop is sent")
    page.wait_for_timeout(1000 * RELEASE_AFTER)
    assert robot.is_locked
    release_e_stop(page)
    wait_until(lambda: not robot.is_locked, "e_stop is released")


def test_space_is_the_emergency_stop_even_with_a_button_in_focus(page, robot, network):
    stand(page, network)
    page.get_by_role("button", name="Start", exact=True).focus()
    page.keyboard.press("Space")
    wait_until(lambda: robot.is_locked, "e_stop is sent")
    release_e_stop(page, by_key=True)
    wait_until(lambda: not robot.is_locked, "e_stop is released")


def test_space_is_the_emergency_stop_even_after_a_click_on_a_checkbox(page, robot):
    show(page, "View")
    checkbox = page.get_by_role("checkbox").first
    checkbox.click()
    page.keyboard.press("Space")
    wait_until(lambda: robot.is_locked, "e_stop is sent")
    checkbox.click()
    release_e_stop(page, by_key=True)
    wait_until(lambda: not robot.is_locked, "e_stop is released")
    show(page, "Drive")


def test_an_emergency_stop_that_the_network_loses_is_sent_again(browser, launched, robot):
    link = Link(int(launched.rpartition(":")[2]))
    page = opened(browser, f"http://127.0.0.1:{link.port}")
    link.take_down()
    page.keyboard.press("Space")
    page.wait_for_selector(".husky-banner:has-text('has NOT been confirmed')")
    assert not robot.is_locked
    link.bring_back()
    wait_until(lambda: robot.is_locked, "e_stop is sent")
    release_e_stop(page)
    wait_until(lambda: not robot.is_locked, "e_stop is released")
    page.wait_for_selector(".husky-banner:empty", state="attached")
    page.close()


def test_a_paused_world_says_so_on_every_tab(page):
    press(page, "Pause")
    page.wait_for_selector(".husky-state:has-text('PAUSED')")
    show(page, "View")
    page.wait_for_selector(".husky-state:has-text('PAUSED')")
    show(page, "Drive")
    press(page, "Resume")
    page.wait_for_selector(".husky-state:not(:has-text('PAUSED'))")


def test_the_state_follows_each_change_at_once_and_says_nothing_false_in_between(page, network):
    driving, standing, by_hand = (
        "driving to the pillar", "standing still until Start is pressed", "driven by hand",
    )  # fmt: skip
    network.call("/husky_simulator/reset")
    network.call("/husky_highlevel_controller/start_stop", "true")
    page.wait_for_selector(f".husky-state:has-text('{driving}')")
    page.evaluate(NOTE_STATES)
    expected = [driving]

    def comes(state):
        expected.append(state)
        page.wait_for_function("state => states.at(-1) === state", arg=state)

    press(page, "Pause")
    comes("PAUSED")
    press(page, "Resume")
    comes(driving)
    page.keyboard.down("a")
    comes(by_hand)
    page.keyboard.up("a")
    comes(driving)
    press(page, "Stop")
    comes(standing)
    page.keyboard.down("w")
    comes(by_hand)
    page.keyboard.up("w")
    comes(standing)
    press(page, "Start")
    comes(driving)
    network.call("/husky_highlevel_controller/start_stop", "false")
    comes(standing)
    other = network.start(
        "rostopic", "pub", "-r", "20", "/cmd_vel", "geometry_msgs/Twist", "{linear: {x: 0.3}}"
    )
    comes("/rostopic drives the robot")
    other.popen.terminate()
    comes(standing)
    network.call("/husky_highlevel_controller/start_stop", "true")
    comes(driving)
    page.keyboard.press("Space")
    comes("emergency stop: the robot obeys no command")
    release_e_stop(page)
    comes(standing)
    # between its start and its first scan a controller waits for one
    assert [state for state in page.evaluate("states") if not state.startswith("waiting")] == expected


def take(page, tool, hint):
    """Choose a tool of the mouse, and wait until the page says what to do with it."""
    press(page, tool)
    page.wait_for_selector(f"text={hint}")
    page.evaluate(NEXT_PICTURE)  # the scene is drawn after the text


def hover(page, x, y):
    """Move the mouse to what can be dragged at (x, y): the cursor is a hand as soon as it is drawn there."""
    cursor = "([x, y]) => document.elementFromPoint(x, y).style.cursor"

    def cursor_at(y):
        page.mouse.move(x, y)
        page.evaluate(NEXT_PICTURE)
        return page.evaluate(cursor, [x, y])

    wait_until(lambda: cursor_at(SKY) != "pointer", "the tool before is put away")
    wait_until(lambda: (cursor_at(SKY), cursor_at(y))[1] == "pointer", "there is something to drag")


def test_a_box_is_put_where_the_ground_is_clicked_dragged_and_deleted(page, robot, network):
    stand(page, network)  # the camera follows the robot, and what is clicked must stay where it is seen
    wait_until(lambda: robot.commanded == 0.0 and abs(robot.speed) < 0.01, "the robot stands")
    before = robot.objects
    show(page, "World")
    take(page, "Put", "Click the ground")
    page.mouse.click(100, 400)
    wait_until(lambda: robot.objects.keys() - before.keys(), "there is a new object")
    ((name, position),) = [item for item in robot.objects.items() if item[0] not in before]
    assert name.startswith("box")
    assert dist(position, robot.position) < 8.0  # near what is seen
    take(page, "Move", "Drag an object")
    hover(page, 100, 395)
    page.mouse.down()
    page.mouse.move(40, 415, steps=4)  # away from the robot
    page.wait_for_selector(f".husky-state:has-text('being moved: {name}')")
    page.mouse.up()
    wait_until(lambda: dist(robot.objects[name], position) > 0.2, "the box has moved")
    take(page, "Delete", "Click an object")

    def is_clicked_away():
        page.mouse.click(40, 415)  # again, as a person does: the box may not be drawn there yet
        page.evaluate(NEXT_PICTURE)
        return name not in robot.objects

    wait_until(is_clicked_away, "the box is gone")
    press(page, "Look")
    show(page, "Drive")


VISER = f"viser-v{viser.__version__}"


def connected(address, **headers):
    """A client without a browser, which reads nothing by itself."""
    socket = address.replace("http", "ws", 1)
    return connect(socket, subprotocols=[VISER], max_size=None, open_timeout=DRAW_TIMEOUT, **headers)


def test_ten_more_clients_of_which_one_reads_nothing_disturb_nobody(page, robot, launched, network):
    stand(page, network)
    clients = [connected(launched) for _ in range(10)]
    for client in clients[1:]:
        assert len(client.recv(DRAW_TIMEOUT)) > 100  # the scene
    page.keyboard.down("w")
    wait_until(lambda: robot.speed > 0.4, "the robot drives")
    for client in clients[1:]:
        client.socket.close()  # without a word
    page.keyboard.up("w")
    wait_until_it_stands(page, robot)
    clients[0].close()


def test_a_recording_is_saved_as_a_page_that_plays_it_from_disk(page, browser, tmp_path):
    show(page, "View")
    press(page, "Record")
    page.wait_for_selector("text=/recording, [1-9]/")
    press(page, "End")
    page.wait_for_selector("text=s recorded")
    with page.expect_download() as download:
        press(page, "Save as a page")
    download.value.save_as(tmp_path / "drive.html")
    plays_from_disk(browser, tmp_path / "drive.html", "recorded in the page")
    show(page, "Drive")


def test_another_address_asks_for_the_token(network, launched, browser):
    port = free_port()
    other = network.start(
        "roslaunch", "husky_highlevel_controller", "web.launch", "web_address:=0.0.0.0",
        f"web_port:={port}", ROS_NAMESPACE="other",
    )  # fmt: skip
    wait_until(lambda: "?token=" in other.output, "the page's address is printed")
    here = re.compile(r"(http://127\.0\.0\.1:\d+)/\?token=(\S+) \(from another")
    address, token = here.search(other.output).groups()
    assert address.endswith(f":{port}")
    logs = [path for path in (network.folder / "log").rglob("*") if path.is_file()]
    assert logs
    assert not [path for path in logs if token in path.read_text(errors="replace")], "others read them, too"
    for wrong in ("", "/?token=guess"):
        with pytest.raises(HTTPError) as refused:
            urlopen(address + wrong)
        assert refused.value.code == 403
    for path in ("", "/drive"):
        with pytest.raises(InvalidStatus):
            connected(address + path)
        connected(address + path, additional_headers={"Cookie": f"husky_token={token}"}).close()
    page = opened(browser, f"{address}/?token={token}")
    page.close()
    assert (token in page.url, page.complaints) == (False, [])


def test_nothing_was_complained_of_and_no_other_host_was_asked(page, launched):
    assert page.complaints == []
    assert [url for url in page.hosts if not url.startswith((launched, "data:", "blob:"))] == []
    page.close()  # and draws no more beside the tests below


def test_a_page_opened_before_the_simulator_and_after_a_restart_of_its_node(browser, tmp_path):
    alone = Ros(tmp_path)
    master = alone.core()
    port = free_port()
    web = ("roslaunch", "husky_highlevel_controller", "web.launch", f"web_port:={port}")
    node = alone.start(*web)
    wait_until(lambda: ADDRESS.search(node.output), "the page's address is printed")
    page = opened(browser, f"http://127.0.0.1:{port}")
    page.wait_for_selector("text=the robot is not responding")
    over_the_view = "getComputedStyle(document.documentElement, '::before').content"
    assert "Waiting for news of the robot" in page.evaluate(over_the_view)
    page.click(E_STOP)
    page.wait_for_selector(".husky-state:has-text('no node subscribes to e_stop')")
    release_e_stop(page)
    simulator = alone.roslaunch("simulator.launch", "web:=false")
    page.wait_for_selector(".husky-state[data-time]")
    assert page.evaluate(over_the_view) == "none"
    wait_until(lambda: yellow(page)[0].size > 0, "the robot is drawn")
    node.popen.terminate()
    page.wait_for_selector(".husky-banner:has-text('Connection lost')")
    before = page.evaluate(TIME_SHOWN)
    node.wait()
    page.keyboard.press("Space")
    page.wait_for_selector(".husky-banner:has-text('has NOT been confirmed')")
    alone.start(*web)
    page.wait_for_selector(".husky-state:has-text('emergency stop: the robot obeys no command')")
    release_e_stop(page)
    page.wait_for_selector(E_STOP)
    page.wait_for_selector(".husky-banner:empty", state="attached")
    wait_until(lambda: page.evaluate(TIME_SHOWN) > before, "the page shows the robot again")
    for process in (simulator, master):
        process.popen.terminate()
        process.wait()
    before = page.evaluate(TIME_SHOWN)
    alone.core()
    alone.roslaunch("simulator.launch", "web:=false")
    wait_until(lambda: page.evaluate(TIME_SHOWN) < before, "the page shows the new simulator")
    page.wait_for_selector("text=the emergency stop of this page may not reach the robot")
    page.click(E_STOP)
    page.wait_for_selector(".husky-e-stop.locked")
    page.wait_for_selector("text=the emergency stop of this page may not reach the robot")
    page.close()
    alone.end()


def plays_from_disk(browser, file, words):
    page = opened(browser, file.as_uri(), f"text={words}")
    page.locator("input").press("End")
    end = page.inner_text("output")
    press(page, "Play")
    wait_until(lambda: page.inner_text("output") != end, "it begins again")
    page.close()
    assert page.complaints == []
    assert {url for url in page.hosts if not url.startswith(("file:", "data:", "blob:"))} == set()
    return end


def test_the_page_of_a_marked_drive_plays_it(browser, tmp_path):
    times = np.arange(0.0, 2.0, 0.02)
    poses = np.column_stack([times, 0.0 * times, 0.0 * times])
    html = to_html(Replay("</script>a drive", "it ended", times, poses, np.array([[3.0, 0.0]])))
    (tmp_path / "replay.html").write_text(html)
    end = plays_from_disk(browser, tmp_path / "replay.html", "</script>a drive")
    assert end.startswith("1.98 s")
    assert "0.82 m to the pillar" in end
