"""Signals come back as numbers, whoever wrote the file and however the messages are laid out."""

import os
import struct
from datetime import UTC, datetime

import numpy as np
import pytest

pytest.importorskip('rclpy')

import recording_tools as tools
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from recording_tools import FLOW, MILLISECOND, POSITION, PRESSURE, START, TOPICS
from sensor_msgs.msg import JointState

from hpv_twin.recording.reader import (
    RecordingError,
    describe,
    find_recordings,
    messages,
    read_signals,
)


def foreign(path, written, topic='/joint_states', type_name='sensor_msgs/msg/JointState',
            **options):
    """A file by another writer: (log time, payload) of one topic, without QoS or hash."""
    with path.open('wb') as file:
        writer = Writer(file, **options)
        writer.start('ros2')
        schema = writer.register_schema(type_name, 'ros2msg', b'')
        channel = writer.register_channel(topic, 'cdr', schema)
        for log_time, payload in written:
            writer.add_message(channel, log_time, payload, log_time)
        writer.finish()
    return path


def test_signals_are_arrays(tmp_path):
    flow = (FLOW, START, tools.scalar(7.3e-4))
    path = tools.record(tmp_path, [flow, *tools.ticks(2000)])
    signals = read_signals(path)
    assert set(signals) == set(TOPICS[:3])
    i = np.arange(2000)
    pressure, position, flow = (signals[topic] for topic in TOPICS[:3])
    np.testing.assert_array_equal(pressure.time, START + i * MILLISECOND)
    np.testing.assert_array_equal(pressure.pressure, 101325.0 + i)
    np.testing.assert_array_equal(pressure.variance, np.zeros(2000))
    assert position.names == ('plunger', 'valve_sleeve')
    np.testing.assert_array_equal(position.position, 1e-3 * i[:, None] + [0, 1])
    np.testing.assert_array_equal(position.velocity, 10 * (1e-3 * i[:, None]) + [0, 1])
    np.testing.assert_array_equal(position.effort, 100 * (1e-3 * i[:, None]) + [0, 1])
    assert (flow.time.tolist(), flow.value.tolist()) == ([START], [7.3e-4])
    assert pressure.malformed == position.malformed == flow.malformed == 0


def test_a_span_and_a_choice_of_topics(tmp_path):
    path = tools.record(tmp_path, tools.ticks(2000))
    told = []
    signals = read_signals(path, [TOPICS[PRESSURE]], START + 500 * MILLISECOND,
                           START + 510 * MILLISECOND, lambda *done: told.append(done))
    assert list(signals) == [TOPICS[PRESSURE]]
    assert signals[TOPICS[PRESSURE]].pressure.tolist() == [101825.0 + i for i in range(10)]
    assert told and told[-1][0] <= told[-1][1] == path.stat().st_size
    assert len(list(messages(path, end=START + 3 * MILLISECOND))) == 6


@pytest.mark.parametrize('topic, said', [
    ('/nothing', 'there is no topic /nothing; the topics are: /diagnostics, /hpv_twin/plunger'),
    ('/diagnostics', '/diagnostics is of type diagnostic_msgs/msg/DiagnosticArray; readable')])
def test_a_topic_that_cannot_be_read_is_refused(tmp_path, topic, said):
    path = tools.record(tmp_path, tools.ticks(1))
    with pytest.raises(RecordingError, match=f'{path}: {said}'):
        read_signals(path, [topic])


def test_headers_may_differ_from_message_to_message(tmp_path):
    frames = ['', 'a', 'cavity', 'cavity_a', 'ein sehr langer Name', 'è'] * 20
    path = foreign(tmp_path / 'a.mcap', [
        (START + i, tools.pressure(START + i, float(i), frame)) for i, frame in enumerate(frames)],
        '/p', 'sensor_msgs/msg/FluidPressure')
    signal = read_signals(path)['/p']
    assert signal.pressure.tolist() == list(range(120))
    assert signal.time.tolist() == [START + i for i in range(120)]


def test_messages_of_a_big_endian_machine(tmp_path):
    path = foreign(tmp_path / 'a.mcap', [
        (START + i, (tools.big_endian_pressure if i % 2 else tools.pressure)(START + i, 1e5 + i))
        for i in range(10)], '/p', 'sensor_msgs/msg/FluidPressure')
    signal = read_signals(path)['/p']
    assert signal.pressure.tolist() == [1e5 + i for i in range(10)]
    assert signal.time.tolist() == [START + i for i in range(10)]


def test_without_a_stamp_the_time_of_recording_counts(tmp_path):
    path = foreign(tmp_path / 'a.mcap', [(START, tools.pressure(0, 1.0))], '/p',
                   'sensor_msgs/msg/FluidPressure')
    assert read_signals(path)['/p'].time.tolist() == [START]


def test_signals_are_in_ascending_time(tmp_path):
    late = [3, 1, 2, 5, 4]
    path = foreign(tmp_path / 'a.mcap', [
        (START + i, tools.pressure(START + when, float(when))) for i, when in enumerate(late)],
        '/p', 'sensor_msgs/msg/FluidPressure')
    assert read_signals(path)['/p'].pressure.tolist() == [1, 2, 3, 4, 5]


def test_joints_of_several_publishers_share_a_topic(tmp_path):
    path = foreign(tmp_path / 'a.mcap', [
        (START, tools.position(START, 1.0, ['arm'])),
        (START + 1, tools.position(START + 1, 2.0, ['leg', 'arm'])),
        (START + 2, tools.serialize_message(tools.stamped(
            JointState(name=['leg'], velocity=[7.0]), START + 2)))])
    signal = read_signals(path)['/joint_states']
    nan = np.nan
    assert signal.names == ('arm', 'leg')
    np.testing.assert_array_equal(signal.position, [[1, nan], [3, 2], [nan, nan]])
    np.testing.assert_array_equal(signal.velocity, [[10, nan], [21, 20], [nan, 7]])


def test_malformed_messages_are_left_out_and_counted(tmp_path):
    good = tools.position(START, 1.0)
    bad = [b'', b'\0', good[:3], good[:20], good[:-8], b'\0\7' + good[2:], os.urandom(100),
           good[:12] + b'\xff' * 4 + good[16:]]
    path = foreign(tmp_path / 'a.mcap', [(START + i, payload) for i, payload in enumerate(
        [good, *bad, good])])
    signal = read_signals(path)['/joint_states']
    assert signal.malformed == len(bad)
    assert signal.position.tolist() == [[1.0, 2.0]] * 2


@given(st.lists(st.tuples(
    st.text(max_size=9).filter(lambda text: '\0' not in text),
    st.lists(st.sampled_from('abcdefgh'), unique=True, max_size=4),
    st.tuples(st.booleans(), st.booleans(), st.booleans()),
    st.integers(1, 2**31 * 10**9 - 1)), max_size=12))
@settings(deadline=None, max_examples=60)
def test_decoding_agrees_with_the_ros_serializer(tmp_path_factory, drawn):
    written, expected = [], {}
    for i, (frame, names, given_fields, stamp) in enumerate(sorted(drawn, key=lambda d: d[3])):
        values = [[100.0 * i + 10 * field + j for j in range(len(names))] if there else []
                  for field, there in enumerate(given_fields)]
        written.append((stamp, tools.serialize_message(tools.stamped(JointState(
            name=names, position=values[0], velocity=values[1], effort=values[2]), stamp,
            frame))))
        expected[i] = {(field, name): value for field, row in enumerate(values)
                       for name, value in zip(names, row, strict=False)}
    path = foreign(tmp_path_factory.mktemp('given') / 'a.mcap', written)
    signal = read_signals(path)['/joint_states']
    assert signal.time.tolist() == [stamp for stamp, _ in written]
    assert signal.malformed == 0
    for i, row in expected.items():
        found = {(field, name): signal[2 + field][i, column] for field in range(3)
                 for column, name in enumerate(signal.names)}
        assert {key: value for key, value in found.items() if not np.isnan(value)} == row


@pytest.mark.parametrize('options', [
    {'use_chunking': False}, {'compression': CompressionType.LZ4},
    {'compression': CompressionType.NONE, 'enable_crcs': False}, {'use_statistics': False},
    {'repeat_channels': False, 'repeat_schemas': False}, {'use_summary_offsets': False}])
def test_files_of_other_writers(tmp_path, options):
    written = [(START + i, tools.position(START + i, float(i))) for i in range(500)]
    path = foreign(tmp_path / 'a.mcap', written, **options)
    about = describe(path)
    assert about.complete, about.problem
    assert about.topics == {'/joint_states': ('sensor_msgs/msg/JointState', 500)}
    assert (about.start, about.end) == (START, START + 499)
    assert [(m.log_time, m.payload) for m in messages(path)] == written
    assert read_signals(path)['/joint_states'].position[:, 0].tolist() == list(range(500))


@pytest.mark.parametrize('content, said', [
    (b'', 'is empty: nothing was recorded'), (b'ROSBAG V2.0', 'is not an MCAP file'),
    (b'\x89MCAP', 'is not an MCAP file')])
def test_what_is_no_recording_is_told_in_one_line(tmp_path, content, said):
    path = tmp_path / 'a.mcap'
    path.write_bytes(content)
    for use in (describe, read_signals, lambda path: list(messages(path))):
        with pytest.raises(RecordingError, match=f'^{path}: {said}$'):
            use(path)


def test_a_missing_file_and_a_folder_are_told_in_one_line(tmp_path):
    with pytest.raises(RecordingError, match=r'a\.mcap: No such file or directory'):
        describe(tmp_path / 'a.mcap')
    with pytest.raises(RecordingError, match='there is no recording in this folder'):
        describe(tmp_path)


def test_a_file_is_read_while_it_is_written(tmp_path):
    recording = tools.recorder(tmp_path, flush_interval=0.01, metadata={'a': 'b'})
    path = recording.start()
    for message in tools.ticks(100):
        recording.write(*message)
    tools.wait_until(lambda: describe(path).messages == 200)
    about = describe(path)
    assert not about.complete and about.problem == 'it was not finished: its index is missing'
    assert about.metadata['a'] == 'b'
    assert read_signals(path)[TOPICS[POSITION]].time.size == 100
    recording.close()


def test_the_newest_recording_comes_first(tmp_path):
    assert find_recordings(tmp_path / 'nowhere') == []
    names = ['twin_20250131T120000.000Z.mcap', 'a_20250131T120001.000Z.mcap',
             'twin_20240131T120000.000Z_recovered.mcap', 'other.mcap', 'notes.txt']
    for name in names:
        (tmp_path / name).touch()
    when = datetime(2024, 6, 1, tzinfo=UTC).timestamp()
    os.utime(tmp_path / 'other.mcap', (when, when))
    assert [path.name for path in find_recordings(tmp_path)] == [
        names[1], names[0], names[3], names[2]]


def test_a_float_is_eight_bytes_after_four(tmp_path):
    """The layout, written out by hand."""
    path = foreign(tmp_path / 'a.mcap', [(START, b'\0\1\0\0' + struct.pack('<d', 2.5))], '/f',
                   'std_msgs/msg/Float64')
    assert read_signals(path)['/f'].value.tolist() == [2.5]
