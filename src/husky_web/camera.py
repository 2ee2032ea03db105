"""Camera of one page: behind the robot, at the pillar, above, or free."""

from __future__ import annotations

from collections import deque
from math import dist, radians
from typing import Any, Deque, Optional

import viser

from husky_highlevel_controller.datatypes import Pose, Vector3
from husky_highlevel_controller.geometry import quat_from_rpy, rotate, wrap_angle, yaw_from_quat
from husky_web.viser_private import look

FOLLOW, PILLAR, ABOVE, FREE = CAMERAS = ("Follow", "Pillar", "Above", "Free")
FIELD_OF_VIEW = radians(34.0)  # vertical field of view; with a wider angle, upright objects seem to lean
# [m] position of the camera relative to the point at which it looks; for FOLLOW, x is along the robot's
# heading
OFFSETS = {FOLLOW: (-5.5, 1.75, 0.45), PILLAR: (-6.4, -7.1, 1.6), ABOVE: (-0.01, 0.0, 34.0)}
# [m] the camera looks at a point this high above the robot or the pillar; with a lower point, upright objects
# would seem to lean
AIM = 0.75
# [m] if the robot has moved farther than this between two updates, a service has moved it, so the camera
# jumps
JUMP = 1.0
TURN_SHARE = 0.08  # fraction of the heading error that the camera corrects in each update
# [m], [rad] if the camera would move less than STILL and turn less than STILL_ANGLE, no message is sent to
# the page
STILL, STILL_ANGLE = 0.002, 0.001
# if the page reports a position that is nearer than SAME [m] to one of the last SENT positions that were sent
# to the page, the mouse has not moved the camera
SENT, SAME = 100, 0.01


class Camera:
    """Moves a page's camera, and lets the page's mouse change the offset from the robot or the pillar."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client  # page to which the camera belongs
        self._name = FOLLOW  # chosen camera, one of CAMERAS
        # true if the camera has been moved to the position that belongs to the choice, such as FOLLOW
        self._is_placed = False
        # true if the page has reported a position that was sent after the last jump of the camera. An earlier
        # report shows the camera before the jump, so it does not prove that the user has moved the camera by
        # the mouse.
        self._has_jump_arrived = False
        self._target: Vector3 = (0.0, 0.0, 0.0)  # [m] position that the camera looks at, in the fixed frame
        # yaw [rad] of the frame that turns with the robot; offset [m] of the camera from its target, in this
        # frame
        self._yaw, self._offset = 0.0, OFFSETS[FOLLOW]
        self._sent: Deque[Vector3] = deque(maxlen=SENT)  # [m] last positions that were sent to the page

    def choose(self, name: str) -> None:
        """Choose one of CAMERAS."""
        self._name, self._is_placed = name, False

    def update(self, base: Optional[Pose], pillar: Optional[Vector3]) -> None:
        """Move the page's camera with the robot or the pillar, both in the fixed frame [m]."""
        robot = None if base is None else base.position
        subject = pillar if self._name == PILLAR else robot  # position that the camera follows
        camera = self._client.camera
        # viser cannot move the camera of a page before the page has reported its camera for the first time
        has_reported = camera.update_timestamp != 0.0
        if subject is None or self._name == FREE or not has_reported:
            return
        target = (subject[0], subject[1], subject[2] + AIM)
        # only the camera FOLLOW turns with the robot
        yaw = 0.0 if base is None or self._name != FOLLOW else yaw_from_quat(base.quat_xyzw)
        if self._is_placed and dist(target, self._target) < JUMP:  # the camera follows smoothly
            turn = TURN_SHARE * wrap_angle(yaw - self._yaw)
            if dist(target, self._target) < STILL and abs(turn) < STILL_ANGLE:
                return  # the motion would not be visible
            self._yaw += turn
            self._take_over(camera)  # the mouse may have moved the camera, so `_offset` may change
        else:  # the camera jumps, because another camera was chosen, or a service has moved the robot
            self._yaw, self._has_jump_arrived = yaw, False
            self._sent.clear()
        if not self._is_placed:  # otherwise the camera keeps the offset that the mouse has given it
            self._offset = OFFSETS[self._name]
        offset = rotate(quat_from_rpy(0.0, 0.0, self._yaw), self._offset)
        position = (target[0] + offset[0], target[1] + offset[1], target[2] + offset[2])
        with self._client.atomic():
            if not self._is_placed:
                camera.up_direction = (0.0, 0.0, 1.0)
            look(camera, position, target)
        self._sent.append(position)
        self._is_placed, self._target = True, target

    def _take_over(self, camera: Any) -> None:
        """Set `_offset` from the pose that the page has reported, if its mouse has moved the camera.

        The page reports the pose of its camera late. If this program has sent the reported position before,
        the mouse has not moved the camera. The camera jumps if another camera is chosen, or if the robot is
        moved far; reports from before a jump do not count. Position and rotation of a report belong
        together, but its target may be newer.
        """
        position = camera.position.tolist()
        is_sent = any(dist(position, sent) < SAME for sent in self._sent)
        if is_sent:
            # a jump empties `_sent`, so the page can report a position in `_sent` only after the jump
            self._has_jump_arrived = True
            return
        if not self._has_jump_arrived:
            return
        w, x, y, z = camera.wxyz.tolist()
        # direction from the target to the camera; a camera looks along its own z axis, so -z points back
        from_target = rotate((x, y, z, w), (0.0, 0.0, -1.0))
        # the target may be newer than the position, so the distance may be wrong by the short way that the
        # robot has driven between the two; the direction comes from the rotation, so it has no such error
        distance = dist(position, camera.look_at.tolist())
        # the same direction in the frame that turns with the robot
        x, y, z = rotate(quat_from_rpy(0.0, 0.0, -self._yaw), from_target)
        self._offset = (distance * x, distance * y, distance * z)
