"""Lockstep: holds the simulated clock until a command has answered the last scan.

In: calls when a scan is sent, when the clock ticks, and when a command arrives. Out: waits of the thread that
owns the simulation. `LeadLimit` is for unlimited speed without lockstep.
"""

from __future__ import annotations

import threading
import time
from enum import Enum
from typing import Callable, Optional, Set

import rospy

from husky_highlevel_controller.ros.simulator.graph import Partners
from husky_highlevel_controller.ros.simulator.listeners import Listeners

PARTNER_TIMEOUT = 60.0  # [s] longest wall time for which the start of simulated time waits for a controller
# [s] if no command answers a scan within this wall time, lockstep ends with a warning
ANSWER_TIMEOUT = 5.0
# [s] if the very first command has not come after this wall time, the scan is sent again
RESEND_TIMEOUT = 1.0
# [s] If an idle controller sends no command for this wall time, the simulator moves the clock to just before
# the next tick (a nudge). If no command comes for this wall time after the nudge, the controller counts as
# asleep.
SLEEP_TIMEOUT = 0.3
# [s] longest wait at a tick until all subscribers are idle. After a wait of this length there are no more
# waits at ticks, because some subscribers, such as RViz, are never idle.
WATCH_TIMEOUT = 1.0
POLL_PERIOD = 0.05  # [s] during a wait, wall time between two checks for service calls
# [s] wall time between two checks whether all nodes are connected; more checks would slow down nodes that are
# starting
PARTNERS_POLL_PERIOD = 0.02

MAX_LEAD = 2  # number of scans without a command after which the simulator waits for the controller
# [s] if a controller does not answer within this wall time, the simulator no longer waits for the controller
CONTROLLER_TIMEOUT = 0.1
# if the simulator no longer waits for a slow controller, it waits again after the controller has answered
# this many scans in a row
FOLLOWING_SCANS = 10

AWAKE = 10  # number of scans that a controller must answer in a row to count as awake


class _Watch(Enum):
    """For how long the simulator watches the listeners: it waits at each tick until all of them are idle.

    The listeners are the processes that receive the scans or the clock. A tick is a message on /clock. While
    a controller sleeps, the listeners are watched in any case.
    """

    UNTIL_ANSWERS = 1  # the listeners are watched until the controller has answered AWAKE scans in a row
    ALWAYS = 2  # the listeners are always watched, because the controller sends commands at ticks
    NEVER = 3  # the listeners are not watched; the simulator waits only for an answer to each scan


class Lockstep:
    """Makes simulated time wait after each scan for one command, so that a run is the same on a busy machine.

    A controller may sleep by simulated time, for example in rospy.sleep. It answers no scan during its sleep,
    so the simulator then does not wait for a command.

    On a busy machine, such a sleep begins by chance before or after a tick of the clock. So the simulator
    watches the listeners (`_Watch`): at each tick and after each answer, it waits until none of their threads
    runs. A controller that has answered AWAKE scans in a row does not sleep, so it is no longer watched.

    If an answer does not come for ANSWER_TIMEOUT, lockstep ends with a warning.
    """

    def __init__(
        self, is_on: bool, listeners: Listeners, tell: Callable[[str, str], None] = lambda *_: None
    ) -> None:
        """Set up; no scan has been sent yet.

        Args:
            is_on: whether the clock waits at all.
            listeners: nodes that receive the scans or the clock; they show whether a controller sleeps.
            tell: function that gets a kind and a sentence when an answer does not come. In the sentence, "it"
                is the controller. The kind is "asleep" for each scan that a sleeping controller does not
                answer, and "unanswered" once, when lockstep ends.
        """
        self._is_on = is_on  # false if lockstep is off or has ended; then the simulator never waits
        # true while the controller sleeps by simulated time; then the simulator waits for no command
        self._is_asleep = False
        # for how long the listeners are watched; it counts only while the controller does not sleep
        self._watch = _Watch.UNTIL_ANSWERS
        self._listeners = listeners
        # tells the recorder of a graded run that an answer does not come: gets a kind and a sentence
        self._tell = tell
        self._answered = threading.Event()  # set if a command has come since the last call of `begin_scan`
        # topics on which a command has come since the last scan; None before the first scan
        self._answered_topics: Optional[Set[str]] = None
        self._has_commanded = False  # true if any command has come so far
        # true during a physics step with a scan, from `begin_scan` until the end of `wait_for_answer`
        self._is_in_scan_step = False
        self._answered_in_a_row = 0  # number of scans in a row that were answered

    @property
    def _is_watching(self) -> bool:
        """Return whether the simulator waits at each tick, and after each scan, for idle listeners."""
        return self._is_on and (self._is_asleep or self._watch is not _Watch.NEVER)

    def drops(self, topic: str) -> bool:
        """Return whether to ignore a command, because an earlier command on its topic has answered the scan.

        The next physics step begins after the first command. It depends on the load of the machine whether a
        second command arrives before or after this step, so a run that obeyed it would not be repeatable.
        While the listeners are watched, no command is ignored, because the step waits until they are idle.
        """
        if not self._is_on or self._is_watching:
            return False
        return topic in (self._answered_topics or ())

    def command_arrived(self, topic: str) -> None:
        """Count a command on any velocity topic as an answer to the last scan, which ends the wait for it.

        Any thread may call this.
        """
        if self._answered_topics is not None:  # None means that there is no scan to answer yet
            self._answered_topics.add(topic)
        self._has_commanded = True
        self._answered.set()

    def wait_for_partners(self, partners: Partners, meanwhile: Callable[[], None]) -> None:
        """Wait until controller and subscribers are connected; `meanwhile` is called again and again.

        If they do not come within PARTNER_TIMEOUT, lockstep ends with a warning. Without lockstep, there is
        no wait.
        """

        def have_joined() -> bool:
            """Serve calls, and return whether all partners are connected."""
            meanwhile()
            return partners.joined()

        if not self._is_on:
            return
        rospy.loginfo(
            f"lockstep: waiting for a subscriber of {partners.scan_topic} and a sender of "
            f"{partners.command_topics}"
        )
        missing = f"there is no subscriber of {partners.scan_topic} or no sender of {partners.command_topics}"
        self._wait_or_end_lockstep(have_joined, PARTNER_TIMEOUT, missing, period=PARTNERS_POLL_PERIOD)

    def begin_scan(self) -> None:
        """Forget earlier commands, so that they do not count as answers; call this before a scan is sent."""
        self._is_in_scan_step = True
        self._answered_topics = set()
        self._answered.clear()

    def wait_for_answer(
        self, meanwhile: Callable[[], None], resend: Callable[[], None], nudge: Callable[[], None]
    ) -> None:
        """Wait until a command has arrived since `begin_scan`; call this after the scan was sent.

        If the controller sleeps by simulated time, no command can come before the clock goes on. So the wait
        also ends without a command if the controller is found to sleep.

        Args:
            meanwhile: serves service calls; it is called again and again during the wait.
            resend: sends the scan again. The very first command of a controller may be lost while its
                publisher connects, so the scan is sent again if no command has come so far.
            nudge: publishes a time just before the next tick, without a physics step. A controller that
                sleeps until a time between two ticks wakes up.
        """
        if not self._is_on:
            return
        if not self._is_asleep:
            self._wait_for_command(meanwhile, resend, nudge)
        # the controller may begin a sleep after its command, and the clock must not go on before this sleep
        self._wait_until_idle(meanwhile)
        # A controller that has never sent a command is not reported as asleep, because it may be waiting for
        # a call of its start service.
        if self._is_on and self._is_asleep and self._has_commanded and not self._answered.is_set():
            self._tell(
                "asleep", "it does not answer every scan with a command, so scans continue while it sleeps"
            )
        self._is_in_scan_step = False
        self._count_answers()

    def _count_answers(self) -> None:
        """Count the scans that were answered in a row; after AWAKE of them, no controller is asleep.

        A controller that answers every scan need not be watched, unless it sends commands at ticks.
        """
        if not self._answered.is_set():
            self._answered_in_a_row = 0
            return
        self._answered_in_a_row += 1
        if self._answered_in_a_row >= AWAKE:
            self._is_asleep = False
            if self._watch is _Watch.UNTIL_ANSWERS:
                self._watch = _Watch.NEVER

    def tick(self, meanwhile: Callable[[], None], again: Callable[[], None]) -> None:
        """Wait until the listeners have done their work at this tick; call this after each tick of the clock.

        Args:
            meanwhile: serves service calls; it is called again and again during the wait.
            again: sends the tick once more. rospy.sleep first reads the clock, and then waits for the next
                tick, so it misses a tick that comes between the two.
        """
        self._wait_until_idle(meanwhile)
        if self._is_watching:
            again()
            self._wait_until_idle(meanwhile)
        if self._watch is _Watch.UNTIL_ANSWERS and self._has_commanded_at_tick():
            self._watch = _Watch.ALWAYS

    def _has_commanded_at_tick(self) -> bool:
        """Return whether a command has come at this tick, before the scan of this step is sent.

        Such a command does not answer a scan. At a tick without a scan, the result is always false, because
        a command that has come may be the answer to the last scan.
        """
        return self._is_in_scan_step and self._answered.is_set()

    def _wait_for_command(
        self, meanwhile: Callable[[], None], resend: Callable[[], None], nudge: Callable[[], None]
    ) -> None:
        """Wait for the command that answers a scan, or until the controller is found to sleep.

        If no command comes, one attempt is made to get a command:

        - Before the very first command, the scan is sent again after RESEND_TIMEOUT, because the scan or the
          command may have been lost while the nodes connected.
        - Later, if the listeners are idle after SLEEP_TIMEOUT, the clock is nudged, because the controller
          may sleep until a time between two ticks. A controller that then sends a command works at ticks, so
          it is always watched from then on.

        When SLEEP_TIMEOUT has passed since the attempt, and the listeners are idle, and still no command has
        come, the controller counts as asleep.
        """
        if self._answered.is_set():
            return
        is_before_first_command = not self._has_commanded
        missing, began_at = "no command answers the scan", time.monotonic()

        def is_answered() -> bool:
            """Serve calls, and return whether the command comes within POLL_PERIOD."""
            meanwhile()
            return self._answered.wait(POLL_PERIOD)

        def seems_asleep() -> bool:
            """Return whether the listeners are idle and have not sent the command."""
            # the command may come while `asleep` looks at the listeners, so the command is checked last
            return self._listeners.asleep() and not self._answered.is_set()

        def is_attempt_due() -> bool:
            """Return whether it is time to resend the scan, or to nudge the clock."""
            waited = time.monotonic() - began_at  # [s]
            if is_before_first_command:
                # only the time decides, because a controller that is starting may look idle
                return waited > RESEND_TIMEOUT
            return waited > SLEEP_TIMEOUT and seems_asleep()

        self._wait_or_end_lockstep(lambda: is_answered() or is_attempt_due(), ANSWER_TIMEOUT, missing)
        if self._answered.is_set() or not self._is_on or rospy.is_shutdown():
            return
        attempted_at = time.monotonic()
        if is_before_first_command:
            resend()
        else:
            nudge()

        def has_attempt_failed() -> bool:
            """Return whether the controller has had time to answer the attempt, and is idle."""
            return time.monotonic() - attempted_at > SLEEP_TIMEOUT and seems_asleep()

        self._wait_or_end_lockstep(
            lambda: is_answered() or has_attempt_failed(), ANSWER_TIMEOUT, missing, began_at=began_at
        )
        if self._answered.is_set():
            if not is_before_first_command:
                self._watch = _Watch.ALWAYS  # the command came only when the nudge moved the clock
        elif self._is_on:
            self._is_asleep = True
            rospy.loginfo_once("lockstep: a controller is sleeping; advancing one scan at a time")

    def _wait_until_idle(self, meanwhile: Callable[[], None]) -> None:
        """Wait until the listeners are idle; return at once if they are not watched.

        During a controller's sleep, lockstep ends if they are not idle within ANSWER_TIMEOUT. Otherwise they
        are no longer watched if they are not idle within WATCH_TIMEOUT, because some of them, such as RViz,
        are never idle.
        """

        def are_idle() -> bool:
            """Serve calls, and return whether no listener works."""
            meanwhile()
            return self._listeners.asleep()

        if not self._is_watching:
            return
        if self._is_asleep:
            self._wait_or_end_lockstep(
                are_idle, ANSWER_TIMEOUT, "a controller that sleeps between scans is still busy"
            )
            return
        end = time.monotonic() + WATCH_TIMEOUT
        while not are_idle():
            if time.monotonic() >= end or rospy.is_shutdown():
                self._watch = _Watch.NEVER
                return
            time.sleep(0.001)

    def _wait_or_end_lockstep(
        self,
        done: Callable[[], bool],
        timeout: float,
        missing: str,
        period: float = 0.001,
        began_at: Optional[float] = None,
    ) -> None:
        """Wait until `done` returns true; after `timeout` [s] of wall time, end lockstep.

        Args:
            done: function that is called again and again until it returns true; during the wait, it also
                serves service calls.
            timeout: longest wait, wall time [s].
            missing: part of the warning that lockstep ends; it says what has not come.
            period: wall time between two calls of `done` [s].
            began_at: wall time at which the wait has begun [s]; None if it begins now.
        """
        end = (time.monotonic() if began_at is None else began_at) + timeout
        while self._is_on and not rospy.is_shutdown() and not done():
            if time.monotonic() > end:
                rospy.logwarn(
                    f"lockstep: after {timeout:g} s of wall time {missing}; continuing without lockstep"
                )
                self._tell(
                    "unanswered",
                    "it does not answer every scan with a command, so scans continued without it",
                )
                self._is_on = False  # ends this loop
            time.sleep(period)


class LeadLimit:
    """Lets the simulation be MAX_LEAD scans ahead of the controller's answers, and no more.

    It is used at unlimited speed without lockstep. Without this limit, at 20 times real time, the robot would
    drive blindly for 0.4 s if the controller got no CPU for 20 ms. The simulation does not wait for a
    controller that answers only some of the scans.
    """

    def __init__(self, is_on: bool) -> None:
        """Set up; without `is_on`, the simulation never waits."""
        self._is_on = is_on
        # true while the controller answers scans in time, as at first; the simulation does not wait for a
        # controller that is always late
        self._follows = is_on
        self._arrived = threading.Event()  # set if a command has come since the last scan
        self._lead = 0  # number of scans sent since the last command
        self._answered_in_a_row = 0  # number of scans in a row that were answered

    def command_arrived(self) -> None:
        """Take any velocity command as an answer to the scans so far; any thread may call this."""
        self._arrived.set()

    def before_scan(self) -> None:
        """Wait for a controller that is MAX_LEAD scans behind; call this before a scan is sent.

        The wait takes CONTROLLER_TIMEOUT at most. After a wait without an answer there are no more waits
        until the controller has answered FOLLOWING_SCANS scans in a row.
        """
        if not self._is_on:
            return
        if self._arrived.is_set():
            self._lead = 0
            self._answered_in_a_row += 1
        else:
            self._lead += 1
            self._answered_in_a_row = 0
        if self._follows and self._lead >= MAX_LEAD:
            self._follows = self._arrived.wait(CONTROLLER_TIMEOUT)  # false if no command came in this time
            self._lead = 0  # the next wait comes only after MAX_LEAD more unanswered scans
        if self._answered_in_a_row >= FOLLOWING_SCANS:
            self._follows = True  # the controller answers again, so the simulation may wait for it again
        self._arrived.clear()
