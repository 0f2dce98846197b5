"""The stand-in machine: a node with sensors alone, and the same as a file."""
import numpy as np
import pytest

from hpv_twin.model import Vibrator, VibratorError
from hpv_twin.node.machine import main
from hpv_twin.node.machine_file import main as write_file
from hpv_twin.recording.about import describe
from hpv_twin.recording.reader import read_signals

PRESSURE, POSITION = '/machine/pressure', '/machine/plunger_position'


@pytest.fixture
def machine(start_twin):
    return start_twin('seed:=3', command=('machine',))


def frequency(messages, since=0):
    """Falls of the pressure per second of stamps, from message `since` on."""
    time = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in messages[since:]])
    high = np.array([m.fluid_pressure for m in messages[since:]]) > 6e6
    falls = time[1:][high[:-1] & ~high[1:]]
    return (len(falls) - 1) / (falls[-1] - falls[0])


def test_it_has_sensors_alone_obeys_setpoints_and_falls_ill_live(machine, ear):
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter
    from sensor_msgs.msg import FluidPressure, JointState
    pressure, position = ear.listen(FluidPressure, PRESSURE), ear.listen(JointState, POSITION)
    ear.until(lambda: len(pressure) > 700 and len(position) > 700, 'sensors')
    names = {name for name, _ in ear.node.get_topic_names_and_types()}
    assert {name for name in names if name.startswith('/machine/')} == {
        PRESSURE, POSITION, *(f'/machine/{name}_setpoint'
                              for name in ('pump_flow', 'preload', 'load'))}
    assert position[0].name == ['plunger']
    assert not position[0].velocity
    assert -1e-4 < min(m.position[0] for m in position) < 0.0
    healthy = frequency(pressure)
    assert healthy == pytest.approx(59.6, abs=8.0)

    def after(what):
        start = len(pressure) + 400
        ear.until(lambda: len(pressure) > start + 800, what)
        return frequency(pressure, start)

    ear.say('/machine/pump_flow_setpoint', 5e-4)
    slow = after('the new flow')
    assert slow < 0.85 * healthy

    def put(**values):
        request = SetParameters.Request(parameters=[
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()])
        return ear.call(SetParameters, '/machine/set_parameters', request).results

    assert all(result.successful for result in put(air_in_oil=1.0))
    assert after('air in the oil') < 0.8 * slow
    assert not put(air_in_oil=1.5)[0].successful
    assert all(result.successful for result in put(stuck=True))
    ear.spin(0.3)
    assert len({m.fluid_pressure for m in pressure[-100:]}) == 1
    assert machine.stop() == 0
    assert 'air_in_oil 1: air in the oil' in machine.log


def test_bad_parameters_end_it_with_a_line(start_twin):
    machine = start_twin('worn_slot:=3.0', command=('machine',))
    assert machine.wait() == 2
    assert 'worn_slot = 3 is outside [0, 1]' in machine.log


def test_help_names_every_fault_and_sensor(capsys):
    assert main(['--help']) == 0
    text = capsys.readouterr().out
    for word in ('air_in_oil', 'blocked_drain', 'pressure_noise', '~/load_setpoint', '--to-file'):
        assert word in text


def test_a_file_holds_what_the_sensors_show(tmp_path, capsys):
    path = tmp_path / 'm.mcap'
    assert write_file(['--to-file', str(path), '--duration', '2', '--rate', '2000', '--dropouts',
                       '0.05', '--jitter', '2e-5', '--position-offset', '1e-4',
                       '--pressure-quantum', '5e3', '--fault', 'air_in_oil=1@1']) == 0
    about = describe(path)
    assert about.complete
    assert Vibrator.load_yaml(about.attachments['machine.yaml'].decode()) == Vibrator()
    signals = read_signals(path)
    pressure, position = signals[PRESSURE], signals[POSITION]
    assert len(pressure.time) == len(position.time) == pytest.approx(3800, abs=130)
    assert set(pressure.pressure % 5e3) == {0.0}
    assert 1e-5 < np.std(np.diff(pressure.time)[np.diff(pressure.time) < 8e5]) * 1e-9 < 4e-5
    assert np.median(position.position[position.position < 2e-4, ]) == pytest.approx(1e-4, abs=1e-5)
    half = (pressure.time - pressure.time[0]) * 1e-9 < 1.0
    falls = [np.sum((p[:-1] > 6e6) & (p[1:] < 6e6)) for p in (pressure.pressure[half],
                                                             pressure.pressure[~half])]
    assert falls[1] < 0.8 * falls[0]
    assert write_file(['--to-file', str(path)]) == 2
    assert 'File exists' in capsys.readouterr().err


def test_payloads_are_those_of_ros():
    serialization = pytest.importorskip('rclpy.serialization')
    from sensor_msgs.msg import FluidPressure, JointState

    from hpv_twin.recording import measurements
    stamp = 1_700_000_000_123_456_789
    message = serialization.deserialize_message(
        measurements.pressure_payload(stamp, 1.5e7), FluidPressure)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_700_000_000, 123_456_789)
    assert (message.header.frame_id, message.fluid_pressure) == ('cavity_a', 1.5e7)
    joint = serialization.deserialize_message(
        measurements.joint_payload(stamp, 1e-3), JointState)
    assert (joint.name, list(joint.position), len(joint.velocity), len(joint.effort)) == (
        ['plunger'], [1e-3], 0, 0)


def test_type_hashes_are_those_of_the_installed_packages():
    sensor_msgs = pytest.importorskip('sensor_msgs')
    from hpv_twin.recording import measurements
    from hpv_twin.recording.schemas import channel_for
    for kind, number in measurements.HASHES.items():
        installed = channel_for('/x', kind, sensor_msgs.__file__)
        assert installed.type_hash == number
        fields = [line.partition('#')[0].strip() for line in installed.schema.splitlines()]
        assert ([line for line in fields if line and '===' not in line]
                == [line for line in measurements.SCHEMAS[kind].splitlines()
                    if line and '===' not in line])


@pytest.mark.parametrize(('options', 'reason'), [
    (['--duration', '0'], 'duration must be above 0'),
    (['--fault', 'worn_slot=2'], r'worn_slot = 2 is outside'),
    (['--pump-flow', '-1'], 'pump_flow')])
def test_a_file_that_cannot_be_is_refused(tmp_path, capsys, options, reason):
    assert write_file(['--to-file', str(tmp_path / 'x.mcap'), *options]) == 2
    assert reason in capsys.readouterr().err
    assert issubclass(VibratorError, ValueError)
