"""Cycles: where they begin, what they measure, which kind they are."""
import numpy as np
import pytest

from hpv_twin.model import CycleFinder, Simulation, Vibrator, find_cycles


def steady(duration=1.0, **setpoints):
    simulation = Simulation()
    for name, value in setpoints.items():
        setattr(simulation, name, value)
    simulation.advance(duration)
    return find_cycles(simulation.advance(0.5))


def test_phase_times_sum_to_the_period():
    cycles = find_cycles(Simulation().advance(0.5))
    total = cycles.build_up + cycles.forward + cycles.dwell + cycles.return_stroke
    assert np.allclose(total, cycles.period, rtol=1e-12)
    assert len(cycles) > 20 and cycles.frequency == pytest.approx(1.0 / cycles.period)


def test_a_cycle_starts_at_its_opening():
    trace = Simulation().advance(0.1)
    cycles = find_cycles(trace)
    openings = trace.switches[trace.switches['before'] == 0]
    assert np.array_equal(cycles.start, openings['time'][:-1])
    assert np.array_equal(cycles.opening_pressure, openings['pressure'][:-1])
    assert cycles.build_up[0] == pytest.approx(
        openings['time'][1] - openings['pressure_min_time'][1], rel=1e-12)


def test_pressure_peaks_before_the_stroke_does():
    cycles = steady()
    assert cycles.phase_lag[-1] == pytest.approx(0.37e-3, abs=0.02e-3)


def test_peak_is_at_least_every_sample():
    trace = Simulation().advance(0.3)
    cycles = find_cycles(trace)
    for k in range(len(cycles)):
        inside = (trace.time >= cycles.start[k]) & (trace.time < cycles.start[k] + cycles.period[k])
        assert cycles.peak_pressure[k] >= trace.pressure[inside].max()


@pytest.mark.parametrize('setpoints, regime', [
    ({}, 'seated oscillation'),
    ({'preload': 1e-4}, 'seat rebound'),
    ({'pump_flow': 9e-3, 'preload': 6e-3}, 'off-seat oscillation'),
])
def test_cycles_are_labelled_by_what_happened(setpoints, regime):
    assert set(steady(**setpoints).regime) == {regime}


def test_cycles_that_arrive_piecemeal_are_the_same_cycles():
    simulation, finder, found = Simulation(), CycleFinder(Vibrator().stroke), []
    for _ in range(500):
        found += finder.feed(simulation.tick(1e-3))
    whole = find_cycles(Simulation().advance(0.5))
    assert [cycle.period for cycle in found] == pytest.approx(whole.period, rel=1e-9)


def test_no_motion_no_cycles():
    assert len(steady(pump_flow=0.0)) == 0


@pytest.mark.parametrize('setpoints', [{}, {'pump_flow': 7e-3},
                                       {'pump_flow': 2e-3, 'preload': 1.5e-3}, {'load': 500.0}])
def test_every_row_of_equation_6_sums_to_the_period(setpoints):
    cycles = steady(**setpoints)
    rows = [(cycles.forward, cycles.dwell, cycles.return_stroke, cycles.build_up),
            (cycles.pressure_rise, cycles.pressure_fall, cycles.pressure_undershoot,
             cycles.pressure_recovery),
            (cycles.sleeve_forward, cycles.dwell, cycles.return_stroke, cycles.sleeve_seated)]
    for row in rows:
        assert np.allclose(sum(row), cycles.period, rtol=1e-9)
        assert all((part > 0.0).all() for part in row)


@pytest.mark.compiled
def test_times_of_equation_6_are_those_read_off_the_waveform():
    simulation = Simulation()
    simulation.advance(0.5)
    trace = simulation.advance(0.1, sample_rate=1e6)
    cycles = find_cycles(trace)
    start, end = cycles.start[1], cycles.start[2]
    inside = (trace.time >= start) & (trace.time < end)
    time, pressure = trace.time[inside], trace.pressure[inside]
    highest, lowest = time[pressure.argmax()], time[pressure.argmin()]
    p2 = cycles.return_pressure[1]
    fall = time[(time > highest) & (pressure <= p2)][0]
    rise = time[(time > lowest) & (pressure >= p2)][0]
    assert cycles.pressure_fall[1] == pytest.approx(fall - highest, abs=3e-6)
    assert cycles.pressure_undershoot[1] == pytest.approx(lowest - fall, abs=3e-6)
    assert cycles.pressure_recovery[1] == pytest.approx(rise - lowest, abs=3e-6)
    assert cycles.peak_pressure[1] == pytest.approx(pressure.max(), rel=1e-6)
    assert cycles.lowest_pressure[1] == pytest.approx(pressure.min(), rel=1e-6)


@pytest.mark.compiled
def test_figures_of_euler_are_near_those_of_the_default():
    simulation = Simulation(method='euler', step=1e-6)
    simulation.advance(0.3)
    coarse, fine = find_cycles(simulation.advance(0.1)), steady()
    for name in ('period', 'peak_pressure', 'pressure_rise', 'pressure_recovery',
                 'sleeve_forward', 'sleeve_seated', 'phase_lag'):
        assert getattr(coarse, name)[-1] == pytest.approx(getattr(fine, name)[-1], rel=5e-3), name
