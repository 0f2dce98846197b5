"""Each regime has a machine that shows it, by the name Simulation and find_cycles give."""
import pytest

from hpv_twin.model import Simulation, Vibrator, find_cycles


def run(duration, design=None, **setpoints):
    simulation = Simulation(Vibrator(**(design or {})))
    for name, value in setpoints.items():
        setattr(simulation, name, value)
    simulation.advance(duration, sample_rate=100)
    return simulation


@pytest.mark.parametrize('regime, design, setpoints', [
    ('no opening', {}, {'pump_flow': 0.0}),
    ('seated oscillation', {}, {}),
    ('seated oscillation', {}, {'pump_flow': 1e-5}),
    ('seat rebound', {}, {'preload': 1e-4}),
    ('seat rebound', {}, {'load': -1290.0}),
    ('partial stroke', {'viscous_friction': 1000.0}, {'pump_flow': 7.3e-5, 'preload': 2e-4}),
    ('off-seat oscillation', {}, {'pump_flow': 9e-3, 'preload': 6e-3}),
    ('held open', {}, {'pump_flow': 1.2e-2}),
    ('hovering', {}, {'load': -3e3}),
    ('hovering', {}, {'preload': 0.0, 'pump_flow': 4e-3}),
])
def test_a_machine_for_each_regime(regime, design, setpoints):
    assert run(4.0, design, **setpoints).regime == regime


def test_flow_cut_after_opening_leaves_the_plunger_hovering():
    simulation = run(0.0142)
    simulation.pump_flow = 0.0
    simulation.advance(1.0)
    assert simulation.regime == 'hovering' and simulation.plunger_position > 1e-4


def test_from_rest_to_the_first_whole_cycle():
    assert run(0.001).regime == 'no opening'
    assert run(0.016).regime == 'starting'
    assert run(0.05).regime == 'seated oscillation'


def test_oscillation_goes_on_through_a_long_build_up_and_ends_with_the_flow():
    simulation = run(0.3)
    simulation.pump_flow = 1e-7
    simulation.advance(5.0)
    assert simulation.regime == 'seated oscillation'
    simulation.pump_flow = 0.0
    simulation.advance(1.0)
    assert simulation.regime == 'no opening'


def test_cycles_carry_the_same_names():
    simulation = run(1.0, preload=1e-4)
    assert set(find_cycles(simulation.advance(0.2)).regime) == {'seat rebound'}


def test_reduced_stroke_off_the_seat_at_120_to_400_hz():
    simulation = run(2.0, pump_flow=9e-3, preload=6e-3)
    cycles = find_cycles(simulation.advance(0.5))
    assert ((cycles.frequency > 120) & (cycles.frequency < 400)).all()
    assert (cycles.stroke < 1.9e-3).all()
