"""Faults are named by their signature; what two share is said."""
import numpy as np
import pytest

from hpv_twin.model import Vibrator
from hpv_twin.model.faults import FAULTS
from hpv_twin.model.machine import Machine
from hpv_twin.tracking.condition import ERROR, WARN, Condition
from hpv_twin.tracking.estimator import Estimate
from hpv_twin.tracking.tracker import Tracker

NAMES = ('cavity_stiffness', 'pump_flow', 'opening_force', 'flow_coefficient', 'base_pressure',
         'viscous_friction')


def estimate(time, sigma=0.005, correlation=0.0, **deviation):
    x = np.array([deviation.get(name, 0.0) for name in NAMES])
    covariance = np.diag([sigma ** 2] * 4 + [0.01 ** 2, 0.2 ** 2])
    covariance[0, 1] = covariance[1, 0] = correlation * sigma ** 2
    return Estimate(time=time, values=np.ones(6), sigma=np.sqrt(np.diag(covariance)), deviation=x,
                    covariance=covariance, opening=time, period=0.018, residual=8e4, noise=8e4,
                    surprise=0.0, flow_sensitivity=0.0, cycles=1)


def judged(duration=5.0, **deviation):
    condition = Condition()
    for time in np.arange(0.0, duration, 0.02):
        condition.feed(estimate(time, **deviation), True, False)
    return condition


@pytest.mark.parametrize('fault', FAULTS)
def test_each_fault_of_the_stand_in_machine_gets_its_name(fault):
    random, machine = np.random.default_rng(3), Machine(Vibrator())
    machine.tick(0.31)
    tracker, condition = Tracker(Vibrator()), Condition()

    def run(duration):
        trace = machine.simulation.advance(duration, 1000.0)
        shown = trace.pressure + 8e4 * random.standard_normal(len(trace.time))
        for one in tracker.feed(trace.time, shown):
            condition.feed(one, tracker.trusted, bool(tracker.candidates))
    run(4.0)
    assert not condition.findings
    machine.set_fault(fault, 0.4)
    run(3.0)
    assert set(condition.findings) == {fault}


def test_small_or_unsure_deviations_are_no_faults():
    assert not judged(cavity_stiffness=-0.05).findings
    assert not judged(flow_coefficient=0.1, sigma=0.03).findings
    assert not judged(cavity_stiffness=0.2, pump_flow=0.2).findings


def test_level_and_evidence():
    found = judged(pump_flow=-0.08).findings['pump_leakage']
    assert found.level == WARN
    assert '-7.7 % from the design (16 standard deviations)' in found.text
    assert 'a pump that does not obey its setpoint looks the same' in found.text
    assert judged(pump_flow=-0.3).findings['pump_leakage'].level == ERROR


def test_what_cannot_be_told_apart_is_said_to_be_so():
    condition = judged(cavity_stiffness=-0.1, pump_flow=-0.08, sigma=0.04, correlation=-0.98)
    assert set(condition.findings) == {'slow_build_up'}
    assert 'air in the oil or a leaking pump' in condition.findings['slow_build_up'].text


def test_a_moment_is_no_fault_and_a_fault_mended_is_forgotten():
    condition = judged(pump_flow=-0.1)
    for time in np.arange(5.0, 6.0, 0.02):
        condition.feed(estimate(time), True, False)
    assert condition.findings
    for time in np.arange(6.0, 8.0, 0.02):
        condition.feed(estimate(time), True, False)
    assert not condition.findings
    for time in np.arange(8.0, 8.4, 0.02):
        condition.feed(estimate(time, pump_flow=-0.1), True, False)
    for time in np.arange(8.4, 10.0, 0.02):
        condition.feed(estimate(time), True, False)
    assert not condition.findings
    condition.feed(estimate(10.0, pump_flow=-0.3), False, False)
    assert not condition.findings


def test_a_drift_over_hours_is_told_with_its_rate():
    condition, random = Condition(), np.random.default_rng(0)
    for time in np.arange(0.0, 3 * 3600.0, 10.0):
        noise = 0.003 * random.standard_normal()
        condition.feed(estimate(time, flow_coefficient=0.01 * time / 3600.0 + noise), True, False)
    told = condition.trends()
    assert set(told) == {'worn_slot'}
    assert '+1.0 % per hour; warns in about 4' in told['worn_slot']
