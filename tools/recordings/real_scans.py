"""Pillar detection and tracking on logs of real lidars: sightings, ghosts, confirmed estimates.

./dev run python tools/recordings/real_scans.py LOG... [--scans 1500] [--tolerance 0.15]

A log is a CARMEN log with corrected poses (`*.log`, `*.log.gz`: acschaefer/ple, data/carmen) or a rosbag of
sensor_msgs/LaserScan from lidars at rest (tysik/obstacle_detector, resources). Parameters are those of
config/controller.yaml with config/robot.yaml and the lidar's limits of config/robot_profile.yaml; only the
tolerance of the radius is wider, because few columns in the logs have a diameter of exactly 0.4 m.

A place is a position at which a pillar was found. It is judged by the scans that look at it from at
most 12 m, and at least 0.7 m away from the positions at which the pillar was found; in a rosbag by all scans.
The place stands if at least half of these scans have a return there. It is a ghost if less than a fifth have.
It is not judged if there are fewer than three such scans.

The first rows count the pillars of all scans by their number of beams. "confirmed" counts the first estimate
that a controller confirms, for a controller that begins at each scan. A round body is a place that stands and
has returns on most of its circle. "from two places" counts the round bodies that were seen from two
positions; it says of how many the controller confirms an estimate if it gets no other pillars.
"""

from __future__ import annotations

import argparse
import gzip
from dataclasses import replace
from functools import partial
from math import dist, hypot, pi, radians
from pathlib import Path
from typing import Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np
import yaml

from husky_highlevel_controller.controller.pillar_detection import Pillar, PillarConfig, find_pillars
from husky_highlevel_controller.controller.tracking import BASELINE, Track, follow
from husky_highlevel_controller.datatypes import Pose, Pose2D, Scan
from husky_highlevel_controller.geometry import pose_from_2d, transform_point, wrap_angle

CONFIG = Path(__file__).parents[2] / "config"
# [m] a scan that judges a place is at least this far from the lidar's positions at which the pillar was found
ELSEWHERE = 0.7
FARTHEST = 12.0  # [m] largest distance from a place to the lidar of a scan that judges it
SLACK = 0.1  # [m] errors of the poses
# smallest share of the judging scans that have a return, if the place stands; share below which the place is
# a ghost; smallest number of scans that judge a place
STANDS, GHOST, VOTERS = 0.5, 0.2, 3
LONGEST_DRIVE = 40  # number of scans in which a controller may confirm an estimate
SAME_BODY = 0.4  # [m] places that are nearer to each other are one body
SECTORS = 8  # number of equal sectors of a circle
ROUND_SECTORS = 5  # smallest number of these sectors that have returns, if the body is round


class Log(NamedTuple):
    """Scans of one lidar, and the pose of each."""

    name: str
    scans: List[Scan]
    poses: np.ndarray  # (N, 3) poses of the lidar: x, y [m], yaw [rad]
    at_rest: bool  # the lidar never moved


class Place(NamedTuple):
    """Position at which a pillar was found, and the scans in which it was found."""

    x: float  # [m]
    y: float  # [m]
    radius: float  # [m]
    beams: int  # largest number of beams of a scan that meet it
    seen_from: Tuple[int, ...]  # indices of the scans in which it was found


class Counts(NamedTuple):
    """Numbers of places."""

    found: int
    judged: int
    standing: int
    ghosts: int


def read_carmen(path: Path, max_range: float, speeds: Tuple[float, float]) -> Log:
    """Return the scans of a CARMEN log with the poses of a map.

    Args:
        path: path of the log; 180 or 181 beams are 1 degree apart, 360 or 361 beams 0.5 degrees.
        max_range: distance from which on a reading means no return [m].
        speeds: speeds [m/s] and [rad/s] for the stamps of the scans, because few logs have true stamps.
    """
    scans: List[Scan] = []
    poses: List[Tuple[float, float, float]] = []
    stamp = 0.0
    with (gzip.open if path.suffix == ".gz" else open)(path, "rt", errors="replace") as lines:
        for line in lines:
            words = line.split()
            if not words or words[0] != "FLASER":
                continue
            count = int(words[1])
            ranges = np.array(words[2 : 2 + count], dtype=float)
            x, y, yaw = map(float, words[2 + count : 5 + count])
            if poses:
                driven = hypot(x - poses[-1][0], y - poses[-1][1])
                # time for the way and the turn since the last scan, but at least 0.1 s
                stamp += max(driven / speeds[0], abs(wrap_angle(yaw - poses[-1][2])) / speeds[1], 0.1)
            step = radians(180.0 / (count - count % 2))  # 180 or 360 steps to half a turn
            last = -pi / 2.0 + (count - 1) * step
            scans.append(Scan(stamp, "laser", -pi / 2.0, last, 0.01, max_range, ranges))
            poses.append((x, y, yaw))
    if not scans:
        raise SystemExit(f"{path}: no FLASER line in this file. Pass a CARMEN log")
    return Log(path.name.split(".")[0].replace("-corrected", ""), scans, np.array(poses), at_rest=False)


def read_bag(path: Path) -> List[Log]:
    """Return a log for each LaserScan topic of a rosbag from lidars at rest."""
    import rosbag

    scans: Dict[str, List[Scan]] = {}
    with rosbag.Bag(str(path)) as bag:
        for topic, message, _ in bag.read_messages():
            if message._type == "sensor_msgs/LaserScan":
                stamp, ranges = message.header.stamp.to_sec(), np.array(message.ranges)
                limits = message.angle_min, message.angle_max, message.range_min, message.range_max
                scans.setdefault(topic, []).append(Scan(stamp, message.header.frame_id, *limits, ranges))
    return [
        Log(f"{path.stem} {topic}", taken, np.zeros((len(taken), 3)), at_rest=True)
        for topic, taken in scans.items()
    ]


def views(log: Log, place: Place) -> Tuple[np.ndarray, np.ndarray]:
    """Return masks (N,) of the scans with a return at a place, and of the scans that look through the place.

    Only 9 beams to the middle 90 % of the place's width are used. A scan has a return at the place if a third
    of these beams end there. If fewer end there, but more than half end there or farther away, the scan looks
    through the place.
    """
    first = log.scans[0]
    step, count = first.angle_increment, len(first.ranges)
    dx, dy = place.x - log.poses[:, 0], place.y - log.poses[:, 1]
    distance = np.hypot(dx, dy)  # (N,) [m] from the lidar to the centre of the place
    bearing = np.arctan2(dy, dx) - log.poses[:, 2]  # (N,) [rad] of the centre, seen from the lidar
    # (N,) [rad] half of the angle that the middle 90 % of the place fill
    half_width = np.arcsin(np.minimum(0.9 * place.radius / np.maximum(distance, 1e-9), 1.0))
    bearings = bearing[:, None] + half_width[:, None] * np.linspace(-1.0, 1.0, 9)  # (N, 9) [rad]
    # angles from the first beam, from -pi/2 to 3/2 pi, so that small negative ones stay negative
    angles = np.mod(bearings - first.angle_min + pi / 2, 2.0 * pi) - pi / 2
    beams = np.rint(angles / step).astype(int)  # (N, 9) indices of the beams
    # (N,) true for the scans in which all 9 beams exist, and whose lidar is near, but not in the place
    inside = ((beams >= 0) & (beams < count)).all(axis=1) & (distance < FARTHEST) & (distance > place.radius)
    has_return, looks_through = np.zeros(len(log.scans), dtype=bool), np.zeros(len(log.scans), dtype=bool)
    for i in inside.nonzero()[0]:
        ranges = log.scans[i].returns[beams[i]]  # (9,) [m]
        directions = log.poses[i, 2] + first.angle_min + beams[i] * step  # (9,) [rad] in the log's frame
        with np.errstate(invalid="ignore"):
            # (9,) [m] from the centre of the place to the end of each beam
            off_x = ranges * np.cos(directions) - dx[i]
            off_y = ranges * np.sin(directions) - dy[i]
        ends_there = np.hypot(off_x, off_y) < place.radius + SLACK
        ends_there_or_beyond = ranges > distance[i] - place.radius - SLACK
        has_return[i] = 3 * ends_there.sum() >= len(ranges)
        looks_through[i] = not has_return[i] and 2 * ends_there_or_beyond.sum() > len(ranges)
    return has_return, looks_through


def share_standing(log: Log, place: Place) -> Optional[float]:
    """Return the share of the judging scans that have a return at the place; None if they are too few."""
    has_return, looks_through = views(log, place)
    if not log.at_rest:
        # (N,) true for the scans that are far enough from all positions at which the pillar was found
        elsewhere = np.ones(len(log.scans), dtype=bool)
        for scan in place.seen_from:
            away = log.poses[:, :2] - log.poses[scan, :2]
            elsewhere &= np.hypot(away[:, 0], away[:, 1]) >= ELSEWHERE
        has_return, looks_through = has_return & elsewhere, looks_through & elsewhere
    voters = int(has_return.sum() + looks_through.sum())
    return has_return.sum() / voters if voters >= VOTERS else None


def is_round(log: Log, place: Place) -> bool:
    """Return whether 80 % of all returns near a place lie on its circle, in enough sectors of the circle."""
    has_return, _ = views(log, place)
    points = []
    for i in has_return.nonzero()[0]:
        scan, (x, y, yaw) = log.scans[i], log.poses[i]
        returns = np.where(scan.valid, scan.ranges, 1e9)  # without a return, a point is far away
        points.append(
            np.stack([x + returns * np.cos(scan.bearings + yaw), y + returns * np.sin(scan.bearings + yaw)])
        )
    if not points:
        return False
    # (2, M) [m] all returns of these scans, relative to the centre of the place
    off = np.concatenate(points, axis=1) - [[place.x], [place.y]]
    distance, bearing = np.hypot(off[0], off[1]), np.arctan2(off[1], off[0])
    near = distance < place.radius + 0.25  # returns farther outside belong to other objects
    on_circle = near & (np.abs(distance - place.radius) < SLACK)
    width = 2.0 * pi / SECTORS
    sectors = np.unique(np.floor((bearing[on_circle] + pi) / width).clip(0, SECTORS - 1))
    return on_circle.sum() >= 0.8 * near.sum() and len(sectors) >= ROUND_SECTORS


def in_odom(log: Log, scan: int, pillar: Pillar) -> Tuple[float, float]:
    """Return the centre of a pillar of a scan in the log's frame, x, y [m]."""
    return transform_point(laser_pose(log.poses[scan]), (pillar.x, pillar.y, 0.0))[:2]


def laser_pose(row: Sequence[float]) -> Pose:
    """Return the pose of the lidar from x, y [m] and yaw [rad]."""
    return pose_from_2d(Pose2D(*map(float, row)))


def confirmed_from(log: Log, found: List[List[Pillar]], start: int) -> Optional[Place]:
    """Return the first estimate that a controller confirms if it begins at the scan `start`, or None.

    `found` has the pillars of each scan.
    """
    track = Track()
    seen_from: List[int] = []  # scans in which the pillar of the estimate was found
    for i in range(start, min(start + LONGEST_DRIVE, len(log.scans))):
        anchor_before = track.anchor
        track, sighting, _ = follow(track, found[i], log.scans[i], laser_pose(log.poses[i]))
        if track.estimate is not None and sighting is not None:
            # the tracker makes a new anchor for another pillar, but also for a confirmed one
            is_same_pillar = track.anchor is anchor_before or track.confirmed
            seen_from = [*seen_from, i] if is_same_pillar else [i]
            if track.confirmed:
                x, y, radius = track.estimate[:3]
                return Place(x, y, radius, track.beams, tuple(seen_from))
    return None


def distinct(places: List[Place]) -> List[Place]:
    """Return the first place of each body."""
    kept: List[Place] = []
    for place in places:
        if all(hypot(place.x - other.x, place.y - other.y) > SAME_BODY for other in kept):
            kept.append(place)
    return kept


def counts_of(log: Log, places: List[Place]) -> Counts:
    """Return how many places were found and judged, and how many stand or are ghosts."""
    shares = [share_standing(log, place) for place in places]
    judged = [share for share in shares if share is not None]
    return Counts(
        found=len(places),
        judged=len(judged),
        standing=sum(share >= STANDS for share in judged),
        ghosts=sum(share < GHOST for share in judged),
    )


def report(log: Log, config: PillarConfig) -> Dict[str, Counts]:
    """Return the rows of one log by name, as the docstring of this module describes them."""
    found = [find_pillars(scan, config) for scan in log.scans]
    places = []
    for i, pillars in enumerate(found):
        for pillar in pillars:
            places.append(Place(*in_odom(log, i, pillar), pillar.radius, pillar.beams, (i,)))
    rows = {
        "2-3 beams": counts_of(log, [place for place in places if place.beams <= 3]),
        "4-5 beams": counts_of(log, [place for place in places if 4 <= place.beams <= 5]),
        "6 and more": counts_of(log, [place for place in places if place.beams >= 6]),
    }
    confirmed = [confirmed_from(log, found, start) for start in range(len(log.scans))]
    estimates = [place for place in confirmed if place is not None]
    rows["confirmed"] = counts_of(log, estimates)
    rows["bodies confirmed"] = counts_of(log, distinct(estimates))
    # of the places of one body, the place with the most beams counts
    places_by_beams = sorted(places, key=lambda place: -place.beams)
    bodies = [
        place
        for place in distinct(places_by_beams)
        if (share_standing(log, place) or 0.0) >= STANDS and is_round(log, place)
    ]
    rows["round bodies"] = Counts(found=len(bodies), judged=len(bodies), standing=len(bodies), ghosts=0)
    # for each body, whether it is confirmed; None if it was not seen from two positions
    are_confirmed = [confirmed_alone(log, found, body) for body in bodies]
    seen_twice = sum(is_confirmed is not None for is_confirmed in are_confirmed)
    # in this row, `standing` is the number of bodies of which an estimate is confirmed
    rows["  from two places"] = Counts(
        found=seen_twice, judged=seen_twice, standing=sum(map(bool, are_confirmed)), ghosts=0
    )
    return rows


def confirmed_alone(log: Log, found: List[List[Pillar]], body: Place) -> Optional[bool]:
    """Return whether the tracker confirms a body if the body is the only pillar in the scans.

    None if the body was not seen from two positions BASELINE apart within 5 scans.
    """
    pillars_at_body = []  # for each scan, the pillars that are this body
    for i, pillars in enumerate(found):
        at_body = [p for p in pillars if dist(in_odom(log, i, p), (body.x, body.y)) < SAME_BODY]
        pillars_at_body.append(at_body)
    seen = [i for i, pillars in enumerate(pillars_at_body) if pillars]  # scans in which the body was found
    dx, dy = np.diff(log.poses[seen, :2], axis=0).T
    driven = np.hypot(dx, dy)  # [m] between each two of these scans that follow each other
    is_soon = np.diff(seen) <= 5
    if not (driven[is_soon] >= BASELINE).any():
        return None
    return any(confirmed_from(log, pillars_at_body, start) is not None for start in seen)


def main() -> None:
    """Print the table of each log, and of all together."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--scans", type=int, default=1500, help="maximum number of scans of a log")
    parser.add_argument("--tolerance", type=float, default=0.15, help="tolerance of the radius [m]")
    options = parser.parse_args()
    values = {}
    for name in ("controller.yaml", "robot.yaml"):
        values.update(yaml.safe_load((CONFIG / name).read_text()))
    lidar = yaml.safe_load((CONFIG / "robot_profile.yaml").read_text())["lidar"]
    known = {name: values[name] for name in PillarConfig.__dataclass_fields__}
    config = replace(PillarConfig(**known), radius_tolerance=options.tolerance)
    totals: Dict[str, Tuple[int, ...]] = {}
    for path in options.logs:
        carmen = partial(
            read_carmen, max_range=lidar["range_max"], speeds=(values["max_linear"], values["max_angular"])
        )
        for log in read_bag(path) if path.suffix == ".bag" else [carmen(path)]:
            log = log._replace(scans=log.scans[: options.scans], poses=log.poses[: options.scans])
            rows = report(log, config)
            show(f"{log.name} ({len(log.scans)} scans)", rows)
            for name, counts in rows.items():
                before = totals.get(name, (0, 0, 0, 0))
                totals[name] = tuple(a + b for a, b in zip(before, counts))
    show("all", totals)


def show(title: str, rows: Mapping[str, Sequence[int]]) -> None:
    """Print the rows of one log."""
    print(title)
    for name, (count, judged, stand, ghosts) in rows.items():
        shares = f"{stand / judged:6.1%} stand, {ghosts / judged:6.1%} ghosts" if judged else ""
        print(f"  {name:18} {count:6} found, {judged:6} judged {shares}", flush=True)


if __name__ == "__main__":
    main()
