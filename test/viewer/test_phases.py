"""Phases read off samples at 1 kHz agree with the switches that the model located."""
import numpy as np
import pytest

from hpv_twin.model import Simulation, Vibrator, find_cycles
from hpv_twin.viewer import phases
from hpv_twin.viewer.signals import Machine, Signal


def sampled(rate=1000, pump_flow=None):
    sim = Simulation(Vibrator())
    if pump_flow:
        sim.pump_flow = pump_flow
    sim.advance(0.1)
    trace = sim.advance(1.0, sample_rate=rate)
    time = np.rint(trace.time * 1e9).astype(np.int64)
    machine = Machine('/x', pressures={'pressure': Signal(time, trace.pressure)},
                      joints={'plunger': Signal(time, trace.plunger_position)},
                      velocities={'plunger': Signal(time, trace.plunger_velocity)})
    return machine, find_cycles(trace)


@pytest.mark.parametrize('pump_flow', [None, 3.65e-4, 1.4e-3])
def test_durations_agree_with_the_model(pump_flow):
    machine, cycles = sampled(pump_flow=pump_flow)
    found = phases.find_phases(machine, 2e-3)
    for kind, name in enumerate(('build_up', 'forward', 'dwell', 'return_stroke')):
        assert np.median(found.durations(kind)) == pytest.approx(
            np.median(getattr(cycles, name)), abs=0.2e-3)
    assert abs(len(found.begins(phases.RETURN)) - len(cycles.period)) <= 2


def test_opening_and_return_pressures_agree_with_the_model():
    machine, cycles = sampled()
    found = phases.find_phases(machine, 2e-3)
    pressure = machine.pressures['pressure']
    opening = phases.pressure_at(pressure, found.begins(phases.FORWARD))
    back = phases.pressure_at(pressure, found.begins(phases.RETURN))
    assert np.median(opening) == pytest.approx(np.median(cycles.opening_pressure), abs=0.25e6)
    assert np.median(back) == pytest.approx(np.median(cycles.return_pressure), abs=1.0e6)


def test_without_velocities_the_positions_will_do():
    machine, cycles = sampled()
    machine.velocities.clear()
    found = phases.find_phases(machine, 2e-3)
    assert np.median(found.durations(phases.CLOSED)) == pytest.approx(
        np.median(cycles.build_up), abs=0.7e-3)


def test_nothing_is_known_in_a_gap():
    machine, _ = sampled()
    signal = machine.joints['plunger']
    kept = (signal.time < signal.time[0] + 4e8) | (signal.time > signal.time[0] + 6e8)
    machine.joints['plunger'] = Signal(signal.time[kept], signal.values[kept])
    machine.velocities['plunger'] = Signal(signal.time[kept],
                                           machine.velocities['plunger'].values[kept])
    found = phases.find_phases(machine, 2e-3)
    (at,) = np.flatnonzero(found.kind[:-1] == phases.UNKNOWN)
    assert found.time[at + 1] - found.time[at] > 1.9e8
    assert np.all(np.diff(found.time) >= 0)


def test_a_plunger_at_rest_has_one_phase():
    time = np.arange(100, dtype=np.int64) * 1_000_000
    machine = Machine('/x', joints={'plunger': Signal(time, np.zeros(100))})
    found = phases.find_phases(machine, 2e-3)
    assert found.kind.tolist() == [phases.CLOSED, phases.UNKNOWN]
