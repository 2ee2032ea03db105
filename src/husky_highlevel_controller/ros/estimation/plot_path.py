"""Command plot_path: draws x and y of the odometry in bags and on topics, as a PNG file.

In: bags and topics. Out: a picture, and a line about each path.
"""

from __future__ import annotations

import argparse
import sys
import threading
from pathlib import Path
from typing import Dict, List, Tuple

import numpy as np
import rosbag
import rosgraph
import rospy
from nav_msgs.msg import Odometry

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.drawing.plots import draw_paths

KIND = "nav_msgs/Odometry"
Points = List[Tuple[float, float]]  # positions x, y [m] of a path


def paths_of_bag(file: Path) -> Dict[str, Points]:
    """Return the positions x, y [m] of each topic of odometry in a bag, by the name of the topic.

    Raises:
        HuskyError: the bag cannot be read, or has no such topic.
    """
    paths: Dict[str, Points] = {}
    try:
        with rosbag.Bag(str(file)) as bag:
            kinds = {topic: info.msg_type for topic, info in bag.get_type_and_topic_info().topics.items()}
            topics = [topic for topic, kind in kinds.items() if kind == KIND]
            # without this test, `read_messages` would read all topics, because the list is empty
            if topics:
                for topic, msg, _ in bag.read_messages(topics=topics):
                    paths.setdefault(topic, []).append(_position(msg))
    except Exception as error:  # rosbag may raise any error if a bag is damaged
        raise HuskyError(f"{file}: {error}") from None
    if not paths:
        raise HuskyError(f"{file} has no {KIND}; its topics: {', '.join(sorted(kinds)) or 'none'}")
    return paths


def paths_of_topics(topics: List[str]) -> Dict[str, Points]:
    """Return the positions x, y [m] that are published on topics of odometry until Ctrl-C, by topic.

    Raises:
        HuskyError: there is no ROS master.
    """
    if not rosgraph.is_master_online():  # `rospy.init_node` would wait for it
        raise HuskyError(f"no ROS master answers at {rosgraph.get_master_uri()}; start a launch file first")
    paths: Dict[str, Points] = {topic: [] for topic in topics}
    rospy.init_node("plot_path", anonymous=True, disable_signals=True)
    for topic in topics:
        # rospy calls the function with each message and with the path of the topic
        rospy.Subscriber(topic, Odometry, lambda msg, path: path.append(_position(msg)), paths[topic])
    print(f"listening to {', '.join(topics)}: Ctrl-C draws", flush=True)
    try:
        threading.Event().wait()  # only Ctrl-C ends this wait
    except KeyboardInterrupt:
        rospy.signal_shutdown("drawn")
    return paths


def _position(msg: Odometry) -> Tuple[float, float]:
    """Return x and y of the pose in a message [m]."""
    return msg.pose.pose.position.x, msg.pose.pose.position.y


def main() -> None:
    """Draw the paths; exit with 2 if there is nothing to draw."""
    parser = argparse.ArgumentParser(prog="plot_path", description=f"Draw x and y of {KIND} as a PNG file.")
    source_help = "bag, of which all odometry is drawn, or topic, which is recorded until Ctrl-C"
    parser.add_argument("sources", nargs="+", metavar="FILE.bag|TOPIC", help=source_help)
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("path.png"), help="output file (default: path.png)"
    )
    options = parser.parse_args(rospy.myargv()[1:])
    try:
        paths = _paths(options.sources)
        options.output.write_bytes(draw_paths(paths))
    except (HuskyError, OSError) as error:
        print(f"plot_path: {error}", file=sys.stderr)
        sys.exit(2)
    for name, path in paths.items():
        steps = np.diff(path, axis=0)  # vectors from each point to the next, (N - 1, 2) [m]
        length = np.hypot(steps[:, 0], steps[:, 1]).sum()
        x, y = path[-1]
        print(f"{name}: {length:.2f} m, ends at x {x:.3f} m, y {y:.3f} m")
    print(options.output)


def _paths(sources: List[str]) -> Dict[str, np.ndarray]:
    """Return the paths (N, 2) [m] of all sources by name; a source is the name of a bag or of a topic.

    Paths of bags come first, so that a path that is measured now is drawn over them. The name of a path is
    its topic. If an earlier path has the same topic, the name also says the source.

    Raises:
        HuskyError: a bag cannot be read, or a topic had no message.
    """
    files = [source for source in sources if source.endswith(".bag")]
    topics = [source for source in sources if source not in files]
    # each pair has the words for an origin, "of run.bag" or "now", and the paths from there, by their topics
    measured: List[Tuple[str, Dict[str, Points]]] = []
    for file in files:
        measured.append((f"of {file}", paths_of_bag(Path(file))))
    if topics:
        measured.append(("now", paths_of_topics(topics)))
    paths: Dict[str, np.ndarray] = {}
    for origin, paths_by_topic in measured:
        for topic, path in paths_by_topic.items():
            if not path:
                raise HuskyError(f"no message arrived on {topic}")
            # such as "/odom" for the first path of this topic, and "/odom of run.bag" for a later one
            name = f"{topic} {origin}" if topic in paths else topic
            paths[name] = np.array(path)
    return paths
