"""Traction of a skid-steer robot: friction forces between wheels and ground.

In: the robot's velocity in the plane, the place and load of each wheel's contact. Out: the ground's forces.

Bullet's own friction is not used, because its axes are fixed in the world. With it, a skid-steer robot turns
at half of the commanded rate, with a ripple of 50 %. So the wheels have no friction in Bullet, and this
module computes the force F of the ground on each wheel. F is Coulomb friction against the slip s, which is
the velocity at which the tread moves over the ground:

    F = -k s,   k = mu N (N / N0)^(-1/3) / sqrt(|s|^2 + vs^2)

If the slip is much faster than the slip speed vs, this is dry friction, which does not depend on the speed.
If it is slower, the force is proportional to the slip (viscous friction), so that the force does not jump
when a wheel stops. N is the load of the wheel, and N0 is a quarter of the robot's weight. The power -1/3 is
the load sensitivity of rubber (Schallamach, Proc. Phys. Soc. B 65, 1952: a contact area grows with N^(2/3)).
It has an effect, because the published centre of mass puts 62 % of the Husky's weight on its right wheels.

The forces depend on the velocity u = (vx, vy, yaw rate) of the robot, and the velocity depends on the forces.
So the velocity u+ after the step is solved for all wheels together. This implicit method is stable for any vs
and any duration dt of a step. M is the matrix of the masses and the yaw inertia. For each contact, the matrix
J computes the velocity of the contact from u (J' is its transpose), and v_tread is the velocity at which the
wheel would roll without slip, so that s = J u+ - v_tread:

    (M + dt sum J'kJ) u+ = M u + dt (sum J'k v_tread + external - M w x u)

The term M w x u is needed because base_link turns by w dt during the step, so a velocity that is constant in
the world has another direction in base_link after the step.

k also depends on the slip after the step, so k is improved in a few rounds; at steady speed, the first round
is enough. Two drives of 60 s with the same changing commands, at 200 Hz and at 2000 Hz, end 0.01 m from each
other. If k came from the slip before the step, they would end 0.10 m from each other.

This model agrees to within 5 % with the published wheel_separation_multiplier of 1.875, which was found on
real ground. If the robot turns in place, lengthwise and sideways forces balance at an effective track of
(1 + g (wheelbase / track)^2) track, where g is the ratio of sideways to lengthwise grip (`lateral_grip`;
F_y = -g k s_y). With equal grip, the factor is 1.80, at any mu.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import List, NamedTuple, Sequence, Tuple

from husky_highlevel_controller.datatypes import Vector3

Vector2 = Tuple[float, float]

# exponent of the wheel's load in the coefficient of friction: a heavily loaded tyre has a smaller coefficient
LOAD_SENSITIVITY = -1.0 / 3.0
# `ground_forces` ends after this number of rounds
MAX_ITERATIONS = 3
# `ground_forces` also ends if a round has changed the velocity by less than this multiple of the slip speed
SETTLED = 0.1
STANDARD_GRAVITY = 9.81  # [m/s^2]


@dataclass(frozen=True)
class TractionConfig:
    """The tyres."""

    # coefficient of friction of a wheel that carries a quarter of the robot's weight (Husky URDF: mu1 = mu2 =
    # 1.0)
    friction: float = 1.0
    # [m/s] If the slip is slower than this speed, friction is viscous: it is proportional to the slip. So a
    # robot on a slope creeps at about tan(slope) * slip_speed.
    slip_speed: float = 0.01
    # ratio of sideways to lengthwise friction; 1.0 if friction is equal in all directions
    lateral_grip: float = 1.0


class WheelContact(NamedTuple):
    """Contact of one wheel with the ground."""

    x: float  # [m] distance from the robot's centre of mass, along base_link's x
    y: float  # [m] distance from the robot's centre of mass, along base_link's y
    load: float  # [N] normal force
    surface_speed: float  # [m/s] backward speed of the tread at the ground, which is wheel speed times radius


# x and y of a wheel as in WheelContact [m], its largest friction force [N], which is 0 for a wheel in the
# air, and its `surface_speed` [m/s]; a plain tuple is fast, and each step makes one for each wheel
_Tread = Tuple[float, float, float, float]


def ground_forces(
    contacts: Sequence[WheelContact],
    velocity: Vector3,
    external: Vector2,
    mass: float,
    yaw_inertia: float,
    dt: float,
    config: TractionConfig,
) -> List[Vector2]:
    """Return the ground's force on each wheel over the next step, in base_link's x and y [N].

    The slip of a wheel is the velocity of its tread over the ground. For a wheel at (x, y), the slip is
    (vx - yaw_rate y - surface_speed, vy + yaw_rate x): the velocity of the robot at this place, minus the
    speed at which the wheel rolls. The force on the wheel is -k times the slip after the step, where k is the
    wheel's largest friction force divided by the speed of the slip.

    The slip depends on the robot's velocity after the step, and k depends on the slip. So each round computes
    k from the velocity that the round before has found, and then a better velocity with these k.

    Args:
        contacts: one per wheel; a wheel in the air has load 0 and gets no force.
        velocity: (vx, vy, yaw rate) of the centre of mass, in base_link [m/s, rad/s].
        external: other force in the plane, in base_link, such as gravity on a slope [N].
        mass: mass of the whole robot [kg].
        yaw_inertia: inertia of the whole robot about its centre of mass [kg m^2].
        dt: duration of the step [s].
        config: the tyres.
    """
    treads = _treads(contacts, mass, config)
    vx, vy, yaw_rate = velocity
    # momentum [kg m/s] and angular momentum [kg m^2/s] after the step if there were no friction. The axes of
    # base_link turn during the step by yaw_rate * dt. So the velocity along these axes turns back by this
    # angle, which gives the terms with yaw_rate.
    momentum = (
        mass * vx + dt * (external[0] + mass * yaw_rate * vy),
        mass * vy + dt * (external[1] - mass * yaw_rate * vx),
        yaw_inertia * yaw_rate,
    )
    ks: List[float] = []  # force per slip of each wheel [N s/m]
    for _ in range(MAX_ITERATIONS):
        last_vx, last_vy, last_yaw_rate = vx, vy, yaw_rate
        ks = [
            # the largest force divided by the speed of the slip; `slip_speed` avoids a division by zero
            max_force / hypot(vx - yaw_rate * y - surface_speed, vy + yaw_rate * x, config.slip_speed)
            for x, y, max_force, surface_speed in treads
        ]
        vx, vy, yaw_rate = _velocity_after_step(ks, treads, momentum, mass, yaw_inertia, dt, config)
        # [m/s] change of the velocity; the yaw rate counts as the speed at a distance of 1 m
        change = hypot(vx - last_vx, vy - last_vy, yaw_rate - last_yaw_rate)
        if change < SETTLED * config.slip_speed:
            break
    # -k times the slip of each wheel, forwards and to the left; grip to the side differs by `lateral_grip`
    return [
        (-k * (vx - yaw_rate * y - surface_speed), -k * config.lateral_grip * (vy + yaw_rate * x))
        for k, (x, y, _, surface_speed) in zip(ks, treads)
    ]


def _treads(contacts: Sequence[WheelContact], mass: float, config: TractionConfig) -> List[_Tread]:
    """Return x and y [m], largest friction force [N] and surface speed [m/s] of each wheel."""
    quarter_weight = mass * STANDARD_GRAVITY / 4.0  # [N] load of a wheel of a robot that stands on a level
    treads = []
    for x, y, load, surface_speed in contacts:
        max_force = 0.0
        if load > 0.0:
            # the coefficient of friction of rubber is smaller if the load is larger
            max_force = config.friction * load * (load / quarter_weight) ** LOAD_SENSITIVITY
        treads.append((x, y, max_force, surface_speed))
    return treads


def _velocity_after_step(
    ks: Sequence[float],
    treads: Sequence[_Tread],
    momentum: Vector3,
    mass: float,
    yaw_inertia: float,
    dt: float,
    config: TractionConfig,
) -> Vector3:
    """Return vx, vy and yaw rate after the step, if each wheel has the force -k times its slip then.

    They are the solution of three linear equations, with terms that the wheels add up::

        a vx              +  b yaw_rate  =  px    (momentum along x)
                 e vy     +  c yaw_rate  =  py    (momentum along y)
        b vx  +  c vy     +  d yaw_rate  =  pw    (angular momentum)

    Args:
        ks: force per slip of each wheel [N s/m].
        treads: positions and surface speeds of the wheels.
        momentum: px, py [kg m/s] and pw [kg m^2/s] after a step without friction.
        mass: mass of the whole robot [kg].
        yaw_inertia: inertia of the whole robot about its centre of mass [kg m^2].
        dt: duration of the step [s].
        config: the tyres.
    """
    grip = config.lateral_grip
    # the values without friction
    a, b, c, d, e = mass, 0.0, 0.0, yaw_inertia, mass
    px, py, pw = momentum
    for k, (x, y, _, surface_speed) in zip(ks, treads):
        # The friction of the wheel changes the momentum along x by -k dt (vx - yaw_rate y - surface_speed),
        # and the momentum along y by -k dt grip (vy + yaw_rate x). The angular momentum changes by x times
        # the change along y, minus y times the change along x. The terms with the unknown velocity are added
        # to the left sides of the equations, and the terms with the known surface speed to the right.
        kdt = k * dt
        a += kdt
        b -= kdt * y
        c += kdt * x * grip
        d += kdt * (x * x * grip + y * y)
        e += kdt * grip
        px += kdt * surface_speed
        pw -= kdt * surface_speed * y
    # The first two equations give vx = (px - b yaw_rate) / a and vy = (py - c yaw_rate) / e. Put into the
    # third equation, they give
    #   yaw_rate = (pw - b px / a - c py / e) / (d - b b / a - c c / e)
    # The code computes c / e as (c a / e) / a. If the grip is equal in all directions, a is equal to e, so
    # c a / e is exactly c, without rounding.
    c_a_by_e = c * (a / e)
    yaw_rate = (pw - (b * px + c_a_by_e * py) / a) / (d - (b * b + c_a_by_e * c) / a)
    return (px - b * yaw_rate) / a, (py - c * yaw_rate) / e, yaw_rate
