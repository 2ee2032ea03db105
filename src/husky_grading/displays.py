"""Displays of an RViz configuration, and their visibility with the frames of a run.

In: the content of an .rviz file, frames and robot descriptions of a recording. Out: records. No ROS.
The saved camera does not count, because it is only the last view of the student.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

TF, ROBOT, SCAN, CLOUD = "rviz/TF", "rviz/RobotModel", "rviz/LaserScan", "rviz/PointCloud2"
MARKER, MARKER_ARRAY = "rviz/Marker", "rviz/MarkerArray"
MARKERS = {MARKER, MARKER_ARRAY}
BASE = "base_link"  # frame of the robot
MAX_TEXT = 200  # longer names of topics, frames and namespaces are cut to this number of characters
MAX_DISPLAYS = 500  # at most this number of displays and groups of a configuration is read


@dataclass(frozen=True)
class RvizDisplay:
    """Display that is switched on, and drawn large and opaque enough to be seen."""

    kind: str  # class of the display in RViz, such as rviz/LaserScan
    source: str = ""  # topic that the display shows; for a robot model, name of the parameter with its URDF
    hidden: Tuple[str, ...] = ()  # marker namespaces that are switched off in the display
    colouring: str = ""  # colours of a point cloud: RViz's Color Transformer and Axis, such as "AxisColor Z"
    size: float = 0.0  # [m] size of the points of a point cloud


@dataclass(frozen=True)
class RvizConfig:
    """Configuration with which a submission would start RViz."""

    # origin of the configuration in words for the student, such as "its rviz node, my.rviz"; empty if the
    # student handed in no configuration
    source: str = ""
    fixed_frame: str = ""
    # displays that are switched on; RViz may still draw nothing for one of them, if its topic is wrong
    displays: Tuple[RvizDisplay, ...] = ()
    # displays that nobody can see: switched off, transparent, or with size 0
    off: Tuple[RvizDisplay, ...] = ()
    problem: str = ""  # reason why the configuration cannot be read; empty if it can be read
    started: bool = False  # true if the launch file starts RViz
    missing: str = ""  # RViz file that the launch file uses, if this file was not handed in; otherwise empty


@dataclass(frozen=True)
class RvizView(RvizConfig):
    """A configuration, and the displays that the submission's RViz shows with it."""

    topics: Tuple[str, ...] = ()  # topics of all visible displays of laser scans and markers
    tf: bool = False  # true if frames are visible
    robot: bool = False  # true if the robot model is visible
    scan: bool = False  # true if the laser's points are visible
    hidden: Tuple[Tuple[str, str], ...] = ()  # topic and namespace of markers that no display shows
    # visible displays that show no marker, because the display is for Marker and the topic has MarkerArray,
    # or the reverse
    mistyped: Tuple[RvizDisplay, ...] = ()

    @property
    def clouds(self) -> Tuple[RvizDisplay, ...]:
        """Return the displays of point clouds, even if no transform makes them visible."""
        return tuple(display for display in self.displays if display.kind == CLOUD)


@dataclass(frozen=True)
class FrameTree:
    """Frames and robot descriptions of a run."""

    # parent frame of each frame, by the name of the frame
    parents: Mapping[str, str] = field(default_factory=dict)
    # names of the parameters with a URDF, if the links of the URDF are frames of TF
    descriptions: Tuple[str, ...] = ()

    def connects(self, frame: str) -> bool:
        """Return whether transforms connect a frame with base_link."""
        return self._root(frame) == self._root(BASE) and frame in {*self.parents, *self.parents.values()}

    def _root(self, frame: str) -> str:
        """Return the top frame above a frame."""
        seen = set()  # ends the search if a submission publishes a circle of frames
        while frame in self.parents and frame not in seen:
            seen.add(frame)
            frame = self.parents[frame]
        return frame


# frames that the simulator alone publishes; they are used if a run has ended before its odometry began
STANDING = FrameTree({BASE: "odom", "base_footprint": BASE}, ("/robot_description",))


def read_rviz_config(source: str, content: Any, remaps: Sequence[Tuple[str, str]] = ()) -> RvizConfig:
    """Return the configuration in an .rviz file, with the topics that it shows after the node's remaps.

    Args:
        source: origin of the file in words for the student.
        content: content of the file, as YAML gives it; it may be anything.
        remaps: remaps of the rviz node, as pairs of old and new topic.
    """
    manager = _mapping(content, "Visualization Manager")
    if not manager:
        return RvizConfig(source, problem="the file is not a configuration of RViz")
    new_topics = {_full_name(old): _full_name(new) for old, new in remaps}
    visible: List[RvizDisplay] = []
    off: List[RvizDisplay] = []
    for entry, is_visible in _display_entries(manager.get("Displays")):
        display = _read_display(entry)
        display = replace(display, source=new_topics.get(display.source, display.source))
        if is_visible:
            visible.append(display)
        else:
            off.append(display)
    # "map" is the default of RViz; TF names a frame without a slash in front
    frame = str(_mapping(manager, "Global Options").get("Fixed Frame", "map"))[:MAX_TEXT].lstrip("/")
    return RvizConfig(source, frame, tuple(visible), tuple(off))


def _mapping(content: Any, key: str) -> Dict[str, Any]:
    """Return the mapping under a key of a mapping; empty if there is none."""
    value = content.get(key) if isinstance(content, dict) else None
    return value if isinstance(value, dict) else {}


def _display_entries(displays: Any) -> Iterator[Tuple[Dict[str, Any], bool]]:
    """Yield the entry of each display in a list of an .rviz file, and whether the display is visible.

    The displays in groups are yielded, too; they are visible only if their group is switched on. At most
    MAX_DISPLAYS displays and groups are read.
    """
    # entries that are not read yet, each with true if all groups around it are switched on
    waiting: List[Tuple[Any, bool]] = (
        [(each, True) for each in displays] if isinstance(displays, list) else []
    )
    for _ in range(MAX_DISPLAYS):
        if not waiting:
            return
        entry, is_on = waiting.pop(0)
        if isinstance(entry, dict):
            is_on = is_on and bool(entry.get("Enabled", True))
            if isinstance(entry.get("Displays"), list):  # the entry is a group of displays
                waiting += [(each, is_on) for each in entry["Displays"]]
            else:
                yield entry, is_on and _is_visible(entry)


def _read_display(entry: Mapping[str, Any]) -> RvizDisplay:
    """Return the display that an entry of an .rviz file describes; a missing topic gets RViz's default."""
    kind = str(entry.get("Class"))[:MAX_TEXT]
    # key of the display's topic, or of the parameter with the URDF
    key, default = "Topic", ""
    if kind == ROBOT:
        key, default = "Robot Description", "robot_description"
    elif kind in MARKERS:
        key = "Marker Topic"
    namespaces = _mapping(entry, "Namespaces")
    hidden = tuple(str(name)[:MAX_TEXT] for name, is_on in namespaces.items() if is_on is False)
    display = RvizDisplay(kind, _full_name(str(entry.get(key, default))), hidden)
    if kind != CLOUD:  # colours and size are graded only for point clouds
        return display
    # a missing colour becomes the text "None", and a missing size 1 m; no exercise requires either of them
    colouring = f"{entry.get('Color Transformer')} {entry.get('Axis')}"[:MAX_TEXT]
    return replace(display, colouring=colouring, size=_number(entry.get("Size (m)")))


def _is_visible(entry: Mapping[str, Any]) -> bool:
    """Return whether RViz draws something for a display that is switched on."""
    kind, alpha = entry.get("Class"), _number(entry.get("Alpha", 1.0))
    if kind == TF:  # frames have a size, but no transparency
        scale = _number(entry.get("Marker Scale", 1.0))
        parts = [entry.get(f"Show {part}", True) for part in ("Axes", "Names", "Arrows")]
        return scale > 0.0 and any(parts) and _any_part(_mapping(entry, "Frames"), "All Enabled")
    if kind == ROBOT:
        if not (entry.get("Visual Enabled", True) or entry.get("Collision Enabled", False)):
            return False
        return alpha > 0.0 and _any_part(_mapping(entry, "Links"), "All Links Enabled")
    if kind in (SCAN, CLOUD):
        # RViz reads the size of the points from another key if their style is "Points"
        key = "Size (Pixels)" if entry.get("Style") == "Points" else "Size (m)"
        size = _number(entry.get(key, 1.0))
        return alpha > 0.0 and size > 0.0
    return alpha > 0.0


def _any_part(parts: Mapping[str, Any], key_of_all: str) -> bool:
    """Return whether at least one frame or link of a display is switched on.

    Args:
        parts: entry of each frame or link in the .rviz file, and the entry `key_of_all`.
        key_of_all: key of the switch for all frames or links; this switch counts if the file lists none.
    """
    switches = [part.get("Value", True) for part in parts.values() if isinstance(part, dict)]
    if not switches:
        return bool(parts.get(key_of_all, True))
    return any(switches)


def _number(value: Any) -> float:
    """Return a value if it is a number, otherwise 1, because RViz's own defaults are visible, too."""
    return float(value) if isinstance(value, (int, float)) and isfinite(value) else 1.0


def _full_name(topic: str) -> str:
    """Return a topic's full name, with a slash in front."""
    return "/" + topic[:MAX_TEXT].strip("/")


def _fits(display: str, message: Optional[str]) -> bool:
    """Return whether a display of markers shows messages of a type; True if the type is unknown (None).

    The type is unknown if no node publishes the topic. A display of such a topic does no harm.

    The display rviz/Marker fits messages of type visualization_msgs/Marker; the same holds for MarkerArray.
    """
    return message is None or display.partition("/")[2] == message.partition("/")[2]


def view_of(config: RvizConfig, tree: FrameTree, marker_types: Mapping[str, str]) -> RvizView:
    """Return the view of RViz with a submission's configuration, in a run with these frames.

    The view shows nothing if there is no configuration, if it cannot be read, or if its fixed frame is not a
    frame of the run.

    Args:
        config: configuration of the submission.
        tree: frames and robot descriptions of the run.
        marker_types: types of the topics of markers, such as "visualization_msgs/Marker". A topic whose type
            is unknown is shown by both displays of markers.
    """
    view = RvizView(**vars(config))  # has all fields of the configuration, and shows nothing yet
    if not config.source or config.problem:  # no configuration was handed in, or it cannot be read
        return view
    if not tree.connects(config.fixed_frame):
        frame = config.fixed_frame
        problem = f"no transform connects the fixed frame '{frame}' with {BASE}, so nothing is shown"
        return replace(view, problem=problem)
    models = [display for display in config.displays if display.kind == ROBOT]
    scans = [display for display in config.displays if display.kind == SCAN]
    markers = [display for display in config.displays if display.kind in MARKERS]
    descriptions = set(tree.descriptions)
    if "/robot_description" in descriptions:
        # the SMB's launch file sets /smb_description, but our simulator does not; so a display of
        # /smb_description counts as a display of /robot_description
        descriptions.add("/smb_description")
    topics = [each.source for each in scans] + _topics_shown(markers, marker_types)
    return replace(
        view,
        topics=tuple(dict.fromkeys(topics)),  # each topic once
        hidden=tuple(_hidden_namespaces(markers)),
        mistyped=tuple(each for each in markers if not _fits(each.kind, marker_types.get(each.source))),
        tf=any(display.kind == TF for display in config.displays),
        # RViz shows a robot model only if the run has a robot description of this name
        robot=any(each.source in descriptions for each in models),
        scan=bool(scans),
    )


def _topics_shown(markers: Sequence[RvizDisplay], marker_types: Mapping[str, str]) -> List[str]:
    """Return the topics of markers that displays of markers show, with the types of these topics."""
    topics = []
    for each in markers:
        if _fits(each.kind, marker_types.get(each.source)):
            topics.append(each.source)
        # a Marker display with topic NAME also shows the MarkerArray messages on NAME_array
        array_topic = f"{each.source}_array"
        if each.kind == MARKER and _fits(MARKER_ARRAY, marker_types.get(array_topic)):
            topics.append(array_topic)
    return topics


def _hidden_namespaces(markers: Sequence[RvizDisplay]) -> List[Tuple[str, str]]:
    """Return the topic and namespace of the markers that are switched off in all displays of their topic."""
    hidden = []
    for each in markers:
        displays_of_topic = [other for other in markers if other.source == each.source]
        for name in each.hidden:
            # a namespace that one display hides is visible if another display of its topic does not hide it
            if all(name in other.hidden for other in displays_of_topic):
                hidden.append((each.source, name))
    return hidden
