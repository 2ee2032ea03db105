"""Currents, battery and temperatures of the real Husky's base."""

import pytest

from husky_highlevel_controller.simulator.power import Power, PowerConfig


def test_standing_only_the_electronics_draw_current():
    state = Power(PowerConfig(), 3.9).update((0.0, 0.0), (0.0, 0.0), 0.1)
    assert state.currents == (0.0, 0.0)
    assert state.electronics_current > 0.0


def test_in_place_both_sides_work_and_in_a_curve_the_outer_one():
    power = Power(PowerConfig(torque_per_ampere=5.0), 4.0)
    assert power.update((-30.0, 30.0), (-0.3, 0.3), 0.1).currents == pytest.approx((8.0, 8.0))
    assert power.update((-30.0, 30.0), (0.1, 0.5), 0.1).currents == pytest.approx((0.0, 8.0))


def test_the_battery_drains_by_the_energy_drawn_and_stays_at_zero():
    power = Power(PowerConfig(capacity=100.0), 4.0)
    used, before = 0.0, 1.0
    for _ in range(3600):
        state = power.update((0.0, 0.0), (1.0, 1.0), 1.0)
        used += state.voltage * (4.0 + state.electronics_current) / 3600.0
    assert state.charge == pytest.approx(max(1.0 - used / 100.0, 0.0), abs=1e-6)
    assert state.charge < before
    for _ in range(3):
        state = power.update((0.0, 0.0), (1.0, 1.0), 1e5)
    assert state.charge == 0.0
    power.reset()
    assert power.update((0.0, 0.0), (0.0, 0.0), 0.1).charge == pytest.approx(1.0, abs=1e-4)


def test_under_load_the_voltage_sags_and_the_motors_warm():
    power = Power(PowerConfig(), 4.0)
    rest = power.update((0.0, 0.0), (0.0, 0.0), 0.1)
    for _ in range(600):
        turning = power.update((-35.0, 35.0), (-0.3, 0.3), 1.0)
    assert turning.voltage < rest.voltage - 0.5
    assert turning.motor_temperatures[0] > turning.driver_temperatures[0] > rest.driver_temperatures[0]
