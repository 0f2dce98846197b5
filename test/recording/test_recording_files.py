"""Names, splitting and retention: nobody else's file is touched, the total is kept."""

import contextlib
import os
import time
from datetime import UTC, datetime

import pytest
import yaml

from hpv_twin.recording import files

NOON = datetime(2025, 1, 31, 12, 0, 0, 5000, UTC)


def old(directory, name, size=100):
    path = directory / name
    path.write_bytes(b'x' * size)
    return path


def total_size(directory):
    total = 0
    for path in directory.rglob('*'):
        with contextlib.suppress(FileNotFoundError):  # removed by the recorder meanwhile
            total += path.stat().st_size
    return total


def test_names_sort_by_time_and_nothing_is_overwritten(tmp_path):
    made = [files.create(tmp_path, 'hpv_twin', NOON) for _ in range(3)]
    names = [file.path.name for file in made]
    for file in made:
        file.close()
    assert names == ['hpv_twin_20250131T120000.005Z.mcap', 'hpv_twin_20250131T120000.006Z.mcap',
                     'hpv_twin_20250131T120000.007Z.mcap']
    assert files.own_files(tmp_path, 'hpv_twin') == [file.path for file in made]


def test_the_oldest_of_ones_own_files_go_first_and_no_other(tmp_path):
    own = [old(tmp_path, f'twin_2025013{day}T120000.000Z.mcap') for day in (0, 1)]
    others = [old(tmp_path, name) for name in (
        'twin.mcap', 'twin_20250101T120000.000Z_recovered.mcap', 'twin_20250101T120000Z.mcap',
        'twin_b_20250101T120000.000Z.mcap', 'my_twin_20250101T120000.000Z.mcap',
        'twin_20250101T120000.000Z.mcap.bak', 'twin_2025-01-01T120000.000Z.mcap')]
    folder = tmp_path / 'twin_20250101T120000.000Z.mcap'
    folder.mkdir()
    link = tmp_path / 'twin_20250102T120000.000Z.mcap'
    link.symlink_to(others[0])
    assert list(files.make_room(tmp_path, 'twin', 150)) == own[:1]
    assert list(files.make_room(tmp_path, 'twin', 0)) == own[1:]
    assert all(path.exists() for path in [*others, folder, link])


def test_a_dot_in_a_name_is_a_dot(tmp_path):
    other = old(tmp_path, 'a-b_20250101T120000.000Z.mcap')
    assert list(files.make_room(tmp_path, 'a.b', 0)) == []
    assert other.exists()


def test_a_file_that_another_recorder_writes_is_left_alone(tmp_path):
    busy = files.create(tmp_path, 'twin', NOON)
    busy.write(b'x' * 100)
    done = old(tmp_path, 'twin_20260101T120000.000Z.mcap')
    assert list(files.make_room(tmp_path, 'twin', 50)) == [done]
    busy.close()
    assert list(files.make_room(tmp_path, 'twin', 50)) == [busy.path]


def test_a_file_that_cannot_be_removed_is_passed_over(tmp_path, monkeypatch):
    first, second = (old(tmp_path, f'twin_2025013{day}T120000.000Z.mcap') for day in (0, 1))
    unlink = type(first).unlink

    def refuse_first(path):
        if path == first:
            raise PermissionError(13, 'Permission denied', str(path))
        unlink(path)

    monkeypatch.setattr(type(first), 'unlink', refuse_first)
    error, removed = files.make_room(tmp_path, 'twin', 100)
    assert isinstance(error, PermissionError) and removed == second


def test_a_recording_is_split_and_the_total_is_kept(tmp_path):
    pytest.importorskip('rclpy')
    import recording_tools as tools

    from hpv_twin.recording.reader import describe, messages
    other = old(tmp_path, 'other_20200101T000000.000Z.mcap', 1000)
    log = tools.Log()
    recording = tools.recorder(tmp_path, max_total_size=4e6, queue_length=20, log=log)
    recording.start([(tools.FLOW, tools.START, tools.scalar(7.3e-4))])
    most = 0
    for i in range(800):
        while not recording.write(tools.PRESSURE, tools.START + i, os.urandom(10_000)):
            time.sleep(1e-3)
        if i % 20 == 0:
            most = max(most, total_size(tmp_path))
    recording.stop()
    assert 2e6 < most < 4e6
    folder, = (path for path in tmp_path.iterdir() if path.is_dir())
    bag = yaml.safe_load((folder / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    left = files.own_files(tmp_path, 'hpv_twin')
    about = [describe(path) for path in left]
    assert all(recording.complete for recording in about)
    assert bag['relative_file_paths'] == [path.name for path in left]
    assert bag['message_count'] == sum(recording.messages for recording in about)
    parts = [int(recording.metadata['recording.part']) for recording in about]
    assert parts == list(range(parts[0], parts[0] + len(parts))) and parts[0] > 1
    stamps = [m.log_time for path in left for m in messages(path, [tools.TOPICS[tools.PRESSURE]])]
    assert stamps == list(range(stamps[0], tools.START + 800))
    for recording in about:
        assert recording.topics[tools.TOPICS[tools.FLOW]].count == 1
    assert other.exists()
    assert any('removed' in text for text in log.of('info'))


def test_sizes_are_told_as_a_person_reads_them():
    assert [files.readable_size(size) for size in (999, 5.24e6, 1e9, 3e13)] == [
        '999 B', '5.2 MB', '1.0 GB', '30.0 TB']
