"""Recording of a run's markers, with positions in the world by TF and the robot's true poses."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np
import rospkg
import rospy
import tf2_ros
from visualization_msgs.msg import Marker, MarkerArray

from husky_grading.drive.marker_shape import LINES, LISTS, MAX_POINTS, draw
from husky_grading.isolation.files import is_below, is_regular
from husky_grading.notes import Kind, Note
from husky_grading.recording import ADD, DELETE, DELETE_ALL, MarkerSample
from husky_highlevel_controller.datatypes import Pose, Quaternion, Vector3
from husky_highlevel_controller.geometry import compose
from husky_highlevel_controller.ros import conversions

BASE = "base_link"  # frame of the robot
# types of messages with markers, and their classes
KINDS = {"visualization_msgs/Marker": Marker, "visualization_msgs/MarkerArray": MarkerArray}
# name of each action of a marker in the recording
ACTIONS = {Marker.ADD: ADD, Marker.DELETE: DELETE, Marker.DELETEALL: DELETE_ALL}
# [s] shortest simulated time between two moments at which markers of the same namespace are recorded
PERIOD = 0.019
# if more than CROWD markers came at the same time, PERIOD becomes longer, in proportion to their number
CROWD = 10
MAX_SAMPLES = 50_000  # at most this number of markers of a run is recorded
# if all recorded markers of a run have more points together, the further points are cut off
MAX_ALL_POINTS = 500_000
MAX_MESSAGE = 2_000_000  # [bytes] largest message of markers that is read
MAX_TOPICS = 50  # markers of at most this number of topics are recorded
MAX_FRAMES = 5000  # at most this number of frames of TF is recorded
# number of characters after which the name of a namespace or frame is cut off; a topic with a longer name is
# ignored
MAX_NAME = 200
# [s] if TF does not know a frame at the time of the marker, later times are tried: every RETRY_STEP, up to
# RETRY_END after the marker
RETRY_STEP, RETRY_END = 0.05, 1.0

# a frame and its parent in the text of all frames that TF returns
_FRAME = re.compile(r"^(\S[^\n]*?): *\n  parent: '([^\n']*)'$", re.MULTILINE)


class MarkerWatch:
    """Records the markers of a run and all transforms; `samples` places the markers after the run.

    Only then are all transforms known, because a transform may come later than the marker that needs it.
    """

    def __init__(self, now: Callable[[], float], packages: Sequence[str] = ()) -> None:
        self._now = now  # returns the simulated time [s]
        # folders that contain the submission's packages; the mesh files of markers are searched there
        self._packages = packages
        # recorded markers, as sample and message; their positions in the world are computed after the run
        self._samples: List[Tuple[MarkerSample, Marker]] = []
        self._points_left = MAX_ALL_POINTS  # number of points that may still be kept in this run
        self._closed = False  # true if no further markers are kept
        # latest time [s] at which markers were kept, and number of the markers of this time, by topic and
        # namespace. `_is_due` decides by them which markers are kept.
        self._moments: Dict[Tuple[str, str], Tuple[float, int]] = {}
        self._topics: Dict[str, rospy.Subscriber] = {}  # subscribers by topic
        self._types: Dict[str, str] = {}  # type of each topic, one of KINDS
        # number of messages on each topic that cannot be read, because they are not of the topic's type
        self._unreadable: Dict[str, int] = {}
        # keeps all transforms of the run, because markers are placed only after it
        self._buffer = tf2_ros.Buffer(rospy.Duration(3600.0), debug=False)
        self._listener = tf2_ros.TransformListener(self._buffer)

    @property
    def topics(self) -> Tuple[str, ...]:
        """Return the topics of markers that were published."""
        return tuple(sorted(self._topics))

    @property
    def types(self) -> Dict[str, str]:
        """Return the type of each topic of markers, such as "visualization_msgs/Marker"."""
        return dict(self._types)

    @property
    def notes(self) -> Tuple[Note, ...]:
        """Return notes on topics with messages that cannot be read."""
        return tuple(
            Note(Kind.UNREADABLE, f"{count} messages on {topic} are not of its type, so they are ignored")
            for topic, count in sorted(self._unreadable.items())
        )

    @property
    def frames(self) -> Dict[str, str]:
        """Return the parent of each frame of TF."""
        pairs = _FRAME.findall(self._buffer.all_frames_as_yaml())
        return {frame[:MAX_NAME]: parent[:MAX_NAME] for frame, parent in pairs[:MAX_FRAMES]}

    @property
    def subscribers(self) -> Tuple[rospy.Subscriber, ...]:
        """Return the subscribers of the topics of markers."""
        return tuple(self._topics.values())

    def close(self) -> None:
        """Keep no further markers, because no more poses of the robot are recorded to place them."""
        self._closed = True

    def place(self, frame: str) -> Optional[Vector3]:
        """Return the position of a frame in base_link [m] by the newest transforms; None if it is unknown."""
        with suppress(tf2_ros.TransformException):
            transform = self._buffer.lookup_transform_core(BASE, frame, rospy.Time())
            return conversions.pose_from_transform(transform).position
        return None

    def places(self) -> Dict[str, Vector3]:
        """Return the positions in base_link [m] of all frames that transforms connect with base_link."""
        places = {frame: self.place(frame) for frame in self.frames}
        return {frame: place for frame, place in places.items() if place is not None}

    def follow(self, topic: str, kind: str) -> None:
        """Record the markers on a topic from now on, if the type `kind` is a type of markers."""
        is_new = topic not in self._topics and len(self._topics) < MAX_TOPICS
        # a topic with a longer name is ignored, because drawing a very long name in a picture could take
        # minutes
        if kind in KINDS and is_new and len(topic) <= MAX_NAME:
            self._types[topic] = kind
            # the messages come as raw bytes, so that a large message is rejected before it is deserialised
            self._topics[topic] = rospy.Subscriber(
                topic, rospy.AnyMsg, self._on_message, (topic, KINDS[kind]), queue_size=100, tcp_nodelay=True
            )

    def _on_message(self, raw: Any, source: Tuple[str, Any]) -> None:
        """Deserialise a message and keep its markers, unless the message is too large or broken.

        `source` is the topic of the message and its class.
        """
        topic, kind = source
        if len(raw._buff) > MAX_MESSAGE:
            # A marker without frame_id, which RViz does not draw, takes the place of the large message. The
            # namespace of this marker gives the reason in the recording.
            large = Marker(ns=f"larger than {MAX_MESSAGE} bytes", action=Marker.ADD)
            self.add([large], topic)
            return
        try:
            message = kind().deserialize(raw._buff)
        except Exception:
            # A submission may send any bytes, so deserialising them may raise any error. The errors are only
            # counted, because a log line for each error would be too much.
            self._unreadable[topic] = self._unreadable.get(topic, 0) + 1
            return
        self.add(message.markers if kind is MarkerArray else [message], topic)

    def add(self, markers: Sequence[Marker], topic: str) -> None:
        """Keep the markers that have come on a topic now, unless they come too soon after earlier ones."""
        now = self._now()
        for marker in markers:
            if marker.action in ACTIONS and self._is_due(now, (topic, marker.ns[:MAX_NAME])):
                # the problem must be found before `_shorten` removes points, text and mesh
                problem = self._problem_of(marker)
                self._shorten(marker)
                lifetime = marker.lifetime.to_sec()
                sample = MarkerSample(
                    topic=topic,
                    namespace=marker.ns,
                    id=marker.id,
                    at=now,
                    stamp=marker.header.stamp.to_sec(),
                    frame=marker.header.frame_id.lstrip("/"),
                    position=(nan, nan, nan),  # `samples` sets it after the run
                    until=now + lifetime if lifetime > 0.0 else inf,  # a lifetime of 0 never ends
                    action=ACTIONS[marker.action],
                    problem=problem,
                    finite=_is_finite(marker),
                )
                self._samples.append((sample, marker))

    def _problem_of(self, marker: Marker) -> str:
        """Return why RViz would not draw a marker, by its values and its mesh file; empty if it would."""
        problem = _invisible(marker)
        if not problem and marker.type == Marker.MESH_RESOURCE and not self._finds_mesh(marker.mesh_resource):
            return "its mesh does not exist"
        return problem

    def _shorten(self, marker: Marker) -> None:
        """Cut the points and names of a marker to their limits, and remove the parts that do not place it.

        A run keeps all markers in memory, so the markers must be small.
        """
        marker.points = marker.points[: min(MAX_POINTS, self._points_left)]
        self._points_left -= len(marker.points)
        marker.colors, marker.text, marker.mesh_resource = [], "", ""
        marker.ns, marker.header.frame_id = marker.ns[:MAX_NAME], marker.header.frame_id[:MAX_NAME]

    def _is_due(self, now: float, key: Tuple[str, str]) -> bool:
        """Return whether a marker that comes now is kept; if so, count the marker.

        All markers that come at the same time are kept. Then further markers of the same topic and namespace
        are ignored for PERIOD. If more than CROWD markers came at once, this pause is longer: twice as long
        after twice CROWD markers. Otherwise a run would soon have MAX_SAMPLES markers, and keep no more.
        """
        if self._closed or len(self._samples) >= MAX_SAMPLES:
            return False
        # latest time at which markers were kept, and how many were kept at this time
        kept_at, count = self._moments.get(key, (-inf, 0))
        if now > kept_at:  # no marker of the time `now` was kept so far
            pause = PERIOD * max(1.0, count / CROWD)  # [s]
            if now - kept_at < pause:
                return False
            kept_at, count = now, 0
        self._moments[key] = kept_at, count + 1
        return True

    def _finds_mesh(self, mesh: str) -> bool:
        """Return whether RViz finds the mesh file of a marker, whose address is file://... or package://...

        Other addresses, such as http, do not count, because a run has no access to the internet. Only files
        of packages count, so a submission cannot learn which other files this machine has.
        """
        scheme, _, place = mesh.partition("://")
        if scheme == "file":  # `place` is an absolute path, which must be in the submission's packages
            return any(_is_file_of(Path(folder), place) for folder in self._packages)
        if scheme != "package":
            return False
        package, _, path = place.partition("/")
        # a package of the submission, or an installed one of this name
        folders = [Path(folder, package) for folder in self._packages]
        with suppress(rospkg.ResourceNotFound):
            folders.append(Path(_installed().get_path(package)))
        return any(_is_file_of(folder, path) for folder in folders)

    def samples(
        self, times: np.ndarray, poses: Sequence[Pose], pillar: Tuple[float, float]
    ) -> Tuple[MarkerSample, ...]:
        """Return all recorded markers in the world, by times (N,) [s] and N poses of base_link in the world.

        `pillar` is the position of the pillar's axis in the world, x and y [m]. The samples get their
        distance from this axis.
        """
        # markers can be placed only with poses of the robot
        if not self._samples or not len(times):
            return ()
        # A callback may append a marker, so the list is copied. The frames are read after the copy, so the
        # frame of each copied marker is known if it came together with the marker.
        samples = list(self._samples)
        parents = self.frames
        known_frames = {BASE, *parents, *parents.values()}
        placed = []
        for sample, marker in samples:
            if sample.problem or sample.action != ADD:
                # a marker that RViz does not draw, or a deletion, has no place
                placed.append(sample)
            elif sample.frame not in known_frames:
                problem = f"there is no frame {sample.frame!r}"
                placed.append(replace(sample, problem=problem, has_frame=False))
            else:
                placed.append(self._placed(sample, marker, times, poses, pillar))
        return tuple(placed)

    def _placed(
        self,
        sample: MarkerSample,
        marker: Marker,
        times: np.ndarray,
        poses: Sequence[Pose],
        pillar: Tuple[float, float],
    ) -> MarkerSample:
        """Return a sample with its place in the world, or with a problem if TF does not know its frame.

        Args:
            sample: sample without a position in the world.
            marker: message of the sample.
            times: times of the poses, (N,) [s].
            poses: N poses of base_link in the world.
            pillar: position of the pillar's axis in the world, x and y [m]. Of a marker with several points,
                the point that is nearest to the pillar counts.
        """
        try:
            # time [s] at which the marker is placed, and pose of its frame in base_link at this time
            moment, frame_in_base = self._frame_in_base(sample)
        except (tf2_ros.TransformException, ValueError) as error:
            # TF raises a ValueError if the name of the frame contains a NUL character. The student only gets
            # the first sentence of an error.
            return replace(sample, problem=str(error).split(". ")[0].strip())
        # row of the first true pose that is not earlier than `moment`; 1e-6 s is a tolerance for rounding
        row = int(np.searchsorted(times, moment - 1e-6))
        row = min(row, len(times) - 1)  # a marker after the last pose gets the last pose
        # pose of the marker in the world, composed of three poses: base_link in the world, the marker's frame
        # in base_link, and the marker in its frame
        pose = compose(compose(poses[row], frame_in_base), _pose(marker))
        scale = (marker.scale.x, marker.scale.y, marker.scale.z)
        points = [(point.x, point.y, point.z) for point in marker.points]
        shape = draw(marker.type, pose, scale, points, pillar)
        # the fields of `shape` have the same names in a sample: position, reach, low and high
        return replace(sample, **shape._asdict())

    def _frame_in_base(self, sample: MarkerSample) -> Tuple[float, Pose]:
        """Return the time [s] at which a marker is placed, and the pose of its frame in base_link then.

        - If the marker has a stamp, it is placed at the time of the stamp.
        - If the stamp is 0, the marker is placed at the time at which it came. If TF does not know the frame
          at this time, later times are tried, up to RETRY_END after it.
        - If no transform came after the marker, the time of the latest transform is taken.

        The pose is relative to base_link, because the true pose of base_link in the world is known. So errors
        of odometry do not count.

        Raises:
            TransformException: no transform connects the two frames.
        """
        if sample.frame == BASE:
            return sample.stamp or sample.at, Pose()
        if sample.stamp:
            return sample.stamp, self._lookup(sample.frame, sample.stamp)
        # [s] times to try: first when the marker came, then later, because the transform may come after the
        # marker
        moments = [sample.at, *(sample.at + np.arange(RETRY_STEP, RETRY_END, RETRY_STEP)).tolist()]
        first_error: Optional[Exception] = None  # error at the time at which the marker came
        for moment in moments:
            try:
                return moment, self._lookup(sample.frame, moment)
            except tf2_ros.TransformException as error:
                first_error = first_error or error
        # [s] latest time for which TF knows the frame
        latest = self._buffer.get_latest_common_time(BASE, sample.frame).to_sec()
        # no transform came after the marker, because the run ended or the submission stopped sending
        # transforms
        if latest < sample.at:
            return latest, self._lookup(sample.frame, latest)
        raise tf2_ros.TransformException(str(first_error))

    def _lookup(self, frame: str, moment: float) -> Pose:
        """Return the pose of a frame in base_link at a moment [s].

        Raises:
            TransformException: no transform connects the two frames at this moment.
        """
        transform = self._buffer.lookup_transform_core(BASE, frame, rospy.Time.from_sec(moment))
        return conversions.pose_from_transform(transform)


def _is_file_of(folder: Path, place: str) -> bool:
    """Return whether `place`, a path in this folder or an absolute path, is a file below this folder."""
    with suppress(OSError, ValueError):  # a loop of links or a NUL character in the path raises an error
        return is_below(folder / place, folder) and is_regular(folder / place)
    return False


def _pose(marker: Marker) -> Pose:
    """Return a marker's pose in its frame, with a quaternion of length 1."""
    p, q = marker.pose.position, marker.pose.orientation
    length = float(np.linalg.norm((q.x, q.y, q.z, q.w)))
    # no rotation; like RViz, a quaternion of zeros counts as no rotation
    quat: Quaternion = (0.0, 0.0, 0.0, 1.0)
    if length > 0.0:
        quat = (q.x / length, q.y / length, q.z / length, q.w / length)
    return Pose((p.x, p.y, p.z), quat)


def _invisible(marker: Marker) -> str:
    """Return why RViz would not draw a marker with these values; empty if RViz would draw it.

    This does not check whether the marker's frame and mesh exist.
    """
    scale = marker.scale
    if marker.action != Marker.ADD:  # a deletion is meant to draw nothing, so this is not a fault
        return ""
    if not marker.header.frame_id:
        return "it has no frame_id"
    if not _is_finite(marker):
        return "its position is not a number"
    if max(scale.x, scale.y, scale.z) <= 0.0:
        return "its scale is 0"
    # a marker with points may have a colour for each point; then RViz ignores the colour of the marker itself
    colors = marker.colors if marker.type in LISTS and marker.colors else [marker.color]
    # RViz draws a mesh in the colours of its file if all four values of the marker's colour are 0
    color = marker.color
    has_file_colors = marker.type == Marker.MESH_RESOURCE and marker.mesh_use_embedded_materials
    uses_file_colors = has_file_colors and (color.r, color.g, color.b, color.a) == (0.0, 0.0, 0.0, 0.0)
    if not uses_file_colors and not any(each.a > 0.0 for each in colors):
        return "its alpha is 0"
    if not 0 <= marker.type <= Marker.TRIANGLE_LIST:
        return f"its type {marker.type} is not a type of visualization_msgs/Marker"
    least_points = 2 if marker.type in LINES else 1
    if marker.type in LISTS and len(marker.points) < least_points:
        return "it has no points"
    if marker.type == Marker.TEXT_VIEW_FACING and not marker.text.strip():
        return "its text is empty"
    return ""


def _is_finite(marker: Marker) -> bool:
    """Return whether pose, scale and points of a marker are finite numbers."""
    p, q, scale = marker.pose.position, marker.pose.orientation, marker.scale
    points = [number for point in marker.points for number in (point.x, point.y, point.z)]
    return all(map(isfinite, (p.x, p.y, p.z, q.x, q.y, q.z, q.w, scale.x, scale.y, scale.z, *points)))


@lru_cache(maxsize=1)
def _installed() -> Any:
    """Return the index of the installed packages, which takes some time to make."""
    return rospkg.RosPack()
