"""Exercise 5: a service stops and starts the robot, and marking calls it during the run."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from husky_grading.displays import RvizView
from husky_grading.exercises.exercise import Exercise
from husky_grading.exercises.watch import DriveState, RosAccess, Watch
from husky_grading.notes import Kind, Note, Subject
from husky_grading.recording import Recording
from husky_grading.records import DEFAULT_RULES, Item, Rules
from husky_grading.rubrics.causes import (
    KEEP_AS_MEMBER,
    causes,
    first_cause,
    hint_on,
    with_cause,
)
from husky_grading.rubrics.items import by_hand, forfeited, weighted
from husky_highlevel_controller.config import to_plain

STOPS_ROBOT = "service stops the robot"
STARTS_ROBOT = "service starts it again"
BONUSES = ("bonus: stops before a crash", "bonus: stops after a crash")
ITEMS = (STOPS_ROBOT, STARTS_ROBOT, *BONUSES)
BEFORE = 0.5  # [s] the speed before a call is the highest speed within this simulated time before the call
# [s] the speed after a call is the highest speed between these two simulated times after the answer
EFFECT_BEGIN, EFFECT_END = 1.5, 4.0
# a node counts as a caller of the service if it has asked the ROS master for the service's address at least
# this often; a node that only waits for the service asks less often
MANY = 5
# [m/s] the robot stands up to the speed STANDING_SPEED, and drives from the speed DRIVING_SPEED on
STANDING_SPEED, DRIVING_SPEED = 0.05, 0.1
SET_BOOL = "std_srvs/SetBool"
# Values of the four calls; a submission may stop at False and start at True, or the other way round. The
# first value that stops the robot is sent twice, because a second stop must not start the robot.
CALLS = (False, True, False, True)
# [s] the first call comes FIRST_CALL after the robot has begun to drive, but at the latest at the simulated
# time LATEST_FIRST_CALL
FIRST_CALL, LATEST_FIRST_CALL = 1.0, 8.0
# [s] a submission that obeys a stop may still send commands for this simulated time after the call
OBEYED = 0.5
NO_SERVICE = 25.0  # [s] the run is over if the submission has offered no service by this simulated time
# hints
SERVICE = f"advertise a service of type std_srvs/SetBool in the constructor, and {KEEP_AS_MEMBER}"
STOP = (
    "keep the request in a member, and let each callback of the scans send a zero twist while it means stop"
)
NEITHER = f"{STOP}; check that no other node of yours calls the service or sends velocities, too"
OTHER_CALLER = (
    f"check the calls of that node, because they come between those of the grader; otherwise {STOP}"
)
START = "let the other request clear that member, so that the callback of the scans drives again"


@dataclass(frozen=True)
class Call:
    """Call of a start/stop service."""

    at: float  # [s] simulated time of the call
    data: bool  # value of the request, which means stop or start
    success: bool
    answer: str  # text of the service's answer, or the error of the call
    # [s] simulated time of the answer; on a busy machine, the answer may come more than a second after the
    # call
    answered_at: float
    is_error: bool = False  # true if the call failed, and `answer` is its error; older recordings have False


@dataclass(frozen=True)
class ServiceCalls:
    """Services that the submission offers, and the calls that `grade` made."""

    services: Tuple[str, ...] = ()  # names of the services of type std_srvs/SetBool
    other_services: Tuple[str, ...] = ()  # services of other types, as "/name (package/Type)"
    calls: Tuple[Call, ...] = ()
    # for each node of the submission, number of times that it asked the ROS master for the service's address;
    # a node does this once for each call
    callers: Mapping[str, int] = field(default_factory=dict)


@dataclass
class CallPlan:
    """Plan of the calls of one run: the values CALLS, each sent after the effect of the call before it.

    The first value that stops the robot is sent once more.
    """

    to_send: List[bool] = field(default_factory=lambda: list(CALLS))  # values that are not sent yet
    last_value: Optional[bool] = None  # value of the last call; None before the first call
    drove_at_last_call: bool = False  # true if the robot drove when the last call was made
    has_repeated: bool = False  # true if a value was sent once more
    # [s] simulated time from which the next call may be made; inf while the last call has no answer
    next_call_at: float = LATEST_FIRST_CALL

    def due(self, now: float, speed: float) -> Optional[bool]:
        """Return the value to send now [s], and count this call as made; None if no call is due.

        `speed` is the robot's speed [m/s].
        """
        drives, stands = abs(speed) > DRIVING_SPEED, abs(speed) <= STANDING_SPEED
        is_before_first_call = self.last_value is None
        if is_before_first_call and drives:
            self.next_call_at = min(self.next_call_at, now + FIRST_CALL)
        if now < self.next_call_at:
            return None
        has_last_call_stopped_it = self.drove_at_last_call and stands
        if has_last_call_stopped_it and not self.has_repeated:
            value = self.last_value
            self.has_repeated = True
        elif self.to_send:
            value = self.to_send.pop(0)
        else:
            return None
        self.last_value, self.drove_at_last_call = value, drives
        self.next_call_at = inf
        return value

    def answered(self, now: float) -> None:
        """Note that the last call was answered at this time [s], or will not be answered."""
        # until this time, the effect of the last call is measured, so no other call may change it
        self.next_call_at = now + EFFECT_END

    def reason(self, now: float, has_service: bool) -> Optional[Note]:
        """Return why the run is over at this time [s], or None if it goes on."""
        if not has_service and now > NO_SERVICE:
            return Note(Kind.NO_SERVICE, f"it offered no start/stop service for {NO_SERVICE:g} s")
        if not self.to_send and now >= self.next_call_at:
            return Note(Kind.PLAN_DONE, "all calls are made")
        return None


class ServiceWatch(Watch):
    """Calls the start/stop service of the submission at the times of a `CallPlan`."""

    def __init__(self, initial: Recording, ros: RosAccess) -> None:
        super().__init__(initial, ros)
        self._plan = CallPlan()
        self._waiting_call: Optional[Call] = None  # call that waits for its answer; None if no call waits
        self._calls: List[Call] = []
        self._types: Dict[str, str] = {}  # types of the submission's services, by their names

    def look(self, state: DriveState) -> Optional[Note]:
        """Call the service if a call is due, and return why the run is over, or None if it goes on."""
        return self._follow_plan(state) or super().look(state)

    def _follow_plan(self, state: DriveState) -> Optional[Note]:
        """Take the answer of the last call, make the call that is due, and return why the run is over.

        Return None if the run goes on.
        """
        # the type of a new service may be unknown at first, so the types are asked for each time
        self._types.update(self._ros.service_types(state.services))
        if self._waiting_call:
            answer = self._ros.answer()
            if answer is None:  # the answer has not come yet, so the run goes on
                return None
            self._calls.append(
                replace(
                    self._waiting_call,
                    success=answer.success,
                    answer=answer.text,
                    answered_at=state.now,
                    is_error=answer.is_error,
                )
            )
            self._plan.answered(state.now)
            self._waiting_call = None
        services = self._start_stop_services()
        value = self._plan.due(state.now, state.speed) if services else None
        if value is None:
            return self._plan.reason(state.now, has_service=bool(services))
        # the values from `success` on are placeholders until the answer comes
        self._waiting_call = Call(state.now, value, success=False, answer="", answered_at=state.now)
        self._ros.call(services[0], value)  # all calls go to the first service, even if there are several
        return None

    def has_silenced(self, last_command: float) -> bool:
        """Return whether a call may be the reason why no command came after `last_command` [s, simulated].

        Then the missing commands are not a fault. A student chooses which value stops the robot, so each call
        may have asked for a stop. A call long after `last_command` counts, too, because it may be the reason
        for the rest of the silence.
        """
        calls = list(self._calls)
        if self._waiting_call:
            calls.append(self._waiting_call)
        return any(call.at >= last_command - OBEYED for call in calls)

    def _start_stop_services(self) -> List[str]:
        """Return the names of the services that can start and stop the robot, in alphabetical order."""
        return sorted(name for name, kind in self._types.items() if kind == SET_BOOL)

    def kept(self) -> Dict[str, Any]:
        """Return the services and calls of the run, as plain values for the recording."""
        services = self._start_stop_services()
        others = tuple(sorted(f"{name} ({kind})" for name, kind in self._types.items() if kind != SET_BOOL))
        callers = self._ros.callers(services[0]) if services else {}  # `grade` has called only the first one
        observed = ServiceCalls(tuple(services), others, tuple(self._calls), callers)
        plain: Dict[str, Any] = to_plain(observed)
        return plain


@dataclass(frozen=True)
class Effect:
    """A call, and the robot's speed before and after it."""

    call: Call
    before: float  # [m/s] highest speed just before the call
    after: float  # [m/s] highest speed after the call, when the robot has had time to react

    @property
    def drove_before(self) -> bool:
        """Return whether the robot drove before the call."""
        return self.before >= DRIVING_SPEED

    @property
    def stopped(self) -> bool:
        """Return whether the robot drove before the call and stands after it."""
        return self.drove_before and self.after <= STANDING_SPEED


def judge_calls(recording: Recording) -> List[Item]:
    """Grade whether the calls of the service stop the robot (50 points) and start it again (50 points).

    An item gets half of its points if only some calls work. The submission chooses which value of the request
    stops, so the grader finds it by the effects. A person grades an item if no call could show the effect.
    """
    stop = Item(STOPS_ROBOT, 0.0, 50.0, "", hint=STOP, subject=Subject.SERVICE)
    start = replace(stop, name=STARTS_ROBOT, hint=START)
    # services of the submission, and the calls that `grade` made
    observed = recording.watched_as(ServiceCalls)
    if not observed.calls:
        return _judge_no_calls([stop, start], recording, observed)
    # name of the service in the report
    service = observed.services[0] if observed.services else "its service"
    all_effects = _measure_effects(recording, observed.calls)  # speeds before and after each call
    if not all_effects:
        evidence = by_hand(f"{service}: the run ended before the effect of a call could be seen")
        return [replace(item, points=None, evidence=evidence) for item in (stop, start)]
    effects, restarts = _without_repeats(all_effects), _find_restarts(all_effects)
    while_driving = [effect for effect in effects if effect.drove_before]
    if not while_driving:
        return _judge_from_rest(stop, start, service, recording, effects)
    if not any(effect.stopped for effect in while_driving):
        return _judge_no_stop(stop, start, service, while_driving, observed)
    return _judge_after_stop(stop, start, service, effects, restarts)


def _without_repeats(effects: Sequence[Effect]) -> List[Effect]:
    """Return the effect of the first call, and of each call with another value than the call before it."""
    pairs = zip(effects, effects[1:])
    changes = [effect for previous, effect in pairs if effect.call.data is not previous.call.data]
    return [*effects[:1], *changes]


def _find_restarts(effects: Sequence[Effect]) -> List[Effect]:
    """Return the effects of calls that start the robot by the value that has just stopped it.

    The service then ignores the value, and each call only switches between standing and driving.
    """
    restarts = []
    for previous, effect in zip(effects, effects[1:]):
        is_repeat = effect.call.data is previous.call.data
        if is_repeat and previous.stopped and effect.after >= DRIVING_SPEED:
            restarts.append(effect)
    return restarts


def _judge_no_calls(items: Sequence[Item], recording: Recording, observed: ServiceCalls) -> List[Item]:
    """Return the items of a run in which no service was called, most often because there is none.

    `items` are the items on stops and starts, without evidence. They get no points, or are graded by hand if
    the submission has services of other types.
    """
    evidence = "no std_srvs/SetBool service"
    if observed.services:  # the run ended before the first call
        evidence = f"{observed.services[0]} was not called"
    elif observed.other_services:
        evidence = by_hand(f"{evidence}, but {', '.join(observed.other_services)}")
        return [replace(item, points=None, evidence=evidence, hint="") for item in items]
    hint = SERVICE
    reasons = causes(recording)
    if reasons:  # such as a node that has crashed
        evidence += f": {reasons[0].text}"
        hint = hint_on(reasons[0])
    return [replace(item, evidence=evidence, hint=hint) for item in items]


def _judge_after_stop(
    stop: Item, start: Item, service: str, effects: Sequence[Effect], restarts: Sequence[Effect]
) -> List[Item]:
    """Return both items of a robot that at least one call has stopped.

    Args:
        stop: item on stops, without evidence.
        start: item on starts, without evidence.
        service: name of the service.
        effects: effects of all calls except repeats of a value; at least one has stopped the robot.
        restarts: effects of calls that start the robot by the value that has just stopped it.
    """
    stop_value = restarts[0].call.data if restarts else _stopping_value(effects)
    # a call to a robot that already stood proves nothing about stops
    stops = [effect for effect in effects if effect.call.data is stop_value and effect.drove_before]
    # a restart is a failed stop, because the robot drives after the value for a stop
    stops += restarts
    failed_stops = [effect for effect in stops if not effect.stopped]
    stop = _with_points(stop, f"{service}: stands", stops, failed_stops)
    starts = _starts_after_stops(effects, stop_value)
    if restarts and not starts:
        value = str(stop_value).lower()
        evidence = by_hand(f"{service}: it ignores its value, because a second {value} starts the robot")
        return [stop, replace(start, points=None, evidence=evidence)]
    return [stop, _judge_starts(start, service, starts)]


def _starts_after_stops(effects: Sequence[Effect], stop_value: bool) -> List[Effect]:
    """Return the effects of the calls that ask a stopped robot to start.

    Such a call has the other value than `stop_value`. It counts only if the call before it has stopped the
    robot, and if the robot still stands.
    """
    starts = []
    for previous, effect in zip(effects, effects[1:]):
        is_start = effect.call.data is not stop_value
        if is_start and previous.stopped and not effect.drove_before:
            starts.append(effect)
    return starts


def _judge_no_stop(
    stop: Item, start: Item, service: str, effects: Sequence[Effect], observed: ServiceCalls
) -> List[Item]:
    """Return both items of a robot that drives on after every call, whichever value the call has.

    They get no points, or are graded by hand if the submission has another service that may stop the robot.

    Args:
        stop: item on stops, so far with 0 points and without evidence.
        start: item on starts, so far with 0 points and without evidence.
        service: name of the service.
        effects: effects of the calls to a driving robot, at least one.
        observed: services of the submission, and nodes that call them.
    """
    if len(observed.services) > 1:  # `grade` has called only the first one
        others = ", ".join(observed.services[1:])
        evidence = by_hand(f"{service} stops nothing, and {others} of the same type was not called")
        # the hints do not apply, because nothing of the other service is known
        return [replace(item, points=None, evidence=evidence, hint="") for item in (stop, start)]
    # two calls are enough for the sentence, because most often one of them has true and the other has false
    speeds = [f"{effect.after:.2f} m/s after {str(effect.call.data).lower()}" for effect in effects[:2]]
    evidence, hint = f"{service}: neither value stops it: {', '.join(speeds)}", NEITHER
    first_call = effects[0].call
    # the text of the answer may say why the service has not obeyed
    if first_call.answer and not first_call.success:
        evidence += f" ({first_call.answer})"
    # Another node of the submission may call the service, too, and undo the calls of `grade`. Each call of a
    # service looks it up, so the number of lookups shows such a node.
    other_callers = [
        f"{node} has looked it up {count} times" for node, count in observed.callers.items() if count >= MANY
    ]
    if other_callers:
        evidence += f"; {', '.join(other_callers)}; each call of a service looks it up"
        hint = OTHER_CALLER
    return [
        replace(stop, evidence=evidence, at=first_call.at, hint=hint),
        replace(start, evidence=f"{service}: no call had stopped it, so none could start it", hint=hint),
    ]


def _stopping_value(effects: Sequence[Effect]) -> bool:
    """Return the value that stops the robot: after this value, it is slower than after the other value."""
    speeds_after: Dict[bool, List[float]] = {False: [], True: []}  # [m/s] speeds after calls with each value
    for effect in effects:
        if effect.drove_before:
            speeds_after[effect.call.data].append(effect.after)
    # if a value was never sent to a driving robot, its mean speed is inf, so the other value counts as the
    # one that stops the robot
    mean_after_true = np.mean(speeds_after[True] or [np.inf])
    mean_after_false = np.mean(speeds_after[False] or [np.inf])
    return bool(mean_after_true < mean_after_false)


def _measure_effects(recording: Recording, calls: Sequence[Call]) -> List[Effect]:
    """Return the effect of each call for which the recording has moments before and after."""
    speeds = np.abs(recording.speeds[:, 0])  # (N,) [m/s] speed at each recorded time
    effects = []
    for call in calls:
        # (N,) true at the moments just before the call
        before = (recording.times >= call.at - BEFORE) & (recording.times <= call.at)
        seconds_since_answer = recording.times - call.answered_at
        # (N,) true at the moments after the answer at which the robot has had time to react
        after = (seconds_since_answer >= EFFECT_BEGIN) & (seconds_since_answer <= EFFECT_END)
        if before.any() and after.any():
            effects.append(Effect(call, float(speeds[before].max()), float(speeds[after].max())))
    return effects


def _judge_starts(item: Item, service: str, effects: Sequence[Effect]) -> Item:
    """Return the item on starts, by the effects of calls to a robot that an earlier call had stopped.

    `service` is the name of the service.
    """
    if not effects:
        return replace(item, evidence=f"{service}: no call had stopped it, so none could start it again")
    failures = [effect for effect in effects if effect.after < DRIVING_SPEED]
    return _with_points(item, f"{service}: drives", effects, failures)


def _judge_from_rest(
    stop: Item, start: Item, service: str, recording: Recording, effects: Sequence[Effect]
) -> List[Item]:
    """Return both items of a robot that stood before every call.

    A person grades the stops, because such a robot cannot show them. A person also grades the starts, because
    a robot that drives only after a call may obey the service. But a robot that never drives gets no points
    for the starts.

    Args:
        stop: item on stops, without evidence.
        start: item on starts, without evidence.
        service: name of the service.
        recording: recording of the run.
        effects: effects of all calls except repeats of a value.
    """
    stop = replace(
        stop, points=None, evidence=by_hand(f"{service}: the robot already stood before each call")
    )
    if any(effect.after >= DRIVING_SPEED for effect in effects):
        evidence = by_hand(f"{service}: it drives after a call, but no call had stopped it before")
        return [stop, replace(start, points=None, evidence=evidence)]
    if not (np.abs(recording.speeds[:, 0]) >= DRIVING_SPEED).any():
        return [stop, with_cause(start, f"{service}: it never drives", first_cause(recording))]
    evidence = by_hand(f"{service}: it had stopped by itself before the first call")
    return [stop, replace(start, points=None, evidence=evidence)]


def _with_points(item: Item, reaction: str, effects: Sequence[Effect], failures: Sequence[Effect]) -> Item:
    """Return an item with all, half or none of its points if all, some or none of the calls worked.

    Args:
        item: item without evidence.
        reaction: beginning of the evidence, such as "/start_stop: stands".
        effects: effects of the calls that are graded, at least one.
        failures: effects of the graded calls that did not work.
    """
    successes = len(effects) - len(failures)
    evidence = f"{reaction} after {successes} of {len(effects)} calls"
    shown_call = effects[0].call
    if failures:  # the evidence shows the first call that did not work
        shown_call, speed = failures[0].call, failures[0].after
        value = str(shown_call.data).lower()
        evidence += f"; after {value} at {shown_call.at:.2f} s it drives at {speed:.2f} m/s"
        if shown_call.answer and not shown_call.success:  # the answer may say why the call failed
            evidence += f" ({shown_call.answer})"
    errors = [effect.call.answer for effect in effects if effect.call.is_error]
    # the robot obeys, but the service answers with an error; this costs no points
    if errors and not failures:
        evidence += f", but {len(errors)} of them had an error: {errors[0]}"
    share = 0.0
    if not failures:
        share = 1.0
    elif successes:
        share = 0.5
    return replace(item, points=share * item.max_points, evidence=evidence, at=shown_call.at)


def judge_exercise_5(
    recordings: Sequence[Recording], _view: RvizView, _scan_topic: str, rules: Rules = DEFAULT_RULES
) -> List[Item]:
    """Return the items of exercise 5: 50 and 50 points, and two bonuses by hand."""
    recording = recordings[0]  # this exercise has a single run
    items, observed = judge_calls(recording), recording.watched_as(ServiceCalls)
    # a robot that stands all the time cannot show that the service stops it, so it gets no points
    drives = (np.abs(recording.speeds[:, 0]) > DRIVING_SPEED).any()
    # the teacher grades a submission by hand if its services have other types than std_srvs/SetBool
    has_only_other_types = bool(observed.other_services) and not observed.services
    if not drives and not has_only_other_types:
        stop, start = items
        cause = first_cause(recording)
        stop = with_cause(replace(stop, points=0.0), "it never drives, so it cannot be stopped", cause)
        items = [stop, replace(start, points=0.0, hint=stop.hint)]
    # the exercise sheet requires a separate node for each bonus; the text reminds the teacher of this
    items += [
        Item(name, None, 25.0, by_hand("it is done by a node of its own"), subject=Subject.SERVICE)
        for name in BONUSES
    ]
    # `forfeited` takes the points of a submission that has interfered with the simulator, and `weighted`
    # applies the weights of the teacher's rubric
    return weighted(forfeited(items, recordings), rules)


EXERCISE = Exercise(ITEMS, judge_exercise_5, pace=2.0, deadline=60.0, watch=ServiceWatch)
