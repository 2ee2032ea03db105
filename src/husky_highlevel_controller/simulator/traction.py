"""Traction of a skid-steer robot: friction forces between wheels and ground.

In: the robot's velocity in the plane, the place and load of each wheel's contact. Out: the ground's forces.

Bullet's own contact friction turns a skid-steer robot at half the commanded rate with a ripple of 50 %
(its friction axes are fixed in the world), so the wheels' contacts are frictionless and the ground's force
comes from here: regularised Coulomb friction against the slip s of each contact,

    F = -k s,   k = mu N (N / N0)^(-1/3) / sqrt(|s|^2 + vs^2),

viscous below the slip speed vs and dry friction above it. N0 is a quarter of the weight. The power -1/3 is
the load sensitivity of rubber (Schallamach, Proc. Phys. Soc. B 65, 1952: a contact area grows with N^(2/3)).
It has an effect, because the published centre of mass puts 62 % of the Husky's weight on its right wheels.

The velocity u+ after the step is solved for all wheels together. This implicit method is stable for any vs
and dt. base_link turns by w dt during the step, so a velocity that is constant in the world turns back in
base_link (the term M w x u):

    (M + dt sum J'kJ) u+ = M u + dt (sum J'k v_tread + external - M w x u),   F = -k s(u+).

k also depends on the slip after the step, so it is improved in a few rounds; at steady speed, the first round
is enough. If k came from the slip before the step, a mixed drive of 60 s at 200 Hz would end 0.10 m from the
same drive at 2000 Hz; now the distance is 0.01 m.

This model gives the published wheel_separation_multiplier of 1.875, which was found on real ground, to within
5 %. If the robot turns in place, lengthwise and sideways forces balance at an effective track of
(1 + g (wheelbase / track)^2) track, where g is the ratio of sideways to lengthwise grip (`lateral_grip`;
F_y = -g k s_y). With equal grip, the factor is 1.80, at any mu.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import List, NamedTuple, Sequence, Tuple

from husky_highlevel_controller.datatypes import Vector3

Vector2 = Tuple[float, float]

LOAD_SENSITIVITY = -1.0 / 3.0  # power of N in the coefficient of friction
# the iterations end after MAX_ITERATIONS, or when an iteration changes the velocity by less than SETTLED
# times vs
MAX_ITERATIONS, SETTLED = 3, 0.1
STANDARD_GRAVITY = 9.81  # [m/s^2]


@dataclass(frozen=True)
class TractionConfig:
    """The tyres."""

    # coefficient of friction of a wheel that carries a quarter of the robot's weight (Husky URDF: mu1 = mu2 =
    # 1.0)
    friction: float = 1.0
    # slip speed vs [m/s] below which friction is viscous; a robot on a slope creeps at about tan(slope) * vs
    slip_speed: float = 0.01
    # ratio of sideways to lengthwise friction; 1.0 if friction is equal in all directions
    lateral_grip: float = 1.0


class WheelContact(NamedTuple):
    """Contact of one wheel with the ground."""

    x: float  # [m] distance from the robot's centre of mass, along base_link's x
    y: float  # [m] distance from the robot's centre of mass, along base_link's y
    load: float  # [N] normal force
    surface_speed: float  # [m/s] backward speed of the tread at the ground, which is wheel speed times radius


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

    The force on a wheel is -k times its slip after the step. The slip depends on the velocity after the step,
    and k depends on the slip. So each round computes k from the slip of the round before, and then the
    velocity from three linear equations (momentum along x and y, and spin), which the module's docstring
    derives.

    Args:
        contacts: one per wheel; a wheel in the air has load 0 and gets no force.
        velocity: (vx, vy, yaw rate) of the centre of mass, in base_link [m/s, rad/s].
        external: other force in the plane, in base_link, such as gravity on a slope [N].
        mass: mass of the whole robot [kg].
        yaw_inertia: inertia of the whole robot about its centre of mass [kg m^2].
        dt: duration of the step [s].
        config: the tyres.
    """
    vx, vy, yaw_rate = last = velocity  # `last` is the velocity that the round before has found
    grip, quarter_weight = config.lateral_grip, mass * STANDARD_GRAVITY / 4.0
    # position of each contact, its largest friction force [N], and the speed of the wheel's tread; as with
    # rubber, the coefficient of friction falls with the load
    treads = [
        (
            x,
            y,
            config.friction * load * (load / quarter_weight) ** LOAD_SENSITIVITY if load > 0.0 else 0.0,
            speed,
        )
        for x, y, load, speed in contacts
    ]
    # momentum and spin after the step if there were no friction; base_link turns during the step, which gives
    # the terms with yaw_rate
    push_x = mass * vx + dt * (external[0] + mass * yaw_rate * vy)
    push_y = mass * vy + dt * (external[1] - mass * yaw_rate * vx)
    spin = yaw_inertia * yaw_rate
    ks: List[float] = []  # force per slip of each wheel [N s/m]
    for _ in range(MAX_ITERATIONS):
        # The velocity after the step solves [[a, 0, b], [0, e, c], [b, c, d]] (vx, vy, yaw_rate) = (px, py,
        # pw), whose rows are the momentum along x and y, and the spin. These are the terms without friction;
        # each wheel adds its own terms below.
        a, b, c, d, e = mass, 0.0, 0.0, yaw_inertia, mass
        px, py, pw = push_x, push_y, spin
        ks = []
        for x, y, limit, speed in treads:
            # force per slip: the largest force divided by the speed of the slip, which is never 0 because of
            # `slip_speed`
            k = limit / hypot(vx - yaw_rate * y - speed, vy + yaw_rate * x, config.slip_speed)
            ks.append(k)
            # the wheel's impulse in the step is -k dt (slip ahead, grip * slip to the left), with the slips
            # vx - yaw_rate y - speed and vy + yaw_rate x. The terms with the unknown velocity are added to
            # the matrix (a to e). The terms with the known `speed` are added to the right side (px, pw).
            kdt = k * dt
            a += kdt
            b -= kdt * y
            c += kdt * x * grip
            d += kdt * (x * x * grip + y * y)
            e += kdt * grip
            px += kdt * speed
            pw -= kdt * speed * y
        # put vx = (px - b yaw_rate) / a and vy = (py - c yaw_rate) / e into the equation of the spin, solve
        # it for the yaw rate, and compute vx and vy from the yaw rate. The quotient c / e is written as
        # `c_a_by_e` / a. If the grip is equal in all directions, a == e, so `c_a_by_e` is exactly c.
        c_a_by_e = c * (a / e)
        yaw_rate = (pw - (b * px + c_a_by_e * py) / a) / (d - (b * b + c_a_by_e * c) / a)
        vx, vy = (px - b * yaw_rate) / a, (py - c * yaw_rate) / e
        # this round has hardly changed the velocity, so no other round is needed
        if hypot(vx - last[0], vy - last[1], yaw_rate - last[2]) < SETTLED * config.slip_speed:
            break
        last = (vx, vy, yaw_rate)
    return [
        (-k * (vx - yaw_rate * y - speed), -k * grip * (vy + yaw_rate * x))
        for k, (x, y, _, speed) in zip(ks, treads)
    ]
