"""Parts by time and size, metadata.yaml as `ros2 bag` has it, retention; nobody else's files."""

import os
import time

import pytest
import yaml

pytest.importorskip('rclpy')

import recording_tools as tools

from hpv_twin.recording import recorder as recorder_module
from hpv_twin.recording import session
from hpv_twin.recording.files import own_files
from hpv_twin.recording.reader import describe, read_signals
from hpv_twin.recording.recover import main as recover_main
from hpv_twin.recording.segment import GAPS_RECORD


@pytest.fixture
def split(tmp_path, monkeypatch):
    """A recording that went on in further files by time; its folder."""
    monkeypatch.setattr(recorder_module, 'MIN_SPLIT_TIME', 0.0)
    log = tools.Log()
    recording = tools.recorder(tmp_path / 'bags', split_time=0.15, log=log)
    first = recording.start([(tools.FLOW, tools.START, tools.scalar(7.3e-4))])
    for message in tools.ticks(600):
        recording.write(*message)
        time.sleep(5e-4)
    folder = recording.stop()
    assert folder == first.with_suffix('')
    return folder


def test_a_recording_is_split_by_time(split):
    parts = own_files(split.parent, 'hpv_twin')
    assert len(parts) >= 3 and {part.parent for part in parts} == {split}
    about = [describe(part) for part in parts]
    assert all(part.complete for part in about)
    assert [part.metadata['recording.part'] for part in about] == [
        str(i + 1) for i in range(len(parts))]
    assert [part.metadata['recording.continues'] for part in about[1:]] == [
        part.name for part in parts[:-1]]
    assert about[0].metadata['recording.closed_because'] == 'its time was over'
    assert all(part.topics[tools.TOPICS[tools.FLOW]].count == 1 for part in about)
    pressure = read_signals(split)[tools.TOPICS[tools.PRESSURE]]
    assert len(pressure.time) == 600


def test_metadata_is_what_ros2_bag_writes(split):
    bag = yaml.safe_load((split / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    parts = own_files(split.parent, 'hpv_twin')
    assert bag['version'] == 9 and bag['storage_identifier'] == 'mcap'
    assert bag['relative_file_paths'] == [part.name for part in parts]
    whole = describe(split)
    assert bag['message_count'] == whole.messages == sum(
        topic['message_count'] for topic in bag['topics_with_message_count'])
    assert bag['starting_time']['nanoseconds_since_epoch'] == tools.START
    topics = {topic['topic_metadata']['name']: topic['topic_metadata']
              for topic in bag['topics_with_message_count']}
    pressure = topics[tools.TOPICS[tools.PRESSURE]]
    assert pressure['type'] == 'sensor_msgs/msg/FluidPressure'
    assert pressure['serialization_format'] == 'cdr'
    assert pressure['type_description_hash'].startswith('RIHS01_')
    assert topics[tools.TOPICS[tools.FLOW]]['offered_qos_profiles'][0]['durability'] == (
        'transient_local')


def test_rosbags_reads_the_folder_as_a_bag(split):
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    with rosbag2.Reader(split) as reader:
        assert reader.message_count == describe(split).messages
        assert sum(1 for _ in reader.messages()) == reader.message_count


def test_recover_takes_a_folder(split, capsys):
    parts = own_files(split.parent, 'hpv_twin')
    damaged = parts[1].read_bytes()
    parts[1].write_bytes(damaged[:len(damaged) // 2])
    assert recover_main([str(split)]) == 3
    said = capsys.readouterr().out
    assert parts[1].name in said
    copy = split.with_name(f'{split.name}_recovered')
    assert [path.name for path in sorted(copy.glob('*.mcap'))] == [part.name for part in parts]
    assert all(describe(path).complete for path in copy.glob('*.mcap'))
    assert (copy / 'metadata.yaml').is_file()
    assert recover_main([str(split)]) == 1
    assert 'not overwritten' in capsys.readouterr().err


def test_recordings_too_old_are_removed_and_nothing_else(tmp_path, split, monkeypatch):
    monkeypatch.setattr(session, 'AGE_INTERVAL', 0.01)
    bags = split.parent
    others = [bags / 'other_20200101T000000.000Z.mcap', bags / 'notes.txt',
              bags / 'hpv_twin_20200101T000000.000Z_recovered.mcap',
              bags / 'hpv_twin_2020.mcap']
    kept_folder = bags / 'hpv_twin_20200101T000000.000Z'
    kept_folder.mkdir()
    others.append(kept_folder / 'mine.txt')
    own = kept_folder / 'hpv_twin_20200101T000000.000Z.mcap'
    for path in [*others, own, *split.iterdir()]:
        path.touch()
        os.utime(path, (1, 1))
    recording = tools.recorder(bags, max_age=3600.0)
    path = recording.start()
    tools.wait_until(lambda: not own.exists())
    recording.stop()
    assert all(other.exists() for other in others)
    assert not split.exists(), 'an empty folder of its own goes too'
    assert path.exists() and own_files(bags, 'hpv_twin') == [path]


def test_a_metadata_file_of_others_is_left_alone(tmp_path, monkeypatch):
    from hpv_twin.recording import bag
    (tmp_path / 'metadata.yaml').write_text('rosbag2_bagfile_information: {version: 9}\n')
    tools.record(tmp_path, tools.ticks(10))
    bag.write_metadata(tmp_path)
    assert (tmp_path / 'metadata.yaml').read_text() == (
        'rosbag2_bagfile_information: {version: 9}\n')


def test_gaps_and_drops_stand_in_the_file(tmp_path):
    recording = tools.recorder(tmp_path, queue_length=50)
    recording.start()
    recording.note_gap(tools.START + 7, 'fell behind: 5 ticks dropped')
    for message in tools.ticks(2000):
        recording.write(*message)
    about = describe(recording.stop())
    assert about.records[GAPS_RECORD] == {str(tools.START + 7): 'fell behind: 5 ticks dropped'}
    dropped = int(about.metadata['recording.dropped'])
    assert dropped == recording.status.dropped > 0
    assert about.messages + dropped == 4000
    assert dropped == sum(int(value) for key, value in about.metadata.items()
                          if key.startswith('recording.dropped/'))
