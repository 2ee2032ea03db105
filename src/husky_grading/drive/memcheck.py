"""Search for variables that a C++ node reads before it writes them, by valgrind's memcheck.

Such a node behaves by chance: it may drive on the student's machine and stand still on this one.
"""

from __future__ import annotations

import contextlib
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Collection, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from husky_grading.drive.bring_up import simulate
from husky_grading.drive.progress import state_of_tree, wait_while_active
from husky_grading.drive.robot_choice import RobotChoice
from husky_grading.drive.ros_graph import (
    read_registrations,
    robot_listened_to,
    topics_subscribed,
)
from husky_grading.drive.run import start_submission
from husky_grading.drive.trials import Trial
from husky_grading.isolation.files import (
    UnreadableFileError,
    is_regular,
    read_text,
    texts_in,
    walk,
)
from husky_grading.isolation.process import Process, wait
from husky_grading.isolation.ros_network import Network
from husky_grading.submission import SIMULATOR_NODES, SUBMISSION_FOLDER, Submission

VALGRIND = "valgrind"
LOG = "memcheck."  # beginning of the name of valgrind's log; `nodes/submission.py` uses the same name
# [s] after a node has subscribed to the scans, it runs under valgrind for this CPU time, but at most for this
# wall time
CPU_TIME, WALL_TIME = 2.0, 8.0
ELF = b"\x7fELF"
SOURCES = {".cpp", ".cc", ".cxx", ".hpp", ".h", ".hh"}
MAX_NESTED = 20  # largest depth of nested parentheses
# character that replaces a pair of parentheses and everything in it, before C++ code is searched
IN_PARENTHESES = "\0"
# only the DEPTH innermost calls of a call stack are searched for a line of the submission
DEPTH = 4
PACE = 1.0  # real-time factor of the simulator, which does not wait for the submission

# line of a call stack: a function, and its place in the source code
_FRAME = re.compile(r"(?:at|by) 0x[0-9A-F]+: (?:.*) \((?P<file>[^()]+):(?P<line>\d+)\)$")
# functions that print a value or write it into a text
_PRINTS = re.compile(r"printf|ostream|operator<<|num_put|rosconsole|ros::console|_itoa")
_TYPE = r"(?:bool|char|int|long|short|float|double|unsigned(?: \w+)?|(?:std::)?size_t|u?int\d+_t)"
# line that declares one or more variables of a simple type, all without a value
_DECLARED_WITHOUT_VALUE = re.compile(
    rf"^[ \t]*(?:mutable |volatile )?{_TYPE}[ \t]+(\w+(?:[ \t]*,[ \t]*\w+)*)[ \t]*;", re.MULTILINE
)
# numbers and classes such as tf::Vector3; their variables have no value unless the code gives them one
_NO_DEFAULT = rf"(?:^|[\s:])(?:{_TYPE}\b|\w+_t\b|(?:std::array|tf2?|Eigen)\b\S*)"
_POINTER = r"^\s*(?:const\s+)?[\w:<>]+\s*\*"
# declaration of variables that may have no value; the group `variables` is a list such as `a = 1, b`
_DECLARATION = re.compile(rf"(?:{_NO_DEFAULT}|{_POINTER})(?P<variables>.*)$", re.DOTALL)
# words that may create memory without a value
_MEMORY = re.compile(r"\b(?:struct|union|enum|new|malloc|alloca)\b")
# comments and preprocessor lines
_COMMENTS = re.compile(r"//[^\n]*|/\*.*?(?:\*/|\Z)|\#[^\n]*", re.DOTALL)


class Place(NamedTuple):
    """A line of a source file."""

    file: str  # name without folders
    line: int


class Read(NamedTuple):
    """Read of a value that was never written: the line that reads it, and the line that made its memory."""

    # line of the submission that reads the value; None if only ROS reads the value, to send it in a message
    place: Optional[Place]
    origin: Optional[Place]  # line of the submission that allocated the memory of the value; None if unknown


def is_worth_checking(submission: Submission) -> bool:
    """Return whether a C++ program of a submission may read a variable before it writes it.

    Only then is the check made, because valgrind takes some seconds.
    """
    root = submission.root
    if root is None or shutil.which(VALGRIND) is None:
        return False
    # in exercise 4, students write no node, but start a node of a ROS package, so there is no code to check
    if submission.parts.by_submission:
        return False
    # a node is package/type, which is also the path of a built program below devel/lib
    if not any(_is_compiled(root / "devel" / "lib" / node) for node in submission.nodes):
        return False
    return any(may_be_unwritten(text) for text in _texts(root / "src").values())


def find_unwritten_variable(
    submission: Submission, trial: Trial, robot: RobotChoice, folder: Path
) -> Tuple[str, RobotChoice]:
    """Run a submission in valgrind for some seconds, to find a variable that it reads before it writes it.

    If the robot is a guess and the submission subscribes to another robot's scans, the simulator starts again
    with that robot.

    Returns:
        A sentence on the first such variable, empty if there is none; and the robot that was simulated last.

    Raises:
        MarkingError: the network or the simulator does not start.
    """
    with Network(folder) as network:
        # the simulator gets no socket for true poses, so it runs without lockstep, and does not wait for the
        # submission, which is slow in valgrind
        simulator = simulate(network, trial, replace(robot.config, pace=PACE))
        process, _ = start_submission(network, submission, "memcheck")
        # if `robot` is a wrong guess, this wait ends when the submission is idle, without a subscription
        gets_scans = _wait_for_subscription(network, submission, process, robot.config.scan_topic)
        final_choice = robot  # robot that is simulated in the end
        if robot.is_guess:
            # settings of the robot whose scans the submission receives; None if there is no such robot, and
            # then `after_hearing` keeps the guess
            heard_config = robot_listened_to(network.uri, SIMULATOR_NODES, robot.config)
            final_choice = robot.after_hearing(heard_config)
        if final_choice.config != robot.config:  # the guess was wrong, so another robot is simulated now
            simulator.kill()
            simulate(network, trial, replace(final_choice.config, pace=PACE))
            # the submission has subscribed to this robot's scans before, so it gets them if it still runs
            gets_scans = process.running
        if gets_scans:
            _let_callbacks_run(process)
        # the logs are read before the end of the network ends the node, because an interrupted `getParam`
        # leaves its variable without a value
        log = _read_logs(network.folder_of(SUBMISSION_FOLDER))
    # `or folder` is only for mypy: `is_worth_checking` lets no submission without a root come here
    sources = (submission.root or folder) / "src"
    return sentence(reads_in(log, sources), sources), final_choice


def _wait_for_subscription(
    network: Network, submission: Submission, process: Process, scan_topic: str
) -> bool:
    """Wait until a submission subscribes to the scans; False if it ends or becomes idle before that."""
    return wait_while_active(
        process,
        node_count=len(submission.nodes),
        condition=lambda: scan_topic in topics_subscribed(network.uri, SIMULATOR_NODES),
        # a submission that still registers new topics is active
        read_graph=lambda: read_registrations(network.uri, SIMULATOR_NODES),
    )


def _let_callbacks_run(process: Process) -> None:
    """Wait until a submission that gets scans has used CPU_TIME more, or has ended; at most WALL_TIME."""

    def cpu_seconds() -> float:
        """Return the CPU time that the submission has used since its start [s]."""
        _, seconds = state_of_tree(process.popen.pid)
        return seconds

    used_before = cpu_seconds()
    wait(lambda: not process.running or cpu_seconds() - used_before > CPU_TIME, WALL_TIME)


def _read_logs(folder: Path) -> str:
    """Return the logs of valgrind in a folder as one text; each process has written a log of its own."""
    log = ""
    for path in sorted(folder.iterdir()):
        if path.name.startswith(LOG):
            with contextlib.suppress(UnreadableFileError):
                log += read_text(path) + "\n"
    return log


def _is_compiled(path: Path) -> bool:
    """Return whether a file is a compiled program, and not a script."""
    with contextlib.suppress(OSError):
        if is_regular(path):  # opening another kind of file, such as a FIFO, could block
            with path.open("rb") as file:
                return file.read(len(ELF)) == ELF
    return False


def may_be_unwritten(text: str) -> bool:
    """Return whether C++ code declares, or may declare, a variable without a value.

    This is only a rough search, which decides whether the slow run in valgrind is worth its time.
    """
    text = _COMMENTS.sub("", text)
    # Everything in parentheses is replaced, the innermost parentheses first. Otherwise the search below would
    # take a comma or "=" in parentheses for a part of a declaration.
    for _ in range(MAX_NESTED):
        text = re.sub(r"\([^()]*\)", IN_PARENTHESES, text)
    if _MEMORY.search(text):
        return True
    variables: List[str] = []  # declared variables, such as "a", "a = 1", or "a(1)" with IN_PARENTHESES
    for statement in re.split(r"[;{}]", text):
        declaration = _DECLARATION.search(statement)
        if declaration is not None:
            variables += declaration["variables"].split(",")
    return any("=" not in variable and IN_PARENTHESES not in variable for variable in variables)


def _texts(sources: Path) -> Dict[str, str]:
    """Return the texts of the C++ files below a folder, by the name of the file."""
    return {path.name: text for path, text in texts_in(sources, SOURCES)}


def reads_in(log: str, sources: Path) -> List[Read]:
    """Return the reads of values that were never written, from the log of memcheck.

    Only lines of the submission's `sources` count. A value that is only printed does not count.
    """
    own_files = {path.name for path in walk(sources) if path.suffix in SOURCES}
    found: List[Read] = []
    # Memcheck begins each line with ==PID==, and ends each report with such a line without text. A report has
    # two call stacks: the read of the value, and the allocation of its memory.
    for report in re.split(r"^==\d+== *$", log, flags=re.MULTILINE):
        text = re.sub(r"^==\d+== *", "", report, flags=re.MULTILINE).strip()
        reading_stack, _, creation_stack = text.partition("Uninitialised value was created")
        origin = _first_own_line(creation_stack, own_files)  # line that allocates the memory
        if reading_stack.startswith(("Conditional jump", "Use of uninitialised value")):
            place = _first_own_line(reading_stack, own_files)
            # without a place, the value is only printed, or the submission does not read it
            if place is not None:
                found.append(Read(place, origin))
        elif reading_stack.startswith("Syscall param") and "ros::" in reading_stack and origin is not None:
            # ROS reads the value to send it, so only the allocation is in a line of the submission
            found.append(Read(None, origin))
    return found


def _first_own_line(stack: str, own_files: Collection[str]) -> Optional[Place]:
    """Return the innermost own line of a call stack; None if there is none, or the value is only printed.

    Own lines are those in `own_files`, the names of the submission's source files. Only the DEPTH innermost
    calls count.
    """
    # the calls come from the innermost to the outermost; the line before the first call is a title
    for line in stack.splitlines()[: DEPTH + 1]:
        frame = _FRAME.match(line.strip())
        if frame and frame["file"] in own_files:
            return Place(frame["file"], int(frame["line"]))
        # The submission has called a function that prints, such as operator<<, and this function reads the
        # value. A wrong printed value does no harm.
        if _PRINTS.search(line):
            return None
    return None


def sentence(reads: Sequence[Read], sources: Path) -> str:
    """Return a sentence for the student on one of the reads; empty if there are no reads.

    The first read whose line names an unwritten variable is preferred, so that the sentence has this name.
    """
    if not reads:
        return ""
    texts = _texts(sources)
    declarations = _declared_without_value(texts)
    # lines of the submission that read a value; a read by ROS alone has no such line
    reading_lines = [read.place for read in reads if read.place is not None]
    for place in reading_lines:
        words = re.findall(r"\w+", _code_at(place, texts))
        names = [word for word in words if word in declarations]
        if names:
            declared_at = declarations[names[0]]
            variable = f"`{names[0]}` ({declared_at.file}:{declared_at.line})"
            return f"{variable} is read at {place.file}:{place.line} before it is written"
    # no line names its variable, so the sentence is on the first read
    first_place, origin = reads[0]
    if first_place is not None:
        return f"a variable is read at {first_place.file}:{first_place.line} before it is written"
    # no line of the submission reads the value, but ROS reads it to send it in a message; `origin` is the
    # line of the submission that allocated the memory of the value
    object_place = f", in an object made at {origin.file}:{origin.line}" if origin else ""
    return f"it sends a value that was never written{object_place}"


def _code_at(place: Place, texts: Mapping[str, str]) -> str:
    """Return the text of a line; empty if the file in `texts`, by its name, has no such line."""
    lines = texts.get(place.file, "").splitlines()
    return lines[place.line - 1] if 1 <= place.line <= len(lines) else ""


def _declared_without_value(texts: Dict[str, str]) -> Dict[str, Place]:
    """Return the file and line of each variable that C++ files declare without a value, by its name.

    `texts` has the texts of the files by the files' names.
    """
    places: Dict[str, Place] = {}
    for file, text in texts.items():
        for declaration in _DECLARED_WITHOUT_VALUE.finditer(text):
            line = text.count("\n", 0, declaration.start(1)) + 1
            for name in re.split(r"[ \t]*,[ \t]*", declaration[1]):
                places.setdefault(name, Place(file, line))
    return places
