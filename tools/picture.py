"""README's pictures of the page in the browser: docs/page.png in mid-drive, docs/drive.webp of a whole drive.

`./dev run python tools/picture.py`, after `./dev setup launch test`, with Debian's chromium-headless-shell. A
browser without a graphics card draws slowly, so the world is slowed down, and its real-time factor left out.
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
from typing import Dict, List, Optional

from PIL import Image
from playwright.sync_api import Page, sync_playwright

DOCS = Path(__file__).resolve().parents[1] / "docs"
PACE = 0.08  # simulated seconds a second
STILL_SIZE, SIZE = {"width": 1600, "height": 900}, {"width": 960, "height": 600}
STILL_TIME = 13.0  # [s], simulated, of the drive
PERIOD, FRAME_RATE = 0.1, 15  # [s], simulated, between two frames; frames a second
WIDTH, QUALITY = 800, 45  # of the animation, pixels and of 100
STANDS = 1.0  # [s], simulated, that are shown after the arrival
TIMEOUT = 300.0  # [s]
SOFTWARE_WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox")
TIME = "Number(document.querySelector('[data-time]').dataset.time)"
HIDE = """() => { const style = document.createElement("style");
style.textContent = ".mantine-Notifications-root { display: none }"; document.head.append(style);
setInterval(() => document.querySelectorAll("dt").forEach(term => {
  if (term.textContent === "real-time factor") term.hidden = term.nextSibling.hidden = true; }), 20); }"""


def main() -> None:
    """Drive twice and save."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    env = {**os.environ, "ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"}
    command = ["roslaunch", "-p", str(port), "husky_highlevel_controller", "controller.launch", "gui:=false"]
    command += ["web:=true", "lockstep:=true", f"real_time_factor:={PACE}"]
    with tempfile.NamedTemporaryFile("w") as output, sync_playwright() as playwright:
        launch = subprocess.Popen(command, stdout=output, stderr=output, env=env)
        try:
            shell = shutil.which("chromium-headless-shell") or shutil.which("chromium")
            browser = playwright.chromium.launch(executable_path=shell, args=list(SOFTWARE_WEBGL))
            page = browser.new_page(viewport=STILL_SIZE)
            page.set_default_timeout(1000.0 * TIMEOUT)
            page.goto(address(Path(output.name)))
            page.wait_for_function(TIME)
            page.evaluate(HIDE)
            (DOCS / "page.png").write_bytes(frames(page, env, STILL_TIME, STILL_TIME)[-1])
            page.set_viewport_size(SIZE)
            save(frames(page, env, PERIOD, None))
        finally:
            launch.terminate()
            launch.wait()


def address(log: Path) -> str:
    """Address of the page, which its node prints."""
    end = time.monotonic() + TIMEOUT
    while time.monotonic() < end:
        found = re.search(r"http://\S+:\d+", log.read_text())
        if found:
            return found.group()
        time.sleep(0.2)
    raise SystemExit(f"no address after {TIMEOUT} s:\n{log.read_text()}")


def frames(page: Page, env: Dict[str, str], period: float, last: Optional[float]) -> List[bytes]:
    """PNGs of a drive from the start, one in each period [s], up to a time [s] or the arrival."""
    subprocess.run(
        ["rosservice", "call", "/husky_simulator/reset"], check=True, env=env, stdout=subprocess.DEVNULL
    )
    begin, pictures, end = page.evaluate(TIME), [], last
    while end is None or len(pictures) * period < end:
        page.wait_for_function(f"{TIME} >= {begin + (len(pictures) + (last is not None)) * period}")
        pictures.append(page.screenshot())
        print(f"\rframe {len(pictures)}", end="", file=sys.stderr, flush=True)
        if end is None and "arrived" in page.inner_text(".husky-state"):
            end = len(pictures) * period + STANDS
    return pictures


def save(pictures: List[bytes]) -> None:
    """Write PNGs as an animation."""
    size = (WIDTH, WIDTH * SIZE["height"] // SIZE["width"])
    small = [Image.open(io.BytesIO(each)).convert("RGB").resize(size, Image.LANCZOS) for each in pictures]
    path = DOCS / "drive.webp"
    small[0].save(
        path, save_all=True, append_images=small[1:], duration=round(1000 / FRAME_RATE), loop=0,
        quality=QUALITY, method=6,
    )  # fmt: skip
    seconds, megabytes = len(small) / FRAME_RATE, path.stat().st_size / 1e6
    print(f"\n{path}: {len(small)} frames, {seconds:.1f} s, {megabytes:.2f} MB", file=sys.stderr)


if __name__ == "__main__":
    main()
