"""The running model: the paper's figures, switches, setpoints, repeatability."""
import math

import numpy as np
import pytest

from hpv_twin.model import Simulation, Trace, Vibrator, find_cycles, kernel


@pytest.fixture(scope='module')
def base():
    return Simulation().advance(0.5)


def test_base_design_shows_the_papers_results(base):
    cycles = find_cycles(base)
    assert set(cycles.regime[1:]) == {'seated oscillation'}
    assert cycles.frequency[-1] == pytest.approx(55.0, abs=0.5)
    assert cycles.stroke[-1] == 2.0e-3
    assert cycles.peak_pressure[-1] == pytest.approx(16.0e6, abs=0.1e6)
    assert cycles.return_pressure[-1] == pytest.approx(3.0e6, abs=0.05e6)
    assert cycles.dwell[-1] / cycles.forward[-1] == pytest.approx(0.15, abs=0.01)


def test_settling_takes_one_cycle(base):
    period = find_cycles(base).period
    assert np.ptp(period[1:]) < 1e-4 * period[-1]


def test_starts_from_rest_and_builds_up_by_equation_7():
    trace = Simulation(method='euler').advance(5e-3)
    rate = 1.4e9 / Vibrator().cavity_volume * 7.3e-4
    assert np.allclose(trace.pressure, rate * trace.time, rtol=1e-9)
    assert not trace.plunger_position.any() and not trace.phase.any()


def test_sample_times_are_the_multiples_of_the_interval():
    simulation = Simulation()
    assert np.allclose(simulation.advance(0.01, 1000).time, np.arange(1, 11) * 1e-3, atol=1e-15)
    assert np.allclose(simulation.advance(0.0025, 1000).time, [0.011, 0.012], atol=1e-15)
    assert np.allclose(simulation.advance(0.0005, 1000).time, [0.013], atol=1e-15)
    assert len(simulation.advance(0.0, 1000).time) == 0


def test_a_thousand_slices_are_one_run():
    whole = Simulation(method='euler').advance(0.5, sample_rate=1000)
    simulation = Simulation(method='euler')
    parts = Trace.join([simulation.advance(1e-3, sample_rate=1000) for _ in range(500)])
    assert np.allclose(parts.time, whole.time, rtol=0, atol=1e-12)
    assert np.allclose(parts.pressure, whole.pressure, rtol=1e-9, atol=1e-3)
    assert np.allclose(parts.switches['time'], whole.switches['time'], rtol=0, atol=1e-9)


def test_equal_inputs_give_equal_bits():
    def run():
        simulation = Simulation()
        simulation.advance(0.1234)
        simulation.pump_flow = 5e-4
        return simulation.advance(0.1)
    first, second = run(), run()
    assert np.array_equal(first.pressure, second.pressure)
    assert first.switches.tobytes() == second.switches.tobytes()


def test_reset_goes_back_to_rest_and_keeps_setpoints():
    simulation = Simulation()
    simulation.pump_flow = 5e-4
    first = simulation.advance(0.1)
    simulation.reset()
    assert (simulation.time, simulation.pressure, simulation.plunger_position) == (0.0, 0.0, 0.0)
    assert simulation.pump_flow == 5e-4
    assert np.array_equal(simulation.advance(0.1).pressure, first.pressure)


def test_located_switches_are_continuous_in_pressure_and_ordered(base):
    switches = base.switches
    assert (np.diff(switches['time']) >= 0).all()
    assert (switches['stage_before'][1:] == switches['stage_after'][:-1]).all()
    opening = switches[(switches['before'] == kernel.PHASE_CLOSED)]
    assert np.allclose(opening['pressure'], Vibrator().opening_pressure, rtol=1e-6)
    arrivals = switches[(switches['after'] == kernel.PHASE_OPEN)]
    assert (arrivals['plunger_position'] == 2e-3).all()


def test_sleeve_follows_the_law_of_the_paper(base):
    forward = base.phase == kernel.PHASE_FORWARD
    y, sleeve = base.plunger_position[forward], base.sleeve_position[forward]
    expected = np.where(y <= 0.2e-3, 0.0, np.where(y < 0.8e-3, (y - 0.2e-3) * 0.8 / 0.6, y))
    assert np.allclose(sleeve, expected, atol=1e-15)
    back = base.phase == kernel.PHASE_RETURN
    assert np.array_equal(base.sleeve_position[back], base.plunger_position[back])


def test_level_tested_switches_do_not_deadlock():
    # A pull opens the valve at zero pressure: no sign ever changes.
    simulation = Simulation()
    simulation.load = -2e3
    trace = simulation.advance(0.1)
    assert trace.switches[0]['time'] == 0.0
    assert np.isfinite(trace.pressure).all()


def test_a_setpoint_acts_from_its_instant_on():
    simulation = Simulation()
    simulation.advance(5e-3)
    pressure = simulation.pressure
    simulation.pump_flow = 3.65e-4
    simulation.advance(1e-3)
    rate = 1.4e9 / Vibrator().cavity_volume * 3.65e-4
    assert simulation.pressure - pressure == pytest.approx(rate * 1e-3, rel=1e-9)


def test_preload_cut_opens_at_once():
    simulation = Simulation()
    simulation.advance(11e-3)
    assert simulation.phase == kernel.PHASE_CLOSED
    simulation.preload = 1e-3
    trace = simulation.advance(1e-4)
    assert trace.switches[0]['time'] == pytest.approx(11e-3, abs=1e-12)
    assert simulation.phase == kernel.PHASE_FORWARD


def test_no_flow_means_no_opening():
    simulation = Simulation()
    simulation.pump_flow = 0.0
    trace = simulation.advance(1.0)
    assert len(find_cycles(trace)) == 0 and simulation.pressure == 0.0


def test_huge_flow_holds_the_valve_open():
    simulation = Simulation()
    simulation.pump_flow = 2.0 * Vibrator().critical_flow
    simulation.advance(1.0)
    assert simulation.phase == kernel.PHASE_OPEN
    # Steady: the slot carries what the pump delivers, (26).
    drop = (simulation.pump_flow / (0.62 * math.pi * Vibrator().sleeve_seat_diameter * 2e-3)) ** 2
    assert simulation.pressure == pytest.approx(drop * 870.0 / 2.0, rel=1e-6)


@pytest.mark.parametrize('name, value', [('pump_flow', -1e-9), ('pump_flow', math.nan),
                                         ('preload', math.inf), ('load', math.nan)])
def test_impossible_setpoints_are_refused_and_change_nothing(name, value):
    simulation = Simulation()
    before = getattr(simulation, name)
    with pytest.raises(ValueError, match=name):
        setattr(simulation, name, value)
    assert getattr(simulation, name) == before


def test_impossible_calls_are_refused():
    with pytest.raises(ValueError, match='method'):
        Simulation(method='magic')
    with pytest.raises(ValueError, match='duration'):
        Simulation().advance(-1.0)
    with pytest.raises(ValueError, match='sample_rate'):
        Simulation().advance(1.0, sample_rate=0)


FIELDS = {'bulk_modulus': 1.0e9, 'flow_coefficient': 0.5, 'viscous_friction': 400.0,
          'drain_pressure': 3e5, 'slotted_spring_stiffness': 2.2e5}


@pytest.mark.parametrize('method', ['default', 'euler'])
def test_redesigned_at_rest_it_is_a_fresh_simulation_to_the_last_bit(method):
    fields = {**FIELDS, 'stroke': 1.8e-3, 'gap_ratio': 0.3}
    changed, fresh = Simulation(method=method), Simulation(Vibrator(**fields), method=method)
    changed.redesign(**fields)
    one, other = changed.advance(0.1), fresh.advance(0.1)
    assert np.array_equal(one.pressure, other.pressure)
    assert one.switches.tobytes() == other.switches.tobytes()
    assert one.vibrator == other.vibrator == Vibrator(**fields)


def test_a_redesign_keeps_state_and_setpoints_and_ends_as_the_new_design_does():
    simulation, fresh = Simulation(), Simulation(Vibrator(**FIELDS, pump_flow=6e-4))
    simulation.pump_flow = 6e-4
    simulation.advance(0.05)
    state = simulation.pressure, simulation.plunger_position, simulation.plunger_velocity
    simulation.redesign(**FIELDS)
    assert state == (simulation.pressure, simulation.plunger_position,
                     simulation.plunger_velocity)
    assert simulation.pump_flow == 6e-4
    settled, other = find_cycles(simulation.advance(0.3)), find_cycles(fresh.advance(0.3))
    assert settled.period[-1] == pytest.approx(other.period[-1], rel=1e-12)
    simulation.reset()
    assert np.array_equal(simulation.advance(0.1).pressure, Simulation(
        Vibrator(**FIELDS, pump_flow=6e-4)).advance(0.1).pressure)


@pytest.mark.parametrize('method', ['default', 'euler'])
def test_slices_after_a_redesign_are_one_run(method):
    def run(slices):
        simulation = Simulation(method=method)
        simulation.advance(0.0513)
        simulation.redesign(**FIELDS)
        return Trace.join([simulation.advance(0.1 / slices) for _ in range(slices)])
    one, other = run(1), run(1000)
    assert np.allclose(one.pressure, other.pressure, rtol=1e-9, atol=1e-3)
    assert len(one.switches) == len(other.switches) > 30
    assert np.allclose(one.switches['time'], other.switches['time'], rtol=0, atol=1e-9)


def test_a_redesign_that_cannot_be_is_refused_with_its_reason_and_changes_nothing():
    simulation = Simulation()
    simulation.advance(0.0185)
    assert simulation.phase != kernel.PHASE_CLOSED
    for fields, reason in (({'stroke': 1e-3}, 'stroke cannot change while'),
                           ({'gap_ratio': 0.3, 'bulk_modulus': 1e9}, 'gap_ratio cannot change'),
                           ({'bulk_modulus': -1.0}, 'bulk_modulus .kappa. = -1 Pa must be above'),
                           ({'preload': 1e-3}, 'preload is a setpoint')):
        with pytest.raises(ValueError, match=reason):
            simulation.redesign(**fields)
    assert simulation.design == Vibrator()
    with pytest.raises(ValueError, match='ledger'):
        Simulation(ledger=True).redesign(bulk_modulus=1e9)


def test_chatter_is_an_error_that_names_the_state():
    # The kernel's guard itself: five phase switches forced at one instant.
    simulation = Simulation()
    simulation._state[kernel.REPEATS] = kernel.SWITCHES_AT_ONCE
    simulation._state[kernel.LAST_SWITCH] = 0.0
    log = np.empty((16, kernel.ROW_SIZE))
    used = kernel.switch_to(simulation._state, kernel.LIFT, simulation._table,
                            simulation._parameters, False, log, 0)
    assert used == -1
    assert 'stage "closed"' in simulation._chatter() and 'preload' in simulation._chatter()


@pytest.mark.compiled
def test_a_log_longer_than_the_buffer_loses_nothing():
    whole = Simulation().advance(20.0, sample_rate=10)
    assert len(whole.switches) > 5000
    assert (whole.switches['stage_before'][1:] == whole.switches['stage_after'][:-1]).all()


@pytest.mark.compiled
def test_euler_halving_its_step_moves_stroke_and_peak_by_less_than_half_a_permille():
    def figures(step):
        cycles = find_cycles(Simulation(method='euler', step=step).advance(0.5))
        return cycles.stroke[-1], cycles.peak_pressure[-1]
    coarse, fine = figures(1e-5), figures(5e-6)
    assert coarse == pytest.approx(fine, rel=5e-4)


def test_tick_and_advance_are_the_same_motion():
    one, other = Simulation(), Simulation()
    rows = np.concatenate([one.tick(1e-3) for _ in range(100)])
    trace = other.advance(0.1)
    assert len(rows) == len(trace.switches)
    assert one.pressure == pytest.approx(other.pressure, rel=1e-9)
