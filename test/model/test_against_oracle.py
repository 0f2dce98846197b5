"""The package against a second, independent implementation of the same equations."""
from itertools import pairwise

import numpy as np
import pytest
from oracle import ENERGIES, JUMPS, Oracle
from oracle_designs import EVERY_TERM, phase_switches, seated_designs, simulate, steady_cycles
from oracle_record import CLOSED, FORWARD, OPEN, RETURN, OracleCycle

from hpv_twin.model import Simulation, Vibrator, find_cycles

pytestmark = pytest.mark.compiled

BASE = Vibrator()
FIGURES = [name for name in OracleCycle._fields if name != 'start']
COLUMNS = ('pressure', 'plunger_position', 'plunger_velocity', 'sleeve_position')


def waveform_errors(trace, record):
    """Largest difference of each column of the samples, as a share of the oracle's range."""
    assert np.array_equal(trace.time, record.column('time'))
    assert np.array_equal(trace.phase, record.column('phase'))
    return {name: np.abs(getattr(trace, name) - record.column(name)).max()
            / max(np.ptp(record.column(name)), 1e-6) for name in COLUMNS}


def switch_error(trace, record):
    """Largest difference in time, s, of switches that are the same in kind and in order."""
    found, expected = phase_switches(trace), record.phase_switches
    kinds = [(switch.before, switch.after) for switch in expected]
    assert list(zip(found['before'].tolist(), found['after'].tolist(), strict=True)) == kinds
    return np.abs(found['time'] - [switch.time for switch in expected]).max(initial=0.0)


def assert_same(design, duration, changes=(), share=1e-6, seconds=1e-8):
    trace = simulate(design, duration, changes)
    record = Oracle(design).run(duration, changes, sample_rate=1000.0)
    assert switch_error(trace, record) <= seconds
    assert max(waveform_errors(trace, record).values()) <= share
    return trace, record


@pytest.mark.parametrize('design', [BASE, EVERY_TERM], ids=['base', 'every term'])
def test_waveforms_and_switches_from_rest_on(design):
    trace, record = assert_same(design, 0.08, share=1e-8, seconds=1e-10)
    assert {(switch.before, switch.after) for switch in record.phase_switches} == {
        (CLOSED, FORWARD), (FORWARD, OPEN), (OPEN, RETURN), (RETURN, CLOSED)}
    period = find_cycles(trace).period
    expected = [cycle.period for cycle in record.cycles()]
    assert len(period) >= 3
    assert period == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize('design', [BASE, EVERY_TERM, BASE.replace(pump_flow=6e-3),
                                    BASE.replace(pump_flow=2e-3, preload=1.5e-3)])
def test_every_figure_of_a_cycle(design):
    trace = simulate(design, 0.1)
    record = Oracle(design).run(0.1)
    cycles, expected = find_cycles(trace), record.cycles()
    assert len(cycles) == len(expected)
    for name in FIGURES:
        values = [getattr(cycle, name) for cycle in expected[1:]]
        assert getattr(cycles, name)[1:] == pytest.approx(values, rel=1e-7), name


@pytest.mark.parametrize('design', [BASE, EVERY_TERM], ids=['base', 'every term'])
def test_every_term_of_the_energy_ledger(design):
    instant, changes = 0.0171, {'preload': 4e-3, 'load': -150.0}
    simulation = Simulation(design, ledger=True)
    simulation.advance(instant)
    simulation.preload, simulation.load = changes['preload'], changes['load']
    simulation.advance(0.05 - instant)
    totals = Oracle(design).run(0.05, [(instant, changes)]).totals
    assert totals['setpoint_work'] != 0.0
    for name in ENERGIES + JUMPS:
        assert getattr(simulation.energy, name) == pytest.approx(
            totals[name], rel=1e-8, abs=1e-9 * totals['pump_work']), name


# Random designs -----------------------------------------------------------------------------------


def worst_errors(seed, count):
    """Worst relative error of each figure over random seated designs, with the design's number."""
    worst = dict.fromkeys(['period', 'peak_pressure', 'return_pressure', 'opening_pressure',
                           'forward', 'dwell', 'return_stroke', 'switches / s'], (0.0, None))
    for number, (design, duration) in enumerate(seated_designs(seed, count)):
        duration = 1.001 * duration
        trace, record = simulate(design, duration), Oracle(design).run(duration)
        cycles, expected = find_cycles(trace), record.cycles()
        assert len(expected) == len(cycles) >= 3
        errors = {'switches / s': switch_error(trace, record)}
        for name in list(worst)[:-1]:
            values = np.array([getattr(cycle, name) for cycle in expected])
            # A dwell of no length is real: the stop is reached with the net force negative.
            scale = np.where(values == 0.0, 1.0, values)
            errors[name] = np.abs((getattr(cycles, name) - values) / scale).max()
        for name, error in errors.items():
            worst[name] = max(worst[name], (error, number), key=lambda pair: pair[0])
    return {name: float(error) for name, (error, number) in worst.items()}


def assert_small(worst):
    assert worst['period'] <= 1e-6
    assert max(worst['peak_pressure'], worst['return_pressure']) <= 1e-5


def test_random_seated_designs():
    worst = worst_errors(seed=3, count=25)
    print(worst)
    assert_small(worst)
    assert worst['switches / s'] <= 1e-9


@pytest.mark.long
def test_two_hundred_random_seated_designs():
    worst = worst_errors(seed=4, count=200)
    print(worst)
    assert_small(worst)


# Setpoints ----------------------------------------------------------------------------------------

CHANGES = [{'pump_flow': 3e-4}, {'pump_flow': 2.5e-3}, {'pump_flow': 0.0}, {'preload': 3e-3},
           {'preload': 8e-3}, {'load': 600.0}, {'load': -900.0},
           {'pump_flow': 1.3e-3, 'preload': 6.1e-3, 'load': 111.0}]
STAGES = ('closed', 'lift', 'slide', 'carry', 'open', 'fall', 'drop')


@pytest.fixture(scope='module')
def instants():
    """One odd instant within each stage of the second cycle."""
    switches = Oracle(EVERY_TERM).run(0.05).switches
    second = [switch for switch in switches if switch.time > 0.02]
    found = {}
    for one, other in pairwise(second):
        found.setdefault(one.named, one.time + 0.4321 * (other.time - one.time))
    return found


@pytest.mark.parametrize('setpoints', CHANGES, ids=str)
@pytest.mark.parametrize('stage', STAGES)
def test_setpoints_change_in_the_middle_of_every_stage(stage, setpoints, instants):
    instant = instants[stage]
    trace, _ = assert_same(EVERY_TERM, instant + 0.03, [(instant, setpoints)])
    untouched = simulate(EVERY_TERM, instant + 0.03)
    assert not np.array_equal(trace.pressure, untouched.pressure)


def test_setpoints_that_keep_changing():
    rng = np.random.default_rng(5)
    changes = [(instant, {'pump_flow': rng.uniform(0.0, 3e-3), 'preload': rng.uniform(1e-3, 8e-3),
                          'load': rng.uniform(-500.0, 800.0)})
               for instant in np.sort(rng.uniform(0.0, 0.1, 30))]
    assert_same(EVERY_TERM, 0.1, changes)


# The design itself --------------------------------------------------------------------------------

REDESIGNS = [{'bulk_modulus': 0.9e9}, {'flow_coefficient': 0.5}, {'viscous_friction': 900.0},
             {'drain_pressure': 1.5e6}, {'slotted_spring_stiffness': 3.1e5, 'preload': 4e-3},
             {'sleeve_seat_diameter': 0.026, 'plunger_seat_diameter': 0.0115, 'sleeve_mass': 0.3,
              'cavity_volume': 1e-3, 'line_damping': 0.0, 'twisted_spring_preload': 0.0}]


@pytest.mark.parametrize('fields', REDESIGNS, ids=str)
@pytest.mark.parametrize('stage', STAGES)
def test_the_design_changes_in_the_middle_of_every_stage(stage, fields, instants):
    instant = instants[stage]
    trace, _ = assert_same(EVERY_TERM, instant + 0.03, [(instant, fields)])
    untouched = simulate(EVERY_TERM, instant + 0.03)
    assert not np.array_equal(trace.pressure, untouched.pressure)


# Other regimes and corners ------------------------------------------------------------------------


def lowest(trace):
    return min(trace.pressure.min(), trace.switches['pressure_min'].min(initial=np.inf))


CORNERS = {
    'off the seat': (BASE.replace(pump_flow=9e-3, preload=6e-3), 0.05, ()),
    'seat rebound': (BASE.replace(preload=1e-4, pump_flow=2e-3), 0.05, ()),
    'partial stroke': (BASE.replace(preload=0.0, pump_flow=3e-4), 0.05, ()),
    'held open': (BASE.replace(pump_flow=1.1 * BASE.critical_flow), 0.02, ()),
    'flow cut while open': (EVERY_TERM, 0.05, [(0.00966, {'pump_flow': 0.0})]),
    'pull': (BASE.replace(load=-1500.0), 0.05, ()),
    'pull into vacuum': (BASE.replace(load=-2000.0, pump_flow=1e-4), 0.02, ()),
    'pull into vacuum and back': (
        BASE.replace(load=-4000.0, pump_flow=1e-4, line_damping=5.0), 0.06,
        [(0.01234, {'load': 300.0, 'pump_flow': 2e-3})]),
    'vacuum in every stage': (
        BASE.replace(load=-1500.0, pump_flow=1e-5, line_damping=3.0), 0.02, ()),
    'open below the drain': (
        BASE.replace(load=-3500.0, drain_pressure=2e6, pump_flow=3e-4), 0.02, ()),
    'left open on a rising pressure': (
        BASE.replace(load=-3500.0, drain_pressure=2e6, pump_flow=3e-4, line_damping=300.0), 0.01,
        [(0.0062, {'load': -1790.0})]),
    'drain at vacuum': (BASE.replace(drain_pressure=-101_325.0), 0.05, ()),
    'dashpot that rules': (BASE.replace(line_damping=300.0), 0.05, ()),
    'friction that rules': (BASE.replace(viscous_friction=2e4), 0.05, ()),
    'no friction at all': (BASE.replace(viscous_friction=0.0, line_damping=0.0), 0.05, ()),
    'sleeve without mass or spring': (
        BASE.replace(sleeve_mass=0.0, twisted_spring_stiffness=0.0), 0.05, ()),
    'load that keeps it shut': (BASE.replace(load=3e3), 0.05, ()),
}


@pytest.mark.parametrize('name', CORNERS)
def test_corners(name):
    trace, record = assert_same(*CORNERS[name])
    pressure = record.column('pressure')
    assert lowest(trace) == pytest.approx(min(row[1] for row in record.extremes), rel=1e-6, abs=1.0)
    if 'into vacuum' in name or 'vacuum in' in name:
        assert record.totals['added_volume'] > 0.0
    if name == 'open below the drain':
        assert np.any((trace.phase == OPEN) & (pressure < 2e6))
    if name == 'flow cut while open':
        switches = phase_switches(trace)
        opened = np.flatnonzero(switches['after'] == OPEN)[0]
        assert switches['time'][opened] < 0.00966 < switches['time'][opened + 1]


def test_corners_are_what_they_are_called():
    regimes = {name: set(steady_cycles(CORNERS[name][0])['regime'])
               for name in ('off the seat', 'seat rebound', 'partial stroke')}
    assert regimes == {'off the seat': {'off-seat oscillation'}, 'seat rebound': {'seat rebound'},
                       'partial stroke': {'partial stroke'}}


# The paper's integrator ---------------------------------------------------------------------------


@pytest.mark.parametrize('design', [BASE, EVERY_TERM, BASE.replace(pump_flow=3e-3)],
                         ids=['base', 'every term', 'fast'])
def test_euler_converges_with_first_order_across_switches(design):
    expected = Oracle(design).run(0.1).cycles()[-1]
    steps = [4e-5, 2e-5, 1e-5, 5e-6, 2.5e-6]
    for name in ('period', 'peak_pressure'):
        errors = [abs(steady_cycles(design, method='euler', step=step)[name].mean()
                      / getattr(expected, name) - 1.0) for step in steps]
        order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
        print(name, errors, order)
        assert order == pytest.approx(1.0, abs=0.2), name
