"""RViz, under a virtual screen: it shows robot, scan, frames and marker, without complaint."""

import re
import subprocess

import numpy as np
from network import PACKAGE, wait_until
from PIL import ImageGrab

SHOWN = {
    "/front/scan",
    "/tf",
    "/tf_static",
    "/odometry/filtered",
    f"/{PACKAGE}/visualization_marker",
}
# what to look for in the picture (RViz shades its colours)
COLORS = {
    "the Husky's yellow": lambda r, g, b: (r > 120) & (g > 90) & (g < 0.85 * r) & (b < 0.4 * r),
    "the scan's magenta": lambda r, g, b: (r > 150) & (g < 0.5 * r) & (b > 0.8 * r),
    "the marker's orange": lambda r, g, b: (r > 120) & (g > 0.3 * r) & (g < 0.6 * r) & (b < 0.3 * r),
}


class Screen:
    """A virtual screen whose pixels can be looked at."""

    def __init__(self, ros):
        command = ("Xvfb", "-displayfd", "1", "-screen", "0", "1300x850x24")
        number = re.compile(r"^(\d+)$", re.MULTILINE)
        for _ in range(3):  # two that start at once may want the same display, and one of them ends
            xvfb = ros.start(*command)
            wait_until(
                lambda xvfb=xvfb: number.search(xvfb.output) or xvfb.popen.poll() is not None,
                "Xvfb has a display",
            )
            if xvfb.popen.poll() is None:
                break
        self.display = f":{number.search(xvfb.output)[1]}"
        ros.start("openbox", DISPLAY=self.display)

    def shows(self, color):
        picture = ImageGrab.grab(xdisplay=self.display).convert("RGB")
        red, green, blue = np.moveaxis(np.asarray(picture, float), 2, 0)
        return int(COLORS[color](red, green, blue)[60:, 400:].sum())


def test_rviz_shows_robot_scan_frames_and_marker(ros):
    screen = Screen(ros)
    launched = ros.start(
        "roslaunch", "-p", str(ros.port), PACKAGE, "controller.launch",
        DISPLAY=screen.display, GALLIUM_DRIVER="softpipe",
    )  # fmt: skip
    launched.says("time begins: RViz draws")
    assert ros.subscriptions("/husky_rviz") >= SHOWN, "and so it is seen from the start"
    launched.says("driving to the pillar")
    begin, drive = (launched.output.index(words) for words in ("time begins: RViz", "driving to the pillar"))
    assert begin < drive, "nobody has seen the robot drive off otherwise"
    for color in COLORS:
        wait_until(lambda color=color: screen.shows(color) > 30, f"{color} is to be seen")
    log = subprocess.run(
        ["grep", "-rhE", r"ERROR|WARN", str(ros.folder / "log")], capture_output=True, text=True
    )
    complaints = [line for line in log.stdout.splitlines() if "rviz" in line]
    assert complaints == []
