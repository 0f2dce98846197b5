"""The energy ledger closes, each term by itself."""
import dataclasses

import numpy as np
import pytest

from hpv_twin.model import Simulation, Vibrator

STEADY = 1.85  # s: a hundred cycles of the base design


def ledger_after(duration, **how):
    setpoints = how.pop('setpoints', {})
    simulation = Simulation(ledger=True, **how)
    for name, value in setpoints.items():
        setattr(simulation, name, value)
    simulation.advance(duration, sample_rate=100)
    return simulation.energy


@pytest.mark.parametrize('setpoints', [
    {}, {'pump_flow': 8.5e-3}, {'preload': 0.0}, {'load': -1500.0}, {'load': 2000.0}])
def test_default_closes_over_a_hundred_cycles(setpoints):
    energy = ledger_after(STEADY, setpoints=setpoints)
    assert abs(energy.oil_residual) < 1e-6 * energy.pump_work
    assert abs(energy.plunger_residual) < 1e-6 * energy.pump_work


def test_default_closes_with_drain_pressure_damping_and_vacuum():
    design = Vibrator(drain_pressure=2e5, line_damping=5.0)
    energy = ledger_after(STEADY, vibrator=design)
    assert abs(energy.oil_residual) < 1e-6 * energy.pump_work
    assert abs(energy.plunger_residual) < 1e-6 * energy.pump_work
    assert energy.dashpot_work < 0.0
    design = Vibrator(preload=0.0, load=-3e3, pump_flow=2e-4)
    energy = ledger_after(0.2, vibrator=design)
    assert energy.clamp_work < 0.0  # the pull draws a vacuum
    scale = energy.stop_loss + energy.friction_loss
    assert abs(energy.oil_residual) < 1e-6 * scale
    assert abs(energy.plunger_residual) < 1e-6 * scale


def test_setpoint_changes_do_work_that_is_accounted_for():
    simulation = Simulation(ledger=True)
    for k, (flow, preload, load) in enumerate([(7.3e-4, 5.2e-3, 0), (5e-4, 6e-3, 300),
                                               (9e-4, 4.5e-3, -200), (7.3e-4, 5.2e-3, 0)]):
        simulation.pump_flow, simulation.preload, simulation.load = flow, preload, load
        simulation.advance(0.0937 + 0.0011 * k, sample_rate=100)
    energy = simulation.energy
    assert energy.setpoint_work != 0.0
    assert abs(energy.plunger_residual) < 1e-9 * energy.pump_work
    assert abs(energy.oil_residual) < 1e-9 * energy.pump_work


@pytest.mark.compiled
def test_euler_misses_in_proportion_to_its_step():
    steps = np.array([2e-5, 1e-5, 5e-6])
    missed = [ledger_after(0.5, method='euler', step=step) for step in steps]
    for name in ('oil_residual', 'plunger_residual'):
        errors = [abs(getattr(energy, name)) / energy.pump_work for energy in missed]
        order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
        assert order == pytest.approx(1.0, abs=0.2), name


def test_known_shares_of_the_base_design():
    energy = ledger_after(STEADY)
    travel = (energy.displaced_work - energy.pressure_work) / energy.pump_work
    switched = (energy.mass_switched_out - energy.mass_switched_in) / energy.pump_work
    assert travel == pytest.approx(0.054, abs=0.002)
    assert switched == pytest.approx(0.0017, abs=0.0002)
    assert energy.sleeve_spring_work > 0.0  # it does not vanish over a cycle
    assert energy.oil_energy >= 0.0 and energy.slot_loss > 0.5 * energy.pump_work


def test_ledger_changes_nothing_of_the_motion():
    with_ledger, without = Simulation(ledger=True), Simulation()
    one, other = with_ledger.advance(0.3), without.advance(0.3)
    assert np.array_equal(one.pressure, other.pressure)


def test_ledger_is_the_same_however_time_is_sliced():
    whole = ledger_after(0.3)
    simulation = Simulation(ledger=True)
    for _ in range(300):
        simulation.tick(1e-3)
    for field in dataclasses.fields(whole):
        assert getattr(simulation.energy, field.name) == pytest.approx(
            getattr(whole, field.name), rel=1e-9, abs=1e-9), field.name


def test_energy_needs_to_be_asked_for():
    with pytest.raises(ValueError, match='ledger=True'):
        Simulation().energy  # noqa: B018


def test_reset_begins_a_new_ledger():
    simulation = Simulation(ledger=True)
    simulation.advance(0.1)
    simulation.reset()
    assert simulation.energy.pump_work == 0.0 and simulation.energy.plunger_residual == 0.0
