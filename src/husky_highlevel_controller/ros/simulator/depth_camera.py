"""Depth camera of a Husky with a Kinect: publishes images and points without delaying the simulation."""

from __future__ import annotations

from typing import Optional

import numpy as np
import rospy
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import Header

from husky_highlevel_controller.datatypes import Pose, Snapshot
from husky_highlevel_controller.geometry import compose
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.clouds import points_to_msg
from husky_highlevel_controller.ros.node import publish
from husky_highlevel_controller.simulator.models.description import CAMERA_FRAME
from husky_highlevel_controller.simulator.sensors.depth_camera import (
    CameraConfig,
    image_of,
    points_in_image,
)
from husky_highlevel_controller.simulator.sensors.renderer import Renderer
from husky_highlevel_controller.simulator.simulation import Simulation

QUEUE = 2  # images are large


class DepthCamera:
    """Lets a renderer in another process draw images, and publishes each image when it is ready.

    So the simulation need not wait for images. If an image is not ready when the next image is due, the next
    image is left out.
    """

    def __init__(self, config: CameraConfig, pose_in_base: Pose, steps: int, wait: bool) -> None:
        """Advertise the topics, and start the renderer.

        Args:
            config: size and angle of the images.
            pose_in_base: pose of the camera in base_link.
            steps: number of physics steps from one image to the next.
            wait: true if the simulation must wait for each image.
        """
        self._config, self._pose_in_base = config, pose_in_base
        self._steps, self._waits_for_image = steps, wait
        self._image_publisher = rospy.Publisher("camera/depth/image_raw", Image, queue_size=QUEUE)
        self._info_publisher = rospy.Publisher("camera/depth/camera_info", CameraInfo, queue_size=QUEUE)
        self._points_publisher = rospy.Publisher("camera/depth/points", PointCloud2, queue_size=QUEUE)
        self._renderer = Renderer(config)
        self._image_stamp = 0.0  # [s] stamp of the image that was started last

    def close(self) -> None:
        """End the renderer."""
        self._renderer.close()

    def update(self, simulation: Simulation, snapshot: Snapshot) -> None:
        """Publish the image that is ready, if any, and start the next image, if it is due.

        Call this method after every step of the physics.
        """
        try:
            self._update(simulation, snapshot)
        except (OSError, EOFError):
            rospy.logerr_throttle(
                60.0, "camera/depth: the renderer has died, so no images come; start the simulator again"
            )
        except Exception as error:  # the simulation continues without this image
            rospy.logerr_throttle(
                60.0, f"camera/depth: cannot render an image: {type(error).__name__}: {error}"
            )

    def _update(self, simulation: Simulation, snapshot: Snapshot) -> None:
        """Publish the image that is ready, if any; start the next image if it is due and has a subscriber."""
        # a timeout of 0 s means that this call does not wait for an image that is not ready
        self._publish(timeout=0.0)
        is_watched = any(
            topic.get_num_connections()
            for topic in (self._image_publisher, self._info_publisher, self._points_publisher)
        )
        if snapshot.step % self._steps == 0 and not self._renderer.busy and is_watched:
            # the renderer gets the poses of all bodies that may have moved: physics moves bodies with a mass,
            # and services also move static bodies; but a body without a collision shape never moves
            poses = {
                name: simulation.pose_of(name) for name, body in simulation.bodies.items() if body.collisions
            }
            camera = compose(snapshot.robot.pose_in_world, self._pose_in_base)
            self._renderer.start(simulation.bodies, poses, camera)
            self._image_stamp = snapshot.stamp
            if self._waits_for_image:  # true in lockstep, so that each run publishes the same images
                self._publish(timeout=None)

    def _publish(self, timeout: Optional[float]) -> None:
        """Publish the image that was started last, if it is ready within a timeout [s].

        With the timeout None, wait until the image is ready.
        """
        buffer = self._renderer.take(timeout)
        if buffer is None:  # no image was started, or the image is not ready
            return
        depth, header = image_of(buffer, self._config), conversions.header(self._image_stamp, CAMERA_FRAME)
        publish(self._info_publisher, camera_info_to_msg(self._config, header))
        if self._image_publisher.get_num_connections():
            publish(self._image_publisher, depth_to_msg(depth, header))
        if self._points_publisher.get_num_connections():
            publish(
                self._points_publisher,
                points_to_msg(points_in_image(depth, self._config), self._image_stamp, CAMERA_FRAME),
            )


def camera_info_to_msg(config: CameraConfig, header: Header) -> CameraInfo:
    """Return the geometry of the camera as a message: a pinhole camera without distortion."""
    f, (u, v) = config.focal_length, config.center  # focal length f and centre (u, v) of the image [pixels]
    return CameraInfo(
        header=header,
        height=config.height,
        width=config.width,
        distortion_model="plumb_bob",
        D=[0.0] * 5,
        # camera matrix K, no rotation R, projection P; all are written row by row
        K=[f, 0.0, u, 0.0, f, v, 0.0, 0.0, 1.0],
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=[f, 0.0, u, 0.0, 0.0, f, v, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


def depth_to_msg(depth: np.ndarray, header: Header) -> Image:
    """Return a depth image (height, width) [m] as a message: metres as 32-bit floats, as REP 118 demands."""
    height, width = depth.shape
    return Image(
        header=header,
        height=height,
        width=width,
        encoding="32FC1",
        is_bigendian=False,
        step=4 * width,  # bytes of a row, with 4 bytes for each number
        data=depth.astype("<f4").tobytes(),
    )
