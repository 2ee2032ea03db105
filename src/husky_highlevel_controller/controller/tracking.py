"""Tracker of one pillar in odom: data association and a filter of its position.

In: the pillars of a scan, and where the lidar was. Out: the one that is followed, and what is believed of it.

The first pillar seen, or the nearest of several, is followed until it proves to be none: its place is in
view, nothing hides it, and yet no pillar is there for EMPTY_TIMEOUT. A near place that stays hidden counts
a tenth of that time, so it is given up after 5 s, but not by a robot that has arrived; one out of view is
kept for as long as odom is, ever less certain. A place that was given up is believed again only when more
beams fall on it, that is, from nearer by.

An estimate is confirmed when it was seen from places BASELINE apart, or for WATCH_TIME. Before that it is
given up after EMPTY_TIMEOUT out of view or hidden, too. An estimate that moves WALK within WATCH_TIME is a
leg or a wheel, not a pillar: it is dropped, pillars elsewhere come first, and the next one is to be
confirmed before the robot drives to it.
"""

from __future__ import annotations

from enum import Enum
from math import asin, atan2, hypot, pi, sqrt
from typing import List, NamedTuple, Optional, Tuple

from husky_highlevel_controller.controller.pillar_detection import Pillar
from husky_highlevel_controller.datatypes import Pose, Scan
from husky_highlevel_controller.geometry import inverse, transform_point

EMPTY_TIMEOUT = 0.5  # [s], this long a place may look empty before it is given up
_HIDDEN_WEIGHT = 0.1  # of a second, what a second counts in which a near place is hidden
_AT_PLACE = 2.0  # [m] from the lidar: a place this near should be seen
_MANY_BEAMS = 8  # a pillar of so many is believed, whatever was there before
_LONGEST_PERIOD = 0.1  # [s], a gap between scans counts as no longer than this
_DRIFT = 0.02  # [m/sqrt(s)], how fast a place in odom becomes uncertain
_GATE, _GATE_SHARE = 0.5, 0.03  # [m] and share of the distance, how far a pillar may be from where it was
_MAX_REJECTED = 8  # places given up that are remembered
BASELINE, WATCH_TIME = 0.3, 2.0  # [m] between two places of the lidar; [s], a step of a walk takes 0.6 s
WALK = 0.2  # [m] beyond the errors of a sighting; legs walk 0.5 to 1.5 m/s, odom drifts below 0.1 m/s


class Estimate(NamedTuple):
    """The pillar, remembered."""

    x: float  # [m], centre, in odom
    y: float  # [m], centre, in odom
    radius: float  # [m]
    deviation: float  # [m], standard deviation of the centre
    seen_at: float  # [s], stamp of the last scan that showed it


class Visibility(Enum):
    """Evidence of a scan about a remembered place."""

    SEEN = "seen"
    OUT_OF_VIEW = "out of view"
    HIDDEN = "hidden"  # by something nearer
    EMPTY = "empty"  # no pillar there, though one would be seen
    UNKNOWN = "unknown"  # nothing is remembered


class Anchor(NamedTuple):
    """Places of an estimate and of the lidar, at most WATCH_TIME ago."""

    estimate: Estimate
    laser: Tuple[float, float]  # [m], in odom


class Track(NamedTuple):
    """Pillar that is followed from scan to scan."""

    estimate: Optional[Estimate] = None
    missed_time: float = 0.0  # [s] that its place looked empty, less those that showed it
    beams: int = 0  # largest number that a scan had on it
    updated_at: float = 0.0  # [s]
    rejected: Tuple[Tuple[float, float, int], ...] = ()  # places given up: x, y in odom [m]; beams they had
    anchor: Optional[Anchor] = None
    confirmed: bool = False  # seen for long enough, or from places far enough apart
    walked_to: Optional[Tuple[float, float]] = None  # [m], in odom, where the last estimate had walked

    @property
    def doubtful(self) -> bool:
        """Whether the estimate may be the one that walked before: not yet to be driven to."""
        return self.walked_to is not None and not self.confirmed


class Sighting(NamedTuple):
    """A pillar of one scan, with its place in odom."""

    pillar: Pillar  # in the laser's frame
    center_in_odom: Tuple[float, float, float]  # [m]


def follow(
    track: Track, pillars: List[Pillar], scan: Scan, laser_in_odom: Pose, keep_hidden: bool = False
) -> Tuple[Track, Optional[Sighting], Visibility]:
    """Find the followed pillar in a scan, whose pillars are nearest first, or begin to follow one.

    With `keep_hidden` a near place is kept although something hides it.

    Returns:
        What is believed now, the followed pillar if the scan shows it, and what it says about the place.
    """
    period = min(max(scan.stamp - track.updated_at, 0.0), _LONGEST_PERIOD)
    sightings = [
        Sighting(pillar, transform_point(laser_in_odom, (pillar.x, pillar.y, 0.0))) for pillar in pillars
    ]
    estimate = track.estimate
    if estimate is not None:
        sighting = _match(estimate, sightings, scan.stamp)
        if sighting is not None:
            sighted = _seen(track, sighting, period, scan, laser_in_odom)
            if not _walks(sighted, sighting.pillar):
                return _watched(sighted, laser_in_odom), sighting, Visibility.SEEN
            track = _give_up(sighted, reject=True)._replace(walked_to=sighting.center_in_odom[:2])
        else:
            visibility = look_at(estimate, scan, laser_in_odom)
            weight = _weight(visibility, track, laser_in_odom, keep_hidden)
            track = track._replace(missed_time=track.missed_time + weight * period, updated_at=scan.stamp)
            if track.missed_time <= EMPTY_TIMEOUT:
                return track, None, visibility
            track = _give_up(track, reject=track.confirmed or visibility is Visibility.EMPTY)
    for sighting in sorted(sightings, key=lambda sighting: _at(track.walked_to, sighting)):
        (x, y, _), seen_beams = sighting.center_in_odom, sighting.pillar.beams
        if all(hypot(x - dx, y - dy) > _GATE or seen_beams > beams for dx, dy, beams in track.rejected):
            return _seen(track, sighting, period, scan, laser_in_odom), sighting, Visibility.SEEN
    return track._replace(updated_at=scan.stamp), None, Visibility.UNKNOWN


def aged(estimate: Estimate, stamp: float) -> Estimate:
    """The estimate as certain as it still is at `stamp` [s]."""
    return estimate._replace(deviation=_deviation_at(estimate, stamp))


def _walks(track: Track, pillar: Pillar) -> bool:
    """Whether the estimate has moved since its anchor, by more than errors of pose and sighting explain."""
    assert track.estimate is not None
    assert track.anchor is not None
    before, now = track.anchor.estimate, track.estimate
    errors = _GATE_SHARE * hypot(pillar.x, pillar.y) + 3.0 * min(before.deviation, 0.3)
    return hypot(now.x - before.x, now.y - before.y) > WALK + errors


def _watched(track: Track, laser_in_odom: Pose) -> Track:
    """The track, confirmed and with a new anchor once the estimate has stood for long enough."""
    assert track.estimate is not None
    assert track.anchor is not None
    before, (x, y, _) = track.anchor, laser_in_odom.position
    watched = track.estimate.seen_at - before.estimate.seen_at >= WATCH_TIME
    if not watched and hypot(x - before.laser[0], y - before.laser[1]) < BASELINE:
        return track
    anchor = Anchor(track.estimate, (x, y)) if watched else before
    return track._replace(anchor=anchor, confirmed=True, walked_to=None)


def _at(place: Optional[Tuple[float, float]], sighting: Sighting) -> bool:
    """Whether a sighting is at a place, in odom."""
    x, y, _ = sighting.center_in_odom
    return place is not None and hypot(x - place[0], y - place[1]) <= _GATE


def _weight(visibility: Visibility, track: Track, laser_in_odom: Pose, keep_hidden: bool) -> float:
    """Weight of a second in which the pillar is not seen."""
    estimate = track.estimate
    assert estimate is not None
    if visibility is Visibility.EMPTY or not track.confirmed:
        return 1.0
    x, y, _ = laser_in_odom.position
    near = hypot(estimate.x - x, estimate.y - y) < _AT_PLACE
    return _HIDDEN_WEIGHT if visibility is Visibility.HIDDEN and near and not keep_hidden else 0.0


def _give_up(track: Track, reject: bool) -> Track:
    """The track without its estimate, whose place is remembered if it is rejected."""
    assert track.estimate is not None
    place = (track.estimate.x, track.estimate.y, min(track.beams, _MANY_BEAMS - 1))
    rejected = (*track.rejected[1 - _MAX_REJECTED :], place) if reject else track.rejected
    return Track(updated_at=track.updated_at, rejected=rejected, walked_to=track.walked_to)


def look_at(estimate: Estimate, scan: Scan, laser_in_odom: Pose) -> Visibility:
    """Evidence of the beams that should meet a remembered pillar."""
    step = scan.angle_increment
    x, y, _ = transform_point(inverse(laser_in_odom), (estimate.x, estimate.y, laser_in_odom.position[2]))
    distance = hypot(x, y)
    if step == 0.0 or distance - estimate.radius > scan.range_max:
        return Visibility.OUT_OF_VIEW
    half = asin(min(0.9 * estimate.radius / max(distance, 1e-9), 1.0)) / abs(step)  # in beams
    middle = (atan2(y, x) - scan.angle_min) / step % (2.0 * pi / abs(step))
    first, last = int(middle - half + 1.0), int(middle + half)
    if first < 1 or last > len(scan.ranges) - 2 or last <= first:  # cut by the edge, or too far to judge
        return Visibility.OUT_OF_VIEW
    slack = min(0.05 + 0.1 * distance, 0.3) + 2.0 * estimate.deviation
    nearest_expected = max(distance - estimate.radius - slack, scan.range_min)
    readings = scan.returns[first : last + 1].tolist()
    beyond = sum(reading >= nearest_expected for reading in readings)
    return Visibility.EMPTY if 2 * beyond > len(readings) else Visibility.HIDDEN


def _match(estimate: Estimate, sightings: List[Sighting], stamp: float) -> Optional[Sighting]:
    """The pillar nearest to where the followed one was, if near enough."""
    deviation = _deviation_at(estimate, stamp)
    best, best_off = None, 1.0
    for sighting in sightings:
        pillar, (x, y, _) = sighting
        gate = _GATE + _GATE_SHARE * hypot(pillar.x, pillar.y) + 3.0 * min(deviation, 0.3)
        off = hypot(x - estimate.x, y - estimate.y) / gate
        if off < best_off:
            best, best_off = sighting, off
    return best


def _seen(track: Track, sighting: Sighting, period: float, scan: Scan, laser_in_odom: Pose) -> Track:
    """Update the estimate with a sighting; the gains are those of a Kalman filter."""
    pillar, (x, y, _) = sighting
    radius = pillar.radius
    # a quarter of the spacing of the beams, and what noise leaves
    variance = (0.005 + 0.25 * abs(scan.angle_increment) * hypot(pillar.x, pillar.y)) ** 2
    old = track.estimate
    if old is not None:
        before = _deviation_at(old, scan.stamp) ** 2
        gain = before / (before + variance)
        x, y = old.x + gain * (x - old.x), old.y + gain * (y - old.y)
        radius = old.radius + gain * (radius - old.radius)
        variance *= gain
    estimate = Estimate(x, y, radius, sqrt(variance), scan.stamp)
    return track._replace(
        estimate=estimate,
        missed_time=max(track.missed_time - 2.0 * period, 0.0),
        beams=max(track.beams, pillar.beams),
        updated_at=scan.stamp,
        anchor=track.anchor or Anchor(estimate, laser_in_odom.position[:2]),
    )


def _deviation_at(estimate: Estimate, stamp: float) -> float:
    """Standard deviation of the place, grown since it was seen [m]."""
    return hypot(estimate.deviation, _DRIFT * sqrt(max(stamp - estimate.seen_at, 0.0)))
