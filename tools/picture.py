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
from typing import Dict, List, Optional, Tuple

from PIL import Image
from playwright.sync_api import Browser, Page, ViewportSize, sync_playwright

DOCS = Path(__file__).resolve().parents[1] / "docs"
PACE = 0.08  # real-time factor
STILL_SIZE, SIZE = ViewportSize(width=1600, height=900), ViewportSize(width=1280, height=720)
STILL_TIME = 6.0  # [s] simulated time of the still picture
PERIOD, SPEED = 0.1, 1.6  # [s] simulated time between two frames; real-time factor of the animation
WIDTH, QUALITY = 800, 60  # width of the animation in pixels, and its quality of 100
STANDS = 0.5  # [s] simulated time that is shown after the arrival
TIMEOUT = 300.0  # [s] wall time
SOFTWARE_WEBGL = (
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-gpu-compositing", "--no-sandbox"
)  # fmt: skip
TIME = "Number(document.querySelector('[data-time]').dataset.time)"
# script that hides the factor and the notifications; its observer is called before the browser draws a change
HIDE = """() => {
const hide = () => [...document.querySelectorAll("dt")]
  .filter(term => term.textContent === "real-time factor")
  .forEach(term => { term.style.display = term.nextSibling.style.display = "none"; });
new MutationObserver(hide).observe(document.body, { childList: true, subtree: true, characterData: true });
hide();
const style = document.createElement("style");
style.textContent = ".mantine-Notifications-root { display: none }";
document.head.append(style);
}"""


def main() -> None:
    """Save the picture of a first drive, and the animation of a second one."""
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
            url = address(Path(output.name))
            page = open_page(browser, url, STILL_SIZE, 1.0)
            _, still = frames(page, env, only_at=STILL_TIME)[0]
            (DOCS / "page.png").write_bytes(still)
            page.close()
            page = open_page(browser, url, SIZE, WIDTH / SIZE["width"])
            pictures = frames(page, env)
            page.close()  # an open page would go on drawing, and slow down `save`
            save(pictures)
        finally:
            launch.terminate()
            launch.wait()


def address(log: Path) -> str:
    """Return the address of the page, which its node prints."""
    end = time.monotonic() + TIMEOUT
    while time.monotonic() < end:
        found = re.search(r"browser: (http://\S+)", log.read_text())
        if found:
            return found.group(1)
        time.sleep(0.2)
    raise SystemExit(f"no address after {TIMEOUT} s:\n{log.read_text()}")


def open_page(browser: Browser, url: str, size: ViewportSize, scale: float) -> Page:
    """Open the page, drawn larger or smaller by the factor `scale`, and wait until it shows the time."""
    page = browser.new_page(viewport=size, device_scale_factor=scale)
    page.set_default_timeout(1000.0 * TIMEOUT)
    page.goto(f"{url}/?antialias")
    page.wait_for_selector("[data-time]")
    page.evaluate(HIDE)
    return page


def frames(page: Page, env: Dict[str, str], only_at: Optional[float] = None) -> List[Tuple[float, bytes]]:
    """Return times [s] and PNGs of a run from its start, one for each PERIOD, or fewer if drawing is slower.

    With `only_at`, only the PNG at this time [s] is returned.
    """
    reset = ["rosservice", "call", "/husky_simulator/reset"]
    subprocess.run(reset, check=True, env=env, stdout=subprocess.DEVNULL)
    begin = page.evaluate(TIME)
    pictures: List[Tuple[float, bytes]] = []
    due, end = begin + (only_at or 0.0), None
    while end is None or due < end:
        page.wait_for_function(f"{TIME} >= {due}")
        pictures.append((page.evaluate(TIME), page.screenshot()))
        due = max(due + PERIOD, pictures[-1][0])  # time of the next PNG; at once if it is late
        print(f"\r{pictures[-1][0] - begin:.1f} s", end="", file=sys.stderr, flush=True)
        if only_at is not None:
            break
        if end is None and "at the pillar" in page.inner_text(".husky-state"):
            end = due + STANDS
    return pictures


def save(pictures: List[Tuple[float, bytes]]) -> None:
    """Write PNGs as an animation, each shown until the time of the next one."""
    small = [Image.open(io.BytesIO(png)).convert("RGB") for _, png in pictures]
    times = [at for at, _ in pictures]
    # [ms] time for which each PNG is shown; a second for the last one
    shown = [round(1000.0 * (after - at) / SPEED) for at, after in zip(times, times[1:])] + [1000]
    path = DOCS / "drive.webp"
    small[0].save(
        path, save_all=True, append_images=small[1:], duration=shown, loop=0, quality=QUALITY, method=6
    )
    rate, megabytes = 1000.0 * len(small) / sum(shown), path.stat().st_size / 1e6
    print(f"\n{path}: {sum(shown) / 1000.0:.1f} s, {rate:.1f} frames/s, {megabytes:.2f} MB", file=sys.stderr)


if __name__ == "__main__":
    main()
