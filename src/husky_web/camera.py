"""Camera of one page: behind the robot, at the pillar, above, or free."""

from __future__ import annotations

from collections import deque
from math import dist, radians
from typing import Deque, Optional

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
# The last SENT positions that this node has sent to the page are kept. If the page reports a position that is
# nearer than SAME [m] to one of them, the mouse has not moved the camera.
SENT, SAME = 100, 0.01


class Camera:
    """Moves a page's camera, and lets the page's mouse change the offset from the robot or the pillar."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client  # page to which the camera belongs
        # Chosen camera, one of CAMERAS, and the number of choices so far. They are one tuple, because another
        # thread may choose during an update.
        self._choice = (FOLLOW, 1)
        self._choices_obeyed = 0  # number of the last choice to whose offset the camera has moved
        self._target: Vector3 = (0.0, 0.0, 0.0)  # [m] position that the camera looks at, in the fixed frame
        # [rad] yaw of the frame in which `_offset` is given; this frame turns with the robot
        self._yaw = 0.0
        self._offset = OFFSETS[FOLLOW]  # [m] offset of the camera from its target, in this frame
        # [m] newest positions of the camera that were sent to the page after the last jump, at most SENT
        self._sent: Deque[Vector3] = deque(maxlen=SENT)
        # true if the page has reported a position from after the last jump
        self._has_jump_arrived = False

    def choose(self, name: str) -> None:
        """Choose one of CAMERAS."""
        _, number = self._choice
        self._choice = (name, number + 1)

    def update(self, base: Optional[Pose], pillar: Optional[Vector3]) -> None:
        """Move the page's camera with the robot or the pillar, both in the fixed frame [m].

        The camera jumps if another camera was chosen, or if its target is suddenly far away. Otherwise it
        follows its target smoothly, and the page's mouse can change its offset from the target.
        """
        name, number = self._choice
        target = _target_of(name, base, pillar)
        if target is None:
            return
        yaw = 0.0
        if base is not None and name == FOLLOW:  # only this camera turns with the robot
            yaw = yaw_from_quat(base.quat_xyzw)
        way = dist(target, self._target)  # [m] motion of the target since the camera was moved last
        has_new_choice = number > self._choices_obeyed
        if has_new_choice:
            self._choices_obeyed = number
            self._begin_jump(yaw)
            self._offset = OFFSETS[name]
        elif way < JUMP:
            turn = TURN_SHARE * wrap_angle(yaw - self._yaw)
            if way < STILL and abs(turn) < STILL_ANGLE:
                return  # the motion would not be visible
            self._yaw += turn
            self._take_over()
        else:  # a service has moved the robot, so the camera jumps, too, but keeps its offset
            self._begin_jump(yaw)
        offset = rotate(quat_from_rpy(0.0, 0.0, self._yaw), self._offset)
        position = (target[0] + offset[0], target[1] + offset[1], target[2] + offset[2])
        with self._client.atomic():
            if has_new_choice:  # z points up again, if the page has changed this
                self._client.camera.up_direction = (0.0, 0.0, 1.0)
            look(self._client.camera, position, target)
        self._sent.append(position)
        self._target = target

    def _begin_jump(self, yaw: float) -> None:
        """Turn the camera to a yaw [rad] at once, and forget the positions from before the jump."""
        self._yaw = yaw
        self._sent.clear()
        self._has_jump_arrived = False  # true again when the page reports a position from after the jump

    def _take_over(self) -> None:
        """Set `_offset` from the pose that the page has reported, if its mouse has moved the camera.

        The mouse has moved the camera if the page reports a position that was not sent to the page. After a
        jump, reports do not count until the page has reported a position from after the jump.
        """
        camera = self._client.camera
        position = camera.position.tolist()
        if any(dist(position, sent) < SAME for sent in self._sent):  # the mouse has not moved the camera
            self._has_jump_arrived = True
            return
        if not self._has_jump_arrived:  # the report may be from before the jump
            return
        w, x, y, z = camera.wxyz.tolist()
        # direction from the target to the camera; a camera looks along its own z axis, so its -z axis points
        # back
        from_target = rotate((x, y, z, w), (0.0, 0.0, -1.0))
        # The reported target (`look_at`) may be newer than the reported position, and the robot has driven a
        # short way in between. This changes the distance only a little, but it would turn the direction, so
        # the direction is taken from the rotation.
        distance = dist(position, camera.look_at.tolist())
        # the same direction in the frame that turns with the robot
        x, y, z = rotate(quat_from_rpy(0.0, 0.0, -self._yaw), from_target)
        self._offset = (distance * x, distance * y, distance * z)


def _target_of(name: str, base: Optional[Pose], pillar: Optional[Vector3]) -> Optional[Vector3]:
    """Return the position [m] that a camera must look at; None if the camera must stay where it is.

    Args:
        name: name of the camera, one of CAMERAS.
        base: pose of the robot.
        pillar: position of the pillar [m].
    """
    robot = None if base is None else base.position
    subject = pillar if name == PILLAR else robot
    if subject is None or name == FREE:
        return None
    return (subject[0], subject[1], subject[2] + AIM)
