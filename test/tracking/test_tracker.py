"""A machine is followed by its pressure: in model time, with noise, without ROS."""
import numpy as np
import pytest

from hpv_twin.model import Simulation, Vibrator
from hpv_twin.tracking.phase import phase_error, rate
from hpv_twin.tracking.tracker import Tracker
from hpv_twin.tracking.windows import WindowFinder

NOISE = 4e4  # Pa


class Followed:
    """A model measured at 1 kHz, and its tracker."""

    def __init__(self, machine=None, reference=None):
        self.random = np.random.default_rng(7)
        self.simulation = Simulation(machine or Vibrator())
        self.simulation.tick(0.31)
        self.tracker = Tracker(reference or Vibrator())
        self.estimates, self.openings = [], []

    def run(self, duration):
        trace = self.simulation.advance(duration, 1000.0)
        opened = (trace.switches['before'] == 0) & (trace.switches['after'] == 1)
        self.openings += list(trace.switches['time'][opened])
        shown = trace.pressure + NOISE * self.random.standard_normal(len(trace.time))
        self.estimates += self.tracker.feed(trace.time, shown)
        return self.estimates[-1]


def test_a_machine_like_its_design_is_found_so_and_in_phase():
    followed, design = Followed(), Vibrator()
    estimate = followed.run(3.0)
    assert followed.tracker.trusted
    for name, value in (('cavity_stiffness', design.bulk_modulus / design.cavity_volume),
                        ('pump_flow', design.pump_flow),
                        ('opening_force', design.plunger_seat_area * design.opening_pressure),
                        ('flow_coefficient', design.flow_coefficient)):
        assert abs(estimate.value(name) - value) < 4.5 * estimate.uncertainty(name), name
        assert estimate.uncertainty(name) < 0.02 * value, name
    assert estimate.residual == pytest.approx(NOISE, rel=0.4)
    openings = np.array(followed.openings)
    for one in followed.estimates[60:]:
        nearest = openings[np.argmin(abs(openings - one.opening))]
        assert abs(phase_error(one.opening, nearest, one.period)) < 0.02


def stiffen(simulation):
    simulation.redesign(bulk_modulus=1.1 * simulation.vibrator.bulk_modulus)


def pump_more(simulation):
    simulation.pump_flow *= 1.1


def press_harder(simulation):
    simulation.load += 0.1 * Vibrator().plunger_seat_area * Vibrator().opening_pressure


@pytest.mark.parametrize('name, change', [
    ('cavity_stiffness', stiffen), ('pump_flow', pump_more), ('opening_force', press_harder)])
def test_a_step_is_found_within_a_second_and_given_to_its_parameter(name, change):
    followed = Followed()
    before = followed.run(5.0)
    change(followed.simulation)
    after = followed.run(1.0)
    for other in ('cavity_stiffness', 'pump_flow', 'opening_force', 'flow_coefficient'):
        expected = 1.1 if other == name else 1.0
        assert after.value(other) / before.value(other) == pytest.approx(expected, abs=0.012)
    (_, shares), = followed.tracker.changes
    assert max(shares, key=shares.get) == name


def test_setpoints_are_no_changes_of_the_machine():
    followed = Followed()
    before = followed.run(3.0)
    followed.tracker.command(followed.simulation.time, pump_flow=9e-4)
    followed.simulation.pump_flow = 9e-4
    after = followed.run(1.0)
    assert after.value('pump_flow') == pytest.approx(
        9e-4 * before.value('pump_flow') / 7.3e-4, rel=0.01)
    assert not followed.tracker.changes


def test_without_oscillation_there_are_no_windows():
    finder = WindowFinder(5e5)
    time = np.arange(0.0, 5.0, 1e-3)
    assert not finder.feed(time, np.full(len(time), 1e7))
    noise = np.random.default_rng(0).normal(1e7, 5e4, len(time))
    assert not finder.feed(time + 5.0, noise)


def test_the_rate_pulls_a_late_twin_forward_within_its_bounds():
    assert rate(1.000, 0.018, 1.000, 0.018) == 1.0
    assert 1.0 < rate(1.001, 0.018, 1.000, 0.018) <= 1.02
    assert 0.98 <= rate(0.999, 0.018, 1.000, 0.018) < 1.0
    assert rate(1.0, 0.018, 1.0, 0.020) == pytest.approx(0.9)
    assert rate(1.0, 0.018, 1.0, 0.100) == 0.75
    assert phase_error(1.0 + 7 * 0.018, 1.0, 0.018) == pytest.approx(0.0, abs=1e-9)
