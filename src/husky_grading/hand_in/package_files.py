"""Facts from the files of a submission's package: its RViz configuration, and the robot that it names."""

from __future__ import annotations

import re
import shlex
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Dict, List, Match, NamedTuple, Optional, Pattern, Sequence, Tuple

from husky_grading.displays import ROBOT, SCAN, TF, RvizConfig, read_rviz_config
from husky_grading.isolation.files import (
    UnreadableFileError,
    is_below,
    is_regular,
    read_text,
    read_yaml,
    texts_in,
    walk,
)
from husky_grading.records import DEFAULT_ROBOT, ROBOT_TITLES, SMB
from husky_grading.submission import COPIES, NamedRobot, Plan, RvizNode
from husky_highlevel_controller.paths import share_folder

_COMMENT = re.compile(r"<!--.*?(?:-->|\Z)", re.DOTALL)
_ATTRIBUTE = re.compile(r"""\b(pkg|name|args)\s*=\s*["']([^"'<>]*)""")
# package of a node in a launch file
_NODE = re.compile(r"<node\b[^>]{0,500}?\spkg\s*=\s*[\"']([\w-]+)")


def find_rviz_config(planned: Plan, root: Optional[Path] = None, launch_file: str = "") -> RvizConfig:
    """Return the RViz configuration that is graded; if there is none, only `started` and `missing` are set.

    The first rviz node names the configuration. If this file was not handed in, or if the node names no file,
    a configuration in the package counts instead.

    Args:
        planned: plan of the submission, with its rviz nodes.
        root: workspace of the submission. The configuration must be in it, or in the folder COPIES next to
            it. None allows any folder.
        launch_file: path of the launch file that is started; empty for a node.
    """
    planned = _without_our_rviz_nodes(planned)
    # remaps of the rviz node: topic in the configuration, and topic that replaces it
    remaps: Sequence[Tuple[str, str]] = ()
    missing = ""  # path that the rviz node names, if this file was not handed in; otherwise empty
    if planned.rviz:
        node = planned.rviz[0]
        remaps = node.remap
        path = _config_path_in(node.args)
        if path is not None and _was_handed_in(path, root):
            return _read_config(f"its rviz node, {path.name}", path, remaps)
        missing = str(path or "")
    config = _config_in_package(planned, Path(launch_file).name, remaps)
    return config or RvizConfig(started=bool(planned.rviz), missing=missing)


def _was_handed_in(path: Path, root: Optional[Path]) -> bool:
    """Return whether a path leads to an existing file of the submission.

    The file must be in the workspace `root`, or in the folder COPIES next to it. COPIES has the copies of
    public packages, such as husky_gazebo, to which a student may have added the file. If `root` is None, the
    file may be in any folder.
    """
    is_in_submission = root is None or is_below(path, root) or is_below(path, root.with_name(COPIES))
    return is_in_submission and is_regular(path)


def _config_in_package(
    planned: Plan, launch_file: str, remaps: Sequence[Tuple[str, str]]
) -> Optional[RvizConfig]:
    """Return the best configuration in a package's .rviz files; None if no file counts.

    The best configuration displays most of frames, robot model and scan.

    `launch_file` is the name of the launch file that is started. It is empty for a node, and then all files
    count. Otherwise, a file that belongs to another launch file does not count, unless two conditions hold:

    - The started launch file starts RViz, and the package has no other .rviz file for this RViz.
    - The other launch file plays no recording (rosbag). An .rviz file for a recording is for exercise 4.
    """
    folder = planned.package_path
    if not folder:
        return None
    files = [path for path in walk(folder) if path.suffix == ".rviz"][:MAX_CONFIGS]
    if launch_file:
        # the other launch file to which an .rviz file belongs, by the name of the .rviz file
        owners = _owners_of_configs(folder, launch_file, starts_rviz=bool(planned.rviz))
        if planned.rviz and len(files) == 1:
            only_file = files[0]
            owner = owners.get(only_file.name)
            if owner and "rosbag" not in _NODE.findall(read_text(owner)):
                source = f"{only_file.name}, the package's only .rviz file, used by {owner.name}"
                return _read_config(source, only_file, remaps)
        files = [path for path in files if path.name not in owners]
    configs = [_read_config(path.name, path, remaps) for path in files]
    return max(configs, key=_count_needed_displays, default=None)


def _without_our_rviz_nodes(planned: Plan) -> Plan:
    """Return a plan without the rviz nodes whose configuration is a file of our package.

    A submission that includes our simulator.launch starts such a node. This configuration is not the
    student's work, so it must get no points. But if a teacher grades our own package, it counts.
    """
    share = share_folder()  # folder with the data of the package husky_highlevel_controller
    # package.xml is checked instead of its folder, because in the workspace of ./dev the folder of our
    # package has only links, which lead into `share`
    if planned.package_path and is_below(planned.package_path / "package.xml", share):
        return planned
    nodes_and_paths = [(node, _config_path_in(node.args)) for node in planned.rviz]
    students_nodes = [node for node, path in nodes_and_paths if not (path and is_below(path, share))]
    return replace(planned, rviz=tuple(students_nodes))


def _count_needed_displays(config: RvizConfig) -> int:
    """Return how many of the three displays TF, robot model and laser scan a configuration has."""
    return len({TF, ROBOT, SCAN} & {display.kind for display in config.displays})


def files_of_others(planned: Plan, launch_file: str) -> List[str]:
    """Return sentences that tell the student which .rviz files are not graded.

    These are the files that other launch files of the package name. But if the started launch file starts no
    RViz, a student may start a second launch file only for RViz. The files of such a launch file are graded,
    too.
    """
    folder = planned.package_path
    if not folder:
        return []
    owners = _owners_of_configs(folder, launch_file, starts_rviz=bool(planned.rviz))
    existing_names = {path.name for path in walk(folder)}
    return [
        f"{name} belongs to {owner.name}, so it is not graded"
        for name, owner in owners.items()
        if name in existing_names
    ]


def rviz_nodes_in(launch_file: Path, package: Path) -> Tuple[RvizNode, ...]:
    """Search the text of a launch file that roslaunch cannot load for its rviz nodes.

    So even a broken launch file can get points for its RViz configuration, which `args` of the node names.
    `package` is the package's folder, which has the name of the package.
    """
    try:
        text = _COMMENT.sub("", read_text(launch_file, MAX_FILE))
    except UnreadableFileError:
        return ()
    # roslaunch would replace $(find PACKAGE) by the path of the package, so this function does it
    find = re.compile(rf"\$\(find +{re.escape(package.name)} *\)")
    rviz_nodes = []
    for node in re.findall(r"<node\b([^<>]{0,2000})", text):
        attributes = dict(_ATTRIBUTE.findall(node))
        if attributes.get("pkg") == "rviz":
            # a function returns the path, because a text with a backslash would be changed by `sub`
            arguments = find.sub(lambda _: str(package), attributes.get("args", ""))
            rviz_nodes.append(RvizNode(attributes.get("name", "rviz"), arguments, remap=()))
    return tuple(rviz_nodes)


def _owners_of_configs(folder: Path, launch_file: str, starts_rviz: bool) -> Dict[str, Path]:
    """Find out which .rviz files of a package belong to other launch files than the started one.

    An .rviz file belongs to a launch file whose text contains the file's name. There is one exception. If the
    started launch file starts no RViz, a student may start a second launch file only for RViz: a launch file
    that plays no recordings and starts no node of the package. Its .rviz files then count as if they belonged
    to the started launch file.

    Args:
        folder: folder of the package.
        launch_file: name of the launch file that is started.
        starts_rviz: true if this launch file starts RViz.

    Returns:
        Path of the other launch file, by the name of the .rviz file.
    """
    owners: Dict[str, Path] = {}
    for path, text in texts_in(folder, {".launch"}, MAX_FILE):
        if path.name == launch_file:
            continue
        packages_of_nodes = set(_NODE.findall(text))
        # the folder of the package has the name of the package
        is_only_for_rviz = "rosbag" not in packages_of_nodes and folder.name not in packages_of_nodes
        if is_only_for_rviz and not starts_rviz:
            continue  # the student starts this launch file, too, to see RViz
        for name in re.findall(r"([\w.-]{1,200}\.rviz)\b", text):
            owners[name] = path
    return owners


def _config_path_in(arguments: str) -> Optional[Path]:
    """Return the path of the configuration that the arguments of an rviz node name, or None.

    The path follows the option -d. Without this option, RViz takes an argument that ends with .rviz.
    """
    try:
        options = shlex.split(arguments)
    except ValueError:  # the arguments have an opening quote without a closing quote
        options = arguments.replace('"', " ").replace("'", " ").split()
    for flag, value in zip(options, options[1:]):  # each option with the one that follows
        if flag in ("-d", "--display-config"):
            return Path(value)
    for option in options:
        if option.endswith(".rviz"):
            return Path(option)
    return None


def _read_config(source: str, path: Path, remaps: Sequence[Tuple[str, str]]) -> RvizConfig:
    """Read an .rviz file, and return its configuration; a broken file has a `problem`.

    `source` names the file for the student. `remaps` are pairs of a topic in the file, and its replacement.
    """
    try:
        return read_rviz_config(source, read_yaml(path), remaps)
    except (UnreadableFileError, ValueError, OverflowError):
        # a number with hundreds of digits raises OverflowError. The content {} is not a configuration of
        # RViz, so the result has a `problem`.
        return read_rviz_config(source, {})


MAX_CONFIGS = 20  # at most this number of .rviz files of a package is read
MAX_FILE = 1_000_000  # [bytes] larger launch files are not read
MAX_TEXT = 200_000  # [bytes] larger files are not searched for the name of a robot
# names of a package, a frame and topics of the SMB; a student's package that contains one of them is for the
# SMB. In an .rviz file, the key `rslidar` does not count, because RViz writes a key for every frame that it
# has seen.
SMB_NAMES = re.compile(r"\bsmb_gazebo\b|\brslidar\b(?!:[ \t]*\n)|/?\brslidar_points\b|/imu0\b")
# patterns of the topics of scans; a package that names only /scan is for the Husky of ROS Melodic
FRONT_SCAN, PLAIN_SCAN = re.compile(r"\bfront/scan\b"), re.compile(r"(?<![\w/])/scan\b")
# suffixes of files in which a submission names its robot; scripts may have no suffix
TEXTS = {"", ".launch", ".xml", ".py", ".cpp", ".cc", ".hpp", ".h", ".yaml", ".yml", ".rviz"}


def named_robot(planned: Plan) -> NamedRobot:
    """Return the robot for which a submission seems to be written, by the nodes and topics that it names.

    Nodes of the SMB's own packages decide first, then names of the SMB in files, then a topic of scans. The
    result is certain only for the SMB. If it is one of the two versions of the Husky, `grade` may still
    choose the other version, when it sees the topic of scans to which the submission subscribes.
    """
    # `left_out` has nodes that `grade` does not start, such as those of the robot
    if any(node.startswith(("smb_gazebo/", "smb_control/")) for node in planned.left_out):
        version, reason = SMB, "its launch file starts the SMB's nodes"
    else:
        version, mention = _robot_in_files(planned)
        if mention is None:  # no file names a robot, so `version` is DEFAULT_ROBOT
            reason = "its package names no topic of scans"
        else:
            reason = f"{mention.path.name} names {mention.match.group()}"
    sentence = f"the simulated robot is the {ROBOT_TITLES[version]}: {reason}"
    return NamedRobot(version, sentence, is_certain=version == SMB)


def _robot_in_files(planned: Plan) -> Tuple[str, Optional[Mention]]:
    """Return the robot that a package's files name, and where; without a name, DEFAULT_ROBOT and None."""
    if mention := first_mention(planned, SMB_NAMES):
        return SMB, mention
    # front/scan comes first, because a package that names both topics may publish /scan itself, for example
    # as the output of a filter
    if mention := first_mention(planned, FRONT_SCAN):
        return DEFAULT_ROBOT, mention
    # the Husky of ROS Melodic publishes its scans on /scan, and the Husky of ROS Noetic on /front/scan
    if mention := first_mention(planned, PLAIN_SCAN):
        return "husky_melodic", mention
    return DEFAULT_ROBOT, None


class Mention(NamedTuple):
    """Place at which a submission names something."""

    path: Path  # file
    match: Match[str]


def first_mention(planned: Plan, pattern: Pattern[str]) -> Optional[Mention]:
    """Search the files of a submission's package for a pattern, and return the first match and its file."""
    folder = planned.package_path
    if not folder:
        return None
    with suppress(UnreadableFileError):  # too many files
        for path, text in texts_in(folder, TEXTS, MAX_TEXT):
            match = pattern.search(text)
            if match:
                return Mention(path, match)
    return None
