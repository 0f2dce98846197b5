"""The model as the node runs it."""
import pytest

pytest.importorskip('rclpy')
from hpv_twin.model import Simulation, Vibrator
from hpv_twin.node.plant import Plant


@pytest.fixture
def plant():
    return Plant(Vibrator(), 101_325.0)


def run(plant, seconds):
    return [cycle for _ in range(round(seconds * 1000)) for cycle in plant.tick(1e-3)]


def test_pressure_is_absolute(plant):
    run(plant, 0.1)
    assert plant.pressure_values() == (plant.simulation.pressure + 101_325.0,)


def test_cycles_are_those_of_the_simulation(plant):
    assert run(plant, 1.0)[-1].frequency == pytest.approx(55.0, abs=0.5)
    assert plant.regime == 'seated oscillation'


def test_a_setpoint_changes_the_frequency_to_what_the_simulation_says(plant):
    run(plant, 0.2)
    plant.set('pump_flow', 3.65e-4)
    other = Simulation()
    other.pump_flow = 3.65e-4
    reference = Plant(Vibrator(pump_flow=3.65e-4), 0.0)
    assert run(plant, 0.2)[-1].period == pytest.approx(run(reference, 1.0)[-1].period, rel=1e-4)


def test_oscillation_that_ends_is_said_once(plant):
    run(plant, 0.2)
    plant.set('pump_flow', 0.0)
    said = [k for k in range(5000) if not plant.tick(1e-3) and plant.stopped()]
    assert len(said) == 1 and plant.regime == 'no opening'


def test_reset_goes_back_to_rest_with_the_setpoints(plant):
    plant.set('preload', 4e-3)
    run(plant, 0.1)
    plant.reset()
    assert plant.simulation.time == 0.0 and plant.simulation.preload == 4e-3
    assert plant.cycle is None and plant.regime == 'no opening'
