"""A recording in several files is found, and read as one."""

import shutil

import numpy as np
import pytest

pytest.importorskip('rclpy')

import recording_tools as tools
from recording_tools import FLOW, MILLISECOND, PRESSURE, START, TOPICS

from hpv_twin.recording.parts import find_parts, find_recordings, resolve
from hpv_twin.recording.reader import (
    RecordingError,
    attached_design,
    describe,
    messages,
    read_signals,
)

NAMES = [f'twin_20250131T12000{i}.000Z.mcap' for i in range(3)]
DESIGN = {'vibrator.yaml': b'stroke: 0.002\n'}


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """A recording in three parts of 500 ms, in a folder named after the first."""
    place = tmp_path_factory.mktemp('bags')
    folder = place / NAMES[0].removesuffix('.mcap')
    folder.mkdir()
    for i, name in enumerate(NAMES):
        path = tools.record(place / 'work', tools.ticks(500, 500 * i),
                            [(FLOW, START + 500 * i * MILLISECOND, tools.scalar(7.3e-4))],
                            metadata={'part': str(i)}, attachments=DESIGN)
        shutil.move(path, folder / name)
    return folder


def test_the_parts_are_found_in_order(folder):
    parts = [folder / name for name in NAMES]
    assert find_parts(folder) == parts
    assert find_parts(parts[1]) == [parts[1]]


def test_a_file_that_moved_into_its_folder_is_found_there(folder):
    gone = folder.parent / NAMES[0]
    assert not gone.exists()
    assert resolve(gone) == folder
    assert describe(gone).messages == 3003


def test_a_folder_of_recordings_stands_for_its_newest(folder, tmp_path):
    older = tmp_path / 'twin_20240101T000000.000Z.mcap'
    older.write_bytes(b'')
    assert resolve(tmp_path) == older
    shutil.copytree(folder, tmp_path / folder.name)
    (tmp_path / 'notes').mkdir()
    assert find_recordings(tmp_path) == [tmp_path / folder.name, older]
    assert resolve(tmp_path) == tmp_path / folder.name
    with pytest.raises(RecordingError, match='notes: there is no recording in this folder'):
        resolve(tmp_path / 'notes')


def test_the_order_is_that_of_metadata_where_names_tell_none(folder, tmp_path):
    for name, part in zip(('z.mcap', 'a.mcap', 'm.mcap'), NAMES, strict=True):
        shutil.copy(folder / part, tmp_path / name)
    (tmp_path / 'metadata.yaml').write_text(
        'rosbag2_bagfile_information:\n  relative_file_paths: [z.mcap, a.mcap, gone.mcap]\n')
    assert [path.name for path in find_parts(tmp_path)] == ['z.mcap', 'a.mcap', 'm.mcap']
    (tmp_path / 'metadata.yaml').write_text('nonsense: [')
    assert [path.name for path in find_parts(tmp_path)] == ['a.mcap', 'm.mcap', 'z.mcap']


def test_the_parts_are_described_as_one(folder):
    about = describe(folder)
    assert about.path == folder and about.complete
    assert about.parts == tuple(folder / name for name in NAMES)
    assert about.size == sum(path.stat().st_size for path in about.parts)
    assert about.topics[TOPICS[PRESSURE]].count == 1500 and about.messages == 3003
    assert (about.start, about.end) == (START, START + 1499 * MILLISECOND)
    assert about.metadata['recording.messages'] == '3003'
    assert about.metadata['recording.opened'] == describe(about.parts[0]).metadata[
        'recording.opened']
    assert attached_design(folder) == 'stroke: 0.002\n'


def test_the_parts_are_read_as_one(folder):
    told = []
    signal = read_signals(folder, [TOPICS[PRESSURE]],
                          progress=lambda *done: told.append(done))[TOPICS[PRESSURE]]
    np.testing.assert_array_equal(signal.time, START + np.arange(1500) * MILLISECOND)
    np.testing.assert_array_equal(signal.pressure, 101325.0 + np.arange(1500))
    assert told == sorted(told) and told[-1][0] <= told[-1][1] == describe(folder).size
    assert sum(1 for _ in messages(folder)) == 3003


def test_a_span_is_read_from_the_parts_that_hold_it(folder):
    first, last = START + 900 * MILLISECOND, START + 1100 * MILLISECOND
    signal = read_signals(folder, [TOPICS[PRESSURE]], first, last)[TOPICS[PRESSURE]]
    np.testing.assert_array_equal(signal.time, np.arange(first, last, MILLISECOND))


def test_damaged_parts_are_told_and_the_others_read(folder, tmp_path):
    copy = tmp_path / folder.name
    shutil.copytree(folder, copy)
    content = (copy / NAMES[1]).read_bytes()
    (copy / NAMES[1]).write_bytes(content[:-100])
    (copy / NAMES[2]).write_bytes(b'')
    about = describe(copy)
    assert not about.complete
    assert f'{NAMES[1]}: it was not finished' in about.problem
    assert f'{copy / NAMES[2]}: is empty' in about.problem
    assert len(read_signals(copy)[TOPICS[PRESSURE]].time) == 1000
    assert about.messages == sum(1 for _ in messages(copy)) == 2002


def test_nothing_readable_is_told(tmp_path):
    folder = tmp_path / 'twin_20250131T120000.000Z'
    folder.mkdir()
    (folder / NAMES[0]).write_bytes(b'')
    for read in (describe, read_signals, lambda path: list(messages(path))):
        with pytest.raises(RecordingError, match='is empty'):
            read(folder)


def test_a_recording_without_a_design_is_told(tmp_path):
    path = tools.record(tmp_path, tools.ticks(1), attachments={'a.bin': b''})
    with pytest.raises(RecordingError, match=f'{path}: no design is attached.*are: a.bin'):
        attached_design(path)
