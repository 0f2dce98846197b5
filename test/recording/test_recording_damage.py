"""A damaged file yields what is whole in it, never garbage and never an exception."""

import os
from unittest import mock

import pytest

pytest.importorskip('rclpy')

import recording_tools as tools
from mcap.writer import CompressionType

from hpv_twin.recording import segment
from hpv_twin.recording.reader import describe, messages, read_signals
from hpv_twin.recording.recover import main, recover
from hpv_twin.recording.summary import read_summary


@pytest.fixture(scope='module')
def small(tmp_path_factory):
    """A recording in chunks of 2 kB: its bytes, its messages and its index."""
    with mock.patch.object(segment, 'CHUNK_SIZE', 2000):
        return whole(tmp_path_factory.mktemp('small'))


@pytest.fixture(scope='module')
def uncompressed(tmp_path_factory):
    with (mock.patch.object(segment, 'CHUNK_SIZE', 2000),
          mock.patch.object(segment, 'COMPRESSION', CompressionType.NONE)):
        return whole(tmp_path_factory.mktemp('uncompressed'))


def whole(directory):
    path = tools.record(directory, tools.ticks(60), [(tools.FLOW, tools.START, tools.scalar(1e-4))],
                        metadata={'a': 'b'}, attachments={'vibrator.yaml': b'stroke: 0.002\n'})
    with path.open('rb') as file:
        problem, summary = read_summary(file)
    assert not problem and len(summary.chunks) > 5
    return path.read_bytes(), [tuple(m) for m in messages(path)], summary


def damaged(tmp_path, content):
    path = tmp_path / 'damaged.mcap'
    path.write_bytes(content)
    return path


def is_prefix(path, written):
    """The messages of a file are the first of those written; how many."""
    found = [tuple(m) for m in messages(path)]
    assert found == written[:len(found)]
    return len(found)


@pytest.mark.parametrize('kind', ['small', 'uncompressed'])
def test_a_file_cut_at_every_byte_of_its_last_chunk_yields_a_prefix(kind, request, tmp_path):
    content, written, summary = request.getfixturevalue(kind)
    last = summary.chunks[-1]
    end = last.chunk_start_offset + last.chunk_length
    before = is_prefix(damaged(tmp_path, content[:last.chunk_start_offset]), written)
    assert 0 < before < len(written)
    counts = []
    for cut in range(last.chunk_start_offset, end + 1):
        path = damaged(tmp_path, content[:cut])
        counts.append(is_prefix(path, written))
        about = describe(path)
        assert not about.complete and about.messages == counts[-1]
    assert counts == sorted(counts) and counts[0] == before and counts[-1] == len(written)
    if kind == 'uncompressed':
        assert len(set(counts)) > 5, 'whole messages of the cut chunk were not salvaged'


def test_a_file_cut_anywhere_yields_a_prefix(small, tmp_path):
    content, written, summary = small
    data_end = summary.chunks[-1].chunk_start_offset + summary.chunks[-1].chunk_length
    for cut in [*range(8, 700), *range(700, data_end, 37), *range(data_end, len(content), 5)]:
        path = damaged(tmp_path, content[:cut])
        assert is_prefix(path, written) <= len(written)
        assert not describe(path).complete
        read_signals(path)


def test_no_flipped_byte_makes_garbage(small, tmp_path):
    """Every message read from a file with one wrong byte is one that was written."""
    content, written, _ = small
    known, fewest = set(written), len(written)
    for place in range(8, len(content), 7):
        path = damaged(tmp_path, content[:place] + bytes([content[place] ^ 0x55])
                       + content[place + 1:])
        payloads = {m.payload for m in messages(path)}
        assert payloads <= {m[-1] for m in known}
        fewest = min(fewest, len(payloads))
        describe(path)
        read_signals(path)
    assert fewest < len(written)


def test_recovery_of_a_cut_file(small, tmp_path, capsys):
    content, written, summary = small
    cut = summary.chunks[-1].chunk_start_offset + 30
    path = damaged(tmp_path, content[:cut])
    assert main([str(path)]) == 3
    said = capsys.readouterr().out
    copy = tmp_path / 'damaged_recovered.mcap'
    about = describe(copy)
    kept = is_prefix(copy, written)
    assert about.complete and 0 < kept < len(written)
    assert about.metadata['a'] == 'b'
    assert about.attachments == {'vibrator.yaml': b'stroke: 0.002\n'}
    assert about.records['hpv_twin_recovered']['bytes_not_understood'] == '30'
    assert f'kept {kept} messages' in said
    assert f'lost 30 bytes from byte {cut - 30}: the file ends inside a chunk' in said
    assert 'the recording was not finished' in said
    assert path.read_bytes() == content[:cut]
    assert sorted(p.name for p in tmp_path.iterdir()) == [path.name, copy.name]


def test_recovery_of_a_whole_file(small, tmp_path, capsys):
    content, written, _ = small
    path = damaged(tmp_path, content)
    assert main([str(path), '-o', str(tmp_path / 'copy.mcap')]) == 0
    assert 'nothing is lost\n' in capsys.readouterr().out
    assert [tuple(m) for m in messages(tmp_path / 'copy.mcap')] == written


def test_recovery_of_a_file_that_lacks_only_its_index(small, tmp_path, capsys):
    content, written, _ = small
    path = damaged(tmp_path, content[:-20])
    assert main([str(path)]) == 0
    assert 'nothing is lost; only it was not finished: its index' in capsys.readouterr().out
    assert is_prefix(tmp_path / 'damaged_recovered.mcap', written) == len(written)


def test_recovery_goes_on_behind_a_damaged_place(small, tmp_path, capsys):
    content, written, summary = small
    hole = summary.chunks[2].chunk_start_offset
    path = damaged(tmp_path, content[:hole] + b'\0' * 50 + content[hole + 50:])
    assert main([str(path)]) == 3
    copied = [tuple(m) for m in messages(tmp_path / 'damaged_recovered.mcap')]
    missing = [m for m in written if m not in copied]
    span = summary.chunks[2].message_start_time, summary.chunks[2].message_end_time
    assert missing and all(span[0] <= m[2] <= span[1] for m in missing)
    assert copied == [m for m in written if m in copied]
    assert 'there is no record here' in capsys.readouterr().out


def test_recovery_leaves_out_a_chunk_with_a_wrong_checksum(small, tmp_path, capsys):
    content, written, summary = small
    place = summary.chunks[2].chunk_start_offset + 100
    path = damaged(tmp_path, content[:place] + b'\xff\xff' + content[place + 2:])
    assert main([str(path)]) == 3
    assert 'a chunk is damaged' in capsys.readouterr().out
    assert 0 < len(written) - describe(tmp_path / 'damaged_recovered.mcap').messages < 40


def test_zeros_where_the_power_failed(small, tmp_path, capsys):
    content, written, summary = small
    cut = summary.chunks[-1].chunk_start_offset
    path = damaged(tmp_path, content[:cut] + b'\0' * 5000)
    assert main([str(path)]) == 3
    assert is_prefix(tmp_path / 'damaged_recovered.mcap', written) > 0
    assert f'lost 5000 bytes from byte {cut}: there is no record here' in capsys.readouterr().out


def test_recovery_never_overwrites(small, tmp_path, capsys):
    path = damaged(tmp_path, small[0])
    (tmp_path / 'damaged_recovered.mcap').write_text('precious')
    assert main([str(path)]) == 1
    assert 'damaged_recovered.mcap: not overwritten, it exists' in capsys.readouterr().err
    assert main([str(path), '-o', str(path)]) == 1
    assert path.read_bytes() == small[0]
    assert (tmp_path / 'damaged_recovered.mcap').read_text() == 'precious'


@pytest.mark.parametrize('length, said', [(0, 'is empty'), (5, 'is not an MCAP file'),
                                          (100, 'not a single message')])
def test_recovery_of_nothing(small, tmp_path, capsys, length, said):
    path = damaged(tmp_path, small[0][:length])
    assert main([str(path)]) == 1
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [path]


def test_recovery_onto_a_full_disk_leaves_nothing(small, tmp_path, capsys, monkeypatch):
    def refuse(fd):
        raise OSError(28, 'No space left on device')

    path = damaged(tmp_path, small[0])
    monkeypatch.setattr(os, 'fsync', refuse)
    assert main([str(path)]) == 1
    assert 'damaged_recovered.mcap: No space left on device' in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [path]


def test_recovery_tells_its_progress(small, tmp_path):
    told = []
    path = damaged(tmp_path, small[0])
    recover(path, tmp_path / 'copy.mcap', lambda done, size: told.append((done, size)))
    assert told and all(0 < done <= size == len(small[0]) for done, size in told)


def test_help_teaches(capsys):
    with pytest.raises(SystemExit) as ended:
        main(['--help'])
    assert ended.value.code == 0
    said = capsys.readouterr().out
    assert 'exit status' in said and 'never overwritten' in said and 'example' in said
