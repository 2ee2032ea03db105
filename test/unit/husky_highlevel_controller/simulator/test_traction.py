"""Wheels on the ground: what friction may and may not do, and how a skid-steer robot turns by it."""

from math import hypot

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_highlevel_controller.simulator.traction import TractionConfig, WheelContact, ground_forces

# Husky URDF, husky_description 0.6.10: wheelbase 0.512 m, track 0.5708 m, mass with the lidar
HALF_BASE, HALF_TRACK = 0.256, 0.2854  # [m]
MASS, YAW_INERTIA = 57.682, 3.8  # [kg], [kg m^2]
GRAVITY = 9.81  # [m/s^2]
WEIGHT = MASS * GRAVITY  # [N]
CONFIG = TractionConfig()
DT = 0.005  # [s]
CORNERS = ((1, 1), (1, -1), (-1, 1), (-1, -1))  # front left, front right, rear left, rear right
REST = (0.0, 0.0, 0.0)
LEVEL = (0.0, 0.0)
LAW = settings(derandomize=True, deadline=None, max_examples=50)

speeds = st.floats(-2.0, 2.0)
velocities = st.tuples(speeds, speeds, st.floats(-3.0, 3.0))
pulls = st.tuples(st.floats(-300.0, 300.0), st.floats(-300.0, 300.0))
loads = st.one_of(st.just(0.0), st.floats(1.0, 600.0))
contacts_of_a_robot = st.tuples(
    *[
        st.builds(WheelContact, st.just(x * HALF_BASE), st.just(y * HALF_TRACK), loads, speeds)
        for x, y in CORNERS
    ]
)
configs = st.builds(TractionConfig, st.floats(0.1, 1.5), st.floats(1e-4, 0.1))
periods = st.floats(1e-4, 0.02)


def robot(left=0.0, right=0.0, loads=(WEIGHT / 4.0,) * 4):
    """The contacts of a symmetric Husky whose treads run at `left` and `right` [m/s]."""
    return [
        WheelContact(x * HALF_BASE, y * HALF_TRACK, load, left if y > 0 else right)
        for (x, y), load in zip(CORNERS, loads)
    ]


def forces_on(contacts, velocity=REST, external=LEVEL, dt=DT, config=CONFIG):
    return ground_forces(contacts, velocity, external, MASS, YAW_INERTIA, dt, config)


def after(contacts, velocity, external, dt, forces):
    """Newton: the velocity one step later, in the axes of base_link after the step, which has turned."""
    vx, vy, yaw_rate = velocity
    fx = external[0] + sum(f[0] for f in forces) + MASS * yaw_rate * vy
    fy = external[1] + sum(f[1] for f in forces) - MASS * yaw_rate * vx
    torque = sum(c.x * f[1] - c.y * f[0] for c, f in zip(contacts, forces))
    return vx + dt * fx / MASS, vy + dt * fy / MASS, yaw_rate + dt * torque / YAW_INERTIA


def slip(contact, velocity):
    vx, vy, yaw_rate = velocity
    return vx - yaw_rate * contact.y - contact.surface_speed, vy + yaw_rate * contact.x


def most(contact, config=CONFIG):
    """The most that friction can hold [N]: mu N (N/N0)^(-1/3)."""
    return config.friction * contact.load * (4.0 * contact.load / WEIGHT or 1.0) ** (-1.0 / 3.0)


def drive(contacts, duration, velocity=REST, external=LEVEL, dt=DT, config=CONFIG):
    """The velocity in base_link after every step of `duration` s; `external` turns with the robot."""
    passed = []
    for _ in range(round(duration / dt)):
        forces = forces_on(contacts, velocity, external, dt, config)
        velocity = after(contacts, velocity, external, dt, forces)
        passed.append(velocity)
    return passed


@LAW
@given(contacts_of_a_robot, velocities, pulls, periods, configs)
def test_a_wheel_in_the_air_gets_no_force(contacts, velocity, external, dt, config):
    lifted = [contacts[0]._replace(load=0.0), contacts[1]._replace(load=-3.0), *contacts[2:]]
    forces = forces_on(lifted, velocity, external, dt, config)
    assert forces[:2] == [(0.0, 0.0), (0.0, 0.0)]
    # nor does what its tread does matter to the others
    idle = [contact._replace(surface_speed=0.0) for contact in lifted[:2]]
    assert forces_on([*idle, *contacts[2:]], velocity, external, dt, config)[2:] == forces[2:]


@LAW
@given(contacts_of_a_robot, velocities, pulls, periods, configs)
def test_friction_opposes_the_slip_and_never_drives_it(contacts, velocity, external, dt, config):
    forces = forces_on(contacts, velocity, external, dt, config)
    moved = after(contacts, velocity, external, dt, forces)
    for contact, (fx, fy) in zip(contacts, forces):
        sx, sy = slip(contact, moved)
        assert fx * sx + fy * sy <= 1e-6
        assert fx * sy - fy * sx == pytest.approx(0.0, abs=1e-6)  # along the slip, not across it


@LAW
@given(contacts_of_a_robot, velocities, pulls, configs)
def test_a_wheel_holds_what_its_load_and_slip_allow_at_any_instant(contacts, velocity, external, config):
    for contact, force in zip(contacts, forces_on(contacts, velocity, external, 1e-9, config)):
        speed = hypot(*slip(contact, velocity))
        share = speed / hypot(speed, config.slip_speed)
        assert hypot(*force) == pytest.approx(share * most(contact, config), rel=1e-3, abs=1e-3)


def test_it_stops_when_its_wheels_do_and_slides_no_farther_than_friction_lets_it():
    passed = drive(robot(), 0.2, velocity=(1.0, 0.0, 0.0))
    braking = [v[0] for v in passed]
    assert braking == sorted(braking, reverse=True)
    assert braking[-1] == pytest.approx(0.0, abs=1e-3)
    # v^2 / (2 mu g) = 0.051 m
    assert sum(braking) * DT == pytest.approx(1.0 / (2.0 * GRAVITY), abs=1.0 * DT)


@pytest.mark.parametrize("dt", [0.02, 0.0005])
@pytest.mark.parametrize("slip_speed", [1e-4, 0.1])
@pytest.mark.parametrize(("left", "right"), [(0.0, 0.0), (1.0, 1.0), (-0.5, 0.5)])
def test_it_settles_at_any_step_and_slip_speed(dt, slip_speed, left, right):
    config = TractionConfig(slip_speed=slip_speed)
    passed = drive(robot(left, right), 2.0, velocity=(0.3, -0.2, 0.5), dt=dt, config=config)
    last, before = passed[-1], passed[-2]
    assert last == pytest.approx(before, abs=1e-4)
    assert last[0] == pytest.approx((left + right) / 2.0, abs=5e-3)
    assert last[1] == pytest.approx(0.0, abs=5e-3)
