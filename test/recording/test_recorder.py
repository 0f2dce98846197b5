"""What is recorded is in the file, in order, and other tools read it."""

import shutil
import threading
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

import mcap.reader
import recording_tools as tools
from recording_tools import FLOW, MILLISECOND, POSITION, PRESSURE, START, TOPICS, Log, recorder

from hpv_twin.recording import session
from hpv_twin.recording.reader import describe, messages


def test_a_file_holds_what_was_written_and_explains_itself(tmp_path):
    opening = [(FLOW, START, tools.scalar(7.3e-4))]
    written = list(tools.ticks(1500))
    path = tools.record(tmp_path / 'new' / 'bags', written, opening,
                        metadata={'ambient_pressure': '101325.0'},
                        attachments={'vibrator.yaml': b'stroke: 0.002\n', 'empty.bin': b''})
    assert path.is_absolute() and path.parent == tmp_path / 'new' / 'bags'
    found = list(messages(path))
    assert [(TOPICS.index(m.topic), m.log_time, m.payload) for m in found] == opening + written
    assert all(m.publish_time == m.log_time for m in found)
    assert [m.sequence for m in found if m.topic == TOPICS[PRESSURE]] == list(range(1, 1501))
    about = describe(path)
    assert about.complete and about.problem == ''
    assert about.library.startswith('hpv_twin')
    assert about.metadata['ambient_pressure'] == '101325.0'
    assert about.metadata['recording.messages'] == '3001'
    assert about.metadata['recording.dropped'] == '0'
    assert about.metadata['recording.closed_because'] == 'stopped'
    assert about.attachments == {'vibrator.yaml': b'stroke: 0.002\n', 'empty.bin': b''}
    assert about.topics[TOPICS[POSITION]] == ('sensor_msgs/msg/JointState', 1500)
    assert (about.start, about.end) == (START, START + 1499 * MILLISECOND)


def test_the_form_is_that_of_rosbag2(tmp_path):
    path = tools.record(tmp_path, tools.ticks(3))
    with path.open('rb') as file:
        reader = mcap.reader.make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == 'ros2'
        summary = reader.get_summary()
    assert {c.compression for c in summary.chunk_indexes} == {'zstd'}
    assert {s.encoding for s in summary.schemas.values()} == {'ros2msg'}
    assert {s.name: s.data.decode() for s in summary.schemas.values()} == {
        c.type_name: c.schema for c in tools.channels()}
    assert [(c.topic, c.message_encoding, c.metadata) for c in summary.channels.values()] == [
        (c.topic, 'cdr', {'offered_qos_profiles': c.qos, 'topic_type_hash': c.type_hash})
        for c in tools.channels()]


def test_mcap_ros2_support_decodes_every_message(tmp_path):
    from mcap_ros2.reader import read_ros2_messages
    path = tools.record(tmp_path, tools.ticks(300), [(FLOW, START, tools.scalar(7.3e-4))])
    decoded = [m.ros_msg for m in read_ros2_messages(str(path), topics=[TOPICS[PRESSURE]])]
    assert [m.fluid_pressure for m in decoded] == [101325.0 + i for i in range(300)]
    flow = next(read_ros2_messages(str(path), topics=[TOPICS[FLOW]]))
    assert flow.ros_msg.data == 7.3e-4 and flow.log_time_ns == START


def test_rosbags_reads_a_bare_file(tmp_path):
    highlevel = pytest.importorskip('rosbags.highlevel')
    path = tools.record(tmp_path, [*tools.ticks(300),
                                   (3, START + 10**9, tools.diagnostics(START + 10**9))])
    with highlevel.AnyReader([path]) as reader:
        assert reader.message_count == 601
        qos = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
        assert (qos[TOPICS[FLOW]].durability.name, qos[TOPICS[FLOW]].depth) == (
            'TRANSIENT_LOCAL', 1)
        names = [reader.deserialize(data, c.msgtype).name for c, _, data in reader.messages()
                 if c.topic == TOPICS[POSITION]]
        assert names == [['plunger', 'valve_sleeve']] * 300


def test_rerun_finds_no_fault(tmp_path):
    cli = Path(str(pytest.importorskip('rerun_cli').__file__)).with_name('rerun')
    import subprocess
    path = tools.record(tmp_path, tools.ticks(300), attachments={'a.yaml': b'a: 1'})
    done = subprocess.run([cli, 'mcap', 'check', path], capture_output=True, text=True,
                          timeout=60, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert 'ERROR' not in done.stderr


def test_messages_dropped_by_a_full_queue_are_counted(tmp_path):
    recording = recorder(tmp_path, queue_length=5)
    assert recording.start()
    accepted = sum(recording.write(*message) for message in list(tools.ticks(3000)))
    path = recording.stop()
    dropped = recording.status.dropped
    assert dropped > 0 and accepted + dropped == 6000
    about = describe(path)
    assert about.messages == accepted
    assert about.metadata['recording.dropped'] == str(dropped)
    assert dropped == sum(int(about.metadata.get('recording.dropped' + topic, 0))
                          for topic in TOPICS)


def test_a_clock_that_goes_back_starts_a_new_file_with_the_latched_messages(tmp_path):
    log = Log()
    recording = recorder(tmp_path, log=log)
    flow, later_flow = tools.scalar(7.3e-4), tools.scalar(3e-4)
    first = recording.start([(FLOW, START, flow)])
    written = list(tools.ticks(400))
    for message in written[:200]:
        recording.write(*message)
    recording.write(FLOW, START + 300 * MILLISECOND, later_flow)
    for channel, stamp, payload in written[200:]:
        recording.write(channel, stamp - 10**10, payload)
    second = recording.stop()
    assert first != second
    assert describe(first).metadata['recording.closed_because'] == 'the clock went back'
    about = describe(second).metadata
    assert (about['recording.part'], about['recording.continues']) == ('2', first.name)
    head, *tail = messages(second)
    assert (head.topic, head.log_time, head.payload) == (
        TOPICS[FLOW], tail[0].log_time, later_flow)
    assert [(m.log_time + 10**10, m.payload) for m in tail] == [m[1:] for m in written[200:]]
    assert log.of('error') == log.of('warning') == []


def test_topics_may_lag_behind_one_another(tmp_path):
    """A setpoint is stamped by another thread: a few milliseconds out of order are no jump."""
    flow = (FLOW, START + 30 * MILLISECOND, tools.scalar(1e-4))
    path = tools.record(tmp_path, [*list(tools.ticks(60))[:100], flow, *tools.ticks(50, 50)])
    assert describe(path).messages == 201
    assert list(tmp_path.iterdir()) == [path]


def test_what_cannot_be_written_is_refused_and_told_once(tmp_path):
    log = Log()
    good = list(tools.ticks(2))
    bad = [(99, START, b'x'), (0, -1, b'x'), (0, START, bytearray(b'x')), (0, START, None),
           (0, 1 << 70, b'x'), ('a', START, b'x'), (0, 1.5, b'x')]
    path = tools.record(tmp_path, [*good[:2], *bad, *good[2:]], log=log)
    assert [m.payload for m in messages(path)] == [payload for *_, payload in good]
    assert describe(path).metadata['recording.rejected'] == str(len(bad))
    assert log.of('warning') == ['not recorded: channel 99, stamp 1700000000123456789, '
                                 'a payload of type bytes']


def test_nothing_is_recorded_before_start_and_after_stop(tmp_path):
    message = next(tools.ticks(1))
    recording = recorder(tmp_path)
    assert recording.write(*message) is False
    assert recording.stop() is None
    first = recording.start()
    assert recording.status.recording and recording.status.file == first
    assert recording.write(*message) is True
    assert recording.stop() == first
    assert recording.write(*message) is False
    assert not recording.status.recording and recording.status.messages == 1
    second = recording.start()
    third = recording.start()  # finishes the second
    assert len({first, second, third}) == 3
    recording.close()
    recording.close()
    assert recording.start() is None
    assert all(describe(path).complete for path in (first, second, third))


def test_no_thread_is_left(tmp_path):
    before = threading.enumerate()
    tools.record(tmp_path, tools.ticks(10))
    assert threading.enumerate() == before


def test_a_recording_without_messages_is_whole(tmp_path):
    recording = recorder(tmp_path, metadata={'a': 'b'})
    path = recording.start()
    assert recording.stop() == path
    about = describe(path)
    assert about.complete and about.messages == 0 and about.start is None
    assert about.metadata['a'] == 'b' and set(about.topics) == set(TOPICS)


def test_an_unwritable_place_leaves_the_twin_unrecorded(tmp_path):
    obstacle = tmp_path / 'file'
    obstacle.write_text('not a directory')
    log = Log()
    recording = recorder(obstacle / 'bags', log=log)
    assert recording.start() is None
    assert recording.write(*next(tools.ticks(1))) is False
    assert recording.stop() is None
    assert str(obstacle) in recording.status.error
    assert len(log.of('error')) == 1 and str(obstacle) in log.of('error')[0]
    obstacle.unlink()
    assert recording.start() is not None
    assert recording.status.error == ''
    recording.close()


def test_recording_does_not_begin_on_a_disk_that_is_nearly_full(tmp_path):
    log = Log()
    recording = recorder(tmp_path, reserve=1e18, log=log)
    assert recording.start() is None
    assert 'of the disk are free' in recording.status.error
    assert list(tmp_path.iterdir()) == []


def test_recording_stops_cleanly_when_the_disk_becomes_nearly_full(tmp_path, monkeypatch):
    monkeypatch.setattr(session, 'SPACE_INTERVAL', 0.01)
    log = Log()
    recording = recorder(tmp_path, reserve=1_000_000, log=log)
    path = recording.start()
    for message in tools.ticks(20):
        recording.write(*message)
    tools.wait_until(lambda: recording.status.messages == 40)
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(session.shutil, 'disk_usage', lambda _: usage._replace(free=500_000))
    tools.wait_until(lambda: describe(path).complete)
    tools.wait_until(lambda: not recording.status.recording)
    assert describe(path).messages == 40
    reason = 'only 500.0 kB of the disk are free, 1.0 MB are left to others'
    assert recording.status.error.startswith(f'{reason}; next try within ')
    assert describe(path).metadata['recording.closed_because'] == reason
    assert log.of('error') == [f'recording waits: {reason}']
    monkeypatch.setattr(session.shutil, 'disk_usage', lambda _: usage)
    tools.wait_until(lambda: recording.status.recording)
    assert recording.status.file != path
    recording.write(*next(tools.ticks(1, 20)))
    last = recording.stop()
    assert describe(last).messages == 1
    assert describe(last).metadata['recording.resumed_after'].startswith('only 500.0 kB')
    assert describe(last).metadata['recording.continues'] == path.name


def test_a_log_that_raises_ends_no_recording(tmp_path, capsys):
    def log(level, text):
        raise ValueError('a log of its own mind')

    path = tools.record(tmp_path, tools.ticks(10), log=log)
    assert describe(path).complete and describe(path).messages == 20
    assert 'a log of its own mind' in capsys.readouterr().err


def test_settings_out_of_bounds_are_refused(tmp_path):
    with pytest.raises(ValueError, match='max_total_size 10 is below 2000000 bytes'):
        recorder(tmp_path, max_total_size=10)
    with pytest.raises(ValueError, match="name 'a/b'"):
        recorder(tmp_path, name='a/b')
