"""Metrics of the controller: of single scans, and of whole runs.

In: numbers of random scans, scenarios, gains. Out: errors, times, touches, by the true poses.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from math import hypot, inf, pi
from typing import Callable, Tuple

import numpy as np

from husky_evaluation.rollout import Controller, Trace, model_of, rollout
from husky_evaluation.scenarios import SICK, Scenario, bare_scene, pillar_scene
from husky_evaluation.setup import Setup
from husky_highlevel_controller.controller.behaviour import decide
from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig, find_pillars
from husky_highlevel_controller.course import PILLAR_RADIUS
from husky_highlevel_controller.drawing.replay import Replay, to_html
from husky_highlevel_controller.robot import Robot
from husky_highlevel_controller.simulator.sensors.lidar import LidarConfig

GOOD = "arrived, within 2 cm, no touch"  # name of the metric `DriveResult.good` in tables and pictures
# sentence above tables that use the word "bound"
MEANING_OF_BOUND = (
    "The bound is the shortest time to the stop point that the robot's speed and acceleration allow."
)
# [m] a found pillar counts as the true pillar if their centres are nearer to each other than this
SAME_PILLAR = 0.2
# in a scan without a pillar, a found pillar counts as an error if it has at least this number of beams; with
# fewer beams, other objects look like a pillar
MANY_BEAMS = 8
# [rad] The robot faces the pillar while the bearing is below this value. A swing past the pillar counts as a
# crossing only if it reaches this bearing on the other side.
ALIGNED = 0.005
# [s] simulated time limit of a run in Gazebo's profile, and in the profile of a real robot, which may have to
# search for the pillar
DRIVE_SECONDS, SEARCH_SECONDS = 180.0, 600.0


def center_error(number: int, seed: int, clutter: bool, lidar: LidarConfig = SICK) -> float:
    """Return the error of the detected centre of a random pillar [m]; inf if the pillar was not detected.

    Args:
        number: number of the random scan with this seed.
        seed: seed of all random scans.
        clutter: whether other objects are around the pillar.
        lidar: lidar of the scan.
    """
    scene = pillar_scene(number, seed, clutter, lidar)
    assert scene.pillar is not None
    x, y, _ = scene.pillar
    pillars = find_pillars(scene.scan, PillarConfig())
    error = min((hypot(p.x - x, p.y - y) for p in pillars), default=inf)
    return error if error < SAME_PILLAR else inf  # a found pillar that is farther away is another object


def false_pillars(number: int, seed: int, lidar: LidarConfig = SICK) -> int:
    """Return the number of pillars with many beams that are found in a random scan without a pillar."""
    pillars = find_pillars(bare_scene(number, seed, lidar).scan, PillarConfig())
    return sum(pillar.beams >= MANY_BEAMS for pillar in pillars)


@dataclass(frozen=True)
class DriveResult:
    """Metrics of one run."""

    name: str
    arrived_at: float  # [s] time of the arrival; inf if the robot did not arrive
    # [s] shortest time in which the robot could arrive, with its largest speed and acceleration, if it faced
    # the pillar at the start
    bound: float
    # [m] true distance from the lidar to the pillar at the end, minus the wanted distance `stop_distance`
    final_error: float
    gap: float  # [m] true distance from the hull's front to the pillar at the end
    pushed: float  # [m] distance from the pillar's first position to its last position
    touched: Tuple[str, ...]
    # number of times that the robot swings past the pillar's direction after it has first faced the pillar
    crossings: int
    # [m] stop distance minus the smallest true distance from the lidar to the pillar; 0 if the robot always
    # keeps the stop distance
    overshoot: float
    nearest: float  # [m] smallest true gap between footprint and pillar during the run
    replay: str = ""  # file name of the run's replay; empty if there is none

    @property
    def ratio(self) -> float:
        """Return the time to arrival divided by the bound."""
        return self.arrived_at / self.bound

    @property
    def summary(self) -> str:
        """Return the end of the run in a sentence."""
        end = f"arrived after {self.arrived_at:.2f} s" if self.arrived_at < inf else "did not arrive"
        touched = f", touched {', '.join(self.touched)}" if self.touched else ""
        return f"{end}, {100.0 * self.final_error:+.1f} cm from its goal{touched}"

    @property
    def good(self) -> bool:
        """Return whether the robot stands at its goal and touched nothing."""
        return self.arrived_at < inf and not self.touched and abs(self.final_error) <= 0.02


def run_scenario(setup: Setup, scenario: Scenario, controller: Controller = decide) -> DriveResult:
    """Drive a scenario and measure the run; `controller` has the signature of `behaviour.decide`."""
    return judge_trace(drive_scenario(setup, scenario, controller), scenario, setup)


# type of a function that drives a setup in a scenario, as a task for `Workers.map`
Drive = Callable[[Tuple[Setup, Scenario]], DriveResult]


def run_scene(item: Tuple[Setup, Scenario]) -> DriveResult:
    """Call `run_scenario` with a setup and a scenario; `Workers.map` needs a task with only one argument."""
    return run_scenario(*item)


def run_with_page(item: Tuple[Setup, Scenario]) -> Tuple[DriveResult, str]:
    """Drive a scenario, and return its metrics and the HTML text of a page that plays the run.

    The metrics have the name of the page's file, which is made of the scenario's name and the gains.
    """
    setup, scenario = item
    trace = drive_scenario(setup, scenario)
    result = judge_trace(trace, scenario, setup)
    control, robot = setup.control, setup.simulator.robot
    gains = f"gains {control.p_gain_vel:g} {control.p_gain_ang:g}, stop {control.stop_distance:g} m"
    title = f"{result.name}, {gains}"
    page = to_html(Replay(title, result.summary, trace.times, trace.poses, trace.pillars, robot=robot))
    # the title, with an underscore in place of spaces and other special characters
    file_name = re.sub(r"[^a-z0-9.]+", "_", title.lower()) + ".html"
    return replace(result, replay=file_name), page


def drive_scenario(setup: Setup, scenario: Scenario, controller: Controller = decide) -> Trace:
    """Drive a scenario, and return the trace from which `judge_trace` computes the metrics."""
    return rollout(
        scenario,
        setup.control,
        setup.detector,
        setup.simulator,
        # [s] the run continues for this time after the arrival; longer if the robot has to touch the pillar,
        # because it may still push the pillar
        settle=3.0 if setup.control.stop_distance == 0.0 else 1.0,
        seconds=time_limit(setup),
        controller=controller,
    )


def time_limit(setup: Setup) -> float:
    """Return the time limit of a run [s]; longer for a real Husky, which may first search for the pillar."""
    return SEARCH_SECONDS if setup.simulator.real else DRIVE_SECONDS


def judge_trace(trace: Trace, scenario: Scenario, setup: Setup) -> DriveResult:
    """Return the metrics of a run, by the true positions of the robot and the pillar."""
    control, robot = setup.control, setup.simulator.robot
    lidar_x = model_of(robot).fixed_poses[robot.lidar_mount.frame].position[0]
    base_x, base_y, yaw = trace.poses.T
    # (N, 2) [m] positions of the lidar, which is `lidar_x` in front of base_link
    lidar_in_world = np.column_stack([base_x + np.cos(yaw) * lidar_x, base_y + np.sin(yaw) * lidar_x])
    # (N,) [m] distance from the lidar to the pillar's surface
    distances = np.hypot(*(trace.pillars - lidar_in_world).T) - PILLAR_RADIUS
    first_x, first_y = trace.pillars[0]
    last_x, last_y = trace.pillars[-1]
    return DriveResult(
        name=scenario.name,
        arrived_at=inf if trace.arrived_at is None else trace.arrived_at,
        bound=time_bound(trace, control, robot, lidar_x),
        final_error=float(distances[-1]) - control.stop_distance,
        # the lidar's distance from the pillar, minus its distance from the hull's front, which is hull[0]
        # ahead of base_link
        gap=float(distances[-1]) - (robot.footprint.hull[0] - lidar_x),
        pushed=hypot(last_x - first_x, last_y - first_y),
        touched=trace.touched,
        crossings=crossings(trace),
        overshoot=max(control.stop_distance - float(distances.min()), 0.0),
        nearest=float(robot.footprint.gaps(trace.poses, trace.pillars, PILLAR_RADIUS).min()),
    )


def time_bound(trace: Trace, control: ControlConfig, robot: Robot, lidar_x: float) -> float:
    """Return the shortest time to the stop point that the robot's speed and acceleration allow [s].

    A robot that needs this time faces the pillar at the start, drives straight ahead, and brakes at the end.
    """
    (x, y, _), (pillar_x, pillar_y) = trace.poses[0], trace.pillars[0]
    # [m] distance from the lidar to the pillar at the stop: the wanted distance, but at least the distance at
    # which the hull's front touches the pillar
    stop = max(control.stop_distance, robot.footprint.hull[0] - lidar_x)
    # [m] distance that the robot has to drive: from base_link to the pillar's centre, minus the pillar's
    # radius, the distance at the stop, and the distance from base_link to the lidar
    length = max(hypot(pillar_x - x, pillar_y - y) - PILLAR_RADIUS - stop - lidar_x, 0.0)
    speed, acceleration = min(robot.drive.max_linear, control.max_linear), robot.drive.max_linear_acceleration
    if length < speed**2 / acceleration:  # the robot brakes before it reaches full speed
        return 2.0 * float(np.sqrt(length / acceleration))
    # The way at full speed takes length / speed. Speeding up costs additional time, 0.5 * speed /
    # acceleration, and braking costs the same.
    return length / speed + speed / acceleration


def crossings(trace: Trace) -> int:
    """Return how often the robot turns past the pillar's direction, from the first alignment to the arrival.

    Only times with a target count, because a robot that searches turns past a pillar that it does not see.
    """
    until = inf if trace.arrived_at is None else trace.arrived_at
    dx, dy = (trace.pillars - trace.poses[:, :2]).T
    # (N,) [rad] true bearing of the pillar from the robot, -pi to pi, positive to the left
    bearings = (np.arctan2(dy, dx) - trace.poses[:, 2] + pi) % (2.0 * pi) - pi
    has_target = np.isfinite(trace.bearing_errors)  # the controller's own bearing is nan without a target
    bearings = bearings[(trace.times <= until) & has_target]
    aligned_rows = np.flatnonzero(np.abs(bearings) < ALIGNED)
    if not len(aligned_rows):
        return 0
    after_alignment = bearings[aligned_rows[0] :]
    first_bearing = after_alignment[0]
    # a bearing below ALIGNED counts as straight ahead, so it is on neither side
    large_bearings = after_alignment[np.abs(after_alignment) >= ALIGNED]
    # The first bearing is small, but its side counts, too. A robot that turns towards a pillar on its left is
    # usually aligned while the pillar is still a little to the left. If it then swings past the pillar, this
    # is the first change of the side.
    sides = np.sign(np.append(first_bearing, large_bearings))
    sides = sides[sides != 0.0]  # a first bearing of exactly 0 is on no side
    return int((np.diff(sides) != 0.0).sum())  # number of changes of the side
