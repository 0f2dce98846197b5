"""Recordings as they were made once are read alike by every tool; today's are of the same form."""

import subprocess
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

import recording_tools as tools
from mcap.reader import make_reader
from mcap_ros2.reader import read_ros2_messages
from recording_tools import FLOW, POSITION, PRESSURE, START, TOPICS

from hpv_twin.recording.reader import describe, read_signals

GOLDEN = Path(__file__).parent / 'golden'
BARE, SPLIT = GOLDEN / 'bare.mcap', GOLDEN / 'split'
TICKS = 40
PRESSURES = [101325.0 + i for i in range(TICKS)]
STAMPS = [START + i * tools.MILLISECOND for i in range(TICKS)]


@pytest.mark.parametrize('path', [BARE, SPLIT])
def test_this_package_reads_them(path):
    about = describe(path)
    assert about.complete and about.metadata['ambient_pressure'] == '101325.0'
    assert about.attachments == {'vibrator.yaml': b'stroke: 0.002\n'}
    signals = read_signals(path)
    assert signals[TOPICS[PRESSURE]].pressure.tolist() == PRESSURES
    assert signals[TOPICS[PRESSURE]].time.tolist() == STAMPS
    position = signals[TOPICS[POSITION]]
    assert list(position.names) == ['plunger', 'valve_sleeve']
    assert position.position[:, 0].tolist() == [1e-3 * i for i in range(TICKS)]


@pytest.mark.parametrize('path', [BARE, *sorted(SPLIT.glob('*.mcap'))])
def test_the_mcap_library_and_its_ros2_support_read_them(path):
    with path.open('rb') as file:
        summary = make_reader(file).get_summary()
    assert summary.statistics.message_count == describe(path).messages
    flow, = read_ros2_messages(str(path), topics=[TOPICS[FLOW]])
    assert flow.ros_msg.data == 7.3e-4
    pressures = {m.log_time_ns: m.ros_msg.fluid_pressure
                 for m in read_ros2_messages(str(path), topics=[TOPICS[PRESSURE]])}
    expected = dict(zip(STAMPS, PRESSURES, strict=True))
    assert pressures and pressures == {stamp: expected[stamp] for stamp in pressures}


def test_rosbags_reads_the_bare_file():
    highlevel = pytest.importorskip('rosbags.highlevel')
    with highlevel.AnyReader([BARE]) as reader:
        read = [reader.deserialize(data, connection.msgtype).fluid_pressure
                for connection, _, data in reader.messages()
                if connection.topic == TOPICS[PRESSURE]]
    assert read == PRESSURES


def test_rosbags_reads_the_folder_by_its_metadata():
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    with rosbag2.Reader(SPLIT) as reader:
        assert reader.message_count == describe(SPLIT).messages
        stamps = [stamp for connection, stamp, _ in reader.messages()
                  if connection.topic == TOPICS[PRESSURE]]
    assert stamps == STAMPS


@pytest.mark.parametrize('path', [BARE, *sorted(SPLIT.glob('*.mcap'))])
def test_rerun_finds_no_fault_in_them(path):
    cli = Path(str(pytest.importorskip('rerun_cli').__file__)).with_name('rerun')
    done = subprocess.run([cli, 'mcap', 'check', path], capture_output=True, text=True, timeout=60,
                          check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_todays_recordings_are_of_the_same_form(tmp_path):
    last = STAMPS[-1]
    path = tools.record(tmp_path, [*tools.ticks(TICKS),
                                   (tools.DIAGNOSTICS, last, tools.diagnostics(last))],
                        [(FLOW, START, tools.scalar(7.3e-4))],
                        metadata={'package_version': '0.1.0', 'ambient_pressure': '101325.0'},
                        attachments={'vibrator.yaml': b'stroke: 0.002\n'})
    assert form_of(path) == form_of(BARE)


def form_of(path):
    """What readers rely on: header, schemas, channels with QoS and hashes, messages, keys."""
    with path.open('rb') as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        channels = sorted(
            (c.topic, c.message_encoding, summary.schemas[c.schema_id].name,
             summary.schemas[c.schema_id].encoding, summary.schemas[c.schema_id].data,
             tuple(sorted(c.metadata.items()))) for c in summary.channels.values())
        messages = [(channel.topic, m.sequence, m.log_time, m.publish_time, len(m.data))
                    for _, channel, m in reader.iter_messages()]
        return (reader.get_header().profile, channels, messages,
                summary.chunk_indexes[0].compression,
                {name: sorted(record) for name, record in describe(path).records.items()})
