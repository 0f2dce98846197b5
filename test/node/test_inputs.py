"""Setpoints: what is obeyed, what is refused, and how that is said."""
import math

import pytest

pytest.importorskip('rclpy')
from hpv_twin.node.inputs import Inputs, Limits

LIMITS = Limits(0.0, 4e-3, 'the lowest', 'pump_flow_max')


class Recorder:
    def __init__(self):
        self.now, self.warnings = 0.0, []
        self.inputs = Inputs(self.warnings.append, lambda: self.now)

    def check(self, value, name='pump_flow'):
        return self.inputs.check(name, value, LIMITS, 7.3e-4)


@pytest.fixture
def desk():
    return Recorder()


def test_values_within_limits_are_accepted_bounds_included(desk):
    assert desk.check(0.0) and desk.check(4e-3)
    assert desk.inputs.accepted['pump_flow'] == 2 and not desk.warnings


@pytest.mark.parametrize('value, words', [
    (math.nan, ['nan', 'not finite']), (math.inf, ['inf', 'not finite']),
    (-1e-9, ['below', 'the lowest is 0 L/min']),
    (5e-3, ['300.0 L/min (0.005 m³/s)', 'pump_flow_max is 240.0 L/min (0.004 m³/s)', 'above']),
])
def test_refusals_name_value_and_limit_and_what_stays(desk, value, words):
    assert not desk.check(value)
    for word in [*words, '43.8 L/min (0.00073 m³/s) stays in force']:
        assert word in desk.warnings[0]
    assert sum(desk.inputs.refused.values()) == 1


def test_warnings_are_throttled_and_counts_are_not(desk):
    for k in range(1000):
        desk.now = k * 1e-3
        desk.check(math.nan)
    desk.now = 2.5
    desk.check(math.nan)
    assert len(desk.warnings) == 2
    assert desk.inputs.refused['pump_flow', 'not finite'] == 1001


def test_age_is_that_of_the_last_accepted(desk):
    assert desk.inputs.age('pump_flow') is None
    desk.check(1e-3)
    desk.now = 4.0
    desk.check(math.nan)
    assert desk.inputs.age('pump_flow') == 4.0
