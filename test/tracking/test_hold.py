"""The frequency is held while the machine drifts, within limits; in model time, without ROS."""
import math

import pytest

from hpv_twin.model import CycleFinder, Simulation, Vibrator
from hpv_twin.model.regimes import HELD_OPEN
from hpv_twin.tracking.frequency_map import FrequencyMap
from hpv_twin.tracking.hold import HOLDING, IDLE, LIMITED, MEASURED, OFF, FrequencyHold

PUMP_FLOW_MAX = 4e-3


class Held:
    """A simulation in ticks of 1 ms under a hold that thinks it is `believed`."""

    def __init__(self, machine=None, believed=None):
        self.simulation = Simulation(machine or Vibrator())
        self.map = FrequencyMap.of(believed or self.simulation.design, PUMP_FLOW_MAX)
        self.hold = FrequencyHold(self.map)
        self.finder = CycleFinder(self.simulation.vibrator.stroke)
        self.cycles, self.flows = [], []

    def run(self, duration, each_tick=lambda now: None):
        begun = len(self.cycles)
        for _ in range(round(duration / 1e-3)):
            each_tick(self.simulation.time)
            for cycle in self.finder.feed(self.simulation.tick(1e-3)):
                self.cycles.append(cycle)
                self.simulation.pump_flow = self.hold.cycle(
                    self.simulation.time, cycle.frequency, self.simulation.pump_flow,
                    cycle.regime)
                self.flows.append(self.simulation.pump_flow)
        return [cycle.frequency for cycle in self.cycles[begun:]]

    def want(self, target):
        self.simulation.pump_flow = self.hold.engage(target, self.simulation.pump_flow, self.map)
        return self


def test_a_new_target_is_reached_within_half_a_second():
    held = Held()
    held.run(0.3)
    held.want(40.0).run(0.5)
    held.want(70.0).run(0.5)
    assert held.run(0.2) == pytest.approx([70.0] * 14, rel=2e-4)
    assert held.hold.state == HOLDING


def test_oil_softer_than_the_model_thinks_is_made_up_for():
    held = Held(Vibrator(bulk_modulus=1.1e9), believed=Vibrator())
    held.run(0.3)
    held.want(60.0).run(0.5)
    assert held.run(0.2)[-1] == pytest.approx(60.0, rel=5e-4)
    assert held.hold.ratio > 1.1


@pytest.mark.parametrize('share', [-0.2, 0.2])
def test_a_drift_of_the_bulk_modulus_leaves_no_error(share):
    held, healthy = Held(), Vibrator().bulk_modulus
    held.run(0.3)
    held.want(60.0).run(0.5)

    def drift(now):
        held.simulation.redesign(bulk_modulus=healthy * (1.0 + share * min(1.0, (now - 0.8) / 3)))
    frequencies = held.run(3.5, drift)
    assert max(abs(frequency / 60.0 - 1.0) for frequency in frequencies) < 2e-3
    assert held.hold.state == HOLDING


def test_switched_on_at_its_frequency_and_off_it_changes_nothing():
    held = Held(Vibrator(bulk_modulus=1.2e9), believed=Vibrator())
    frequency = held.run(0.5)[-1]
    assert held.want(frequency).simulation.pump_flow == Vibrator().pump_flow
    held.run(0.3)
    flow = held.simulation.pump_flow
    assert flow == pytest.approx(Vibrator().pump_flow, rel=1e-4)
    held.hold.release()
    held.run(0.3)
    assert held.simulation.pump_flow == flow
    assert held.hold.state == OFF


@pytest.mark.parametrize('target, end', [(500.0, -1), (0.5, 0)])
def test_a_target_out_of_reach_ends_at_a_limit_without_wind_up(target, end):
    held = Held()
    held.run(0.3)
    held.want(target).run(2.0)
    assert held.simulation.pump_flow == held.map.flow[end]
    assert held.hold.state == LIMITED
    assert f'{target:.1f} Hz is out of reach' in held.hold.limited
    assert {cycle.regime for cycle in held.cycles} == {'seated oscillation'}
    held.want(60.0).run(0.3)
    assert held.run(0.1)[-1] == pytest.approx(60.0, rel=1e-3)


def test_the_limits_are_the_pump_and_a_share_of_the_critical_flow():
    design = Vibrator()
    assert FrequencyMap.of(design, 1.0).flow[-1] == pytest.approx(0.35 * design.critical_flow)
    small = FrequencyMap.of(design, 1e-3)
    assert small.flow[-1] == pytest.approx(1e-3)
    assert small.limit == 'pump_flow_max'


def test_where_nothing_oscillates_the_flow_is_left_alone():
    hold = FrequencyHold(FrequencyMap.none())
    assert hold.engage(60.0, 7e-4, FrequencyMap.none()) == 7e-4
    assert hold.state == LIMITED
    assert hold.cycle(1.0, 50.0, 7e-4) == 7e-4
    assert not FrequencyMap.of(Vibrator(), 0.0).usable


def test_it_backs_off_when_the_plunger_no_longer_returns():
    held = Held().want(120.0)
    before = held.simulation.pump_flow
    flow = held.hold.cycle(1.0, 120.0, before, HELD_OPEN)
    assert flow == pytest.approx(0.8 * before)
    assert 'did not return to its seat' in held.hold.limited
    held.hold.lost(flow)
    assert held.hold.command(flow) == pytest.approx(0.64 * before)
    assert held.want(60.0).hold.state == IDLE


def test_a_slow_pump_is_not_taken_for_a_changed_machine():
    hold, frequency_map = Held().hold, Held().map
    flow = hold.engage(70.0, 5e-4, frequency_map)
    hold.cycle(0.0, 40.0, 5e-4, gains=MEASURED)
    for k in range(8):  # at the old frequency still, while the pump begins to obey
        flow = hold.cycle(0.03 * k, 40.0, flow, gains=MEASURED)
    assert hold.ratio == pytest.approx(1.0, abs=1e-9)
    assert flow == pytest.approx(frequency_map.flow_for(70.0))


def test_time_may_begin_anew():
    hold = Held().want(60.0).hold
    hold.cycle(100.0, 60.0, 1e-3)
    hold.cycle(100.1, 60.0, 5e-4)
    for k in range(20):
        hold.cycle(0.01 * k, 60.0, 8e-4)
    assert hold.ratio == pytest.approx(8e-4 / Held().map.flow_for(60.0), rel=1e-3)
    assert math.isfinite(hold.error)
