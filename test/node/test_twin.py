"""The real node, its real messages, and what an operator can do to it."""
import signal
import subprocess

import numpy as np
import pytest

pytest.importorskip('rclpy')
from diagnostic_msgs.msg import DiagnosticArray
from mcap.reader import make_reader
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

from hpv_twin.model import Simulation, find_cycles
from hpv_twin.recording.reader import read_signals

AMBIENT = 101_325.0


def stamp(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def rises(time, pressure, level=8e6):
    """Instants at which the pressure passes a level upwards."""
    k = np.nonzero((pressure[1:] >= level) & (pressure[:-1] < level))[0]
    share = (level - pressure[k]) / (pressure[k + 1] - pressure[k])
    return time[k] + share * (time[k + 1] - time[k])


def expected_frequency(**setpoints):
    simulation = Simulation()
    for name, value in setpoints.items():
        setattr(simulation, name, value)
    return find_cycles(simulation.advance(1.0)).frequency[-1]


def value_of(messages, part, key):
    """The newest value of a key in the diagnostics of a part."""
    for message in reversed(messages):
        for status in message.status:
            if status.name.endswith(f': {part}'):
                return {pair.key: pair.value for pair in status.values}.get(key)
    return None


def test_a_subscriber_sees_the_machine_of_the_paper(start_twin, ear):
    start_twin()
    pressure = ear.listen(FluidPressure, '/hpv_twin/pressure')
    position = ear.listen(JointState, '/hpv_twin/plunger_position')
    ear.until(lambda: len(pressure) > 3000 and len(position) > 3000, '3 s of messages')
    times = np.array([stamp(message) for message in pressure])
    steps = np.diff(times)
    assert (steps >= 999_000).all()
    assert (steps <= 1_001_000).mean() > 0.99
    assert list(position[0].name) == ['plunger', 'valve_sleeve']
    assert not set(map(stamp, pressure[500:2500])) - set(map(stamp, position))
    gauge = np.array([message.fluid_pressure for message in pressure]) - AMBIENT
    frequency = 1.0 / np.median(np.diff(rises(times * 1e-9 - times[0] * 1e-9, gauge)))
    assert frequency == pytest.approx(55.0, abs=0.5)
    assert gauge.max() == pytest.approx(16e6, abs=0.1e6)
    assert max(message.position[0] for message in position) == 2e-3
    assert max(message.position[1] for message in position) == 2e-3


def test_setpoints_take_effect_and_are_announced(start_twin, ear):
    start_twin()
    frequency = ear.listen(Float64, '/hpv_twin/frequency')
    in_force = ear.listen(Float64, '/hpv_twin/pump_flow', latched=True)
    ear.until(lambda: len(frequency) > 5 and in_force, 'cycles')
    assert in_force[0].data == 7.3e-4
    ear.say('/hpv_twin/pump_flow_setpoint', 3.65e-4)
    ear.until(lambda: in_force[-1].data == 3.65e-4, 'the new flow in force')
    settled = len(frequency) + 8
    ear.until(lambda: len(frequency) > settled, 'cycles at the new flow')
    assert frequency[-1].data == pytest.approx(expected_frequency(pump_flow=3.65e-4), rel=1e-3)
    ear.say('/hpv_twin/preload_setpoint', 4e-3)
    settled = len(frequency) + 20
    ear.until(lambda: len(frequency) > settled, 'cycles at the new preload')
    expected = expected_frequency(pump_flow=3.65e-4, preload=4e-3)
    assert frequency[-1].data == pytest.approx(expected, rel=1e-3)


def test_bad_setpoints_are_refused_and_change_nothing(start_twin, ear):
    twin = start_twin()
    frequency = ear.listen(Float64, '/hpv_twin/frequency')
    in_force = ear.listen(Float64, '/hpv_twin/pump_flow', latched=True)
    report = ear.listen(DiagnosticArray, '/diagnostics')
    ear.until(lambda: len(frequency) > 5 and in_force, 'cycles')
    for value in (float('nan'), float('inf'), -1e-6, 5e-3):
        ear.say('/hpv_twin/pump_flow_setpoint', value)
        ear.spin(0.1)  # the queue holds one setpoint: the next would replace it
    ear.until(lambda: value_of(report, 'inputs', 'refused') == '4', 'four refusals counted')
    assert [message.data for message in in_force] == [7.3e-4]
    assert frequency[-1].data == pytest.approx(55.0, abs=0.5)
    for words in ('nan refused, not finite', '300.0 L/min (0.005 m³/s)', 'pump_flow_max is 240.0'):
        assert words in twin.log


def test_reset_pause_and_record_do_what_they_say(start_twin, ear):
    twin = start_twin()
    pressure = ear.listen(FluidPressure, '/hpv_twin/pressure')
    report = ear.listen(DiagnosticArray, '/diagnostics')
    ear.until(lambda: len(pressure) > 300, 'pressure')
    assert ear.call(SetBool, '/hpv_twin/pause', SetBool.Request(data=True)).success
    ear.spin(0.3)
    count, reports = len(pressure), len(report)
    ear.until(lambda: len(report) > reports + 1, 'diagnostics while paused')
    assert len(pressure) == count
    assert ear.call(Trigger, '/hpv_twin/reset').success
    assert ear.call(SetBool, '/hpv_twin/pause', SetBool.Request(data=False)).success
    ear.until(lambda: len(pressure) > count + 10, 'pressure after the pause')
    # From rest the pressure builds up in a straight line: about 1 MPa a millisecond.
    assert pressure[count].fluid_pressure - AMBIENT < 1.5e6
    answer = ear.call(SetBool, '/hpv_twin/record', SetBool.Request(data=False))
    assert answer.success and 'finished' in answer.message
    assert ear.call(SetBool, '/hpv_twin/record', SetBool.Request(data=True)).success
    assert len(twin.recordings) == 2
    assert twin.stop() == 0


@pytest.mark.parametrize('signals', [[signal.SIGINT], [signal.SIGINT, signal.SIGINT],
                                     [signal.SIGTERM], [signal.SIGTERM, signal.SIGINT]])
def test_signals_end_it_with_code_0_and_a_finished_file(start_twin, ear, signals):
    twin = start_twin()
    pressure = ear.listen(FluidPressure, '/hpv_twin/pressure')
    ear.until(lambda: len(pressure) > 200, 'pressure')
    for number in signals:
        twin.signal(number)
    assert twin.wait(10) == 0
    assert 'Traceback' not in twin.log
    [recording] = twin.recordings
    with open(recording, 'rb') as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
    assert summary.statistics.message_count > 400
    topics = {channel.topic for channel in summary.channels.values()}
    assert {'/hpv_twin/pressure', '/hpv_twin/preload', '/hpv_twin/frequency'} <= topics


def test_a_recording_misses_nothing(start_twin, ear):
    twin = start_twin()
    report = ear.listen(DiagnosticArray, '/diagnostics')
    ear.until(lambda: len(report) > 2, 'diagnostics')
    twin.stop()
    stamps = {}
    with open(twin.recordings[0], 'rb') as file:
        for _, channel, message in make_reader(file).iter_messages():
            stamps.setdefault(channel.topic, []).append(message.log_time)
            assert message.publish_time == message.log_time
    for topic in ('/hpv_twin/pressure', '/hpv_twin/plunger_position'):
        steps = np.diff(stamps[topic])
        dropped = int(value_of(report, 'timing', 'dropped ticks'))
        assert (steps > 1_001_000).sum() <= dropped
        assert steps.min() >= 999_000
    assert stamps['/hpv_twin/pressure'] == stamps['/hpv_twin/plunger_position']
    assert len(stamps['/hpv_twin/pump_flow']) >= 1 and len(stamps['/diagnostics']) >= 2


def test_a_recording_can_be_thinned(start_twin, ear):
    twin = start_twin('record_rate:=100')
    report = ear.listen(DiagnosticArray, '/diagnostics')
    ear.until(lambda: len(report) > 2, 'diagnostics')
    twin.stop()
    with open(twin.recordings[0], 'rb') as file:
        stamps = [message.log_time for _, channel, message in make_reader(file).iter_messages()
                  if channel.topic == '/hpv_twin/pressure']
    assert len(stamps) > 100
    assert np.median(np.diff(stamps)) == 10_000_000


def test_waveforms_are_recorded_between_the_ticks(start_twin, ear):
    twin = start_twin('record_rate:=20000')
    report = ear.listen(DiagnosticArray, '/diagnostics')
    ear.until(lambda: len(report) > 3, 'diagnostics')
    twin.stop()
    signals = read_signals(twin.recordings[0])
    fine, plain = signals['/hpv_twin/pressure_fine'], signals['/hpv_twin/pressure']
    assert len(fine.time) >= 19 * len(plain.time)
    steps = np.diff(fine.time)
    dropped = int(value_of(report, 'timing', 'dropped ticks'))
    assert (steps > 60_000).sum() <= dropped and np.median(steps) == 50_000 and steps.min() > 0
    # Where a sample falls on a tick, it is what was published.
    common, at, there = np.intersect1d(fine.time, plain.time, return_indices=True)
    assert len(common) > 0.9 * len(plain.time)
    assert fine.pressure[at] == pytest.approx(plain.pressure[there], rel=1e-9)
    positions = signals['/hpv_twin/plunger_position_fine']
    published = signals['/hpv_twin/plunger_position']
    assert (positions.time == fine.time).all() and positions.names == published.names
    assert positions.position[at] == pytest.approx(published.position[there], abs=1e-12)
    assert positions.velocity[at] == pytest.approx(published.velocity[there], abs=1e-9)


def test_parameters_set_the_start_and_integers_are_numbers(start_twin, ear):
    twin = start_twin('pump_flow:=3.65e-4', 'load:=100', 'record:=false', 'ambient_pressure:=0',
                      'publish_rate:=200', 'pump_flw:=1', ros=['-r', '__ns:=/left'])
    pressure = ear.listen(FluidPressure, '/left/hpv_twin/pressure')
    load = ear.listen(Float64, '/left/hpv_twin/load', latched=True)
    flow = ear.listen(Float64, '/left/hpv_twin/pump_flow', latched=True)
    ear.until(lambda: len(pressure) > 50 and load and flow, 'pressure at 200 Hz')
    assert load[0].data == 100.0 and flow[0].data == 3.65e-4
    steps = np.diff([stamp(message) for message in pressure])
    assert np.median(steps) == 5_000_000
    assert 'did you mean "pump_flow"' in twin.log
    assert not twin.recordings


@pytest.mark.parametrize('parameter, words', [
    ('publish_rate:=fast', ['publish_rate', "'fast'", 'a number']),
    ('pump_flow:=-1.0', ['pump_flow', '-1', '[0, 1]']),
    ('pump_flow:=0.01', ['pump_flow', '600.0 L/min (0.01 m³/s)', 'pump_flow_max']),
    ('vibrator:=absent.yaml', ['absent.yaml', 'No such file']),
    ('record:=1', ['record', 'true or false']),
    ('record_rate:=50000', ['record_rate', '50000', '20000']),
    ('record_split_size:=100', ['record_split_size', '100 bytes', '1e+06']),
])
def test_a_bad_parameter_is_one_line_and_exit_code_2(start_twin, parameter, words):
    twin = start_twin(parameter)
    assert twin.wait() == 2
    assert len(twin.log.strip().splitlines()) == 1
    for word in words:
        assert word in twin.log


def test_a_folder_that_cannot_be_written_leaves_the_twin_running(start_twin, ear):
    twin = start_twin('record_directory:=/proc/no/such/place')
    pressure = ear.listen(FluidPressure, '/hpv_twin/pressure')
    ear.until(lambda: len(pressure) > 100, 'pressure')
    assert 'not recording' in twin.log and '/proc/no' in twin.log
    assert twin.stop() == 0


def test_a_stopped_process_reports_one_drop_and_goes_on(start_twin, ear):
    twin = start_twin('record:=false')
    pressure = ear.listen(FluidPressure, '/hpv_twin/pressure')
    report = ear.listen(DiagnosticArray, '/diagnostics')
    ear.until(lambda: len(report) > 2, 'diagnostics')
    twin.signal(signal.SIGSTOP)
    ear.spin(1.5)
    count = len(pressure)
    twin.signal(signal.SIGCONT)
    ear.until(lambda: len(pressure) > count + 1000, 'pressure after the stop')
    ear.until(lambda: float(value_of(report, 'timing', 'dropped time [s]')) > 1.0, 'the report')
    stamps = np.array([stamp(message) for message in pressure])
    steps = np.diff(stamps)
    gaps = (steps - 1_000_000)[(steps > 2_000_000) & (stamps[1:] > stamp(report[0]))]
    # What was dropped while the two were still finding one another is in the first report.
    dropped = [float(value_of(reports, 'timing', 'dropped time [s]'))
               for reports in (report[:1], report)]
    assert gaps.sum() * 1e-9 == pytest.approx(dropped[1] - dropped[0], abs=1e-3)
    assert gaps.max() * 1e-9 == pytest.approx(1.5, abs=0.3)
    assert 'fell behind' in twin.log
    # Model time has not jumped: the pressure goes on where it was.
    rates = np.abs(np.diff([message.fluid_pressure for message in pressure]))
    k = int(np.argmax(steps))
    assert rates[k] <= 1.05 * rates.max()
    assert value_of(report, 'model', 'model time [s]') is not None


def test_a_speed_beyond_the_machine_is_dropped_counted_and_said(start_twin, ear):
    twin = start_twin('record:=false', 'speed:=10000.0')
    pressure = ear.listen(FluidPressure, '/hpv_twin/pressure')
    report = ear.listen(DiagnosticArray, '/diagnostics')
    ear.until(lambda: len(report) > 3 and len(pressure) > 100, 'three reports')
    timing = next(s for s in report[-1].status if s.name.endswith(': timing'))
    assert timing.level == timing.WARN
    assert float(value_of(report, 'timing', 'real-time factor')) < 0.9
    # Model time is that of the ticks that were, at most those of one report more.
    ticks = int(value_of(report, 'timing', 'ticks'))
    model_time = float(value_of(report, 'model', 'model time [s]'))
    assert model_time == pytest.approx(10.0 * ticks, abs=10.0 * 40)
    steps = np.diff([stamp(message) for message in pressure])
    assert (steps % 1_000_000 == 0).all() and (steps > 20_000_000).any()
    assert 'fell behind' in twin.log
    assert twin.stop() == 0


def test_use_sim_time_is_said_to_have_no_effect_and_clock_can_be_published(start_twin, ear):
    from rosgraph_msgs.msg import Clock
    twin = start_twin('use_sim_time:=true', 'publish_clock:=true', 'speed:=0.1', 'record:=false')
    clock = ear.listen(Clock, '/clock')
    pressure = ear.listen(FluidPressure, '/hpv_twin/pressure')
    ear.until(lambda: len(clock) > 500 and len(pressure) > 500, 'a second of clock')
    assert 'use_sim_time has no effect' in twin.log
    seconds = [message.clock.sec + 1e-9 * message.clock.nanosec for message in clock]
    assert np.median(np.diff(seconds)) == pytest.approx(1e-4, rel=1e-3)
    assert np.median(np.diff([stamp(message) for message in pressure])) == 1_000_000


def test_publishers_that_cannot_be_heard_are_counted(start_twin, ear):
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from std_msgs.msg import Float32
    twin = start_twin('record:=false')
    report = ear.listen(DiagnosticArray, '/diagnostics')
    ear.until(lambda: report, 'diagnostics')
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    ear.node.create_publisher(Float64, '/hpv_twin/load_setpoint', best_effort)
    ear.node.create_publisher(Float32, '/hpv_twin/preload_setpoint', 1)
    ear.until(lambda: value_of(report, 'inputs', 'load publishers with incompatible QoS') == '1',
              'the count')
    assert 'somebody publishes load with an incompatible QoS' in twin.log
    assert twin.stop() == 0


def test_limits_can_be_changed_while_it_runs(start_twin, ear):
    from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
    from rcl_interfaces.srv import SetParameters

    def ask(name, **value):
        request = SetParameters.Request(parameters=[Parameter(name=name, value=ParameterValue(
            **value))])
        return ear.call(SetParameters, '/hpv_twin/set_parameters', request).results[0]
    twin = start_twin('record:=false')
    in_force = ear.listen(Float64, '/hpv_twin/pump_flow', latched=True)
    report = ear.listen(DiagnosticArray, '/diagnostics')
    number, integer, text = (ParameterType.PARAMETER_DOUBLE, ParameterType.PARAMETER_INTEGER,
                             ParameterType.PARAMETER_STRING)
    assert ask('pump_flow_max', type=number, double_value=1e-3).successful
    assert ask('load_max', type=integer, integer_value=5000).successful
    for name, value in (('pump_flow_max', {'type': number, 'double_value': float('nan')}),
                        ('pump_flow_max', {'type': number, 'double_value': 2.0}),
                        ('pump_flow_max', {'type': text, 'string_value': 'much'}),
                        ('load_min', {'type': number, 'double_value': 6000.0}),
                        ('speed', {'type': number, 'double_value': 2.0})):
        answer = ask(name, **value)
        assert not answer.successful and answer.reason
    ear.say('/hpv_twin/pump_flow_setpoint', 1.5e-3)
    ear.until(lambda: value_of(report, 'inputs', 'refused') == '1', 'the refusal')
    ear.say('/hpv_twin/pump_flow_setpoint', 0.9e-3)
    ear.until(lambda: in_force and in_force[-1].data == 0.9e-3, 'the setpoint in force')
    assert 'pump_flow_max is 60.0 L/min (0.001 m³/s)' in twin.log
    assert 'failed' not in twin.log


def test_two_twins_live_in_two_namespaces(start_twin, ear):
    one = start_twin('record:=false', ros=['-r', '__ns:=/left'])
    other = start_twin('record:=false', 'pump_flow:=3.65e-4', ros=['-r', '__ns:=/right'])
    left = ear.listen(Float64, '/left/hpv_twin/frequency')
    right = ear.listen(Float64, '/right/hpv_twin/frequency')
    ear.until(lambda: len(left) > 20 and len(right) > 20, 'both frequencies')
    assert left[-1].data == pytest.approx(55.0, abs=0.5)
    assert right[-1].data == pytest.approx(expected_frequency(pump_flow=3.65e-4), rel=1e-3)
    assert one.stop() == 0 and other.stop() == 0


@pytest.mark.parametrize('delay', [0.2, 1.0, 3.0])
def test_a_signal_while_the_model_compiles_ends_it(start_twin, tmp_path, monkeypatch, delay):
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'cold'))
    twin = start_twin()
    with pytest.raises(subprocess.TimeoutExpired):
        twin.wait(delay)
    twin.signal(signal.SIGINT)
    assert twin.wait(3) == 0
    assert 'Traceback' not in twin.log and not twin.recordings
