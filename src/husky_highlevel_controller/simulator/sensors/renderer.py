"""Renders depth images in a process of its own, so that the simulation need not wait.

In, over a pipe: bodies, their poses, the camera's pose. Out: depth buffers.
"""

from __future__ import annotations

import signal
import subprocess
import sys
from dataclasses import replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Dict, Mapping, NamedTuple, Optional

import numpy as np

from husky_highlevel_controller.datatypes import Body, Pose
from husky_highlevel_controller.simulator.bullet.world import BulletWorld
from husky_highlevel_controller.simulator.sensors.depth_camera import CameraConfig


class RenderRequest(NamedTuple):
    """Request for one image."""

    bodies: Optional[Mapping[str, Body]]  # bodies of the world; None if they have not changed
    poses: Mapping[str, Pose]  # poses in the world of the bodies that may have moved
    pose_camera_in_world: Pose  # pose of the camera's optical frame (z ahead, y down)


class Renderer:
    """Another process that renders depth images, one at a time.

    If this process has died, the methods raise OSError or EOFError.
    """

    def __init__(self, config: CameraConfig) -> None:
        """Start the process, and send it the camera's configuration."""
        self._pipe, process_end = Pipe()
        # the new process runs this module as a program; multiprocessing.Process is not used, because it would
        # load the simulator's main script in the new process
        command = [sys.executable, "-m", __name__, str(process_end.fileno())]
        self._process = subprocess.Popen(command, pass_fds=[process_end.fileno()])
        process_end.close()  # the new process has its own copy of this end of the pipe
        self._pipe.send(config)
        self._bodies: Dict[str, Body] = {}  # bodies that were sent to the process
        self.busy = False  # true from the start of an image until `take` returns it

    def start(self, bodies: Mapping[str, Body], poses: Mapping[str, Pose], camera: Pose) -> None:
        """Begin to render an image; `busy` must be false.

        Args:
            bodies: bodies of the world.
            poses: poses in the world of the bodies that may have moved.
            camera: pose of the camera's optical frame in the world.
        """
        # the process keeps the bodies, so they are sent only if they have changed
        changed_bodies: Optional[Mapping[str, Body]] = None
        if self._bodies != bodies:
            self._bodies = dict(bodies)
            changed_bodies = self._bodies
        self._pipe.send(RenderRequest(changed_bodies, poses, camera))
        self.busy = True

    def take(self, timeout: Optional[float] = 0.0) -> Optional[np.ndarray]:
        """Return the depth buffer, (height, width) in 0..1; None if it is not ready after `timeout` s."""
        if not self.busy or not self._pipe.poll(timeout):
            return None
        self.busy = False
        buffer: np.ndarray = self._pipe.recv()
        return buffer

    def close(self) -> None:
        """End the process."""
        self._pipe.close()
        self._process.wait()


def _serve_requests(pipe: Connection) -> None:
    """Main function of the new process: read the camera's configuration, then render an image per request.

    The function ends when the pipe closes. It has a Bullet world of its own, which only contains shapes, and
    whose physics never steps. Changed bodies are removed and added again. All other bodies are only moved.
    """
    # Ctrl-C is ignored, because this process ends when the simulator closes the pipe
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    config: CameraConfig = pipe.recv()
    bullet = BulletWorld(1.0)  # the duration of a step does not matter, because no step is made
    bullet.clear((0.0, 0.0, 0.0))
    bodies_drawn: Mapping[str, Body] = {}
    while True:
        try:
            request: RenderRequest = pipe.recv()
        except (EOFError, OSError):
            return
        if request.bodies is not None:
            bodies = _bodies_to_draw(request.bodies)
            for name, body in bodies_drawn.items():
                if body != bodies.get(name):
                    bullet.remove_body(name)
            for name, body in bodies.items():
                if body != bodies_drawn.get(name):
                    bullet.add_body(body)
            bodies_drawn = bodies
        for name, pose in request.poses.items():
            if name in bodies_drawn:
                bullet.set_pose_unchecked(name, pose)
        buffer = bullet.depth_buffer(
            request.pose_camera_in_world,
            config.width,
            config.height,
            config.vertical_field_of_view,
            config.near,
            config.far,
        )
        pipe.send(buffer)


def _bodies_to_draw(bodies: Mapping[str, Body]) -> Dict[str, Body]:
    """Return the bodies to draw, by name.

    The renderer draws collision shapes, so the visuals of a body without such shapes become its collisions.
    """
    to_draw = {}
    for name, body in bodies.items():
        if body.collisions:
            to_draw[name] = body
        elif body.visuals:
            # Nothing moves in the renderer, so the body gets no mass, which makes it static. With a mass,
            # Bullet would draw a mesh as its convex hull, and refuse a plane.
            to_draw[name] = replace(body, collisions=body.visuals, mass=0.0)
    return to_draw


if __name__ == "__main__":
    _serve_requests(Connection(int(sys.argv[1])))
