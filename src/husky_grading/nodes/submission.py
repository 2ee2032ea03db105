"""Program that starts a submission's launch file or node as roslaunch would, but no simulator and no window.

It runs in the submission's environment, where a submitted package may shadow ours, so it imports nothing of
our package. It writes events to a file, one JSON object per line, such as missing packages and ends of nodes.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import shlex
import shutil
import signal
import sys
from pathlib import Path
from typing import Any, Dict, List, NamedTuple, Optional, Set
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

# roslaunch imports distutils. Without these lines, this import would load setuptools, which takes long.
if sys.version_info < (3, 12):
    with contextlib.suppress(ImportError, AttributeError):
        import _distutils_hack

        _distutils_hack.remove_shim()

import roslaunch
import roslaunch.launch
import roslaunch.parent
import roslaunch.pmon
import roslaunch.rlutil
import roslaunch.xmlloader
import roslib.packages
import yaml
from rospkg import ResourceNotFound, RosPack, rospack

# nodes of these packages are not started: they belong to the simulator or the robot, which `grade` starts
# itself, or they need a user
SIMULATION = {
    "gazebo_ros", "husky_gazebo", "husky_control", "husky_description", "husky_navigation", "husky_viz",
    "smb_gazebo", "smb_control", "smb_description", "robot_state_publisher", "joint_state_publisher",
    "joint_state_publisher_gui", "controller_manager", "twist_mux", "robot_localization",
    "interactive_marker_twist_server", "joy", "pointcloud_to_laserscan", "teleop_twist_joy",
    "teleop_twist_keyboard",
}  # fmt: skip
# a launch-prefix with one of these programs is dropped, because the program needs a screen or a keyboard
INTERACTIVE = {
    "gnome-terminal", "xterm", "konsole", "x-terminal-emulator", "terminator", "xfce4-terminal", "lxterminal",
    "urxvt", "gdb", "lldb", "cuda-gdb", "ddd", "screen", "tmux",
}  # fmt: skip
OWN_PACKAGE = "husky_highlevel_controller"  # name of this package, which is also the name of many submissions
PILLAR = re.compile(r"single_?pillar", re.IGNORECASE)  # pattern of the name of the world that the course uses
LOAD_DEADLINE = 30  # [s] a launch file that loads longer than this wall time counts as broken
MAX_FILES = 1000  # a launch file with more includes counts as broken
# parameters of a launch file that are not set, because `grade` sets them itself
OUR_PARAMETERS = {"/use_sim_time", "/robot_description", "/rosdistro", "/rosversion", "/run_id"}


class OwnNames(NamedTuple):
    """Names and paths of our package; `grade` gives them, because this program cannot import the package."""

    nodes: List[str]  # names of the simulator's nodes; no other node may have such a name
    rviz: List[str]  # names of the RViz nodes in our launch files
    files: List[str]  # launch files that start the simulator
    # path of our package.xml, and then the folders of our programs; empty if our own nodes may be started
    places: List[str]
    # packages of ROS whose nodes count as the student's, and are started: in exercise 4, robot_localization
    by_submission: List[str]
    by_marking: List[str]  # packages whose nodes are not started, because `grade` starts them itself


class Reporter(roslaunch.pmon.ProcessListener):
    """Writes events to a file, which `grade` reads; roslaunch calls it when a node ends."""

    def __init__(self, path: str) -> None:
        self._file = open(path, "a", buffering=1)  # noqa: SIM115 - open as long as the process runs
        self.packages: Dict[str, str] = {}  # package of each node, by the name of the node

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def write(self, event: str, **details: Any) -> None:
        """Write an event."""
        self._file.write(json.dumps({"event": event, **details}) + "\n")

    def process_died(self, process_name: str, exit_code: Optional[int]) -> None:
        """Write an event on the end of a node; roslaunch calls this."""
        node = process_name.rsplit("-", 1)[0]
        self.write("died", node=node, exit_code=exit_code, package=self.packages.get(node, ""))


class MissingIncludeError(Exception):
    """A launch file includes a file that does not exist."""


class TolerantLoader(roslaunch.xmlloader.XmlLoader):
    """Reads a launch file, and leaves out tags that need a package that does not exist."""

    def __init__(self, reporter: Reporter, simulator_files: List[str]) -> None:
        """Make a loader that has read no file yet.

        Args:
            reporter: writes an event on each tag that is left out.
            simulator_files: paths of the simulator's launch files in their packages; an <include> of one is
                left out.
        """
        super().__init__()
        # set here, because some versions of roslaunch set this attribute only in roslaunch-check
        self.ignore_unset_args = False
        self._reporter = reporter
        self._simulator_files = simulator_files
        self._included_count = 0  # number of included files, at most MAX_FILES
        self.uses: Set[str] = set()  # packages that the launch file names in $(find ...)
        self.names_pillar_world = False  # true if the launch file names the world that the course uses

    def resolve_args(self, args: Any, context: Any) -> Any:
        """Keep the packages and worlds that an attribute names; roslaunch calls this for each attribute."""
        self.uses.update(re.findall(r"\$\(find +([^)]+?) *\)", args or ""))
        value = super().resolve_args(args, context)
        if PILLAR.search(str(value)):
            self.names_pillar_world = True
        return value

    def _load_as_roslaunch(self, tag_name: str, *arguments: Any, **options: Any) -> Any:
        """Load a tag as roslaunch would, but leave it out if it needs a package that does not exist.

        roslaunch loads a tag such as <node> by its method `_node_tag`. The methods of this name below call
        this function. A tag that is left out is reported, and the result is None.
        """
        try:
            return getattr(super(), f"_{tag_name}_tag")(*arguments, **options)
        except ResourceNotFound as error:
            self._report_missing(tag_name, error)
            return None

    def _report_missing(self, tag_name: str, error: ResourceNotFound) -> str:
        """Write an event on a tag that needs a missing package, and return the package's name."""
        # the text of the error contains $(find PACKAGE), or begins with the name of the package
        match = re.search(r"\$\(find +([^)]+)\)", str(error))
        package = match.group(1).strip() if match else str(error).split()[0].strip("':,")
        # a missing package of a simulator is not a fault, because `grade` starts the simulator itself
        event = "left_out" if package in SIMULATION or "gazebo" in package else "missing"
        self._reporter.write(event, package=package, tag=tag_name)
        return package

    def _include_tag(self, tag: Any, context: Any, *arguments: Any) -> Any:
        """Load an <include>, or leave it out if it would start a simulator; roslaunch calls this.

        A launch file that starts the simulator, such as that of husky_gazebo, is left out, because marking
        starts the simulator itself. Other launch files of the simulator's packages are loaded, but a fault in
        one of them is only reported.

        Raises:
            MissingIncludeError: the included file does not exist.
            ValueError: more than MAX_FILES files are included.
            TimeoutError: the launch files take longer than LOAD_DEADLINE.
        """
        self._included_count += 1
        if self._included_count > MAX_FILES:
            raise ValueError(f"more than {MAX_FILES} files are included")
        # The arguments of an include may name packages, or the world of the course. `resolve_args` keeps
        # these names, so it is called even if the include is left out later.
        for argument in tag.getElementsByTagName("arg"):
            with contextlib.suppress(Exception):
                self.resolve_args(argument.getAttribute("value"), context)
        # Most files are given as $(find PACKAGE)/PATH. Without $(find ...), the package is not known.
        match = re.match(r"\$\(find +([^)]+?) *\)/+(.*)", tag.getAttribute("file"))
        package, place = match.groups() if match else ("", tag.getAttribute("file"))
        is_of_simulator = package in SIMULATION  # the file belongs to a package of the simulator or robot
        if is_of_simulator and place in self._simulator_files:  # our simulator takes its place
            self._reporter.write("left_out", package=package, tag="include")
            return None
        # name of the file for the student, without folders of this machine
        shown = f"{package}/{place}" if package else os.path.basename(place)
        try:
            return self._load_as_roslaunch("include", tag, context, *arguments)
        except TimeoutError:  # the time is up for all files together, so loading ends
            raise
        except Exception as error:
            # a fault in a launch file of the simulator does no harm, because `grade` starts the simulator
            # itself
            if is_of_simulator:
                self._reporter.write("skipped", path=shown, error=_one_line(error))
                return None
            if self._is_missing(tag, context):
                raise MissingIncludeError(shown) from error
            raise

    def _is_missing(self, tag: Any, context: Any) -> bool:
        """Return whether the file of an <include> does not exist; False if its name cannot be resolved."""
        with contextlib.suppress(Exception):
            return not os.path.isfile(super().resolve_args(tag.getAttribute("file"), context))
        return False

    def _rosparam_tag(self, *arguments: Any, **options: Any) -> Any:
        """Load a <rosparam>, or leave it out if it needs a missing package; roslaunch calls this."""
        return self._load_as_roslaunch("rosparam", *arguments, **options)

    def _node_tag(self, *arguments: Any, **options: Any) -> Any:
        """Load a <node>, or leave it out if it needs a missing package; roslaunch calls this."""
        return self._load_as_roslaunch("node", *arguments, **options)

    def _param_tag(self, tag: Any, *arguments: Any, **options: Any) -> Any:
        """Load a <param>, or leave it out if it needs a missing package; roslaunch calls this.

        Two parameters are always left out, because a launch file may set them by a command that this machine
        does not have. `grade` sets the robot_description itself, and other_simulator only looks for a running
        simulator.
        """
        if tag.getAttribute("name").lstrip("/") in ("robot_description", "other_simulator"):
            return None
        return self._load_as_roslaunch("param", tag, *arguments, **options)

    def _arg_tag(self, tag: Any, context: Any, *arguments: Any, **options: Any) -> Any:
        """Load an <arg>, and give it a path that does not exist if its value needs a missing package.

        roslaunch calls this. Without a value, roslaunch would reject each tag that uses the argument.
        """
        try:
            return super()._arg_tag(tag, context, *arguments, **options)
        except ResourceNotFound as error:
            package = self._report_missing("arg", error)
            context.add_arg(tag.getAttribute("name"), default=f"/missing/{package}")
            return None


def tolerant_manifest(element: Any, file: str) -> Any:
    """Return the ElementTree of a package.xml, or of an empty manifest if the file cannot be read.

    rospkg would otherwise stop at a broken package.xml, and find no package in the whole folder.
    """
    try:
        return ElementTree.ElementTree(element, file)
    except (OSError, ElementTree.ParseError):
        return ElementTree.ElementTree(ElementTree.fromstring("<package><name/></package>"))


def refuse_aliases() -> None:
    """Let YAML reject aliases in parameter files, because a few aliases can expand to billions of values."""
    compose_node = yaml.SafeLoader.compose_node

    # takes the place of the method `compose_node`, with which YAML reads each value
    def compose_plain(loader: Any, parent: Any, index: Any) -> Any:
        """Reject an alias, and read any other value as before."""
        if loader.check_event(yaml.AliasEvent):
            problem = "YAML aliases are not allowed; write the value out"
            raise yaml.composer.ComposerError(None, None, problem, loader.peek_event().start_mark)
        return compose_node(loader, parent, index)

    yaml.SafeLoader.compose_node = compose_plain


def load_launchable(
    launchable: List[str], reporter: Reporter, ours: OwnNames
) -> roslaunch.config.ROSLaunchConfig:
    """Read a launch file or node, write the event "plan", and return the configuration of the nodes to start.

    Nodes that marking starts itself, such as the simulator, are left out. RViz is left out, too, because only
    its configuration file is graded.

    Args:
        launchable: `--launch PACKAGE FILE [ARGUMENTS]` or `--node PACKAGE TYPE [ARGUMENTS]`.
            FILE is a name in the package, or an absolute path.
        reporter: writes events.
        ours: names and paths of our package.
    """
    loader = TolerantLoader(reporter, ours.files)
    config = read_launchable(launchable, reporter, loader)
    nodes = sort_nodes([node for node in config.nodes if node.package != "rviz"], reporter, ours)
    rviz = graded_rviz([node for node in config.nodes if node.package == "rviz"], ours)
    config.nodes = nodes.to_start
    # when a node ends, `reporter` writes an event with the package of the node
    reporter.packages = {node.name: node.package for node in nodes.to_start}
    config.tests = []  # drop the nodes in <test> tags, because only rostest starts them
    for name in OUR_PARAMETERS & set(config.params):
        del config.params[name]
    # a launch file that clears all parameters below "/" would also delete the parameters of the simulator
    config.clear_params = [name for name in config.clear_params if name != "/"]
    plan = {
        "nodes": [f"{node.package}/{node.type}" for node in nodes.to_start],
        "left_out": sorted(set(nodes.left_out)),
        "left_out_arguments": nodes.left_out_arguments,
        "rviz": rviz,
        "uses": sorted({*loader.uses, *(node.package for node in nodes.to_start)}),
        "digest": digest_of(config),  # two launch files with the same hash start the same programs
        "pillar": loader.names_pillar_world,
    }
    reporter.write("plan", plan=plan)
    return config


def read_launchable(
    launchable: List[str], reporter: Reporter, loader: TolerantLoader
) -> roslaunch.config.ROSLaunchConfig:
    """Let roslaunch read a launch file or node, and return the configuration of all its nodes and parameters.

    Nothing is started. The event "package" tells `grade` the folder of the package.
    """
    config = roslaunch.config.ROSLaunchConfig()
    kind, package, name, *arguments = launchable
    # `grade` needs the folder of the package. There is no folder if a launch file is given by its path and is
    # not in a package.
    with contextlib.suppress(ResourceNotFound):
        reporter.write("package", path=RosPack().get_path(package))
    if kind == "--node":  # a single node is put into a launch file, so the loader reads it, too
        text = f"<launch><node name={quoteattr(Path(name).stem)} pkg={quoteattr(package)} "
        text += f'type={quoteattr(name)} args={quoteattr(" ".join(arguments))} output="screen"/></launch>'
        loader.load_string(text, config, verbose=False)
    else:
        file = name  # absolute path, or the name of a file in the package
        if not os.path.isabs(name):
            file, *_ = roslaunch.rlutil.resolve_launch_arguments([package, name])
        loader.load(file, config, argv=["roslaunch", *arguments], verbose=False)
    config.assign_machines()
    return config


class SortedNodes(NamedTuple):
    """Nodes of a launch file by their use, without RViz."""

    to_start: List[Any]  # nodes of the submission, which will be started
    # package/type of each node that is not started, because it does not belong to the submission
    left_out: List[str]
    # package/type and arguments of each node that `grade` starts in place of the submission, or that needs a
    # user; exercise 4 finds in them the bag that the launch file plays
    left_out_arguments: List[List[str]]


def is_started_by_marking_or_user(node: Any, ours: OwnNames) -> bool:
    """Return whether a node is left out because marking starts it itself, or because it needs a user."""
    # some packages of SIMULATION are the student's work in one exercise, so their nodes are not left out
    left_out = SIMULATION - set(ours.by_submission)
    return (
        node.package in left_out
        or node.package in ours.by_marking
        or node.package.startswith("rqt")  # a program with a window
        # ROS would end the simulator's node if another node with the same name started
        or node.namespace + node.name in ours.nodes
    )


def sort_nodes(nodes: List[Any], reporter: Reporter, ours: OwnNames) -> SortedNodes:
    """Sort the nodes of a launch file into the submission's nodes, and nodes that are not started.

    The event "own" is written for each node of the grading package. The submission's nodes are changed: they
    will print into the output of this program, and run without a terminal or debugger.

    Args:
        nodes: nodes of the launch file, as roslaunch gives them, without RViz.
        reporter: gets the events.
        ours: names and paths of our package.
    """
    result = SortedNodes(to_start=[], left_out=[], left_out_arguments=[])
    for node in nodes:
        program = f"{node.package}/{node.type}"
        if is_started_by_marking_or_user(node, ours):
            result.left_out.append(program)
            result.left_out_arguments.append([program, node.args or ""])
        elif is_our_program(node, ours.places):  # no submission may use it, so the student gets a note
            result.left_out.append(program)
            reporter.write("own", node=program)
        else:
            node.output = "screen"  # otherwise roslaunch would write the output into a log file of its own
            drop_prefix(node, reporter)
            result.to_start.append(node)
    return result


def graded_rviz(rviz_nodes: List[Any], ours: OwnNames) -> List[Dict[str, Any]]:
    """Return name, arguments and remaps of the RViz nodes whose configuration files are graded.

    The arguments name the file. RViz nodes of our launch files are returned only if there are no others.
    """
    nodes_of_submission = [node for node in rviz_nodes if node.name not in ours.rviz]
    return [
        {"name": node.name, "args": node.args, "remap": [list(remap) for remap in node.remap_args]}
        for node in nodes_of_submission or rviz_nodes
    ]


def digest_of(config: roslaunch.config.ROSLaunchConfig) -> str:
    """Return a hash of nodes and parameters; two launch files with the same hash start the same programs."""
    nodes = [(node.package, node.type, node.namespace, node.args, node.remap_args) for node in config.nodes]
    parameters = [(name, config.params[name].value) for name in sorted(config.params)]
    return hashlib.sha256(repr((sorted(map(repr, nodes)), parameters)).encode()).hexdigest()


def is_our_program(node: Any, places: List[str]) -> bool:
    """Return whether a node belongs to the grading package, and not to a submitted package of the same name.

    Args:
        node: node of a launch file.
        places: path of the grading package's package.xml, and then the folders of its programs. If the list
            is empty, nodes of the grading package may be started, and the result is False.
    """
    if not places or node.package != OWN_PACKAGE:
        return False
    our_manifest, *our_folders = places
    with contextlib.suppress(ResourceNotFound):
        # if several packages have this name, ROS finds one of them
        manifest = os.path.join(RosPack().get_path(node.package), "package.xml")
        if os.path.realpath(manifest) == our_manifest:
            return True
    # ROS finds the submission's package. If this package has no such program, roslaunch takes the program of
    # another package with the same name, perhaps of ours. If there are several programs, it starts the first.
    programs = roslib.packages.find_node(node.package, node.type)
    return bool(programs) and os.path.dirname(os.path.realpath(programs[0])) in our_folders


def drop_prefix(node: Any, reporter: Reporter) -> None:
    """Drop a launch-prefix that is a terminal or debugger, or that is not installed.

    With such a launch-prefix, roslaunch would not start the node.
    """
    if not node.launch_prefix:
        return
    try:
        words = shlex.split(node.launch_prefix)
    except ValueError:  # a quote in the launch-prefix is not closed
        words = [node.launch_prefix]
    program = words[0] if words else ""
    if program and (os.path.basename(program) in INTERACTIVE or shutil.which(program) is None):
        reporter.write("prefix", node=node.name, prefix=node.launch_prefix)
        node.launch_prefix = None


def run_in_valgrind(nodes: List[Any], folder: str) -> None:
    """Let the nodes that are compiled programs run in valgrind, with a log of each process in a folder.

    Scripts, such as Python nodes, run as usual.
    """
    log = os.path.join(folder, "memcheck.%p")  # valgrind replaces %p by the process id
    valgrind = f"valgrind --track-origins=yes --num-callers=20 --log-file={shlex.quote(log)}"
    for node in nodes:
        paths = roslib.packages.find_node(node.package, node.type)
        # if there is no such program, an empty file is read in its place; roslaunch reports the program later
        with open(paths[0] if paths else os.devnull, "rb") as file:
            if file.read(4) == b"\x7fELF":  # compiled programs begin with these bytes, but scripts do not
                node.launch_prefix = valgrind


def tolerate_failed_nodes() -> None:
    """Let roslaunch continue if a node cannot be started, because otherwise it ends all nodes."""
    launch_node = roslaunch.launch.ROSLaunchRunner.launch_node

    def tolerant(runner: Any, node: Any, core: bool = False) -> Any:
        """Start a node as roslaunch would, but print an error and go on if it cannot be started."""
        try:
            return launch_node(runner, node, core)
        except (roslaunch.pmon.FatalProcessLaunch, ValueError) as error:
            # A ValueError means that a quote in `args` is not closed. `grade` finds this line in the output
            # and reports the node.
            print(f"ERROR: cannot launch node of type [{node.package}/{node.type}]: {error}", flush=True)
            return None, False  # no process, and not successful

    roslaunch.launch.ROSLaunchRunner.launch_node = tolerant


class Parent(roslaunch.parent.ROSLaunchParent):
    """Main process of roslaunch, which starts the nodes of a configuration that is already loaded."""

    def __init__(self, run_id: str, ready: roslaunch.config.ROSLaunchConfig, reporter: Reporter) -> None:
        super().__init__(
            run_id, roslaunch_files=[], local_only=True, process_listeners=[reporter], show_summary=False,
            sigint_timeout=2.0, sigterm_timeout=1.0,
        )  # fmt: skip
        self._ready = ready

    def _load_config(self) -> None:
        """Set the configuration; roslaunch calls this before it starts the nodes."""
        self.config = self._ready


def describe(launchable: List[str], reporter: Reporter, ours: OwnNames) -> Any:
    """Load a launch file or node, and return its configuration, or None if it cannot be loaded.

    The events say which nodes it would start, or why it cannot be loaded. For `launchable`, see
    `load_launchable`.
    """
    reporter.write("launchable")  # all events up to the next one of this kind are about this launchable
    # In the module `rospack`, `ElementTree` is the class that rospkg calls with the path of each package.xml.
    # Our function takes its place, so a broken package.xml does not hide other packages.
    rospack.ElementTree = tolerant_manifest
    signal.alarm(LOAD_DEADLINE)  # `_out_of_time` raises a TimeoutError after this time
    try:
        return load_launchable(launchable, reporter, ours)
    except MissingIncludeError as error:
        reporter.write("no_include", path=str(error))
        return None
    except Exception as error:  # a hostile launch file may raise any error
        reporter.write("unloadable", error=_one_line(error))
        return None
    finally:
        signal.alarm(0)


def _one_line(error: Exception) -> str:
    """Return the text of an error without line breaks, at most 500 characters of it."""
    return " ".join(str(error).split())[:500]


def _out_of_time(*_: Any) -> None:
    """End the loading of a launch file; Python calls this when the alarm of `describe` goes off."""
    raise TimeoutError(f"it could not be read within {LOAD_DEADLINE} s")


def main(arguments: List[str]) -> int:
    """Describe launchables, or start one and wait for its end, and return the exit code.

    Args:
        arguments: EVENTS ACTION OURS LAUNCHABLE... EVENTS is the file for events. ACTION is describe, run, or
            memcheck, which runs compiled programs in valgrind. OURS has the fields of `OwnNames`, as a JSON
            object. Each LAUNCHABLE is a launch file or node, as a JSON list, such as ["--launch", PACKAGE,
            FILE].
    """
    events, action, ours, *launchables = arguments
    # our launch files read this variable; without it, they would refuse to start because a simulator is
    # already running
    os.environ["HUSKY_SIMULATOR_IS_OURS"] = "1"
    reporter = Reporter(events)
    refuse_aliases()
    signal.signal(signal.SIGALRM, _out_of_time)
    # configuration of the last launchable (launch file or node); the actions `run` and `memcheck` get a
    # single one
    config = None
    for launchable in launchables:
        config = describe(json.loads(launchable), reporter, OwnNames(**json.loads(ours)))
    # without a launchable (launch file or node), the call only checks that this program can start
    if action == "describe" or config is None:
        has_failed = bool(launchables) and config is None  # the last launchable cannot be loaded
        return int(has_failed)
    if action == "memcheck":
        run_in_valgrind(config.nodes, os.path.dirname(events))
    # the original function may print control characters for the title of the terminal into the output
    roslaunch.rlutil.update_terminal_name = lambda *_: None
    tolerate_failed_nodes()
    with contextlib.suppress(KeyboardInterrupt):
        # the run id of the ROS master; True makes this call wait until the master answers
        run_id = roslaunch.rlutil.get_or_generate_uuid(None, True)
        parent = Parent(run_id, config, reporter)
        parent.start()
        parent.spin()
    return 0


if __name__ == "__main__":
    # `starter` lets runpy run this file, so argument 1 is the path of this file
    sys.exit(main(sys.argv[2:]))
