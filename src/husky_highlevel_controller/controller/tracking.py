"""Tracker of one pillar in odom: data association and a filter of its position.

In: the pillars of a scan, and the pose of the lidar. Out: the tracked pillar, and its estimate.

The first pillar seen, or the nearest of several, is tracked until its position proves to be empty. A position
is empty if it is in view, nothing hides it, and no pillar is there for EMPTY_TIMEOUT. If the position is near
the lidar and something hides it, only a tenth of the time counts, so the position is given up after 5 s. But
a robot that has arrived keeps a hidden position. A position out of view is kept, and becomes less and less
certain.

A position that is given up is usually rejected. A pillar at a rejected position is accepted again only if
more beams fall on it, for example because the robot has come closer.

An estimate is confirmed when it was seen from positions BASELINE apart, or for WATCH_TIME. An estimate that
is not yet confirmed is also given up if it is out of view or hidden for EMPTY_TIMEOUT. An estimate that moves
by WALK within WATCH_TIME is a leg or a wheel and not a pillar, so it is given up. Then pillars at other
positions are preferred to this object, and the robot drives to the next pillar only when that pillar is
confirmed.
"""

from __future__ import annotations

from enum import Enum
from math import asin, atan2, hypot, pi, sqrt
from typing import List, NamedTuple, Optional, Tuple

from husky_highlevel_controller.controller.pillar_detection import Pillar
from husky_highlevel_controller.datatypes import Pose, Scan
from husky_highlevel_controller.geometry import inverse, transform_point

EMPTY_TIMEOUT = 0.5  # [s] a pillar is given up if its remembered position looks empty for longer than this
# If the pillar should be near, and another object hides its position, only this fraction of the time counts
# as time in which the position looks empty.
_HIDDEN_WEIGHT = 0.1
# [m] a remembered position counts as near if it is closer to the lidar than this; the lidar should see a
# pillar that is so near
_NEAR = 2.0
_MANY_BEAMS = 8  # a pillar with at least this many beams is accepted even at a rejected position
# [s] a longer time between two scans counts as this time, so that a pause of the scans alone does not make
# the robot give up a pillar
_LONGEST_PERIOD = 0.1
# [m/sqrt(s)] odom drifts, so the standard deviation of a remembered position grows by this times sqrt(time)
_DRIFT = 0.02
# A pillar of a scan can be the remembered pillar only if it is near the remembered position. The limit of the
# distance is _GATE [m], plus _GATE_FRACTION of the pillar's range, plus the uncertainty of the position.
_GATE, _GATE_FRACTION = 0.5, 0.03
# [m] a larger standard deviation of a position counts as this, because otherwise a pillar far away from an
# old position would match it
_LARGEST_DEVIATION = 0.3
_MAX_REJECTED = 8  # largest number of rejected positions that are remembered
# [m], [s] a pillar is confirmed if the lidar has seen it from two positions that are BASELINE apart, or for
# WATCH_TIME; a walking person would move in this time, because a step takes 0.6 s
BASELINE, WATCH_TIME = 0.3, 2.0
# [m] an object that moves farther than this in WATCH_TIME is a walking person (0.5 to 1.5 m/s) and not a
# pillar; a pillar seems to move less, by errors of measurement and the drift of odom (below 0.1 m/s)
WALK = 0.2


class Estimate(NamedTuple):
    """Remembered pillar."""

    x: float  # [m] x of the centre in odom
    y: float  # [m] y of the centre in odom
    radius: float  # [m]
    deviation: float  # [m] standard deviation of the centre's position
    seen_at: float  # [s], stamp of the last scan that showed the pillar


class Visibility(Enum):
    """Answer of a scan to the question whether a pillar stands at its remembered position."""

    SEEN = "seen"
    OUT_OF_VIEW = "out of view"
    HIDDEN = "hidden"  # hidden by a nearer object
    EMPTY = "empty"  # the scan shows that the remembered position is empty
    UNKNOWN = "unknown"  # no position is remembered, or the scan cannot show the remembered position


class Anchor(NamedTuple):
    """Earlier estimate and lidar position, at most WATCH_TIME old, from which their motion is measured."""

    estimate: Estimate
    laser: Tuple[float, float]  # [m] position of the lidar in odom


class Track(NamedTuple):
    """Pillar that is followed from scan to scan."""

    estimate: Optional[Estimate] = None
    # [s] time in which the remembered position looked empty; it becomes shorter again while the pillar is
    # seen
    missed_time: float = 0.0
    beams: int = 0  # largest number of beams that have hit the pillar in one scan
    updated_at: float = 0.0  # [s] stamp of the last scan
    # rejected positions: x and y in odom [m], largest number of beams on the object there
    rejected: Tuple[Tuple[float, float, int], ...] = ()
    anchor: Optional[Anchor] = None
    # true if the pillar was seen for WATCH_TIME, or from two positions BASELINE apart
    confirmed: bool = False
    # [m] position in odom to which the last tracked object has walked, which was probably a person; None if
    # no object has walked. It is kept after the object is given up, so that other pillars are preferred.
    walked_to: Optional[Tuple[float, float]] = None

    @property
    def doubtful(self) -> bool:
        """Return whether the tracked pillar may be the person who walked, so the robot must not drive yet."""
        return self.walked_to is not None and not self.confirmed


class Sighting(NamedTuple):
    """A pillar of one scan, with its position in odom."""

    pillar: Pillar  # pillar in the laser's frame
    center_in_odom: Tuple[float, float, float]  # [m]


def follow(
    track: Track, pillars: List[Pillar], scan: Scan, laser_in_odom: Pose, keep_hidden: bool = False
) -> Tuple[Track, Optional[Sighting], Visibility]:
    """Find the tracked pillar in a scan, or begin to track another pillar of the scan.

    A pillar that moves (a leg or a wheel), or that is missed for EMPTY_TIMEOUT, is given up. The position is
    rejected if the pillar moved or was confirmed before, or if the position looks empty. At a rejected
    position a pillar is tracked again only if more beams fall on it.

    Args:
        track: track after the last scan.
        pillars: pillars of this scan, nearest first.
        scan: the scan.
        laser_in_odom: pose of the lidar at the scan.
        keep_hidden: whether to keep a near pillar although something hides it; true after the arrival.

    Returns:
        The new track, the tracked pillar if the scan shows it, and whether its position is seen, hidden, out
        of view or empty.
    """
    period = min(max(scan.stamp - track.updated_at, 0.0), _LONGEST_PERIOD)
    sightings = [
        Sighting(pillar, transform_point(laser_in_odom, (pillar.x, pillar.y, 0.0))) for pillar in pillars
    ]
    estimate = track.estimate
    if estimate is None:
        return _begin_anew(track, sightings, period, scan, laser_in_odom)
    sighting = _match(estimate, sightings, scan.stamp)
    if sighting is not None:
        track = _updated(track, sighting, period, scan, laser_in_odom)
        if not _walks(track, sighting.pillar):
            return _confirmed_if_watched(track, laser_in_odom), sighting, Visibility.SEEN
        # an object that moves is a leg or a wheel, so it is given up although the scan shows it
        track = _give_up(track, reject=True)._replace(walked_to=sighting.center_in_odom[:2])
    else:
        visibility = look_at(estimate, scan, laser_in_odom)
        weight = _weight_of_miss(visibility, track, laser_in_odom, keep_hidden)
        track = track._replace(missed_time=track.missed_time + weight * period, updated_at=scan.stamp)
        if track.missed_time <= EMPTY_TIMEOUT:
            return track, None, visibility
        # For a confirmed pillar, `missed_time` shows that the pillar is gone, because a scan that could not
        # show the pillar does not count. For any other pillar, such scans count, too, so the pillar is known
        # to be gone only if its position looks empty now.
        is_gone = track.confirmed or visibility is Visibility.EMPTY
        track = _give_up(track, reject=is_gone)
    # the tracked pillar was given up, so this scan may already show the next one
    return _begin_anew(track, sightings, period, scan, laser_in_odom)


def _begin_anew(
    track: Track, sightings: List[Sighting], period: float, scan: Scan, laser_in_odom: Pose
) -> Tuple[Track, Optional[Sighting], Visibility]:
    """Begin to track a pillar of a scan: the nearest one that is not at a rejected position.

    The object that has walked to `track.walked_to` is the last choice, because it is probably a person. At a
    rejected position, an object is tracked again only if more beams fall on it than before.

    Args:
        track: track without a pillar, which knows the rejected positions.
        sightings: pillars of this scan, nearest first.
        period: time since the last scan [s].
        scan: the scan.
        laser_in_odom: pose of the lidar at the scan.

    Returns:
        The new track, the pillar that it follows now, if any, and whether there is one: SEEN or UNKNOWN.
    """
    # `sorted` puts false before true, and otherwise keeps the order
    walker_last = sorted(sightings, key=lambda sighting: _is_at(track.walked_to, sighting))
    for sighting in walker_last:
        if not _is_rejected(sighting, track):
            return _updated(track, sighting, period, scan, laser_in_odom), sighting, Visibility.SEEN
    return track._replace(updated_at=scan.stamp), None, Visibility.UNKNOWN


def aged(estimate: Estimate, stamp: float) -> Estimate:
    """Return the estimate at a later time `stamp` [s], at which its position is less certain."""
    return estimate._replace(deviation=_deviation_at(estimate, stamp))


def _walks(track: Track, pillar: Pillar) -> bool:
    """Return whether the tracked object moves, so that it is a leg or a wheel and not a pillar.

    It moves if it is farther from its earlier position, the anchor, than WALK and the possible errors.

    Args:
        track: track of the object, with estimate and anchor.
        pillar: the object in the present scan.
    """
    assert track.estimate is not None
    assert track.anchor is not None
    before, now = track.anchor.estimate, track.estimate
    # [m] error of the measured position, which grows with the range of the pillar
    range_error = _GATE_FRACTION * hypot(pillar.x, pillar.y)
    # [m] error of the earlier position, three standard deviations
    earlier_error = 3.0 * min(before.deviation, _LARGEST_DEVIATION)
    return hypot(now.x - before.x, now.y - before.y) > WALK + (range_error + earlier_error)


def _confirmed_if_watched(track: Track, laser_in_odom: Pose) -> Track:
    """Confirm the track if the pillar stood still for WATCH_TIME, or was seen from positions BASELINE apart.

    The track's anchor is an earlier estimate, and the position of the lidar at that time. The time and the
    distance are counted from the anchor. After WATCH_TIME, the present estimate and position are the new
    anchor. The caller has already given up a pillar that does not stand still.
    """
    assert track.estimate is not None
    assert track.anchor is not None
    anchor, (x, y, _) = track.anchor, laser_in_odom.position
    is_watched = track.estimate.seen_at - anchor.estimate.seen_at >= WATCH_TIME
    has_baseline = hypot(x - anchor.laser[0], y - anchor.laser[1]) >= BASELINE
    if not is_watched and not has_baseline:
        return track
    if is_watched:
        anchor = Anchor(track.estimate, (x, y))
    # a confirmed pillar cannot be the object that walked, so the position of this object is forgotten
    return track._replace(anchor=anchor, confirmed=True, walked_to=None)


def _is_at(position_in_odom: Optional[Tuple[float, float]], sighting: Sighting) -> bool:
    """Return whether a pillar of the scan is at a position [m]; false if the position is None."""
    if position_in_odom is None:
        return False
    x, y, _ = sighting.center_in_odom
    return hypot(x - position_in_odom[0], y - position_in_odom[1]) <= _GATE


def _is_rejected(sighting: Sighting, track: Track) -> bool:
    """Return whether a pillar of the scan must not be tracked, because its position was rejected before.

    A rejected position is accepted again if more beams fall on the pillar than on the object that was
    rejected there, because more beams show its shape better.
    """
    x, y, _ = sighting.center_in_odom
    for rejected_x, rejected_y, rejected_beams in track.rejected:
        is_there = hypot(x - rejected_x, y - rejected_y) <= _GATE
        if is_there and sighting.pillar.beams <= rejected_beams:
            return True
    return False


def _weight_of_miss(visibility: Visibility, track: Track, laser_in_odom: Pose, keep_hidden: bool) -> float:
    """Return the part, 0 to 1, of the time since the last scan that counts as time without the pillar.

    The caller adds this part of the time to `missed_time` of the track. If the position looks empty, or the
    track is not confirmed, all of the time counts. If something hides a near position, a small part counts,
    because the lidar normally sees a pillar that is so near; with `keep_hidden`, no time counts. If a far
    position is hidden, or if a position is out of view, no time counts.
    """
    estimate = track.estimate
    assert estimate is not None
    if visibility is Visibility.EMPTY or not track.confirmed:
        return 1.0
    x, y, _ = laser_in_odom.position
    is_near = hypot(estimate.x - x, estimate.y - y) < _NEAR
    if visibility is Visibility.HIDDEN and is_near and not keep_hidden:
        return _HIDDEN_WEIGHT
    return 0.0


def _give_up(track: Track, reject: bool) -> Track:
    """Return a track that no longer has a pillar.

    With `reject`, the pillar's position is added to the rejected positions, so that the same object is not
    tracked again at the next scan. The new track keeps the rejected positions and `walked_to`, because both
    say which objects not to track.
    """
    assert track.estimate is not None
    rejected = track.rejected
    if reject:
        # the object at a rejected position is accepted again if more beams hit it; this limit makes sure that
        # _MANY_BEAMS are always enough
        beams = min(track.beams, _MANY_BEAMS - 1)
        # at most _MAX_REJECTED positions are kept, so the oldest one is dropped before one is added
        newest_rejected = rejected[-(_MAX_REJECTED - 1) :]
        rejected = (*newest_rejected, (track.estimate.x, track.estimate.y, beams))
    return Track(updated_at=track.updated_at, rejected=rejected, walked_to=track.walked_to)


def look_at(estimate: Estimate, scan: Scan, laser_in_odom: Pose) -> Visibility:
    """Return why a scan does not show a remembered pillar: out of view, hidden, or its position is empty.

    The caller has not found the pillar in the scan. The beams that should meet the pillar decide. The
    position is empty if most of them reach it or pass beyond it, because then no nearer object hides it.
    """
    step = scan.angle_increment
    center_in_odom = (estimate.x, estimate.y, laser_in_odom.position[2])
    # remembered position in the laser's frame
    x, y, _ = transform_point(inverse(laser_in_odom), center_in_odom)
    distance = hypot(x, y)
    if step == 0.0 or distance - estimate.radius > scan.range_max:
        return Visibility.OUT_OF_VIEW
    # [m] A beam should meet the pillar if it passes the pillar's centre at this distance or less. Farther
    # from the centre, a small error of the position can make the beam miss the pillar.
    inner_radius = 0.9 * estimate.radius
    half_angle = asin(min(inner_radius / max(distance, 1e-9), 1.0))
    half_width = half_angle / abs(step)  # the angle as a number of beams
    # Index of the beam that would point exactly to the pillar's centre, usually not a whole number. A scan
    # may begin at any angle, so whole turns are added until the index is positive.
    beams_per_turn = 2.0 * pi / abs(step)
    middle = (atan2(y, x) - scan.angle_min) / step % beams_per_turn
    # Indices of the first and the last beam that should meet the pillar. `int` rounds down, so both are
    # inside: the middle 10.3 and the half width 2.5 reach from 7.8 to 12.8, so the beams are 8 to 12.
    first, last = int(middle - half_width + 1.0), int(middle + half_width)
    # the pillar lies at an end of the scan, or is so far away that it gets fewer than two beams
    if first < 1 or last > len(scan.ranges) - 2 or last <= first:
        return Visibility.OUT_OF_VIEW
    # [m] A beam may end before the pillar by this error of the distance, which is 5 cm and a tenth of the
    # distance, but at most 30 cm, and two standard deviations of the position. A still shorter range means
    # that a nearer object hides the pillar.
    slack = min(0.05 + 0.1 * distance, 0.3) + 2.0 * estimate.deviation
    nearest_expected = max(distance - estimate.radius - slack, scan.range_min)
    # [m] a beam that meets nothing is inf here, so it passes beyond the pillar
    readings = scan.returns[first : last + 1].tolist()
    not_hidden = sum(reading >= nearest_expected for reading in readings)
    return Visibility.EMPTY if 2 * not_hidden > len(readings) else Visibility.HIDDEN


def _match(estimate: Estimate, sightings: List[Sighting], stamp: float) -> Optional[Sighting]:
    """Return the pillar of the scan that is the remembered pillar; None if all are too far away from it.

    Each pillar of the scan has a gate, which is the largest distance that it may have from the remembered
    position. The pillar whose distance is the smallest fraction of its gate is returned. `stamp` is the stamp
    of the scan [s].
    """
    deviation = _deviation_at(estimate, stamp)
    # with the fraction 1, the distance is as large as the gate, so only smaller fractions match
    best, smallest_fraction = None, 1.0
    for sighting in sightings:
        pillar, (x, y, _) = sighting
        # [m] the gate includes three standard deviations of the remembered position
        gate = _GATE + _GATE_FRACTION * hypot(pillar.x, pillar.y) + 3.0 * min(deviation, _LARGEST_DEVIATION)
        fraction = hypot(x - estimate.x, y - estimate.y) / gate
        if fraction < smallest_fraction:
            best, smallest_fraction = sighting, fraction
    return best


def _updated(track: Track, sighting: Sighting, period: float, scan: Scan, laser_in_odom: Pose) -> Track:
    """Return the track with a new estimate: the mean of the old position and the measured position.

    The mean is weighted with the gain of a Kalman filter. Without an old estimate, the measured position is
    the estimate.

    Args:
        track: track before, with or without an estimate.
        sighting: pillar that this scan shows.
        period: time since the last scan [s].
        scan: the scan.
        laser_in_odom: pose of the lidar at the scan.
    """
    pillar, (x, y, _) = sighting
    radius = pillar.radius
    # An edge of the pillar lies anywhere between two beams. So the standard deviation of the measured
    # position is 5 mm, plus a quarter of the distance between two beams at the pillar.
    beam_spacing = abs(scan.angle_increment) * hypot(pillar.x, pillar.y)  # [m]
    deviation = 0.005 + 0.25 * beam_spacing  # [m]
    variance = deviation**2
    old = track.estimate
    if old is not None:
        old_variance = _deviation_at(old, scan.stamp) ** 2
        gain = old_variance / (old_variance + variance)
        x, y = old.x + gain * (x - old.x), old.y + gain * (y - old.y)
        radius = old.radius + gain * (radius - old.radius)
        variance *= gain  # variance of the old position and the new one together
    estimate = Estimate(x, y, radius, sqrt(variance), scan.stamp)
    return track._replace(
        estimate=estimate,
        # time with the pillar counts twice as much as time without the pillar
        missed_time=max(track.missed_time - 2.0 * period, 0.0),
        beams=max(track.beams, pillar.beams),
        updated_at=scan.stamp,
        # a new pillar is watched from its first sighting on (see `_walks` and `_confirmed_if_watched`)
        anchor=track.anchor or Anchor(estimate, laser_in_odom.position[:2]),
    )


def _deviation_at(estimate: Estimate, stamp: float) -> float:
    """Return the standard deviation of the position at a time [m], which grows because odom drifts."""
    return hypot(estimate.deviation, _DRIFT * sqrt(max(stamp - estimate.seen_at, 0.0)))
