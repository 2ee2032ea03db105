"""Draws docs/scan_profiles.png: a pillar 0.5 m before a wall, scanned by the lidars of both profiles.

./dev run python tools/benchmarks/scan_picture.py docs/scan_profiles.png
"""

import sys
from functools import partial
from typing import Dict, Union

import matplotlib as mpl
import numpy as np

from husky_highlevel_controller.datatypes import Box, Cylinder, Pose, RobotState
from husky_highlevel_controller.simulator.sensors.lidar import Lidar
from husky_highlevel_controller.simulator.sensors.lms1xx import Lms1xx, Lms1xxConfig
from husky_highlevel_controller.simulator.sensors.raycast import cast_rays, make_scene
from husky_highlevel_controller.simulator.simulator_config import simulator_config

mpl.use("Agg")
from matplotlib import pyplot as plt

STILL = RobotState(Pose(), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
CENTRE = (8.0, 0.0)  # [m] centre of the pillar


def main(path: str) -> None:
    """Draw the picture and write it to `path`."""
    scene = make_scene(
        [(Cylinder(0.2, 2.0), Pose((*CENTRE, 0.0))), (Box((0.1, 4.0, 2.0)), Pose((8.55, 0.0, 0.0)))]
    )
    cast = partial(cast_rays, scene)
    lidars: Dict[str, Union[Lidar, Lms1xx]] = {
        "profile:=gazebo": Lidar(simulator_config().lidar, cast, "laser", Pose()),
        "profile:=robot": Lms1xx(Lms1xxConfig(), cast, "laser", Pose(), scan_time=0.02),
    }
    figure, axes = plt.subplots(1, 2, figsize=(7, 3.6), sharey=True, dpi=90)
    for axis, (name, lidar) in zip(axes, lidars.items()):
        for seed in range(10):
            lidar.reset(np.random.default_rng(seed))
            scan = lidar.sample(STILL, stamp=0.0)
            x, y = scan.ranges * np.cos(scan.bearings), scan.ranges * np.sin(scan.bearings)
            axis.plot(y, x, ".", color="tab:red", markersize=2)
        axis.add_patch(plt.Circle(CENTRE[::-1], 0.2, color="0.8"))
        axis.axhspan(8.5, 8.6, color="0.8")
        axis.set(title=name, xlim=(0.6, -0.6), ylim=(7.7, 8.65), aspect="equal", xlabel="y [m]")
    axes[0].set_ylabel("x [m]")
    figure.tight_layout()
    figure.savefig(path)


if __name__ == "__main__":
    main(sys.argv[1])
