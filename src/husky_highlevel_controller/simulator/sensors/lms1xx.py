"""Simulated SICK LMS1xx of a real Husky: beams with a width, swept while the robot moves.

In: the robot's true pose and motion, a function that casts rays, a random generator. Out: a `Scan`.

Sources: the driver (LMS1xx 0.3.0, LMS1xx_node) and the sensor's 50 Hz at 0.5 degrees give range_min,
range_max, beams, ranges in whole millimetres, the range 0.0 of a miss, and 0.5 / 360 / 50 s between beams.
The operating instructions (SICK 8012471, 3.6.2) give the spot, 8 mm + 15 mrad x distance. The data sheet
gives 12 mm of statistical error, and 18 m of range on a surface of 10 % remission. The remission is the
fraction of the light that a surface returns. No source gives the remission of surfaces, the distance below
which two echoes become one, and the scale of the intensities, so these three values are assumed.

A beam is a round spot of light, which becomes wider with the distance. At an edge, a part of the spot falls
on the near surface, and the rest on a surface behind it. So several rays in the scan plane sample the spot
across its width, and each ray carries a fraction of the light. An echo is the light that comes back from
surfaces at nearly one distance. Its range is the mean of the rays of this echo, so an edge gives ranges
between near and far. An echo is detected if its fraction of the light is large enough for its distance: half
a spot on a pillar is enough at 10 m, but not at 20 m.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import inf, pi
from typing import List, NamedTuple, Tuple

import numpy as np

from husky_highlevel_controller.config import number
from husky_highlevel_controller.datatypes import Beams, Pose, RobotState, Scan, beams_at
from husky_highlevel_controller.geometry import compose, quat_from_rpy
from husky_highlevel_controller.simulator.sensors.lidar import CastRays

RAYS_PER_BEAM = 5  # number of rays from one beam to the next
# [rad] Rays sample the spot of a beam up to this angle on either side of its middle. The edges of a spot at
# 0.3 m are at this angle. The edges of a spot on a nearer surface are at a larger angle, and are not sampled.
MAX_HALF_ANGLE = 0.0208
# If the robot moves, a scan is divided into this number of pieces. All rays of a piece start at the robot's
# pose at the middle of the piece, so ranges are wrong by less than 1.5 mm at 1 m/s.
SWEEP_PIECES = 5
MAX_ECHOES = 3  # number of echoes per beam that are evaluated, nearest first
FARTHEST = 60.0  # [m] largest distance of an echo
STANDING_SPEED = 1e-3  # [m/s], [rad/s] slower motion counts as standing
DARK_REMISSION, DARK_RANGE = 0.1, 18.0  # a surface with this remission is detected up to this range [m]
# intensity if the whole spot falls on a surface that returns all light; an assumed value
INTENSITY_SCALE = 255.0


@dataclass(frozen=True)
class Lms1xxConfig:
    """Beams, angles, range and noise of the lidar."""

    beams: int = number(2, 1082, "number of beams", default=541)
    angle_max: float = number(
        0.01, 3.1, "angle of the last beam; the first has the negative angle [rad]", default=2.35619
    )
    range_min: float = number(0.0, 10.0, "a shorter range reads 0 [m]", default=0.01)
    range_max: float = number(0.1, 100.0, "a longer range reads 0 [m]", default=20.0)
    resolution: float = number(1e-6, 0.1, "ranges are multiples of this [m]", default=0.001)
    noise: float = number(0.0, 1.0, "standard deviation [m]", default=0.012)
    time_increment: float = number(0.0, 3.6e-5, "time from one beam to the next [s]", default=2.778e-5)
    spot: float = number(0.0, 0.1, "diameter of the beam at the lidar [m]", default=0.008)
    divergence: float = number(0.001, 0.04, "growth of the diameter [rad]", default=0.015)
    remission: float = number(
        0.01, 1.0, "fraction of the light that surfaces return; 0.2 is a grey card", default=0.2
    )
    echo_length: float = number(0.01, 5.0, "echoes closer than this merge [m]", default=0.5)

    @property
    def sweep_time(self) -> float:
        """Time from the first beam to the last [s]."""
        return (self.beams - 1) * self.time_increment


class Lms1xx:
    """The lidar on a base_link that moves."""

    def __init__(
        self, config: Lms1xxConfig, cast_rays: CastRays, frame: str, pose_in_base: Pose, scan_time: float
    ) -> None:
        """Make a lidar.

        Args:
            config: beams, angles, range and noise.
            cast_rays: measures distances along rays.
            frame: frame of the scans.
            pose_in_base: pose of the lidar in base_link.
            scan_time: time from scan to scan [s].
        """
        self._config, self._cast_rays = config, cast_rays
        self._frame, self._pose_in_base, self._scan_time = frame, pose_in_base, scan_time

    def reset(self, rng: np.random.Generator) -> None:
        """Restart with noise from `rng`."""
        self._rng = rng

    def sample(self, state: RobotState, stamp: float) -> Scan:
        """Return the sweep that ends at `stamp` [s]; the stamp of the scan is the time of its first beam."""
        config = self._config
        (vx, vy, _), (_, _, yaw_rate) = state.velocity_in_base, state.angular_velocity_in_base
        is_moving = max(abs(vx), abs(vy), abs(yaw_rate)) > STANDING_SPEED
        # range [m] of each beam's echo, and fraction of the light in this echo; 0 if there is no echo
        ranges_of_pieces, fractions_of_pieces = [], []
        for piece in _pieces(config, SWEEP_PIECES if is_moving else 1):
            base_in_world = _pose_before(state, piece.time_to_end) if is_moving else state.pose_in_world
            # a ray may reach beyond `range_max`; below, the noisy range decides whether an echo is valid
            depths = self._cast_rays(compose(base_in_world, self._pose_in_base), piece.rays, FARTHEST)
            ranges_of_piece, fractions_of_piece = _echoes(depths, piece, config)
            ranges_of_pieces.append(ranges_of_piece)
            fractions_of_pieces.append(fractions_of_piece)
        ranges, light_fractions = np.concatenate(ranges_of_pieces), np.concatenate(fractions_of_pieces)
        # every beam gets a random number, even if it meets nothing, so that the noise of one beam does not
        # depend on the other beams
        noisy = ranges + self._rng.normal(0.0, config.noise, config.beams)
        noisy = np.round(noisy / config.resolution) * config.resolution
        is_echo = (ranges > 0.0) & (noisy >= config.range_min) & (noisy <= config.range_max)
        noisy[~is_echo] = 0.0
        intensities = np.where(is_echo, np.round(INTENSITY_SCALE * config.remission * light_fractions), 0.0)
        for array in (noisy, intensities):
            array.setflags(write=False)
        return Scan(
            stamp=stamp - config.sweep_time,
            frame=self._frame,
            angle_min=-config.angle_max,
            angle_max=config.angle_max,
            range_min=config.range_min,
            range_max=config.range_max,
            ranges=noisy,
            time_increment=config.time_increment,
            scan_time=self._scan_time,
            intensities=intensities,
        )


def _pose_before(state: RobotState, age: float) -> Pose:
    """Return the pose of base_link in the world `age` s ago, estimated from the present velocity and tilt."""
    (vx, vy, vz), (_, _, yaw_rate) = state.velocity_in_base, state.angular_velocity_in_base
    turn_back = quat_from_rpy(0.0, 0.0, -yaw_rate * age)
    pose_before_in_base = Pose((-vx * age, -vy * age, -vz * age), turn_back)
    return compose(state.pose_in_world, pose_before_in_base)


class _Piece(NamedTuple):
    """Neighbouring beams of a scan whose rays are cast from one pose."""

    beams: int  # number of beams
    time_to_end: float  # [s] time from the middle beam of this piece to the end of the scan
    rays: Beams  # all rays that sample the light spots of these beams
    offsets: np.ndarray  # (S,) [rad] angles of the S rays of one spot, relative to the middle of its beam


@lru_cache(maxsize=8)
def _pieces(config: Lms1xxConfig, count: int) -> List[_Piece]:
    """Divide the scan into `count` pieces of neighbouring beams, and return them with their rays.

    The robot may move during a scan, so the rays of each piece are cast from another pose. There are
    RAYS_PER_BEAM rays from one beam to the next. A spot is wider than this, so neighbouring spots overlap and
    share rays.
    """
    angles, increment = np.linspace(-config.angle_max, config.angle_max, config.beams, retstep=True)
    step = float(increment) / RAYS_PER_BEAM  # [rad] angle from one ray to the next
    rays_per_side = int(MAX_HALF_ANGLE / step) + 1  # number of a spot's rays on either side of its middle ray
    offsets = step * np.arange(-rays_per_side, rays_per_side + 1)
    pieces = []
    for beams in np.array_split(np.arange(config.beams), min(count, config.beams)):
        middle_beam = (beams[0] + beams[-1]) / 2.0
        # the scan ends with the last beam
        time_to_end = (config.beams - 1 - middle_beam) * config.time_increment
        # The rays are counted from the middle ray of the first spot, which is number 0. The first ray of the
        # piece is at the edge of the first spot, and the last ray is at the edge of the last spot.
        middle_of_last_spot = (len(beams) - 1) * RAYS_PER_BEAM
        numbers = np.arange(-rays_per_side, middle_of_last_spot + rays_per_side + 1)
        rays = angles[beams[0]] + step * numbers  # [rad]
        pieces.append(_Piece(len(beams), time_to_end, beams_at(rays), offsets))
    return pieces


def _echoes(depths: np.ndarray, piece: _Piece, config: Lms1xxConfig) -> Tuple[np.ndarray, np.ndarray]:
    """Find the nearest echo of each beam that is strong enough, and return its range and fraction of light.

    Surfaces within `echo_length` give one echo, at the mean of their distances. A weak echo is skipped, and
    the next echo behind it is tried, up to MAX_ECHOES echoes.

    Args:
        depths: distances at which the rays meet a surface [m], inf for a miss.
        piece: beams of these rays.
        config: remission and spot.

    Returns:
        Ranges (N,) [m], 0 if there is no echo, and fractions (N,).
    """
    ranges, fractions = np.zeros(piece.beams), np.zeros(piece.beams)
    # (N, S) distances of the S rays that sample the spot of each beam. Each spot begins RAYS_PER_BEAM rays
    # after the spot before it. S is larger than RAYS_PER_BEAM, so neighbouring spots share rays.
    spots = np.lib.stride_tricks.sliding_window_view(depths, len(piece.offsets))[::RAYS_PER_BEAM]
    # Indices of the beams whose range is still searched: at first, all beams with a ray that meets a surface.
    # `depth` and `weights` have one row for each of these beams.
    (searched,) = np.isfinite(spots).any(axis=1).nonzero()
    depth = spots[searched]
    weights = _weights(depth, piece.offsets, config)
    depth[weights <= 0.0] = inf  # a ray outside of the round spot carries no light
    for _ in range(MAX_ECHOES):
        if not len(searched):
            break
        echo: _NearestEchoes = _nearest_echoes(depth, weights, config.echo_length)
        # The lidar just detects a surface of DARK_REMISSION that fills the spot at DARK_RANGE. The light from
        # a surface falls with the square of the distance, so a nearer echo needs less.
        least_light = DARK_REMISSION * (echo.distance / DARK_RANGE) ** 2
        has_echo = echo.light > 0.0
        is_strong = has_echo & (echo.light * config.remission >= least_light)
        found = searched[is_strong]
        ranges[found] = echo.distance[is_strong]
        # the strips of a spot's rays (see `_weights`) can have 1.02 times the area of the spot
        fractions[found] = np.minimum(echo.light[is_strong], 1.0)
        # The search goes on only for beams with a weak echo. The rays of the weak echo do not count any more,
        # so the next round finds the echo behind it.
        depth[echo.has_ray] = inf
        is_weak = has_echo & ~is_strong
        searched, depth, weights = searched[is_weak], depth[is_weak], weights[is_weak]
    return ranges, fractions


class _NearestEchoes(NamedTuple):
    """Nearest echo of each of N beams; S rays sample the spot of a beam."""

    has_ray: np.ndarray  # (N, S) true for each ray of the echo; all false if the beam has no echo
    distance: np.ndarray  # (N,) [m] mean distance of these rays
    light: np.ndarray  # (N,) fraction of the spot's light in this echo; 0 if the beam has no echo


def _nearest_echoes(depth: np.ndarray, weights: np.ndarray, echo_length: float) -> _NearestEchoes:
    """Return the nearest echo of each beam.

    The echo consists of the beam's shortest ray, and of the rays that are longer by at most `echo_length`.

    Args:
        depth: distances of the rays of N beams (N, S) [m]; inf for a ray that does not count.
        weights: fraction of the light of its spot that each ray carries (N, S).
        echo_length: largest difference of the distances in an echo [m].
    """
    # the limit FARTHEST keeps a ray of inf out of the echo, also if all rays of the beam are inf
    longest = np.minimum(depth.min(axis=1) + echo_length, FARTHEST)
    has_ray = depth <= longest[:, None]
    light_of_rays = np.where(has_ray, weights, 0.0)
    light = light_of_rays.sum(axis=1)
    # mean of the distances, weighted by the light; 1e-12 avoids a division by zero
    distance = (light_of_rays * np.where(has_ray, depth, 0.0)).sum(axis=1) / np.maximum(light, 1e-12)
    return _NearestEchoes(has_ray, distance, light)


def _weights(depths: np.ndarray, offsets: np.ndarray, config: Lms1xxConfig) -> np.ndarray:
    """Return the fraction of its spot's light that each ray carries, (N, S); 0 outside of the spot.

    Args:
        depths: distances at which the rays meet a surface (N, S) [m]; inf for a ray that misses, whose light
            does not come back.
        offsets: angles of the rays relative to the beam (S,) [rad].
        config: size and divergence of the spot.
    """
    # half the angle [rad] under which the lidar sees the spot, at each distance
    half_angle = 0.5 * (config.divergence + config.spot / np.maximum(depths, 1e-3))
    # A ray stands for a narrow strip of the round spot, at a right angle to the scan plane. The fraction of
    # the light is the area of the strip, divided by the area of the spot. With the half angle as the unit of
    # length, the strip is 2 sqrt(1 - x^2) long and step / half_angle wide, and the area of the spot is pi.
    x = offsets / half_angle  # position of the strip across the spot, from -1 to 1
    step = offsets[1] - offsets[0]
    fractions: np.ndarray = np.sqrt(np.maximum(1.0 - x * x, 0.0)) * (2.0 / pi * step) / half_angle
    return fractions
