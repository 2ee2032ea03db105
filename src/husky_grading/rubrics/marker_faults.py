"""Faults of wrong markers: the direction of the error, seen from the robot, and hints on its cause."""

from __future__ import annotations

from math import atan2, cos, hypot, sin
from typing import List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from husky_grading.notes import Kind
from husky_grading.recording import MarkerSample, Recording
from husky_grading.records import Rules
from husky_highlevel_controller.course import PILLAR_RADIUS
from husky_highlevel_controller.robot import load_robot

FEW = 3  # fewer than FEW markers or moments are not enough for a judgement
# a fault is reported if at least this fraction of the tested markers has it
MOSTLY = 0.8
# [m/m] tolerance that is added for each metre between robot and pillar, when a marker is compared with the
# mirrored or the swapped position of the pillar
IMAGE_SLOPE = 0.1
COORDINATE_TOLERANCE = 0.05  # [m] a coordinate counts as 0, or as a whole number of metres, up to this error
# [m] a marker is at a position if its distance from the position is at most this
POSITION_TOLERANCE = 0.15
# [m] a coordinate above this probably comes from a variable that was never set
OUT_OF_THE_WORLD = 1e6
# [m] a marker loses no points if it is up to this height above the pillar or below the ground
HEIGHT_MARGIN = 0.3
# [m] a marker loses all points at HEIGHT_MARGIN + HEIGHT_FADE above the pillar or below the ground; linear in
# between
HEIGHT_FADE = 0.7
FAULTS = {
    Kind.Y_IS_ZERO: "y is always 0",
    Kind.WHOLE_METRES: "its coordinates are whole metres",
    Kind.SWAPPED: "x and y are swapped",
    Kind.OTHER_BEAM: "its distance is right, its angle is not",
    Kind.AT_ORIGIN: "it is at the origin of its frame",
    Kind.NO_RETURN: "it is on the lidar where no beam has a return",
}
CHECK = "check header.frame_id and header.stamp, and the pillar's position in that frame"
HINTS = {
    Kind.MIRRORED: "x = r cos(angle) and y = r sin(angle) hold in the scan's header.frame_id, so publish the "
    "marker in it, or transform the point by TF, and change no sign",
    Kind.Y_IS_ZERO: "give the marker a y, too: y = r sin(angle)",
    Kind.WHOLE_METRES: "compute the position in double, because an int cuts it to whole metres",
    Kind.SWAPPED: "x = r cos(angle) and y = r sin(angle): x is ahead, y to the left",
    Kind.OTHER_BEAM: "angle = angle_min + index * angle_increment, with the index of the nearest valid range",
    Kind.IN_BASE_LINK: f"{CHECK}, because the lidar is not in base_link's origin",
    Kind.NOT_A_NUMBER: "leave out ranges that are inf or NaN before you compute the position",
    Kind.AT_ORIGIN: "set pose.position from the nearest valid range and its angle before you publish it",
    Kind.NO_RETURN: "if no beam has a return, the marker sits on the lidar, so publish none then",
    Kind.WRONG_HEIGHT: "check pose.position.z and scale.z: z is 0 at the height of header.frame_id",
    Kind.NO_FRAME: "set header.frame_id of the marker to the one of the scan's header",
    Kind.INVISIBLE: "RViz does not draw such a marker; correct what is wrong with it",
    Kind.DELETED: "give it a longer lifetime, or do not delete it before the next one comes",
    Kind.OLD_ONES: "send each marker with the same ns and id, because otherwise the old markers stay in RViz",
}


class Seen(NamedTuple):
    """Wrong marker, and the pillar, seen from base_link."""

    x: float  # [m] x of the marker in base_link, positive ahead of the robot
    y: float  # [m] y of the marker in base_link, positive to the left of the robot
    pillar_distance: float  # [m] distance from base_link to the pillar's axis
    pillar_bearing: float  # [rad] direction of the pillar in base_link, 0 ahead, positive to the left
    tolerance: float  # [m] the marker is at a position if its distance from the position is at most this

    @property
    def pillar_x(self) -> float:
        """Return the pillar's coordinate ahead [m]."""
        return self.pillar_distance * cos(self.pillar_bearing)

    @property
    def pillar_y(self) -> float:
        """Return the pillar's coordinate to the left [m]."""
        return self.pillar_distance * sin(self.pillar_bearing)

    def is_near(self, x: float, y: float) -> bool:
        """Return whether the marker is at a position in base_link [m], up to its tolerance."""
        return hypot(self.x - x, self.y - y) <= self.tolerance

    def is_mirrored(self) -> bool:
        """Return whether the marker's y has the wrong sign, so the marker is on the robot's other side."""
        return self.is_near(self.pillar_x, -self.pillar_y)

    def is_swapped(self) -> bool:
        """Return whether the marker has the pillar's x as y, and the pillar's y as x.

        If the lidar is upside down, its y axis points to the right. In the lidar's frame, the pillar is then
        at (x, -y), and a swapped marker at (-y, x). In base_link, this marker is at (-y, -x).
        """
        is_swapped_in_base = self.is_near(self.pillar_y, self.pillar_x)
        is_swapped_upside_down = self.is_near(-self.pillar_y, -self.pillar_x)
        return is_swapped_in_base or is_swapped_upside_down


def fault_of_invisible(marker: MarkerSample) -> Kind:
    """Return the kind of fault of a marker that RViz does not draw."""
    if not marker.finite:
        return Kind.NOT_A_NUMBER
    return Kind.INVISIBLE if marker.has_frame else Kind.NO_FRAME


def find_fault(
    recording: Recording, wrong: Sequence[MarkerSample], wrong_share: float, rules: Rules
) -> Optional[Kind]:
    """Return the kind of fault that most wrong markers have; None if unknown.

    The tests run in a fixed order, and the first fault that fits counts.

    Args:
        recording: recording of the run.
        wrong: wrong markers, at least one.
        wrong_share: fraction of all markers that are wrong, 0 to 1.
        rules: rules of the rubric.
    """
    if _are_mostly_true([not marker.finite for marker in wrong]):
        return Kind.NOT_A_NUMBER
    drawn = [marker for marker in wrong if not marker.problem]
    if not drawn:
        return fault_of_invisible(wrong[0])
    lidar_x = load_robot(recording.robot).lidar_mount.x  # [m] x of the lidar in base_link
    if _are_mostly_true([_is_at_origin(recording, marker, lidar_x) for marker in drawn]):
        came_without_range = _are_mostly_true([_came_without_range(recording, marker) for marker in drawn])
        # if all markers are wrong, the submission never sets the position, so the scans are not the reason
        some_are_right = wrong_share < 1.0
        if some_are_right and came_without_range:
            return Kind.NO_RETURN
        return Kind.AT_ORIGIN
    fault = _find_direction_fault(recording, wrong, wrong_share, rules)
    if fault:
        return fault
    if _are_mostly_true([_leaves_out_lidar_mount(recording, marker, lidar_x, rules) for marker in drawn]):
        return Kind.IN_BASE_LINK
    if _are_mostly_true([_has_only_wrong_height(recording, marker, rules) for marker in drawn]):
        return Kind.WRONG_HEIGHT
    return None


def _has_only_wrong_height(recording: Recording, marker: MarkerSample, rules: Rules) -> bool:
    """Return whether a marker is at the pillar, seen from above, but above the pillar or below the ground."""
    # [m] limit for a robot at the pillar; a robot farther away has a larger limit
    limit = rules.marker_full + slack_of(recording, robot_distance=0.0, rules=rules)
    is_at_pillar = distance_to_pillar(recording, marker) <= limit
    return is_at_pillar and height_score(marker, recording.pillar_size.height) < 1.0


def _find_direction_fault(
    recording: Recording, wrong: Sequence[MarkerSample], wrong_share: float, rules: Rules
) -> Optional[Kind]:
    """Return the fault in the coordinates of most wrong markers; None if unknown.

    Only markers count that are drawn while the pillar is off the robot's x axis, because on this axis a
    mirrored marker is right, too. `wrong_share` is the fraction of all markers that are wrong.
    """
    seen_markers = off_axis(recording, wrong, rules)
    if not seen_markers:
        return None
    frame = wrong[0].frame  # the first marker stands for all, because few submissions use several frames
    if frame != "odom":  # any other frame counts as base_link or as the lidar's frame
        # [m] x of the frame's origin in base_link
        frame_x = 0.0 if frame == "base_link" else load_robot(recording.robot).lidar_mount.x
        fault = _find_fault_of_numbers(seen_markers, frame_x)
        if fault:
            return fault
    if _are_mostly_true([seen.is_mirrored() for seen in seen_markers]):
        return Kind.MIRRORED
    if _are_mostly_true([seen.is_swapped() for seen in seen_markers]):
        return Kind.SWAPPED
    # A node with a wrong beam has many wrong markers. If a node has only a few, these markers came late while
    # the robot turned, so their distance is right, but their direction is wrong.
    has_many_wrong = wrong_share >= 0.5
    radius = recording.pillar_size.radius
    if has_many_wrong and _are_mostly_true([_is_on_another_beam(seen, radius) for seen in seen_markers]):
        return Kind.OTHER_BEAM
    return None


def _find_fault_of_numbers(seen_markers: Sequence[Seen], frame_x: float) -> Optional[Kind]:
    """Return the fault in the numbers that the student has computed for most markers; None if unknown.

    These numbers are coordinates in the markers' frame, which is base_link or the lidar's frame. They differ
    from the coordinates in base_link only by `frame_x`, the x of the frame's origin in base_link [m], and for
    an upside-down lidar by the sign of y. In odom, all numbers would differ.
    """
    if _are_mostly_true([abs(seen.y) <= COORDINATE_TOLERANCE and seen.x > 0.0 for seen in seen_markers]):
        return Kind.Y_IS_ZERO
    if _are_mostly_true([_is_whole(seen.x - frame_x) and _is_whole(seen.y) for seen in seen_markers]):
        return Kind.WHOLE_METRES
    return None


def off_axis(recording: Recording, wrong: Sequence[MarkerSample], rules: Rules) -> List[Seen]:
    """Return the wrong markers that are drawn while the pillar is off the robot's x axis.

    On this axis a mirrored marker and a correct one are at the same position.
    """
    seen_markers = []
    for marker in wrong:
        if marker.problem:  # RViz does not draw this marker, so it has no position
            continue
        # the score of a marker is for the time at which the marker came, so this test is for the same time
        if not is_off_axis(recording, marker.at, rules):
            continue
        # [s] the student has computed the position for this time, so marker and pillar are compared then
        position_time = _time_of_position(marker)
        x, y = _from_robot(recording, marker.position, position_time)
        pillar_distance, pillar_bearing = pillar_from_robot(recording, position_time)
        # [m] distance from the pillar at which the rubric still gives a marker half of the points
        half_points_distance = rules.marker_half + slack_of(recording, pillar_distance, rules)
        # [m] a mirrored or swapped marker is recognised up to a larger distance than the rubric allows
        tolerance = half_points_distance + IMAGE_SLOPE * pillar_distance
        seen_markers.append(Seen(x, y, pillar_distance, pillar_bearing, tolerance))
    return seen_markers


def _time_of_position(marker: MarkerSample) -> float:
    """Return the simulated time [s] at which a marker's position holds; RViz draws the marker only later.

    This time is the marker's stamp. A stamp of 0 stands for the time at which the marker came.
    """
    return marker.stamp or marker.at


def _is_on_another_beam(seen: Seen, radius: float) -> bool:
    """Return whether a wrong marker is as far away as the pillar, but in another direction.

    Args:
        seen: marker that is known to be wrong.
        radius: radius of the pillar [m].
    """
    # [m] Error of the marker's distance. The pillar reaches from `radius` before its axis to `radius` behind
    # its axis, so a distance in between has no error.
    distance_error = max(abs(hypot(seen.x, seen.y) - seen.pillar_distance) - radius, 0.0)
    # [m] distance of the marker from the line through robot and pillar
    across = abs(seen.y * cos(seen.pillar_bearing) - seen.x * sin(seen.pillar_bearing))
    # the marker is wrong, so if its distance has no error, its direction has one
    is_mostly_direction = across > 2.0 * distance_error
    return distance_error <= POSITION_TOLERANCE and is_mostly_direction


def _are_mostly_true(tests: Sequence[bool]) -> bool:
    """Return whether at least the fraction MOSTLY of some tests is true."""
    return float(np.mean(tests)) >= MOSTLY


def _is_at_origin(recording: Recording, marker: MarkerSample, lidar_x: float) -> bool:
    """Return whether a marker is on the lidar, or at the origin of odom or base_link if that is its frame.

    The student has then probably set no position. `lidar_x` is the x of the lidar in base_link [m].
    """
    start = recording.start  # origin of odom
    from_start = hypot(marker.position[0] - start.x, marker.position[1] - start.y)
    if marker.frame == "odom" and from_start <= POSITION_TOLERANCE:
        return True
    x, y = _from_robot(recording, marker.position, _time_of_position(marker))
    if marker.frame == "base_link" and hypot(x, y) <= POSITION_TOLERANCE:
        return True
    return hypot(x - lidar_x, y) <= POSITION_TOLERANCE


def _came_without_range(recording: Recording, marker: MarkerSample) -> bool:
    """Return whether no beam had a return in the last scan before a marker; False if there was no scan."""
    # (N, 2) [s, m] time and smallest range of the scans before the marker; 1e-6 is a tolerance for rounding
    before = recording.nearest[recording.nearest[:, 0] <= marker.at + 1e-6]
    return len(before) > 0 and float(before[-1, 1]) == np.inf


def _leaves_out_lidar_mount(recording: Recording, marker: MarkerSample, lidar_x: float, rules: Rules) -> bool:
    """Return whether a marker in base_link has coordinates that would be right in the lidar's frame.

    The student has then left out the position of the lidar on the robot. `lidar_x` is the x of the lidar in
    base_link [m].
    """
    if marker.frame != "base_link" or abs(lidar_x) <= COORDINATE_TOLERANCE:
        return False
    at = _time_of_position(marker)
    distance, bearing = pillar_from_robot(recording, at)
    x, y = _from_robot(recording, marker.position, at)
    pillar_x, pillar_y = distance * cos(bearing), distance * sin(bearing)  # [m] position in base_link
    # [m] distance from the pillar's axis to the marker, if the marker is moved ahead by the lidar's position
    error = hypot(x + lidar_x - pillar_x, y - pillar_y)
    return error <= rules.marker_full + slack_of(recording, distance, rules)


def _from_robot(recording: Recording, position: Sequence[float], at: float) -> Tuple[float, float]:
    """Return a position (x, y) in the world [m] as its position in base_link at a moment [s]."""
    # index of the first true pose at this moment or after it
    row = min(int(np.searchsorted(recording.times, at)), len(recording.times) - 1)
    x, y, yaw = map(float, recording.poses[row])
    dx, dy = position[0] - x, position[1] - y
    return dx * cos(yaw) + dy * sin(yaw), dy * cos(yaw) - dx * sin(yaw)


def _is_whole(coordinate: float) -> bool:
    """Return whether a coordinate [m] is a whole number of metres, up to COORDINATE_TOLERANCE."""
    return abs(coordinate - round(coordinate)) <= COORDINATE_TOLERANCE


def is_off_axis(recording: Recording, at: float, rules: Rules) -> bool:
    """Return whether the pillar is so far off the robot's x axis that a mirrored marker scores 0.

    Only at such moments can a marker show whether its y has the right sign. `at` is the time of the moment
    [s].
    """
    distance, bearing = pillar_from_robot(recording, at)
    # [m] distance from the pillar to a marker whose y has the wrong sign
    mirror_error = 2.0 * distance * abs(sin(bearing))
    # [m] error at which the score falls to 0, because it falls linearly from 1 at `marker_full` to 0.5 at
    # `marker_half`
    zero_score_error = 2.0 * rules.marker_half - rules.marker_full
    return mirror_error > zero_score_error + slack_of(recording, distance, rules)


def slack_of(recording: Recording, robot_distance: float, rules: Rules) -> float:
    """Return how much [m] is added to the distances from the pillar that the rubric allows to a marker.

    The rubric's distances are for a robot at the course's pillar. The addition grows with the robot's
    distance from the pillar [m], and with the pillar's radius, because a marker on the surface of a thick
    pillar is right, too.
    """
    return rules.marker_per_metre * robot_distance + recording.pillar_size.radius - PILLAR_RADIUS


def height_score(marker: MarkerSample, height: float) -> float:
    """Return the factor of a marker's score, 0 to 1, for its height in the world.

    It is 1 beside a pillar of this height [m], and less for a marker above the pillar or below the ground.
    """
    # [m] height of the whole marker above the pillar, or its depth below the ground; 0 if it is beside the
    # pillar
    gap = max(marker.low - height, -marker.high, 0.0)
    return 1.0 - min(max(gap - HEIGHT_MARGIN, 0.0) / HEIGHT_FADE, 1.0)


def distance_to_pillar(recording: Recording, marker: MarkerSample) -> float:
    """Return the distance of a marker from the pillar's axis [m]."""
    x, y = recording.pillar
    return hypot(marker.position[0] - x, marker.position[1] - y)


def pillar_from_robot(recording: Recording, at: float) -> Tuple[float, float]:
    """Return distance [m] and bearing [rad] of the pillar in base_link at a moment [s]."""
    ahead, left = _from_robot(recording, recording.pillar, at)
    return hypot(ahead, left), atan2(left, ahead)


def fault_text(recording: Recording, marker: MarkerSample) -> str:
    """Return a sentence for the student: where a wrong marker is, and in which direction from the pillar."""
    if marker.problem:  # reason why RViz does not draw it
        return f"not visible: {marker.problem}"
    x, y = recording.pillar
    marker_x, marker_y, marker_z = marker.position
    if max(abs(marker_x), abs(marker_y), abs(marker_z)) > OUT_OF_THE_WORLD:
        return f"at ({marker_x:.1e}, {marker_y:.1e}, {marker_z:.1e}); give each coordinate a value"
    text = f"at ({marker_x:.2f}, {marker_y:.2f}, {marker_z:.2f}), the pillar at ({x:.2f}, {y:.2f})"
    height = recording.pillar_size.height
    if height_score(marker, height) < 1.0:
        text += f": z is wrong, it is drawn from {marker.low:.2f} to {marker.high:.2f} m"
        return f"{text}, the pillar from 0 to {height:g} m"
    at = _time_of_position(marker)
    distance, bearing = pillar_from_robot(recording, at)
    ahead, left = _from_robot(recording, marker.position, at)
    # [m] error along the line from the robot to the pillar, positive behind the pillar; and error across this
    # line, positive to the left
    along = ahead * cos(bearing) + left * sin(bearing) - distance
    across = left * cos(bearing) - ahead * sin(bearing)
    parts = []
    # the sentence leaves out one of the two errors if it is less than half of the other error
    if 2.0 * abs(along) >= abs(across):
        # the error is measured from the surface of the pillar, because a marker on the surface is right, too
        gap = max(abs(along) - recording.pillar_size.radius, 0.0)
        parts.append(f"{gap:.2f} m {'behind' if along > 0.0 else 'in front of'} the pillar")
    if 2.0 * abs(across) >= abs(along):
        parts.append(f"{abs(across):.2f} m too far {'left' if across > 0.0 else 'right'}")
    return f"{text}: {' and '.join(parts)}, seen from the robot"
