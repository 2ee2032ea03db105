"""Makes pictures of the page in the browser: page.png in mid-drive, drive.gif of a whole drive to the pillar.

`./dev run python docs/make_pictures.py`, after `./dev setup launch test` and with Debian's
chromium-headless-shell. A browser without a graphics card is slower than the drive: for the animation the
simulator steps from frame to frame.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Dict, List, Tuple

from PIL import Image
from playwright.sync_api import Page, sync_playwright

FOLDER = Path(__file__).resolve().parent
SIZE = {"width": 960, "height": 540}
SOFTWARE_WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox")
HIDE_NOTICES = (
    ".mantine-Notifications-root { display: none }"  # that of the software renderer covers the view
)
STEPS, STEP_TIME = 160, 0.005  # physics steps between two frames, and their length [s]
FRAMES = 28
STILL_DISTANCE = 6.0  # [m] to go, at which page.png is taken
GIF_WIDTH, COLORS = 640, 128
FRAME_TIME, LAST_FRAME_TIME = 150, 2000  # [ms]
TIMEOUT = 120.0  # [s] of wall time for anything


def main() -> None:
    """Drive, photograph and save."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    env = {**os.environ, "ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"}
    command = ["roslaunch", "-p", str(port), "husky_highlevel_controller", "controller.launch"]
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        with log.open("w") as output:
            launch = subprocess.Popen(
                [*command, "gui:=false", "web:=true", "lockstep:=true"], stdout=output, stderr=output, env=env
            )
        try:
            still, frames = photograph(address(log), env)
        finally:
            launch.terminate()
            launch.wait()
    (FOLDER / "page.png").write_bytes(still)
    save_animation(frames, FOLDER / "drive.gif")


def address(log: Path) -> str:
    """What the page's node has printed."""
    end = time.monotonic() + TIMEOUT
    while time.monotonic() < end:
        found = re.search(r"\]: (http://\S+)\n", log.read_text())
        if found:
            return found.group(1)
        time.sleep(0.2)
    raise SystemExit(f"no address after {TIMEOUT} s:\n{log.read_text()}")


def photograph(url: str, env: Dict[str, str]) -> Tuple[bytes, List[bytes]]:
    """PNGs: one of a drive in real time, then one for each STEPS steps of physics of another."""
    with sync_playwright() as playwright:
        chromium = shutil.which("chromium-headless-shell") or shutil.which("chromium")
        browser = playwright.chromium.launch(executable_path=chromium, args=list(SOFTWARE_WEBGL))
        page = browser.new_page(viewport=SIZE)
        page.set_default_timeout(1000.0 * TIMEOUT)
        page.goto(url)
        page.add_style_tag(content=HIDE_NOTICES)
        call(env, "reset")
        page.wait_for_function(f"{READING.format('distance to go')} > {2.0 * STILL_DISTANCE}")
        page.wait_for_function(f"{READING.format('distance to go')} < {STILL_DISTANCE}")
        still = page.screenshot()
        call(env, "pause")
        call(env, "reset")
        call(env, "step", 1)
        frames = []
        begin = shown_time(page)
        for number in range(FRAMES):
            wait_until_drawn(page, begin + number * STEPS * STEP_TIME)
            frames.append(page.screenshot())
            print(f"\rframe {number + 1} of {FRAMES}", end="", file=sys.stderr, flush=True)
            call(env, "step", STEPS)
        browser.close()
    return still, frames


def call(env: Dict[str, str], service: str, *arguments: int) -> None:
    """Call a service of the simulator."""
    command = ["rosservice", "call", f"/husky_simulator/{service}", *map(str, arguments)]
    subprocess.run(command, check=True, env=env, stdout=subprocess.DEVNULL)


READING = (
    "parseFloat([...document.querySelectorAll('dt')]"
    ".find(term => term.textContent === '{}')?.nextSibling.textContent)"
)
TIME = READING.format("time")
TWO_FRAMES = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"


def shown_time(page: Page) -> float:
    """The simulated time [s] that the page shows."""
    return float(page.evaluate(TIME))


def wait_until_drawn(page: Page, simulated_time: float) -> None:
    """Wait until the page shows this time [s], rounded to 0.1 s, and has drawn what it knows."""
    page.wait_for_function(f"{TIME} > {simulated_time - 0.11}")
    page.evaluate(TWO_FRAMES)


def save_animation(frames: List[bytes], path: Path) -> None:
    """Write PNGs as a GIF with the colours of the last."""
    height = GIF_WIDTH * SIZE["height"] // SIZE["width"]
    pictures = [Image.open(io.BytesIO(frame)).convert("RGB") for frame in frames]
    small = [picture.resize((GIF_WIDTH, height), Image.LANCZOS) for picture in pictures]
    palette = small[-1].quantize(COLORS, method=Image.Quantize.FASTOCTREE)
    drawn = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in small]
    times = [*[FRAME_TIME] * (len(drawn) - 1), LAST_FRAME_TIME]
    drawn[0].save(path, save_all=True, append_images=drawn[1:], duration=times, loop=0)
    print(f"\n{path}: {path.stat().st_size / 1e6:.2f} MB", file=sys.stderr)


if __name__ == "__main__":
    main()
