"""What holds for every design and every sequence of setpoints."""
import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from oracle import Oracle
from oracle_designs import SPREAD, phase_switches, simulate

from hpv_twin.model import Simulation, Vibrator, find_cycles, kernel

BASE = Vibrator()
VACUUM = -101_325.0  # Pa gauge
QUICK = {'deadline': None, 'derandomize': True, 'database': None,
         'suppress_health_check': list(HealthCheck)}
DURATION = 0.06  # s


def shares(share):
    return st.floats(1.0 - share, 1.0 + share)


@st.composite
def designs(draw):
    """Designs far wider than what oscillates on its seat, up to strong pulls and no flow."""
    fields = {name: getattr(BASE, name) * draw(shares(share)) for name, share in SPREAD.items()}
    fields |= draw(setpoints(every=True))
    return Vibrator(
        gap_ratio=draw(st.floats(0.2, 0.5)), viscous_friction=draw(st.floats(0.0, 2e3)),
        line_damping=draw(st.none() | st.floats(0.0, 30.0)),
        drain_pressure=draw(st.just(0.0) | st.floats(VACUUM, 2e6)), **fields)


@st.composite
def setpoints(draw, every=False):
    """Some of the setpoints, or every one."""
    values = {'pump_flow': st.just(0.0) | st.floats(1e-5, 9e-3),
              'preload': st.just(0.0) | st.floats(1e-4, 9e-3),
              'load': st.just(0.0) | st.floats(-2e3, 3e3)}
    optional = None if every else dict(values)
    return draw(st.fixed_dictionaries(values if every else {}, optional=optional))


@st.composite
def changes(draw):
    """Setpoint changes at increasing instants."""
    instants = draw(st.lists(st.just(0.0) | st.floats(1e-6, DURATION), max_size=6))
    return [(instant, draw(setpoints())) for instant in sorted(instants)]


CASE = designs(), changes(), st.sampled_from(['default', 'euler'])


def examples(count):
    """Decorate a property of (design, sequence of setpoints, method): that many fixed examples."""
    def decorate(check):
        return settings(max_examples=count, **QUICK)(given(*CASE)(check))
    return decorate


def expected_sleeve(design, trace):
    y, h_b, h_s = trace.plunger_position, design.stroke, design.gap_ratio * design.stroke
    waiting = np.clip((y - 0.1 * h_b) * h_s / (h_s - 0.1 * h_b), 0.0, None)
    return np.where((trace.phase == kernel.PHASE_FORWARD) & (y < h_s), waiting, y)


@examples(150)
def test_state_stays_within_its_bounds(design, sequence, method):
    trace = simulate(design, DURATION, sequence, sample_rate=20_000.0, method=method)
    switches = trace.switches
    assert all(np.isfinite(getattr(trace, name)).all() for name in (
        'time', 'pressure', 'plunger_position', 'plunger_velocity', 'sleeve_position'))
    for y in (trace.plunger_position, switches['plunger_position'], switches['position_max'],
              switches['position_min']):
        assert ((y >= 0.0) & (y <= design.stroke)).all()
    for p in (trace.pressure, switches['pressure'], switches['pressure_min']):
        assert (p >= VACUUM).all()
    assert np.isfinite(switches['pressure_max']).all()


@examples(100)
def test_plunger_rests_on_seat_and_stop_and_the_sleeve_obeys_its_law(design, sequence, method):
    trace = simulate(design, DURATION, sequence, sample_rate=20_000.0, method=method)
    closed, opened = trace.phase == kernel.PHASE_CLOSED, trace.phase == kernel.PHASE_OPEN
    assert not trace.plunger_velocity[closed | opened].any()
    assert not trace.plunger_position[closed].any()
    assert (trace.plunger_position[opened] == design.stroke).all()
    assert np.allclose(trace.sleeve_position, expected_sleeve(design, trace), rtol=0, atol=1e-12)
    assert (trace.sleeve_position <= trace.plunger_position + 1e-15).all()


@examples(100)
def test_switches_are_in_order_and_chained(design, sequence, method):
    switches = simulate(design, DURATION, sequence, method=method).switches
    assert (np.diff(switches['time']) >= 0.0).all()
    assert ((switches['time'] >= 0.0) & (switches['time'] <= DURATION)).all()
    assert (switches['stage_before'][1:] == switches['stage_after'][:-1]).all()
    assert (switches['pressure_min'] <= switches['pressure']).all()
    assert (switches['pressure_max'] >= switches['pressure']).all()
    moves = switches[switches['before'] != switches['after']]
    allowed = {(0, 1), (1, 2), (1, 0), (1, 3), (2, 3), (3, 2), (3, 0)}
    assert set(zip(moves['before'].tolist(), moves['after'].tolist(), strict=True)) <= allowed
    # At one instant: four at most, and a setpoint change may start another count.
    others = moves['time'][~np.isin(moves['time'], [instant for instant, _ in sequence])]
    assert max(np.unique(others, return_counts=True)[1], default=0) <= 4


def same(values, others, tolerance):
    """Tell whether two arrays agree, within a share of the larger one's size; 0: to the bit."""
    if tolerance == 0.0:
        return np.array_equal(values, others, equal_nan=values.dtype.kind == 'f')
    size = max(np.abs(values).max(initial=0.0), 1e-12)
    return len(values) == len(others) and np.allclose(values, others, rtol=0.0,
                                                      atol=tolerance * size, equal_nan=True)


@examples(60)
def test_slicing_changes_nothing(design, sequence, method):
    # A slice that ends off the grid of Euler's steps shortens one.
    cuts = [1e-3, 1.7e-3, 0.02, 0.05] + [math.pi / 100.0] * (method == 'default')
    sliced = sorted(sequence + [(cut, {}) for cut in cuts], key=lambda change: change[0])
    one, other = (simulate(design, DURATION, changes, method=method)
                  for changes in (sequence, sliced))
    tolerance = 0.0 if method == 'default' else 1e-9
    for name in ('time', 'pressure', 'plunger_position', 'plunger_velocity', 'phase'):
        assert same(getattr(one, name), getattr(other, name), tolerance), name
    for name in one.switches.dtype.names:
        assert same(one.switches[name], other.switches[name], tolerance), name


@examples(30)
def test_same_inputs_same_bits(design, sequence, method):
    one, other = (simulate(design, DURATION, sequence, method=method) for _ in range(2))
    for name in ('time', 'pressure', 'plunger_position', 'plunger_velocity', 'phase'):
        assert np.array_equal(getattr(one, name), getattr(other, name))
    assert one.switches.tobytes() == other.switches.tobytes()
