"""Records of marking: the launchable, the settings, the job of one submission, and its result.

The marking program gets a job and returns a result, both as JSON that `config.from_plain` reads.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Mapping, Optional, Sequence, Tuple

from husky_grading.notes import Kind, Subject
from husky_highlevel_controller.config import number, setting
from husky_highlevel_controller.course import REACHED

# topic of the scans, and launch arguments of the simulator, for each robot
ROBOT_VERSIONS = {
    "husky": ("/front/scan", ("robot:=husky", "laser_topic:=front/scan", "laser_prefix:=front")),
    "husky_melodic": ("/scan", ("robot:=husky", "laser_topic:=scan", "laser_prefix:=base")),
    "smb": ("/scan", ("robot:=smb", "laser_topic:=scan")),
}
ROBOT_TITLES = {"husky": "Husky", "husky_melodic": "Husky of ROS Melodic", "smb": "SMB"}
DEFAULT_ROBOT, SMB = "husky", "smb"
# with this value, `grade` chooses the robot itself: by the submission's files, or by the topic of scans to
# which the submission subscribes
AUTO = "auto"
# longest wall time of a run [s]: WALL_BASE, plus WALL_SLOWNESS times the wall time that the run would take at
# its maximum real-time factor
WALL_BASE, WALL_SLOWNESS = 300.0, 20.0
# [m/s] The robot rams the pillar if it touches the pillar faster than `gentle` plus this margin. The margin
# is needed because the robot does not follow a command exactly.
RAMMING_MARGIN = 0.05
MAX_TEXT = 1000  # largest number of characters of an evidence or note; the rest is cut


@dataclass(frozen=True)
class Rules:
    """A rubric's tolerances and weights; the defaults are the course's sheet."""

    reached: float = number(0.0, 5.0, "gap between footprint and pillar that counts as reached [m]", REACHED)
    ramming_costs: float = number(0.0, 30.0, "points that ramming the pillar costs", 0.0)
    gentle: float = number(0.0, 5.0, "speed above which touching the pillar is ramming [m/s]", 0.5)
    marker_full: float = number(0.0, 5.0, "distance of a marker from the axis for all points [m]", 0.3)
    marker_half: float = number(
        0.0, 5.0, "distance of a marker from the axis for half of the points [m]", 0.5
    )
    other_worlds: float = number(0.0, 1.0, "weight of all runs in other worlds together", 1.0 / 3.0)
    # "person", "zero" and "node" stand for the three rules in the text, in this order
    no_rviz_config: str = setting(
        "rule for a submission without a configuration of RViz: graded by hand, no points, or all points for "
        "a launch file that starts RViz", "person", choices=("person", "zero", "node"),
    )  # fmt: skip
    marker_per_metre: float = number(
        0.0, 1.0, "addition to both distances for each metre between robot and pillar", 0.005
    )
    weights: Mapping[str, float] = field(  # points by item
        default_factory=dict, metadata={"min": 0.0, "max": 1000.0, "help": "an item's points"}
    )
    by_person: Tuple[str, ...] = ()  # names of items that are graded by hand

    def rams(self, speed: float) -> bool:
        """Return whether touching the pillar at this speed [m/s] is ramming that costs points."""
        return self.ramming_costs > 0.0 and speed > self.gentle + RAMMING_MARGIN


@dataclass(frozen=True)
class MarkingConfig:
    """Settings of a marking, the same for every submission."""

    exercise: int = 3
    robot: str = setting("version of the robot", AUTO, choices=(AUTO, *ROBOT_VERSIONS))
    seed: int = number(0, 2**31, "random seed for starts, pillars and noise", 0)
    trials: int = number(1, 1000, "number of runs", 3)
    deadline: float = number(0.1, 3600.0, "time limit of each run, simulated [s]", 120.0)
    pace: float = number(0.1, 3600.0, "maximum real-time factor", 5.0)
    rules: Rules = field(default_factory=Rules)
    # topic on which scans are sent, because the submission subscribes to it; defaults to the robot's topic
    scans: str = ""

    @property
    def scan_topic(self) -> str:
        """Return the topic of the scans; the robot must be known."""
        default_topic, _ = ROBOT_VERSIONS[self.robot]
        return self.scans or default_topic

    @property
    def simulator_arguments(self) -> Tuple[str, ...]:
        """Return the launch arguments of the simulator; the robot must be known."""
        _, arguments = ROBOT_VERSIONS[self.robot]
        if self.scans:  # the last value of an argument counts
            arguments = (*arguments, f"laser_topic:={self.scans.lstrip('/')}")
        return arguments

    @property
    def wall_limit(self) -> float:
        """Return the longest wall time of a run [s]."""
        return WALL_BASE + WALL_SLOWNESS * self.deadline / self.pace

    @property
    def robot_name(self) -> str:
        """Return the robot, one of ROBOTS, without the version of its topics; so husky_melodic is husky."""
        return self.robot.partition("_")[0]


@dataclass(frozen=True)
class Launchable:
    """A launch file or a node, and its arguments."""

    kind: str  # launch or node
    package: str
    name: str  # name of the launch file in its package, absolute path of the launch file, or type of the node
    arguments: Tuple[str, ...] = ()
    title: str = ""  # title of the result; defaults to the command line

    @property
    def command(self) -> Tuple[str, ...]:
        """Return the options of `grade` that name the launchable."""
        return (f"--{self.kind}", self.package, self.name, *self.arguments)

    @property
    def summary(self) -> str:
        """Return the title; without a title, the options of `grade`."""
        return self.title or " ".join(self.command)


DEFAULT_RULES = Rules()


@dataclass(frozen=True)
class GivenPoints:
    """Points of one item, given by hand."""

    points: float = number(0.0, 1000.0, "an item's points")
    word: str = setting("comment to the student with the reason")


@dataclass(frozen=True)
class Late:
    """A penalty for lateness."""

    percent: float = number(0.0, 100.0, "penalty in percent of all points")
    word: str = setting("comment to the student with the reason")


@dataclass(frozen=True)
class Override:
    """Settings for one student; marking chooses the settings that are None."""

    launch: Optional[str] = setting("path of a launch file in the submission, or the end of the path", None)
    node: Optional[str] = setting("package and type of a node", None)
    arguments: Tuple[str, ...] = ()  # arguments of the launch file or node
    robot: Optional[str] = setting("version of the robot", None, choices=tuple(ROBOT_VERSIONS))
    exercise: Optional[int] = number(1, 99, "exercise number in names of files and folders", None)
    points: Mapping[str, GivenPoints] = field(default_factory=dict)  # points by item
    late: Optional[Late] = None
    hold: bool = False  # true if the student gets no feedback yet

    def __post_init__(self) -> None:
        """Reject settings that do not fit together."""
        if self.launch and self.node:
            raise ValueError("has both launch and node; remove one of them")
        if self.node and len(self.node.split()) != 2:
            raise ValueError(
                f"node = {self.node!r} is not a package and a type, such as 'my_package node.py'"
            )


@dataclass(frozen=True)
class Job:
    """Job of one marking: a launchable of a sourced workspace, or delivered files that are built first."""

    name: str  # name of the student
    out: str  # folder for the result
    config: MarkingConfig
    launchable: Optional[Launchable] = None
    hand_in: str = ""  # path of the delivered folder or archive
    override: Override = field(default_factory=Override)
    setups: Tuple[str, ...] = ()  # setup.bash files, sourced in this order
    packages: Tuple[str, ...] = ()  # folders of packages that need no build
    hidden: Tuple[str, ...] = ()  # folders that the sandbox must hide from the submission
    # hash of everything on which the build depends: delivered files, settings, and our own code
    made_of: str = ""
    fingerprint: str = ""  # hash of everything on which the runs depend
    installed: str = ""  # hash of the names of the packages that this machine has
    time_limit: float = 0.0  # [s] longest wall time for marking the submission; 0 means the default


@dataclass(frozen=True)
class Item:
    """Line of the table."""

    name: str
    points: Optional[float]  # points of the item; None if it is graded by hand
    max_points: float
    evidence: str
    # [s] simulated time that the evidence is about; None if it is about no single time
    at: Optional[float] = None
    hint: str = ""  # advice to the student, if points are lost
    drive: int = 1  # number of the run that the evidence comes from
    subject: Subject = Subject.CODE
    # reason for grading by hand that other submissions may also have, so that a teacher can grade them
    # together
    reason: Optional[Kind] = None

    @property
    def full(self) -> bool:
        """Return whether the item has full marks or is graded by hand."""
        return self.points is None or self.points >= self.max_points - 1e-9


class ResultState(Enum):
    """State of a result."""

    MARKED = "marked"
    GRADED_BY_HAND = "to be graded by hand"
    NOT_MARKED = "could not be marked"


@dataclass(frozen=True)
class MarkingResult:
    """Result of one submission; its texts are printable, whatever names a submission has."""

    name: str
    what: str  # name of the launch file or node that was graded
    settings: Mapping[str, Any]
    items: Tuple[Item, ...]
    notes: Tuple[str, ...] = ()  # findings in sentences
    problem: str = ""  # reason why the submission could not be marked, in a sentence; empty if it was marked
    held: bool = False  # true if the student gets no feedback yet

    def __post_init__(self) -> None:
        """Make every text printable."""
        for name in ("name", "what", "problem", "notes", "items"):
            object.__setattr__(self, name, _printable(getattr(self, name)))

    @property
    def points(self) -> float:
        """Return the sum of the points that were given."""
        return total(self.items)[0]

    @property
    def max_points(self) -> float:
        """Return the sum of the points that `grade` can give."""
        return total(self.items)[1]

    @property
    def cause(self) -> Optional[Item]:
        """Return the first item that lost points; None if no item lost points."""
        for item in self.items:
            if not item.full:
                return item
        return None

    @property
    def state(self) -> ResultState:
        """Return the state: marked, at least one item to be graded by hand, or not marked."""
        if self.problem:
            return ResultState.NOT_MARKED
        is_open = any(item.points is None for item in self.items)
        return ResultState.GRADED_BY_HAND if is_open else ResultState.MARKED

    @property
    def lacks_rviz_file_only(self) -> bool:
        """Return whether a result is graded by hand only because there is no RViz configuration."""
        reasons = {item.reason for item in self.items if item.points is None}
        return reasons == {Kind.NO_RVIZ_FILE}

    @property
    def full(self) -> bool:
        """Return whether the submission has all points that `grade` can give."""
        return not self.problem and all(item.full for item in self.items)


def total(items: Sequence[Item]) -> Tuple[float, float]:
    """Return the sum of points, and the largest sum that `grade` can give.

    Items that are graded by hand count in neither sum.
    """
    judged = [item for item in items if item.points is not None]
    points = sum(item.points or 0.0 for item in judged)
    max_points = sum(item.max_points for item in judged)
    return round(points, 1), max_points


def _printable(value: Any) -> Any:
    """Return a value with printable texts; the value is a text, an item, or a sequence of these."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, Item):
        name, evidence, hint = printable(value.name), printable(value.evidence), printable(value.hint)
        return replace(value, name=name, evidence=evidence, hint=hint)
    return tuple(map(_printable, value))


def printable(text: str, limit: int = MAX_TEXT) -> str:
    """Return a text on one line, cut if long, without control characters and bytes that are not UTF-8."""
    text = text if len(text) <= limit else text[:limit] + " [...]"
    try:
        data = text.encode("utf-8", "surrogateescape")
    except UnicodeEncodeError:  # an escape in JSON, such as "\ud800", can stand for half a character
        data = text.encode("utf-8", "backslashreplace")
    text = data.decode("utf-8", "backslashreplace")
    return "".join(letter if letter.isprintable() else " " for letter in text)
