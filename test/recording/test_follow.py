"""A recording is followed while it grows: nothing twice, nothing left out, half records wait."""
import numpy as np
import pytest

from hpv_twin.recording.follow import Follower
from hpv_twin.recording.measurements import MeasurementFile
from hpv_twin.recording.reader import read_signals
from hpv_twin.recording.summary import RecordingError

BEGIN = 1_760_000_000_000_000_000
TOPIC = '/machine/pressure'


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / 'run.mcap'
    time = BEGIN + np.arange(30_000, dtype=np.int64) * 1_000_000
    with MeasurementFile(path) as file:
        file.write(time, 1e6 + np.arange(30_000.0), np.zeros(30_000))
    return path


def test_every_prefix_is_followed_without_loss(recording, tmp_path):
    data, path = recording.read_bytes(), tmp_path / 'growing.mcap'
    path.write_bytes(data[:100])
    follower, times = Follower(path), []
    for end in range(100, len(data) + 7919, 7919):
        path.write_bytes(data[:end])
        signals, others = follower.read()
        assert others == []
        times.append(signals[TOPIC].time if TOPIC in signals else np.empty(0, np.int64))
    follower.close()
    assert follower.finished
    assert sum(len(part) > 0 for part in times) > 5
    assert np.array_equal(np.concatenate(times), read_signals(recording)[TOPIC].time)


def test_only_what_is_new(recording, tmp_path):
    data, path = recording.read_bytes(), tmp_path / 'growing.mcap'
    path.write_bytes(data[:len(data) // 2])
    follower = Follower(path, from_end=True)
    assert follower.read() == ({}, [])
    path.write_bytes(data)
    signals, _ = follower.read()
    follower.close()
    assert 0 < len(signals[TOPIC].time) < 20_000
    assert signals[TOPIC].time[-1] == BEGIN + 29_999 * 1_000_000


def test_the_next_part_follows(recording, tmp_path):
    folder = tmp_path / 'twin_20260101T000000.000Z'
    folder.mkdir()
    first = folder / 'twin_20260101T000000.000Z.mcap'
    first.write_bytes(recording.read_bytes())
    follower = Follower(folder)
    assert len(follower.read()[0][TOPIC].time) == 30_000
    assert follower.finished
    second = folder / 'twin_20260101T000100.000Z.mcap'
    second.write_bytes(recording.read_bytes())
    assert follower.read() == ({}, [])
    assert not follower.finished
    assert len(follower.read()[0][TOPIC].time) == 30_000
    follower.close()


def test_what_is_no_recording_is_refused(tmp_path):
    path = tmp_path / 'notes.mcap'
    path.write_text('these are notes, not a recording')
    with pytest.raises(RecordingError, match=r'notes\.mcap: is not an MCAP file'):
        Follower(path)
