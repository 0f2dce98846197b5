"""A sensor that cannot be followed is recognised and named."""
import numpy as np
import pytest

from hpv_twin.model import Simulation, Vibrator
from hpv_twin.tracking.sensor import PressureWatch

AMBIENT = 101_325.0
TIME = np.arange(1, 1001) * 1e-3 + 1.0


@pytest.fixture(scope='module')
def absolute():
    simulation = Simulation(Vibrator())
    simulation.tick(0.3)
    trace = simulation.advance(1.0, 1000.0)
    return trace.pressure[:1000] + AMBIENT + np.random.default_rng(1).normal(0.0, 8e4, 1000)


def feed(values, times=TIME):
    watch, passed = PressureWatch(Vibrator(), AMBIENT), 0
    for k in range(0, len(values), 20):
        passed += len(watch.feed(times[k:k + 20], values[k:k + 20])[0])
    return watch, passed


def test_a_good_sensor_is_passed_on_as_gauge_pressure(absolute):
    watch, passed = feed(absolute)
    assert watch.verdict == 'fine' and passed > 650
    _, gauge, gap = watch.feed([2.001], [AMBIENT + 5e6])
    assert gauge == pytest.approx([5e6]) and not gap
    assert watch.feed([2.2], [AMBIENT + 5e6])[2]


@pytest.mark.parametrize('unit, factor', [('bar', 1e-5), ('MPa', 1e-6), ('kPa', 1e-3),
                                          ('psi', 1.450377e-4)])
def test_another_unit_is_named(absolute, unit, factor):
    watch, passed = feed(factor * absolute)
    assert (watch.verdict, passed) == ('unit', 0)
    assert f'in {unit}?' in watch.text


def test_stuck_lost_and_nonsense_are_named(absolute):
    assert feed(np.full(1000, 5e6))[0].verdict == 'stuck'
    broken = absolute.copy()
    broken[::3] = np.nan
    assert feed(broken)[0].verdict == 'nonsense'
    assert feed(absolute, TIME[::-1].copy())[0].verdict == 'nonsense'
    assert feed(-absolute)[0].verdict == 'nonsense'
    watch, _ = feed(absolute)
    watch.silent()
    assert watch.verdict == 'lost'
    for k in range(0, 1000, 20):
        watch.feed(TIME[k:k + 20] + 5.0, absolute[k:k + 20])
    assert watch.verdict == 'fine'


def test_a_few_bad_samples_are_left_out(absolute):
    broken = absolute.copy()
    broken[::50] = np.inf
    watch, passed = feed(broken)
    assert watch.verdict == 'fine' and passed > 600


def test_a_machine_at_rest_is_no_broken_sensor():
    rest = AMBIENT + np.random.default_rng(2).normal(0.0, 8e4, 1000)
    assert feed(rest)[0].verdict == 'fine'
    assert 'a vacuum' in feed(rest - AMBIENT)[0].text


def test_a_zero_too_low_by_ambient_is_a_gauge_sensor(absolute):
    watch, _ = feed(absolute - AMBIENT)
    watch.zero(-AMBIENT + 5e3, 4e3)
    watch.feed(TIME[:20] + 1.0, absolute[:20])
    assert watch.verdict == 'gauge' and 'gauge sensor?' in watch.text
    watch.zero(2e3, 4e3)
    watch.feed(TIME[20:40] + 1.0, absolute[:20])
    assert watch.verdict == 'fine'
