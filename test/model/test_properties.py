"""What holds for every design and every sequence of setpoints."""
import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from oracle import Oracle
from oracle_designs import SPREAD, phase_switches, simulate

from hpv_twin.model import Simulation, Trace, Vibrator, kernel

pytestmark = pytest.mark.compiled

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
    values = {'pump_flow': st.just(0.0) | st.floats(1e-4, 9e-3),
              'preload': st.just(0.0) | st.floats(1e-4, 9e-3),
              'load': st.just(0.0) | st.floats(-2e3, 3e3)}
    optional = None if every else dict(values)
    return draw(st.fixed_dictionaries(values if every else {}, optional=optional))


@st.composite
def changes(draw):
    """Setpoint changes at increasing instants."""
    instants = draw(st.lists(st.floats(1e-5, DURATION), max_size=6, unique=True))
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


# Sizes of time, s, pressure, Pa, position, m, and velocity, m/s, against which errors are measured.
SIZES = {'time': 1e-2, 'pressure': 1e6, 'position': 2e-3, 'velocity': 1.0}


def assert_same(one, other, tolerance):
    """Compare two arrays of numbers, or of records, in proportion to the sizes of their fields."""
    assert len(one) == len(other)
    for name in one.dtype.names:
        if name.endswith(('max_time', 'min_time')) and tolerance:
            continue  # Where the vacuum holds the pressure, its lowest value has many times.
        size = next((size for part, size in SIZES.items() if part in name), 1.0)
        assert np.allclose(one[name], other[name], rtol=0.0, atol=tolerance * size,
                           equal_nan=True), name


def samples(trace):
    """Return the samples as records."""
    names = ('time', 'pressure', 'plunger_position', 'plunger_velocity', 'sleeve_position', 'phase')
    return np.rec.fromarrays([getattr(trace, name) for name in names], names=names)


@examples(60)
def test_slicing_changes_nothing(design, sequence, method):
    # A slice that ends off the grid of Euler's steps shortens one.
    cuts = [1e-3, 1.7e-3, 0.02, 0.05] + [math.pi / 100.0] * (method == 'default')
    sliced = sorted(sequence + [(cut, {}) for cut in cuts], key=lambda change: change[0])
    one, other = (simulate(design, DURATION, changes, method=method)
                  for changes in (sequence, sliced))
    # Instants are sums of slices: they may differ in the last bit, and so may an Euler step.
    tolerance = 1e-9 if method == 'default' else 1e-6
    assert_same(samples(one), samples(other), tolerance)
    assert_same(one.switches, other.switches, tolerance)


@examples(40)
def test_slices_of_a_millisecond_give_the_same_bits(design, sequence, method):
    simulation = Simulation(design, method=method)
    one = Simulation(design, method=method).advance(DURATION, sample_rate=1000.0)
    other = Trace.join(simulation.advance(1e-3, sample_rate=1000.0) for _ in range(60))
    tolerance = 0.0 if method == 'default' else 1e-6
    assert_same(samples(one), samples(other), tolerance)
    assert_same(one.switches, other.switches, tolerance)


@examples(30)
def test_same_inputs_same_bits(design, sequence, method):
    one, other = (simulate(design, DURATION, sequence, method=method) for _ in range(2))
    assert samples(one).tobytes() == samples(other).tobytes()
    assert one.switches.tobytes() == other.switches.tobytes()


def slot_flow(design, pressure, position, phase):
    """
    (26), (27) with the pressure of the moment, m³/s.

    The default integrator takes it linear in the pressure up to 1 Pa above the drain.
    """
    slot = np.choose(phase, [0.0 * position, position - design.gap_ratio * design.stroke,
                             0.0 * position + design.stroke, position])
    drop = np.clip(pressure - design.drain_pressure, 0.0, None)
    area = math.pi * design.sleeve_seat_diameter * np.clip(slot, 0.0, None)
    drop = np.where(drop < 1.0, drop * drop, drop)
    return design.flow_coefficient * area * np.sqrt(2.0 * drop / design.density)


def drained(design, trace):
    """Volume that has left through the slot up to each sample, m³; jumps of the slot are split."""
    rows = phase_switches(trace)
    parts = [(trace.time, trace.pressure, trace.plunger_position, trace.phase),
             *((rows['time'], rows['pressure'], rows['plunger_position'], rows[phase])
               for phase in ('before', 'after'))]
    time, pressure, position, phase = (np.concatenate(column) for column in zip(
        *parts, strict=True))
    order = np.lexsort((np.repeat([2, 0, 1], [len(trace.time), len(rows), len(rows)]), time))
    flow = slot_flow(design, pressure, position, phase.astype(int))[order]
    # From rest at time 0: nothing flows before the first sample.
    volume = np.concatenate([[0.0], np.cumsum(
        np.diff(time[order]) * 0.5 * (flow[1:] + flow[:-1]))])
    return volume[np.flatnonzero(order < len(trace.time))]


def pumped(design, sequence, time):
    """Volume that the pump has delivered, m³."""
    instants, flows = [0.0], [design.pump_flow]
    for instant, values in sequence:
        instants.append(instant)
        flows.append(values.get('pump_flow', flows[-1]))
    ends = np.append(instants[1:], np.inf)
    return sum(flow * np.clip(time - start, 0.0, end - start)
               for flow, start, end in zip(flows, instants, ends, strict=True))


@examples(40)
def test_oil_is_conserved_but_for_what_the_vacuum_adds(design, sequence, method):
    # Where the slot's flow begins as a root does, trapezoids need samples as close as these.
    trace = simulate(design, DURATION, sequence, sample_rate=4e6)
    seat, sleeve = design.plunger_seat_area, design.sleeve_seat_area
    displaced = seat * trace.plunger_position + (sleeve - seat) * trace.sleeve_position
    compressed = design.cavity_volume / design.bulk_modulus * trace.pressure
    delivered = pumped(design, sequence, trace.time)
    added = compressed + displaced + drained(design, trace) - delivered
    slack = 1e-5 * (delivered[-1] + sleeve * design.stroke)
    cavitates = trace.pressure <= VACUUM + 1e-3
    steps = np.diff(added)
    assert (steps >= -slack).all()
    assert (steps[~cavitates[1:] & ~cavitates[:-1]] <= slack).all()
    if not cavitates.any():
        assert np.abs(added).max() <= slack


@examples(15)
def test_motion_is_that_of_the_oracle(design, sequence, method):
    duration = DURATION / 2
    # Without flow the pressure ends where the root in the slot's law has no slope: too stiff a
    # problem for the oracle's explicit method.
    design = design.replace(pump_flow=max(design.pump_flow, 3e-4))
    sequence = [(instant, {name: max(value, 3e-4) if name == 'pump_flow' else value
                           for name, value in values.items()})
                for instant, values in sequence if instant < duration]
    trace = simulate(design, duration, sequence)
    record = Oracle(design).run(duration, sequence, sample_rate=1000.0)
    found, expected = phase_switches(trace), record.phase_switches
    assert [(switch.before, switch.after) for switch in expected] == list(
        zip(found['before'], found['after'], strict=True))
    assert np.allclose(found['time'], [switch.time for switch in expected], rtol=0.0, atol=1e-9)
    for name in ('pressure', 'plunger_position', 'plunger_velocity'):
        assert np.allclose(getattr(trace, name), record.column(name), rtol=1e-6,
                           atol=1e-7 * SIZES[name.split('_')[-1]]), name


PROPERTIES = [value for name, value in dict(globals()).items() if name.startswith('test_')]


@pytest.mark.long
@pytest.mark.parametrize('check', PROPERTIES, ids=lambda check: check.__name__)
def test_many_more_examples(check):
    count = 20 * check._hypothesis_internal_use_settings.max_examples
    examples(count)(check.hypothesis.inner_test)()
