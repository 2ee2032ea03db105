"""`./dev launch`: roslaunch that checks the arguments first and exits with 1 when a required node failed.

Usage: launch.py [PACKAGE] FILE.launch [name:=value ...] [options of roslaunch]. FILE without PACKAGE is a
launch file of this package or a path.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import shutil
import signal
import socket
import sys
import threading
from pathlib import Path
from typing import Any, Dict, List, Optional, Set, Tuple

if sys.version_info < (3, 12):  # rosclean imports distutils; Python's own is faster than setuptools'
    with contextlib.suppress(ImportError, AttributeError):
        import _distutils_hack

        _distutils_hack.remove_shim()

import find_packages
import gazebo_packages
import rosgraph.names
import rosgraph.network
import roslaunch
import roslaunch.core
import roslaunch.launch
import roslaunch.nodeprocess
import roslaunch.parent
import roslaunch.pmon
import rospkg
from find_packages import PACKAGE, PACKAGE_FOLDER
from launch_arguments import Arguments, check_arguments, refuse
from launch_output import FoldedOutput
from roslaunch import substitution_args

from husky_highlevel_controller.ros.restart import display_problem

MASTER_TIMEOUT = 3.0  # [s] wall time for a connection to a master elsewhere
GAZEBO_MESSAGES = "share/gazebo_msgs/python"  # end of the path to the messages of compat/gazebo_msgs
# names of this package's RViz nodes: the view of the robot, and the replacement of Gazebo's window
OWN_RVIZ, GAZEBO_WINDOW = "husky_rviz", "gazebo_gui"
# programs that open a window of their own around a node, as in launch-prefix="xterm -e"
TERMINALS = {
    "xterm",
    "gnome-terminal",
    "konsole",
    "xfce4-terminal",
    "terminator",
    "x-terminal-emulator",
    "urxvt",
}


def say(sentence: str) -> None:
    """Print a sentence in the way of ./dev."""
    print(f"[dev] {sentence}", file=sys.stderr, flush=True)


def find_launch_file(words: List[str]) -> Tuple[Path, List[str]]:
    """Return the launch file with which a command line begins, [PACKAGE] FILE.launch, and the other words."""
    name, *others = words
    if not name.endswith(".launch") and others and others[0].endswith(".launch"):
        package, name, *others = words
        found = find_packages.find_file(package, name, Path.cwd())
        if found is None:
            places = ", ".join(map(str, (*find_packages.places(Path.cwd()), find_packages.NEIGHBOURHOOD)))
            raise SystemExit(
                f"[dev] error: cannot find {name} of the package '{package}' in {places}, ROS_PACKAGE_PATH. "
                f"Run ./dev launch PATH/{name}"
            )
        return found, others
    own = PACKAGE_FOLDER / "launch" / name
    # a file in the caller's folder comes first, as in roslaunch; a student's file may have a name of ours
    path = Path(name)
    if not path.is_file() and "/" not in name and own.is_file():
        path = own
    if not path.is_file():
        known = ", ".join(sorted(file.name for file in (PACKAGE_FOLDER / "launch").glob("*.launch")))
        raise SystemExit(f"[dev] error: cannot find the launch file '{name}'; this package has {known}")
    return path.absolute(), others


def check_master() -> None:
    """Refuse a ROS_MASTER_URI with a wrong form, an unknown host, or another machine without a master.

    With such an address, roslaunch would raise an exception.
    """
    uri = rosgraph.get_master_uri()
    address = re.fullmatch(r"http://([^:/]+):(\d+)/?", uri)
    if address is None:
        raise SystemExit(f"[dev] error: ROS_MASTER_URI='{uri}' is not of the form http://HOST:PORT")
    host = address[1]
    try:
        socket.getaddrinfo(host, None)
    except OSError:
        problem = f"the host '{host}' of ROS_MASTER_URI has no address on this machine; add it to /etc/hosts"
        raise SystemExit(f"[dev] error: {problem}") from None
    if not rosgraph.network.is_local_address(host):
        socket.setdefaulttimeout(MASTER_TIMEOUT)
        online = rosgraph.is_master_online()
        socket.setdefaulttimeout(None)
        if not online:
            raise SystemExit(f"[dev] error: no ROS master answers at {uri}. Start roscore on '{host}'")


def check_display() -> None:
    """Run headless if DISPLAY names a display that does not answer."""
    problem = display_problem(os.environ.get("DISPLAY", ""))
    if problem:
        say(f"warning: {problem}; running headless, without RViz")
        del os.environ["DISPLAY"]


def check_quotes(config: Any) -> None:
    """Refuse a node whose command line has an open quote; roslaunch would end in a traceback."""
    for node in config.nodes:
        for attribute, text in (("launch-prefix", node.launch_prefix), ("args", node.args)):
            try:
                shlex.split(text or "")
            except ValueError:
                problem = (
                    f"node {node.name}: {attribute} = {text!r} has an open quote or a backslash at its end"
                )
                raise SystemExit(f"[dev] error: {problem}") from None


def drop_missing_terminals(config: Any) -> None:
    """Drop a node's launch-prefix if its program is not installed, or is a terminal without a display."""
    for node in config.nodes:
        words = shlex.split(node.launch_prefix or "")
        if not words:
            continue
        program = words[0]
        if shutil.which(program) is None:
            why = "is not installed"
        elif Path(program).name in TERMINALS and not os.environ.get("DISPLAY"):
            why = "has no display"
        else:
            continue
        prefix = f"launch-prefix '{node.launch_prefix}'"
        say(f"warning: node {node.name} starts without {prefix} because {program} {why}")
        node.launch_prefix = None


def drop_missing_rviz(config: Any) -> None:
    """Start no RViz without a display, or if it is not installed; Debian forky's archive lacks it."""
    others = [node for node in config.nodes if node.package != "rviz"]
    has_rviz_node = len(others) < len(config.nodes)
    if has_rviz_node and "rviz" not in rospkg.RosPack().list():
        say("warning: RViz is not installed; web:=true shows the robot in a browser")
        config.nodes = others
    if not os.environ.get("DISPLAY"):
        config.nodes = others


def check_integers(config: Any) -> None:
    """Refuse whole numbers that the parameter server cannot take; roslaunch would end in a traceback."""
    for param in config.params.values():
        if isinstance(param.value, int) and not -(2**31) <= param.value < 2**31:
            value = str(param.value)
            if len(value) > 20:
                value = f"{value[:20]}... ({len(value)} digits)"
            raise SystemExit(
                f"[dev] error: {param.key} = {value} does not fit into the 32 bits of a parameter"
            )


def hide_own_package() -> None:
    """Take this package's workspace out of the environment, because another package has its name.

    The messages of compat/gazebo_msgs stay, at the end, because only this workspace has them.
    """
    own = str(PACKAGE_FOLDER / ".dev")
    for variable in ("ROS_PACKAGE_PATH", "CMAKE_PREFIX_PATH", "PYTHONPATH"):
        paths = os.environ.get(variable, "").split(os.pathsep)
        messages = [path for path in paths if path.endswith(GAZEBO_MESSAGES)]
        others = [path for path in paths if path and not path.startswith(own)]
        os.environ[variable] = os.pathsep.join([*others, *messages])


def find_packages_for(file: Path) -> Path:
    """Let roslaunch find the package of a launch file, its neighbours, and stand-ins for Gazebo's packages.

    Returns:
        The launch file, or its stand-in.
    """
    folder = file.resolve().parent
    package = find_packages.package_around(folder)
    if package == PACKAGE_FOLDER:  # roslaunch finds this package in the workspace of ./dev
        package = None
    if PACKAGE_FOLDER not in folder.parents:
        find_packages.source_workspace(folder)
    if package and find_packages.name_of(package) == PACKAGE:
        hide_own_package()
    paths = gazebo_packages.package_paths()
    if package:
        paths.insert(0, str(package))
    if folder != PACKAGE_FOLDER / "launch":  # this package's own launch files need no package of a person
        paths = find_packages.add_packages(paths, folder, Path.cwd())
    joined = gazebo_packages.join_copies(paths)
    os.environ["ROS_PACKAGE_PATH"] = os.pathsep.join(gazebo_packages.package_path(paths, joined.values()))
    prefer_joined(joined)
    return replacement_of(file, package, joined)


def prefer_joined(joined: Dict[str, Path]) -> None:
    """Let $(find ...) in launch files find a joined package, and not a built copy of the same name."""
    find_resource = substitution_args._find_resource

    def find(resolved: str, command: str, arguments: List[str], *others: Any, **named: Any) -> str:
        """Find a file or program of a package, in place of roslaunch's own function."""
        # roslaunch would find a built copy before the joined package; after this error it searches
        # ROS_PACKAGE_PATH, where the joined package is the first
        if arguments[0] in joined:
            raise substitution_args.SubstitutionException("joined with a stand-in")
        return str(find_resource(resolved, command, arguments, *others, **named))

    substitution_args._find_resource = find


def replacement_of(file: Path, package: Optional[Path], joined: Dict[str, Path]) -> Path:
    """Return the stand-in of a launch file that needs Gazebo, otherwise the file itself.

    `joined` has the folders of the packages that were joined with ours, by name, see `join_copies`.
    """
    if package is None:
        return file
    name = find_packages.name_of(package)
    if name not in joined:
        return file
    stand_in = joined[name] / file.resolve().relative_to(package)
    # a link to the file itself is there because our package has no launch file of this name
    if not stand_in.is_file() or stand_in.resolve() == file.resolve():
        return file
    ours = gazebo_packages.COMPAT / name / file.resolve().relative_to(package)
    # a stand-in that is not a link has values of the file, see `keep_world_and_pose`
    kept = "" if stand_in.is_symlink() else ", and keeps its world and pose"
    say(f"warning: {file} needs Gazebo, so {ours} replaces it{kept}")
    return stand_in


def starts_robot(node: Any) -> bool:
    """Return whether a node is a stand-in that starts this package's simulator."""
    if node.type == "spawn_husky":
        return True
    # Gazebo's program that adds a model to the world; a robot is given to this program as a URDF
    return (node.package, node.type) == ("gazebo_ros", "spawn_model") and "-urdf" in node.args


def adapt(config: Any, file: Path, arguments: Arguments) -> None:
    """Change the nodes of a launch file that was written for Gazebo and a desktop, so that they start here.

    Arguments for the simulator take effect. Programs that cannot run are left out. If the file has a view of
    its own in RViz, this package's view is left out.
    """
    check_integers(config)
    check_quotes(config)
    robots = [node for node in config.nodes if starts_robot(node)]
    for name in arguments.for_simulator:
        if not robots:  # no node starts the simulator, so nothing takes the simulator's arguments
            refuse(file, name, takes=arguments.known, candidates=arguments.known)
    if is_true(arguments.for_simulator.get("exit_on_arrival", "false")):
        for node in robots:
            node.required = True  # the node ends at the arrival, and ends the launch
    if not is_true(arguments.for_simulator.get("rviz", "true")):
        config.nodes = [n for n in config.nodes if n.package != "rviz" or n.name == GAZEBO_WINDOW]
    drop_missing_terminals(config)
    drop_missing_rviz(config)
    programs = {(node.package, node.type) for node in config.nodes}
    has_world = "/gazebo_world/world_name" in config.params or ("gazebo_ros", "gzserver") in programs
    for node in config.nodes:
        if (node.package, node.type) == ("gazebo_ros", "spawn_model"):
            # the node prints why it refuses a model; if the model is a robot, the simulator takes its place
            node.output = "screen"
    if has_world and not robots:
        say("warning: the launch file has a world but no robot; add husky_gazebo/launch/spawn_husky.launch")
    if any(node.package == "rviz" and node.name not in (OWN_RVIZ, GAZEBO_WINDOW) for node in config.nodes):
        config.nodes = [node for node in config.nodes if node.name != OWN_RVIZ]  # the file has its own view


def warn_of_dependencies(config: Any, file: Path) -> None:
    """Warn if a person's package in the launch depends on a package that is missing here."""
    folder = find_packages.package_around(file.resolve().parent)
    packages = rospkg.RosPack()
    names = {node.package for node in config.nodes} & set(packages.list())
    folders = [Path(packages.get_path(name)) for name in sorted(names)]
    if folder:
        folders.insert(0, folder)
    for sentence in find_packages.dependency_sentences(folders):
        say(f"warning: {sentence}")


def is_true(value: str) -> bool:
    """Return whether a value of an argument is true for roslaunch."""
    return value.lower() in ("true", "1")


def shorten_summary(config: Any) -> None:
    """Leave the parameters out of roslaunch's summary, because they would hide the first useful line."""
    summary = config.summary  # function of roslaunch that returns the text

    def short_summary(*arguments: Any, **named: Any) -> str:
        text = summary(*arguments, **named)
        return re.sub(r"PARAMETERS\n.*?(?=NODES\n)", "", text, flags=re.DOTALL)

    config.summary = short_summary


class Failures(roslaunch.pmon.ProcessListener):
    """Remembers the first required node that failed."""

    def __init__(self) -> None:
        self.required: Set[str] = set()  # names of the required nodes, such as husky_simulator
        self.first: Optional[str] = None  # name of the process that failed first, such as husky_simulator-2
        self.exit_code = 0  # exit code of this process

    def process_died(self, process_name: str, exit_code: Optional[int]) -> None:
        """Roslaunch calls it when a process has ended by itself."""
        node = process_name.rsplit("-", 1)[0]
        if self.first is None and exit_code and node in self.required:
            self.first, self.exit_code = process_name, exit_code


def last_fatal(process_name: str, log_folder: Path) -> Optional[str]:
    """Return the last FATAL message that a rospy node wrote into its log; None if there is none."""
    for log in log_folder.glob(f"{process_name.replace('/', '-')}.log"):  # nothing if the node has no log
        # a line of the log is [LOGGER][LEVEL] DATE TIME: MESSAGE
        found = re.findall(
            r"\]\[(?:FATAL|CRITICAL)\][^:]*:\d+:\d+,\d+: (.*)", log.read_text(errors="replace")
        )
        if found:
            return found[-1]
    return None


def tell(text: str) -> None:
    """Print roslaunch's message on a process, unless roslaunch ends it itself."""
    if not text.endswith("killing on exit"):
        roslaunch.core.printlog(text)


def tell_end(text: str) -> None:
    """Print roslaunch's message on a node; if a required node has ended, print one line instead."""
    required = re.search(r"REQUIRED process \[(.*)-\d+\] has died", text)
    if required:
        say(f"{required[1]} has ended, so the launch ends")
    else:
        roslaunch.core.printerrlog(text)


def start_own_master() -> None:
    """Let roslaunch start the master of this package, which lists the parameters that no node reads."""
    create = roslaunch.launch.create_master_process

    def create_own(*arguments: Any, **named: Any) -> Any:
        """Make the process of the master, with this package's program for the master."""
        process = create(*arguments, **named)
        process.args = [sys.executable, str(PACKAGE_FOLDER / "tools" / "master.py"), *process.args[1:]]
        return process

    roslaunch.launch.create_master_process = create_own


def terminate_processes() -> None:
    """Send SIGTERM to all processes of this launch.

    A Python program that still imports ends in silence at SIGTERM, but with a traceback at SIGINT, which
    roslaunch would send.
    """
    for monitor in list(roslaunch.pmon._pmons):
        for process in list(monitor.procs):
            if process.popen is not None and process.popen.poll() is None:  # it still runs
                os.killpg(process.popen.pid, signal.SIGTERM)


def launch(file: Path, arguments: Arguments, output: FoldedOutput) -> int:
    """Run roslaunch with functions of this module in place of some of its own.

    Returns:
        0, or 1 if a required node failed.
    """
    roslaunch.pmon.printlog, roslaunch.pmon.printerrlog = tell, tell_end
    failures = Failures()
    # State that the functions below share. "started" is true when all nodes are started, "forking" while one
    # process is being started, and "signal" is the number of a signal that came meanwhile. Later, "id" is the
    # id of the run, and "robots" has the names of the robots' nodes.
    run: Dict[str, Any] = {"started": False, "forking": False, "signal": 0}
    # functions of roslaunch, which the functions below call
    end = roslaunch.pmon.rl_signal
    start = roslaunch.nodeprocess.LocalProcess.start

    class Parent(roslaunch.parent.ROSLaunchParent):
        """Roslaunch's own class, which also adapts the nodes of the file before it starts them."""

        def __init__(self, run_id: str, *arguments: Any, **named: Any) -> None:
            run["id"] = run_id
            super().__init__(run_id, *arguments, process_listeners=[failures], **named)

        def _load_config(self) -> None:
            """Read the file, then adapt its nodes; roslaunch calls this before it starts any node."""
            try:
                super()._load_config()
            except roslaunch.core.RLException as error:
                # roslaunch names the file of an include, but not the first file
                raise roslaunch.core.RLException(f"while processing {file}:\n{error}") from error
            adapt(self.config, file, arguments)
            warn_of_dependencies(self.config, file)
            if "--screen" not in arguments.options:
                shorten_summary(self.config)
            nodes = self.config.nodes
            run["robots"] = {node.name for node in nodes if starts_robot(node)}
            names = [rosgraph.names.ns_join(node.namespace, node.name) for node in nodes if node.required]
            # roslaunch leaves out the first slash in the name of a node's process
            failures.required = {name.lstrip("/") for name in names}

        def start(self, auto_terminate: bool = True) -> None:
            """Start all nodes, and note that they are started."""
            super().start(auto_terminate)
            run["started"] = True

    def end_also_while_starting(number: int, frame: Any) -> None:
        """End roslaunch and its nodes at a signal, also while roslaunch still starts the nodes."""
        if run["forking"]:  # a process that is half started cannot be ended, so `start_process` calls again
            run["signal"] = number
            return
        if not run["started"]:
            terminate_processes()
        end(number, frame)
        if not run["started"]:  # otherwise roslaunch would go on, and wait for the master that it has ended
            sys.stdout.flush()
            output.close()
            os._exit(128 + signal.SIGINT)  # SystemExit could be raised at a place where Python ignores it

    def start_process(process: Any) -> Any:
        """Start a process; a signal that comes meanwhile is handled afterwards."""
        # a handler of signals runs in the main thread only, so it cannot interrupt another thread's start
        if run["started"] or threading.current_thread() is not threading.main_thread():
            return start(process)
        run["forking"] = True
        try:
            return start(process)
        finally:
            run["forking"] = False
            if run["signal"]:
                end_also_while_starting(run["signal"], None)

    roslaunch.nodeprocess.LocalProcess.start = start_process
    roslaunch.pmon.rl_signal = end_also_while_starting
    roslaunch.parent.ROSLaunchParent = Parent
    roslaunch.main(["roslaunch", str(file), *arguments.options])
    if failures.first is None:
        return 0
    name = failures.first.rsplit("-", 1)[0]
    sentence = last_fatal(failures.first, Path(rospkg.get_log_dir()) / run["id"])
    if not sentence and name in run["robots"]:
        return 1  # this node is a roslaunch of simulator.launch, which has printed the reason
    say(f"error: {name}: {sentence or f'ended with exit code {failures.exit_code}'}")
    return 1


def main() -> int:
    """Check the command line and the network, then launch."""
    # ./dev starts this program with SIGINT ignored; nodes must not inherit this, because SIGINT ends them
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    file, arguments = find_launch_file(sys.argv[1:])
    file = find_packages_for(file)
    check_master()
    check_display()
    checked = check_arguments(file, arguments)
    start_own_master()
    output = FoldedOutput()
    try:
        return launch(file, checked, output)
    finally:
        output.close()


if __name__ == "__main__":
    sys.exit(main())
