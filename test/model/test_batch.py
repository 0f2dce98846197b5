"""Designs in a batch: the figures of single simulations, however many there are at once."""
import numpy as np
import pytest
from oracle_designs import random_design

from hpv_twin.model import Simulation, Vibrator, VibratorError, find_cycles, kernel
from hpv_twin.model.batch import BATCH_REGIMES, CYCLES, IMPOSSIBLE, run_designs
from hpv_twin.model.designs import FIELDS, Designs
from hpv_twin.model.regimes import HELD_OPEN, HOVERING, NO_OPENING, OSCILLATING, SEATED

BASE = Vibrator()


def settings(count, seed=5):
    """Random settings of flow and preload, from a trickle to beyond Q_crit."""
    rng = np.random.default_rng(seed)
    return Designs(BASE, pump_flow=rng.uniform(5e-5, 8e-3, count),
                   preload=rng.uniform(0.1e-3, 1e-2, count))


def single(design, frequency):
    """Means of the same figures, by a Simulation long enough to settle, and its regime."""
    simulation = Simulation(design)
    trace = simulation.advance(400.0 / frequency, sample_rate=10.0)
    cycles = find_cycles(trace)
    last = slice(-CYCLES, None)
    mass = design.plunger_mass + design.sleeve_mass
    found = {name: getattr(cycles, name)[last].mean() for name in (
        'stroke', 'opening_pressure', 'return_pressure', 'build_up', 'forward', 'dwell',
        'return_stroke', 'phase_lag')}
    found['frequency'] = 1.0 / cycles.period[last].mean()
    found['peak_pressure'] = cycles.peak_pressure[last].max()
    found['lowest_pressure'] = cycles.lowest_pressure[last].min()
    found['impact_energy'] = np.mean(0.5 * mass * np.nan_to_num(cycles.stop_speed[last]) ** 2)
    found['seat_energy'] = np.mean(
        0.5 * design.plunger_mass * np.nan_to_num(cycles.seat_speed[last]) ** 2)
    return found, simulation.regime


def test_figures_are_those_of_single_simulations_in_every_regime():
    designs = settings(150)
    batch = run_designs(designs)
    assert {SEATED, 'seat rebound', 'off-seat oscillation', HELD_OPEN} <= set(batch['regime'])
    for i in range(len(designs)):
        if batch['regime'][i] not in OSCILLATING:
            simulation = Simulation(designs.vibrator(i))
            simulation.tick(3.0)
            assert simulation.regime == batch['regime'][i]
            continue
        assert batch['settled'][i] == 1.0
        found, regime = single(designs.vibrator(i), batch['frequency'][i])
        assert regime == batch['regime'][i]
        for name, value in found.items():
            assert batch[name][i] == pytest.approx(value, rel=1e-8, abs=1e-9, nan_ok=True), name


def test_random_designs_with_every_field_varied():
    rng = np.random.default_rng(11)
    vibrators = [random_design(rng) for _ in range(30)]
    names = [name for name in FIELDS if name != 'line_damping']
    columns = {name: [getattr(vibrator, name) for vibrator in vibrators] for name in names}
    columns['line_damping'] = [np.nan if vibrator.line_damping is None else vibrator.line_damping
                               for vibrator in vibrators]
    designs = Designs(BASE, **columns)
    batch = run_designs(designs)
    assert (batch['regime'] == SEATED).sum() > 20
    for i, vibrator in enumerate(vibrators):
        for name in kernel.CONSTANTS + ('return_pressure', 'opening_pressure', 'critical_flow'):
            value = np.broadcast_to(getattr(designs, name), len(designs))[i]
            assert value == pytest.approx(getattr(vibrator, name), rel=1e-15), name
        if batch['regime'][i] == SEATED:
            found, _ = single(vibrator, batch['frequency'][i])
            assert batch['frequency'][i] == pytest.approx(found['frequency'], rel=1e-10)
            assert batch['impact_energy'][i] == pytest.approx(found['impact_energy'], rel=1e-10)
            load = vibrator.load * vibrator.stroke
            assert batch['load_work'][i] == pytest.approx(load, rel=1e-9)
            assert batch['efficiency'][i] == pytest.approx(
                (load + found['impact_energy']) / batch['hydraulic_energy'][i], rel=1e-9)


def test_energy_put_in_and_losses_are_the_ledgers():
    designs = settings(20)
    batch = run_designs(designs)
    for i in np.nonzero(batch['regime'] == SEATED)[0]:
        simulation = Simulation(designs.vibrator(i), ledger=True)
        period = 1.0 / batch['frequency'][i]
        simulation.advance(5.0 * period, 10.0)
        before = simulation.energy
        simulation.advance(10.0 * period, 10.0)
        after = simulation.energy
        for name, term in (('hydraulic_energy', 'pump_work'), ('impact_energy', 'stop_loss'),
                           ('seat_energy', 'seat_loss')):
            spent = (getattr(after, term) - getattr(before, term)) / 10.0
            assert batch[name][i] == pytest.approx(spent, rel=1e-7)


def test_rate_of_pressure_is_the_steepest_of_the_cycle():
    designs = settings(12)
    batch = run_designs(designs)
    for i in np.nonzero(batch['regime'] == SEATED)[0]:
        period = 1.0 / batch['frequency'][i]
        simulation = Simulation(designs.vibrator(i))
        simulation.advance(5.0 * period, 10.0)
        trace = simulation.advance(period, 2e6)
        slopes = np.diff(trace.pressure) / np.diff(trace.time)
        assert batch['pressure_rate'][i] >= np.abs(slopes).max() * (1.0 - 1e-9)
        assert batch['pressure_rate'][i] == pytest.approx(np.abs(slopes).max(), rel=0.02)


def test_one_lane_or_many_and_any_company_give_the_same_bits():
    designs = settings(40)
    together = run_designs(designs, threads=2)
    alone = run_designs(designs, threads=1)
    pieces = [run_designs(designs[k:k + 7], threads=1) for k in range(0, 40, 7)]
    for name, values in together.items():
        assert np.array_equal(values, alone[name], equal_nan=values.dtype.kind == 'f'), name
        joined = np.concatenate([piece[name] for piece in pieces])
        assert np.array_equal(values, joined, equal_nan=values.dtype.kind == 'f'), name


def test_machines_that_stand_still_are_named_and_have_no_figures():
    designs = Designs(BASE, pump_flow=[0.0, 0.02, 7.3e-4, 7.3e-4],
                      plunger_seat_diameter=[0.011, 0.011, 0.03, 0.011],
                      load=[0.0, 0.0, 0.0, -1800.0])
    batch = run_designs(designs, threads=1)
    assert list(batch['regime'][:3]) == [NO_OPENING, HELD_OPEN, IMPOSSIBLE]
    assert batch['regime'][3] in (HOVERING, HELD_OPEN)
    assert list(designs.possible) == [True, True, False, True]
    assert (batch['frequency'] == 0.0).all() and (batch['impact_power'] == 0.0).all()
    assert np.isnan(batch['peak_pressure']).all()
    assert list(batch['regime']) == [BATCH_REGIMES[code] for code in batch['regime_code']]


def test_a_value_out_of_bounds_names_field_and_bound():
    with pytest.raises(VibratorError, match=r'stroke \(h_b\) = 0.2 m is outside'):
        Designs(BASE, stroke=[1e-3, 0.2])
    with pytest.raises(VibratorError, match='not a finite number'):
        Designs(BASE, stroke=[1e-3, np.inf])
    with pytest.raises(VibratorError, match='no field "flow"'):
        Designs(BASE, flow=[1.0])
