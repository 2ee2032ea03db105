"""Habits of the nodes that command the robot: which node drives it, and faults that a student may not see.

In: commands with their stamps and senders. Out: findings, each of them once, and a sentence for each.

A sender is a node that sends velocity commands. A command expires if no other command follows in time; then
the robot stops. Topics have priorities (see `twist_mux.py`): a command on a topic overrules the commands on
all weaker topics.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Callable, Dict, Iterator, NamedTuple, Optional, Set, Tuple

# [s] when this time has passed since the first command that moves the robot, the rate of its sender is
# reported
RATE_TIME = 1.0
# A gap is the time from one command of a sender to its next command. A gap is slow if the first of these two
# commands expired in this time. A sender is slow if it has this number of slow gaps without another gap
# between them.
SLOW_GAPS = 8
# [s] a longer gap is a pause and does not count, because a person may be pressing keys
LONGEST_GAP = 3.0
ZEROS_TIME = 10.0  # [s] a sender is reported if all its commands for this time were zero
ZEROS_COUNT = 20  # a sender is reported only if it has sent at least this number of zero commands
# [s] if zero commands on a topic of higher priority stop another node for this time, this is reported
OVERRULED_TIME = 2.0


class Habit(Enum):
    """Kind of a finding."""

    DRIVES = "drives"  # the sender's commands move the robot; not a fault
    SLOW = "slow"  # the sender's commands expire before its next command
    ZEROS = "zeros"  # the sender's commands are all zero
    OVERRULED = "overruled"  # the sender's commands are stopped by zero commands of higher priority


class Finding(NamedTuple):
    """Habit of a node that sends commands."""

    habit: Habit
    sender: str  # name of the node
    topic: str
    rate: float = 0.0  # [1/s] number of commands per simulated second
    timeout: float = 0.0  # [s] age at which a command expires
    stronger_sender: str = ""  # name of the node that stops `sender` by commands of higher priority
    stronger_topic: str = ""


@dataclass
class _Sender:
    """Memory of one sender on one topic."""

    first: float  # [s] stamp of the sender's first command
    last: float  # [s] stamp of the sender's last command
    count: int = 0  # number of commands
    has_commanded_motion: bool = False  # true after the sender's first command that is not zero
    # [s] stamp of the first command that moved the robot after the last pause; None if there is none. The
    # rate of the sender is measured from there.
    moves_since: Optional[float] = None
    moves_count: int = 0  # number of commands after `moves_since`
    # [s] lengths of the last slow gaps, see SLOW_GAPS. A command that comes in time empties the list.
    slow_gaps: Tuple[float, ...] = ()
    # [s] stamp of the first command that was blocked by another topic; None if the last command was not
    # blocked
    overruled_since: Optional[float] = None


class _Command(NamedTuple):
    """Last command of a sender."""

    topic: str
    sender: str  # name of the node that sent the command
    is_zero: bool  # true if the command lets the robot stand
    stronger_topic: Optional[str]  # topic that is obeyed instead of `topic`; None if this command is obeyed


class CommandHabits:
    """Memory of the commands of each sender."""

    def __init__(self, timeout: float, may_stand: Callable[[str], bool]) -> None:
        """Begin without commands.

        Args:
            timeout: time after which a command expires [s].
            may_stand: function that takes the name of a node, and returns whether this node may send only
                zero commands, because it stops the robot on purpose.
        """
        self._timeout, self._may_stand = timeout, may_stand
        self._senders: Dict[Tuple[str, str], _Sender] = {}  # memory by topic and name of the sender
        # for each topic whose last command was zero, the sender of this command, for `Habit.OVERRULED`
        self._zero_senders: Dict[str, str] = {}
        # habits and names of senders that were reported; no habit of a sender is reported again
        self._reported: Set[Tuple[Habit, str]] = set()

    def note(
        self, stamp: float, topic: str, sender: str, is_zero: bool, stronger_topic: Optional[str] = None
    ) -> Iterator[Finding]:
        """Note a command, and yield new findings.

        Args:
            stamp: simulated time of the command [s].
            topic: topic of the command.
            sender: name of the node that sent the command.
            is_zero: true if the command lets the robot stand.
            stronger_topic: topic that is obeyed instead of `topic`; None if this command is obeyed.
        """
        memory = self._senders.setdefault((topic, sender), _Sender(first=stamp, last=stamp))
        gap = stamp - memory.last  # 0 for the first command of a sender
        memory.last = stamp
        memory.count += 1
        if is_zero:
            self._zero_senders[topic] = sender
        else:
            self._zero_senders.pop(topic, None)
            memory.has_commanded_motion = True
        command = _Command(topic, sender, is_zero, stronger_topic)
        findings = (
            self._driving(command, memory, gap),
            self._slow(command, memory, gap),
            self._zeros(command, memory),
            self._overruled(command, memory),
        )
        for finding in findings:
            if finding is not None and (finding.habit, sender) not in self._reported:
                self._reported.add((finding.habit, sender))
                yield finding

    def _driving(self, command: _Command, memory: _Sender, gap: float) -> Optional[Finding]:
        """Return the rate of a sender that has moved the robot for RATE_TIME without a pause.

        The rate is counted from the first command that moves the robot: it is not zero, and no stronger topic
        overrules it. `gap` is the time between the last two commands of the sender [s].
        """
        stamp = memory.last
        if gap > LONGEST_GAP:
            memory.moves_since = None
        if memory.moves_since is None:
            if not command.is_zero and command.stronger_topic is None:
                memory.moves_since = stamp
                memory.moves_count = 0
            return None
        memory.moves_count += 1
        duration = stamp - memory.moves_since
        if duration < RATE_TIME:
            return None
        return Finding(Habit.DRIVES, command.sender, command.topic, memory.moves_count / duration)

    def _slow(self, command: _Command, memory: _Sender, gap: float) -> Optional[Finding]:
        """Return the rate of a sender whose command had expired before each of its last SLOW_GAPS commands.

        The count of the gaps starts again after a command that comes in time, after a pause, and after a
        finding. `gap` is the time between the last two commands of the sender [s].
        """
        has_expired = self._timeout < gap <= LONGEST_GAP
        memory.slow_gaps = (*memory.slow_gaps, gap) if has_expired else ()
        if len(memory.slow_gaps) < SLOW_GAPS:
            return None
        rate = len(memory.slow_gaps) / sum(memory.slow_gaps)
        memory.slow_gaps = ()
        return Finding(Habit.SLOW, command.sender, command.topic, rate, self._timeout)

    def _zeros(self, command: _Command, memory: _Sender) -> Optional[Finding]:
        """Return a finding if a sender has sent many commands over some time, and all of them were zero.

        A node that stops the robot on purpose may do so.
        """
        has_sent_many = memory.last - memory.first >= ZEROS_TIME and memory.count >= ZEROS_COUNT
        if not has_sent_many or memory.has_commanded_motion or self._may_stand(command.sender):
            return None
        return Finding(Habit.ZEROS, command.sender, command.topic)

    def _overruled(self, command: _Command, memory: _Sender) -> Optional[Finding]:
        """Return a finding if zero commands on a stronger topic have stopped a sender for OVERRULED_TIME.

        The sender wants to move the robot, and another node holds the robot, which is also named.
        """
        stronger_topic = command.stronger_topic or ""  # empty if no stronger topic overrules the command
        # name of the node whose last command on the stronger topic is zero; None if there is no such node
        holder = self._zero_senders.get(stronger_topic)
        if command.is_zero or not holder:
            memory.overruled_since = None
            return None
        if memory.overruled_since is None:
            memory.overruled_since = memory.last
        if memory.last - memory.overruled_since < OVERRULED_TIME:
            return None
        return Finding(
            Habit.OVERRULED,
            command.sender,
            command.topic,
            stronger_sender=holder,
            stronger_topic=stronger_topic,
        )


def habit_sentence(finding: Finding) -> str:
    """Return a finding as a sentence for the log."""
    sender, topic = finding.sender, finding.topic
    if finding.habit is Habit.DRIVES:
        return f"{sender} drives the robot by {topic}, {finding.rate:.3g} commands per second"
    if finding.habit is Habit.SLOW:
        return (
            f"{sender} sends {finding.rate:.1f} commands per second of simulated time on {topic}, but a "
            f"command expires after {finding.timeout:g} s, so the robot stops between two commands. Send at "
            "10 Hz or more: shorten the callback, do not sleep in it, and set queue_size to 1"
        )
    if finding.habit is Habit.ZEROS:
        return (
            f"{sender} has sent only zero commands on {topic} for {ZEROS_TIME:g} s, so the robot stands. "
            "Check the parameters and the conditions of the node"
        )
    # the only other habit is OVERRULED
    return (
        f"{finding.stronger_sender} holds the robot with zero commands on {finding.stronger_topic}, which "
        f"has priority over {topic}, so {sender} does not drive it. End {finding.stronger_sender}, or let it "
        "pause"
    )
