"""Exercise 5: a service stops and starts the robot; marking calls it while the robot drives."""

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
    MEMBER,
    causes,
    first_cause,
    hint_on,
    with_cause,
)
from husky_grading.rubrics.items import forfeited, weighted
from husky_highlevel_controller.config import to_plain

ITEMS = (
    "service stops the robot",
    "service starts it again",
    "bonus: stops before a crash",
    "bonus: stops after a crash",
)
BEFORE = 0.5  # [s], simulated, before a call: what the robot did then counts as just before
SETTLED, CALM = 1.5, 4.0  # [s], simulated, after a call's answer: from when to when it is looked at
MANY = 5  # lookups of a node: fewer come also from one that only waits for the service
SLOW, FAST = 0.05, 0.1  # [m/s]: stands, drives
SET_BOOL = "std_srvs/SetBool"
CALLS = (False, True, False, True)  # stop and start, twice; the other way round where True stops
DRIVES = 0.1  # [m/s]
FIRST_CALL, LATEST_FIRST_CALL = (1.0, 8.0)  # [s]: after it drives; where it waits for a call to drive at all
OBEYED = 0.5  # [s], simulated, after a call: by then a submission that it stops sends no more
NO_SERVICE = 25.0  # [s], simulated, without a service
# hints
SERVICE = f"advertise a service of type std_srvs/SetBool in the constructor, and {MEMBER}"
NEITHER = (
    "keep the request in a member, and let each callback of the scans send a zero twist while it says stop; "
    "see that no other node of yours calls the service, or sends velocities as well"
)
STOP = "keep the request in a member, and let each callback of the scans send a zero twist while it says stop"
OTHER_CALLER = f"see what that node sends, because its calls come between those of marking; otherwise {STOP}"
START = "let the other request clear that member, so that the scans' callback drives again"


@dataclass(frozen=True)
class Call:
    """Call of a start/stop service."""

    at: float  # [s], simulated
    data: bool  # what was sent
    success: bool
    answer: str  # its text, or what went wrong
    answered_at: float  # [s], simulated; on a busy machine more than a second later


@dataclass(frozen=True)
class ServiceCalls:
    """Services that the submission offers, and the calls of them."""

    services: Tuple[str, ...] = ()  # of type std_srvs/SetBool
    other_services: Tuple[str, ...] = ()  # of other types, as "/name (package/Type)"
    calls: Tuple[Call, ...] = ()
    # lookups of the service by each node of the submission: each call makes one
    callers: Mapping[str, int] = field(default_factory=dict)


@dataclass
class CallPlan:
    """Plan of the calls of one drive."""

    made: int = 0
    answered_at: float = -inf  # [s], the last call
    drove_at: float = inf  # [s], for the first time

    def due(self, now: float, speed: float) -> Optional[bool]:
        """The value to call with now, or None; time in s, speed in m/s."""
        if abs(speed) > DRIVES:
            self.drove_at = min(self.drove_at, now)
        begin = min(self.drove_at + FIRST_CALL, LATEST_FIRST_CALL)
        if self.made >= len(CALLS) or now < max(begin, self.answered_at + CALM):
            return None
        value = CALLS[self.made]
        self.made, self.answered_at = self.made + 1, inf
        return value

    def answered(self, now: float) -> None:
        """Call when the last call has been answered, or will not be; time in s."""
        self.answered_at = now

    def reason(self, now: float, offered: bool) -> Optional[Note]:
        """Reason why the drive is over; None: it is not."""
        if not offered and now > NO_SERVICE:
            return Note(Kind.NO_SERVICE, f"no start/stop service for {NO_SERVICE:g} s")
        if self.made >= len(CALLS) and now >= self.answered_at + CALM:
            return Note(Kind.PLAN_DONE, "all calls are made")
        return None


class ServiceWatch(Watch):
    """Calls the submission's service by the plan."""

    def __init__(self, known: Recording, ros: RosAccess) -> None:
        super().__init__(known, ros)
        self._plan = CallPlan()
        self._made: Optional[Call] = None  # the call that waits for its answer
        self._calls: List[Call] = []
        self._types: Dict[str, str] = {}  # of its services, by their names

    def look(self, state: DriveState) -> Optional[Note]:
        """Call the service if that is due, and return why the drive is over; None if the drive goes on."""
        return self._follow_plan(state) or super().look(state)

    def _follow_plan(self, state: DriveState) -> Optional[Note]:
        """Take the answer of the last call, or make the next one; return why the plan is done, if it is."""
        self._types.update(self._ros.service_types(state.services))
        if self._made:
            answer = self._ros.answer()
            if answer is None:
                return None
            made = replace(self._made, success=answer.success, answer=answer.text, answered_at=state.now)
            self._calls.append(made)
            self._plan.answered(state.now)
            self._made = None
        names = [name for name, kind in self._types.items() if kind == SET_BOOL]
        value = self._plan.due(state.now, state.speed) if names else None
        if value is None:
            return self._plan.reason(state.now, bool(names))
        self._made = Call(state.now, value, False, "", state.now)
        self._ros.call(min(names), value)
        return None

    def has_silenced(self, last_command: float) -> bool:
        """Whether a call came just before the submission's last command [s, simulated], or after it."""
        made = [*self._calls, self._made] if self._made else self._calls
        return any(call.at >= last_command - OBEYED for call in made)

    def kept(self) -> Dict[str, Any]:
        """Services and calls of the drive."""
        offered = tuple(sorted(name for name, kind in self._types.items() if kind == SET_BOOL))
        others = tuple(sorted(f"{name} ({kind})" for name, kind in self._types.items() if kind != SET_BOOL))
        callers = self._ros.callers(offered[0]) if offered else {}
        plain: Dict[str, Any] = to_plain(ServiceCalls(offered, others, tuple(self._calls), callers))
        return plain


@dataclass(frozen=True)
class Effect:
    """A call, and what the robot did."""

    call: Call
    before: float  # [m/s], the highest speed just before
    after: float  # [m/s], the highest speed once it has settled

    @property
    def stopped(self) -> bool:
        """Whether the robot drove and stands."""
        return self.before >= FAST and self.after <= SLOW


def judge_calls(recording: Recording) -> List[Item]:
    """The service stops (50) and starts (50) the robot, again and again; half for once only."""
    stop = Item(ITEMS[0], 0.0, 50.0, "", hint=STOP, subject=Subject.SERVICE)
    start = replace(stop, name=ITEMS[1], hint=START)
    made = recording.watched_as(ServiceCalls)
    if not made.calls:
        why = f"{made.services[0]} was not called" if made.services else "no std_srvs/SetBool service"
        if not made.services and made.other_services:
            why += f", but {', '.join(made.other_services)}: for a person"
            return [replace(stop, points=None, evidence=why), replace(start, points=None, evidence=why)]
        cause = next(iter(causes(recording)), None)
        hint = SERVICE
        if cause:
            why, hint = f"{why}: {cause.text}", hint_on(cause)
        return [replace(item, evidence=why, hint=hint) for item in (stop, start)]
    name = made.services[0] if made.services else "its service"
    effects = _effects(recording, made.calls)
    if not effects:
        why = f"{name}: the drive ended before its effect was to be seen: for a person"
        return [replace(item, points=None, evidence=why) for item in (stop, start)]
    driven = [effect for effect in effects if effect.before >= FAST]
    if driven and not any(effect.stopped for effect in driven):
        return _neither_stops(stop, start, name, driven, made.callers)
    stops = _stopping_value(effects)
    stop = _judge_stops(stop, name, [effect for effect in effects if effect.call.data is stops])
    if not any(effect.before >= FAST for effect in effects):
        return [stop, _judge_starts_from_rest(start, name, recording, effects)]
    # a start counts where the robot stood because an earlier call had stopped it
    starts = [
        effect
        for number, effect in enumerate(effects)
        if effect.call.data is not stops and number and effects[number - 1].stopped
    ]
    return [stop, _judge_starts(start, name, starts)]


def _neither_stops(
    stop: Item, start: Item, name: str, driven: Sequence[Effect], callers: Mapping[str, int]
) -> List[Item]:
    """Items of a robot that drives on after every call, whichever value was sent."""
    speeds = [f"{effect.after:.2f} m/s after {str(effect.call.data).lower()}" for effect in driven[:2]]
    evidence, hint = f"{name}: neither value stops it: {', '.join(speeds)}", NEITHER
    if driven[0].call.answer and not driven[0].call.success:
        evidence += f" ({driven[0].call.answer})"
    others = [f"{node} has looked it up {count} times" for node, count in callers.items() if count >= MANY]
    if others:
        evidence += f"; {', '.join(others)}, as each call does"
        hint = OTHER_CALLER
    stop = replace(stop, evidence=evidence, at=driven[0].call.at, hint=hint)
    return [
        stop,
        replace(start, evidence=f"{name}: no call had stopped it, so none could start it", hint=hint),
    ]


def _stopping_value(effects: Sequence[Effect]) -> bool:
    """The value after which a driving robot is slower: which of the two stops is the submission's choice."""
    mean = {
        data: np.mean([e.after for e in effects if e.call.data is data and e.before >= FAST] or [np.inf])
        for data in (False, True)
    }
    return bool(mean[True] < mean[False])


def _effects(recording: Recording, calls: Sequence[Call]) -> List[Effect]:
    """Effect of each call, without those that the recording holds no moment before or after of."""
    speeds, effects = np.abs(recording.speeds[:, 0]), []
    for call in calls:
        before = (recording.times >= call.at - BEFORE) & (recording.times <= call.at)
        since = recording.times - call.answered_at
        after = (since >= SETTLED) & (since <= CALM)
        if before.any() and after.any():
            effects.append(Effect(call, float(speeds[before].max()), float(speeds[after].max())))
    return effects


def _judge_stops(item: Item, name: str, effects: Sequence[Effect]) -> Item:
    driving = [effect for effect in effects if effect.before >= FAST]
    if not driving:
        evidence = f"{name}: not judged, the robot stood already before each call: for a person"
        return replace(item, points=None, evidence=evidence)
    wrong = [effect for effect in driving if not effect.stopped]
    return _judged(item, f"{name}: stands", driving, wrong)


def _judge_starts(item: Item, name: str, effects: Sequence[Effect]) -> Item:
    if not effects:
        return replace(item, evidence=f"{name}: no call had stopped it, so none could start it again")
    return _judged(item, f"{name}: drives", effects, [effect for effect in effects if effect.after < FAST])


def _judge_starts_from_rest(item: Item, name: str, recording: Recording, effects: Sequence[Effect]) -> Item:
    """Item of a robot that stood before every call."""
    if any(effect.after >= FAST for effect in effects):
        evidence = f"{name}: it drives after a call, but no call had stopped it before: for a person"
        return replace(item, points=None, evidence=evidence)
    if not (np.abs(recording.speeds[:, 0]) >= FAST).any():
        return with_cause(item, f"{name}: it never drives", first_cause(recording))
    evidence = f"{name}: not judged, it had stopped by itself before the first call: for a person"
    return replace(item, points=None, evidence=evidence)


def _judged(item: Item, effect: str, effects: Sequence[Effect], wrong: Sequence[Effect]) -> Item:
    good = len(effects) - len(wrong)
    evidence = f"{effect} after {good} of {len(effects)} calls"
    at = effects[0].call.at
    if wrong:
        call, speed, at = wrong[0].call, wrong[0].after, wrong[0].call.at
        evidence += f"; after {str(call.data).lower()} at {call.at:.2f} s it drives at {speed:.2f} m/s"
        if call.answer and not call.success:
            evidence += f" ({call.answer})"
    points = item.max_points if good == len(effects) else item.max_points / 2.0 if good else 0.0
    return replace(item, points=points, evidence=evidence, at=at)


def judge_exercise_5(
    recordings: Sequence[Recording], _view: RvizView, _scan_topic: str, rules: Rules = DEFAULT_RULES
) -> List[Item]:
    """Items of exercise 5: 50 and 50, and two bonuses by hand."""
    items, made = judge_calls(recordings[0]), recordings[0].watched_as(ServiceCalls)
    drives = (np.abs(recordings[0].speeds[:, 0]) > FAST).any()
    if not drives and (made.services or not made.other_services):
        stop, start = (replace(item, points=0.0) for item in items)
        stop = with_cause(stop, "it never drives, so it cannot be stopped", first_cause(recordings[0]))
        items = [stop, replace(start, hint=stop.hint)]
    items += [
        Item(name, None, 25.0, "for a person: a node of its own", subject=Subject.SERVICE)
        for name in ITEMS[2:]
    ]
    return weighted(forfeited(items, recordings), rules)


EXERCISE = Exercise(ITEMS, judge_exercise_5, pace=2.0, deadline=60.0, watch=ServiceWatch)
