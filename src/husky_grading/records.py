"""Records of marking: what is started, how it is marked, the job of one hand-in, and its result.

A job travels to the marking program, and the result back, as JSON that `config.from_plain` reads.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Mapping, Optional, Sequence, Tuple

from husky_grading.notes import Kind, Subject
from husky_highlevel_controller.config import number, setting
from husky_highlevel_controller.course import REACHED

# topic of the scans, and launch arguments of the simulator, of each robot that submissions are written for
ROBOT_VERSIONS = {
    "husky": ("/front/scan", ("robot:=husky", "laser_topic:=front/scan", "laser_prefix:=front")),
    "husky_melodic": ("/scan", ("robot:=husky", "laser_topic:=scan", "laser_prefix:=base")),
    "smb": ("/scan", ("robot:=smb", "laser_topic:=scan")),
}
ROBOT_TITLES = {"husky": "Husky", "husky_melodic": "Husky of ROS Melodic", "smb": "SMB"}
DEFAULT_ROBOT, SMB = "husky", "smb"
AUTO = "auto"  # the robot whose scans the submission subscribes to, or that it names
WALL_BASE, WALL_SLOWNESS = 300.0, 20.0  # [s] of wall time a drive may take, and how much slower than its pace
RAMMING_MARGIN = 0.05  # [m/s], a measured speed is not exact: a robot commanded to `gentle` does not ram
MAX_TEXT = 1000  # letters of an evidence or note


@dataclass(frozen=True)
class Rules:
    """A rubric's tolerances and weights; the defaults are the course's sheet."""

    reached: float = number(
        0.0, 5.0, "from the robot's outline to the pillar that it has reached [m]", REACHED
    )
    ramming_costs: float = number(0.0, 30.0, "points that ramming the pillar costs", 0.0)
    gentle: float = number(0.0, 5.0, "a robot that touches the pillar faster than this rams it [m/s]", 0.5)
    marker_full: float = number(0.0, 5.0, "from the marker to the pillar's axis for all points [m]", 0.3)
    marker_half: float = number(
        0.0, 5.0, "from the marker to the pillar's axis for half of the points [m]", 0.5
    )
    other_worlds: float = number(0.0, 1.0, "what the drives in other worlds weigh, together", 1.0 / 3.0)
    no_rviz_config: str = setting(
        "without a configuration of RViz: a person judges, no points, or all of them for a launch file that "
        "starts RViz", "person", choices=("person", "zero", "node"),
    )  # fmt: skip
    marker_per_metre: float = number(0.0, 1.0, "added to both for each metre between robot and pillar", 0.005)
    weights: Mapping[str, float] = field(  # points by item
        default_factory=dict, metadata={"min": 0.0, "max": 1000.0, "help": "an item's points"}
    )
    by_person: Tuple[str, ...] = ()  # names of items that a person judges

    def rams(self, speed: float) -> bool:
        """Whether touching the pillar at this speed [m/s] is ramming that costs points."""
        return self.ramming_costs > 0.0 and speed > self.gentle + RAMMING_MARGIN


@dataclass(frozen=True)
class MarkingConfig:
    """Settings of a marking, the same for every submission."""

    exercise: int = 3
    robot: str = setting("version of the robot", AUTO, choices=(AUTO, *ROBOT_VERSIONS))
    seed: int = number(0, 2**31, "of starts, pillars and noise", 0)
    trials: int = number(1, 1000, "drives", 3)
    deadline: float = number(0.1, 3600.0, "of each drive, simulated [s]", 120.0)
    pace: float = number(0.1, 3600.0, "simulated seconds a second, at most", 5.0)
    rules: Rules = field(default_factory=Rules)
    scans: str = ""  # topic of the scans that the submission subscribes to; empty: the robot's

    @property
    def scan_topic(self) -> str:
        """Topic of the scans, once the robot is known."""
        return self.scans or ROBOT_VERSIONS[self.robot][0]

    @property
    def simulator_arguments(self) -> Tuple[str, ...]:
        """Launch arguments of the simulator, once the robot is known."""
        topic = (f"laser_topic:={self.scans.lstrip('/')}",) if self.scans else ()
        return (*ROBOT_VERSIONS[self.robot][1], *topic)

    @property
    def wall_limit(self) -> float:
        """Longest wall time of a drive [s]."""
        return WALL_BASE + WALL_SLOWNESS * self.deadline / self.pace

    @property
    def robot_name(self) -> str:
        """The robot, one of ROBOTS, without the version of its topics."""
        return self.robot.partition("_")[0]


@dataclass(frozen=True)
class Launchable:
    """A launch file or a node, and its arguments."""

    kind: str  # launch or node
    package: str
    name: str  # of the launch file, in its package or an absolute path; type of the node
    arguments: Tuple[str, ...] = ()
    title: str = ""  # of the result; empty: the command line

    @property
    def command(self) -> Tuple[str, ...]:
        """Its arguments on a command line."""
        return (f"--{self.kind}", self.package, self.name, *self.arguments)

    @property
    def summary(self) -> str:
        """The title, or the command line."""
        return self.title or " ".join(self.command)


DEFAULT_RULES = Rules()


@dataclass(frozen=True)
class GivenPoints:
    """Points of one item, given by a person."""

    points: float = number(0.0, 1000.0, "an item's points")
    word: str = setting("the reason, for the student")


@dataclass(frozen=True)
class Late:
    """A penalty for lateness."""

    percent: float = number(0.0, 100.0, "of all points")
    word: str = setting("the reason, for the student")


@dataclass(frozen=True)
class Override:
    """Settings for one student; None is left to marking."""

    launch: Optional[str] = setting("place of a launch file, or the end of it", None)
    node: Optional[str] = setting("package and type of a node", None)
    arguments: Tuple[str, ...] = ()  # of the launch file or node
    robot: Optional[str] = setting("version of the robot", None, choices=tuple(ROBOT_VERSIONS))
    exercise: Optional[int] = number(1, 99, "number in names", None)
    points: Mapping[str, GivenPoints] = field(default_factory=dict)  # by item
    late: Optional[Late] = None
    hold: bool = False  # feedback is kept back

    def __post_init__(self) -> None:
        """Refuse what does not go together."""
        if self.launch and self.node:
            raise ValueError("has both launch and node")
        if self.node and len(self.node.split()) != 2:
            raise ValueError(f"node = {self.node!r} is not a package and a type")


@dataclass(frozen=True)
class Job:
    """Job of one marking: a launchable of a sourced workspace, or a hand-in that is built first."""

    name: str  # the student's
    out: str  # folder for the result
    config: MarkingConfig
    launchable: Optional[Launchable] = None
    hand_in: str = ""  # folder or archive
    override: Override = field(default_factory=Override)
    setups: Tuple[str, ...] = ()  # setup.bash files, sourced in this order
    packages: Tuple[str, ...] = ()  # folders of packages that need no build
    hidden: Tuple[str, ...] = ()  # folders that the submission must not see
    made_of: str = ""  # fingerprint of files, settings and version of this package that decide what is built
    fingerprint: str = ""  # likewise, of what decides how it drives
    installed: str = ""  # likewise, of the packages on this machine
    time_limit: float = 0.0  # [s] of wall time; 0: the usual one


@dataclass(frozen=True)
class Item:
    """Line of the table."""

    name: str
    points: Optional[float]  # None: a machine cannot judge it
    max_points: float
    evidence: str
    at: Optional[float] = None  # [s], simulated: the moment the evidence is about
    hint: str = ""  # what to look at, where points are lost
    drive: int = 1  # number of the drive that the evidence is about
    subject: Subject = Subject.CODE
    reason: Optional[Kind] = None  # why a person has to judge it, where many hand-ins are alike

    @property
    def full(self) -> bool:
        """Full marks, or not machine-gradable."""
        return self.points is None or self.points >= self.max_points - 1e-9


class ResultState(Enum):
    """State of a result."""

    MARKED = "marked"
    GRADED_BY_HAND = "to be graded by hand"
    NOT_MARKED = "could not be marked"


@dataclass(frozen=True)
class MarkingResult:
    """Result of one submission; its texts are printable, whatever a submission called its files and nodes."""

    name: str
    what: str  # the launch file or node
    settings: Mapping[str, Any]
    items: Tuple[Item, ...]
    notes: Tuple[str, ...] = ()  # what went wrong, in sentences
    problem: str = ""  # why it could not be marked, in a sentence; empty: it was marked
    held: bool = False  # the student's feedback is kept back

    def __post_init__(self) -> None:
        """Make every text printable."""
        for name in ("name", "what", "problem", "notes", "items"):
            object.__setattr__(self, name, _printable(getattr(self, name)))

    @property
    def points(self) -> float:
        """Sum of the points that were given."""
        return total(self.items)[0]

    @property
    def max_points(self) -> float:
        """Sum of the points that a machine can give."""
        return total(self.items)[1]

    @property
    def cause(self) -> Optional[Item]:
        """The first item that lost points: what went wrong first; None: nothing."""
        return next((item for item in self.items if not item.full), None)

    @property
    def state(self) -> ResultState:
        """Marked, or left to a person at least in part, or not marked at all."""
        if self.problem:
            return ResultState.NOT_MARKED
        is_open = any(item.points is None for item in self.items)
        return ResultState.GRADED_BY_HAND if is_open else ResultState.MARKED

    @property
    def lacks_rviz_file_only(self) -> bool:
        """Whether a person has to judge it for want of an RViz configuration alone."""
        reasons = {item.reason for item in self.items if item.points is None}
        return reasons == {Kind.NO_RVIZ_FILE}

    @property
    def full(self) -> bool:
        """Whether it has all points that a machine can give."""
        return not self.problem and all(item.full for item in self.items)


def total(items: Sequence[Item]) -> Tuple[float, float]:
    """Points, and how many a machine can give."""
    judged = [item for item in items if item.points is not None]
    return round(sum(item.points or 0.0 for item in judged), 1), sum(item.max_points for item in judged)


def _printable(value: Any) -> Any:
    """A text, items, or several of these with every text printable."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, Item):
        texts = printable(value.name), printable(value.evidence), printable(value.hint)
        return replace(value, name=texts[0], evidence=texts[1], hint=texts[2])
    return tuple(map(_printable, value))


def printable(text: str, limit: int = MAX_TEXT) -> str:
    """A text on one line, cut if long, without control letters, escapes, or bytes that are no UTF-8."""
    text = text if len(text) <= limit else text[:limit] + " [...]"
    text = text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    return "".join(letter if letter.isprintable() else " " for letter in text)
