"""The rubric of exercise 5: a service stops and starts the robot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import List, Mapping, Sequence

import numpy as np

from husky_grading.displays import RvizView
from husky_grading.notes import Subject
from husky_grading.recording import Call, Recording
from husky_grading.records import DEFAULT_RULES, Item, Rules
from husky_grading.rubrics.causes import (
    MEMBER,
    causes,
    first_cause,
    hint_on,
    with_cause,
)
from husky_grading.rubrics.items import forfeited, weighted

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
    if not recording.calls:
        services = recording.services
        why = f"{services[0]} was not called" if services else "no std_srvs/SetBool service"
        if not services and recording.other_services:
            why += f", but {', '.join(recording.other_services)}: for a person"
            return [replace(stop, points=None, evidence=why), replace(start, points=None, evidence=why)]
        cause = next(iter(causes(recording)), None)
        why += f": {cause.text}" if cause else ""
        hint = hint_on(cause) if cause else SERVICE
        return [replace(item, evidence=why, hint=hint) for item in (stop, start)]
    name = recording.services[0] if recording.services else "its service"
    effects = _effects(recording)
    if not effects:
        why = f"{name}: the drive ended before its effect was to be seen: for a person"
        return [replace(item, points=None, evidence=why) for item in (stop, start)]
    driven = [effect for effect in effects if effect.before >= FAST]
    if driven and not any(effect.stopped for effect in driven):
        return _neither_stops(stop, start, name, driven, recording.callers)
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
    told = f" ({driven[0].call.answer})" * (not driven[0].call.success and bool(driven[0].call.answer))
    evidence = f"{name}: neither value stops it: {', '.join(speeds)}{told}"
    others = [f"{node} has looked it up {count} times" for node, count in callers.items() if count >= MANY]
    evidence += f"; {', '.join(others)}, as each call does" * bool(others)
    hint = OTHER_CALLER if others else NEITHER
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


def _effects(recording: Recording) -> List[Effect]:
    """Effect of each call, without those that the recording holds no moment before or after of."""
    speeds, effects = np.abs(recording.speeds[:, 0]), []
    for call in recording.calls:
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
        evidence += f" ({call.answer})" * (not call.success and bool(call.answer))
    points = item.max_points if good == len(effects) else item.max_points / 2.0 if good else 0.0
    return replace(item, points=points, evidence=evidence, at=at)


def judge_exercise_5(
    recordings: Sequence[Recording], _view: RvizView, _scan_topic: str, rules: Rules = DEFAULT_RULES
) -> List[Item]:
    """Items of exercise 5: 50 and 50, and two bonuses by hand."""
    items = judge_calls(recordings[0])
    drives = (np.abs(recordings[0].speeds[:, 0]) > FAST).any()
    if not drives and (recordings[0].services or not recordings[0].other_services):
        stop, start = (replace(item, points=0.0) for item in items)
        stop = with_cause(stop, "it never drives, so it cannot be stopped", first_cause(recordings[0]))
        items = [stop, replace(start, hint=stop.hint)]
    items += [
        Item(name, None, 25.0, "for a person: a node of its own", subject=Subject.SERVICE)
        for name in ITEMS[2:]
    ]
    return weighted(forfeited(items, recordings), rules)
