"""The machine to measure: faults switched while it runs, setpoints, and its sensors."""

import numpy as np
import pytest

from hpv_twin.model import Simulation, Vibrator, VibratorError, find_cycles
from hpv_twin.model.faults import FAULTS, apply_faults
from hpv_twin.model.machine import Machine
from hpv_twin.model.sensors import Dropouts, Sensor


def last_period(machine):
    return find_cycles(machine.simulation.advance(0.3)).period[-1]


@pytest.mark.parametrize('name', FAULTS)
def test_a_fault_switched_while_it_runs_ends_as_a_machine_built_with_it(name):
    machine = Machine(Vibrator())
    healthy = last_period(machine)
    machine.set_fault(name, 0.5)
    assert last_period(machine) == pytest.approx(
        find_cycles(Simulation(apply_faults(Vibrator(), {name: 0.5})).advance(0.3)).period[-1],
        rel=1e-12)
    machine.set_fault(name, 0.0)
    assert last_period(machine) == pytest.approx(healthy, rel=1e-12)


def test_what_it_is_told_arrives_less_what_the_faults_take():
    machine = Machine(Vibrator(), {'pump_leakage': 0.5, 'preload_loss': 1.0})
    machine.set('pump_flow', 6e-4)
    assert machine.simulation.pump_flow == pytest.approx(0.8 * 6e-4)
    assert machine.simulation.preload == pytest.approx(0.6 * Vibrator().preload)
    assert machine.told == Vibrator(pump_flow=6e-4)


def test_what_it_cannot_be_leaves_it_as_it_was():
    machine = Machine(Vibrator())
    for change in (lambda: machine.set_fault('worn_slot', 2.0),
                   lambda: machine.set('preload', -1.0)):
        with pytest.raises(VibratorError):
            change()
    assert (machine.told, machine.severities) == (Vibrator(), {})
    assert machine.simulation.design == Vibrator()


def test_a_sensor_has_gain_offset_noise_and_steps():
    random, truth = np.random.default_rng(1), np.full(20_000, 5e6)
    assert np.all(Sensor().read(truth, random) == truth)
    shown = Sensor(gain=2.0, offset=-1e5, noise=8e4).read(truth, random)
    assert shown.mean() == pytest.approx(9.9e6, abs=3e3)
    assert shown.std() == pytest.approx(8e4, rel=0.03)
    assert set(Sensor(noise=8e4, quantum=5e4).read(truth, random) % 5e4) == {0.0}
    assert isinstance(Sensor(noise=1.0).read(3.0, random), float)


def test_dropouts_are_a_share_of_the_samples_in_gaps():
    dropouts = Dropouts(np.random.default_rng(2))
    lost = np.array([dropouts.lost(0.1) for _ in range(100_000)])
    assert lost.mean() == pytest.approx(0.1, abs=0.02)
    assert np.sum(np.diff(lost.astype(int)) == 1) == pytest.approx(500, abs=120)
    assert not any(dropouts.lost(0.0) for _ in range(100))
