"""Draws depth images in a process of its own, so that the simulation need not wait.

In, over a pipe: what stands where, and where the camera is. Out: depth buffers.
Must not know: ROS, time.
"""

from __future__ import annotations

import signal
import subprocess
import sys
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Dict, Mapping, NamedTuple, Optional

import numpy as np

from husky_highlevel_controller.camera import CameraConfig
from husky_highlevel_controller.datatypes import Pose, Thing
from husky_highlevel_controller.engine import Engine


class View(NamedTuple):
    """One image to draw."""

    things: Optional[Mapping[str, Thing]]  # None: those of the view before
    poses: Mapping[str, Pose]  # of the things that may have moved, in the world
    pose_camera_in_world: Pose  # its optical frame


class Renderer:
    """A process that draws one view at a time; every method raises OSError or EOFError when it has died."""

    def __init__(self, config: CameraConfig) -> None:
        self._pipe, end = Pipe()
        # not by multiprocessing, which would run the simulator's main script in the new process again
        command = [sys.executable, "-m", __name__, str(end.fileno())]
        self._process = subprocess.Popen(command, pass_fds=[end.fileno()])
        end.close()
        self._pipe.send(config)
        self._things: Dict[str, Thing] = {}
        self.busy = False

    def start(self, things: Mapping[str, Thing], poses: Mapping[str, Pose], camera: Pose) -> None:
        """Begin to draw; not while busy."""
        changed = self._things != things
        if changed:
            self._things = dict(things)
        self._pipe.send(View(self._things if changed else None, poses, camera))
        self.busy = True

    def take(self, patience: Optional[float] = 0.0) -> Optional[np.ndarray]:
        """The depth buffer begun last, (height, width) in 0..1; None if there is none after `patience` s."""
        if not self.busy or not self._pipe.poll(patience):
            return None
        self.busy = False
        buffer: np.ndarray = self._pipe.recv()
        return buffer

    def close(self) -> None:
        """End the process."""
        self._pipe.close()
        self._process.wait()


def _draw_forever(pipe: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends when the simulator closes the pipe, or has died
    config: CameraConfig = pipe.recv()
    engine = Engine(1.0)
    engine.clear((0.0, 0.0, 0.0))
    drawn: Mapping[str, Thing] = {}
    while True:
        try:
            view: View = pipe.recv()
        except (EOFError, OSError):
            return
        if view.things is not None:
            for name in [name for name in drawn if view.things.get(name) != drawn[name]]:
                engine.remove_thing(name)
            for name, thing in view.things.items():
                if thing != drawn.get(name):
                    engine.add_thing(thing)
            drawn = view.things
        for name, pose in view.poses.items():
            engine.show_thing(name, pose)
        pipe.send(engine.depth_buffer(view.pose_camera_in_world, config))


if __name__ == "__main__":
    _draw_forever(Connection(int(sys.argv[1])))
