"""A disk that fails never disturbs the twin, and what was written before can be read."""

import errno
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

import recording_tools as tools

from hpv_twin.recording import files, segment
from hpv_twin.recording.reader import describe, messages
from hpv_twin.recording.summary import RecordingError

MESSAGES = list(tools.ticks(200))
RECORDING = Path(segment.__file__).parents[2]


class FaultyDisk:
    """Stands in for the operating system's write: the n-th call and all later ones fail."""

    def __init__(self, monkeypatch, failing, fault):
        self.calls, self.failing, self.fault = 0, failing, fault
        self.later_calls = 0
        self._write = files.os.write
        monkeypatch.setattr(files.os, 'write', self)

    def __call__(self, fd, data):
        self.calls += 1
        if self.calls < self.failing:
            return self._write(fd, data)
        self.later_calls += self.calls > self.failing
        if self.fault == 'short' and self.calls == self.failing:
            self.later_calls -= 1  # the rest of a short write is asked for once more
            return self._write(fd, data[:len(data) // 2])
        if self.fault == 'nothing':
            return 0
        raise OSError(getattr(errno, self.fault, errno.ENOSPC), 'the disk failed')


def run(directory, log):
    """Record everything in small chunks; the path, None if not even that could be begun."""
    recording = tools.recorder(directory, flush_interval=0.0, log=log)
    path = recording.start([(tools.FLOW, tools.START, tools.scalar(7.3e-4))])
    for message in MESSAGES:
        recording.write(*message)
    finished = recording.stop()
    status = recording.status
    recording.close()
    return path, finished, status


@pytest.mark.parametrize('fault', ['ENOSPC', 'EIO', 'short', 'nothing'])
def test_the_nth_write_fails_for_every_n(tmp_path, monkeypatch, fault):
    with monkeypatch.context() as patch:
        whole = FaultyDisk(patch, 10**9, fault)
        path, finished, _ = run(tmp_path / 'whole', tools.Log())
    assert path == finished
    payloads = [m.payload for m in messages(path)]
    for failing in range(1, whole.calls + 1):
        log = tools.Log()
        with monkeypatch.context() as patch:
            disk = FaultyDisk(patch, failing, fault)
            path, finished, status = run(tmp_path / str(failing), log)
        if disk.calls < failing:
            continue  # this run needed fewer writes
        assert finished is None and not status.recording and status.error
        assert len(log.of('error')) == 1
        assert disk.later_calls == 0, 'the damaged file was written to again'
        if path is None:
            assert list((tmp_path / str(failing)).iterdir()) == []
            continue
        kept = [m.payload for m in messages(path)]
        assert kept == payloads[:len(kept)] and len(kept) >= 1
        assert not describe(path).complete
        assert f'hpv-twin recover {path}' in log.of('error')[0]


def test_a_file_that_is_removed_ends_the_recording(tmp_path):
    log = tools.Log()
    recording = tools.recorder(tmp_path, flush_interval=0.01, log=log)
    recording.start().unlink()
    tools.wait_until(lambda: not recording.status.recording)
    recording.close()
    assert 'the file was removed while it was written' in log.of('error')[0]


def test_the_log_tells_of_a_file_that_does_not_read_back(tmp_path, monkeypatch):
    monkeypatch.setattr(segment, 'unfinished', lambda path: 'its index is damaged')
    log = tools.Log()
    recording = tools.recorder(tmp_path, log=log)
    path = recording.start()
    assert recording.stop() is None
    assert log.of('error') == [f'{path}: its index is damaged']


LIMITED = """
    import resource, sys, time
    import recording_tools as tools
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
    log = tools.Log()
    recording = tools.recorder(sys.argv[1], log=log)
    recording.start()
    print(recording.status.file, flush=True)
    alive = 0
    for i in range(60):
        for message in tools.ticks(200, 200 * i):
            alive += 1
            recording.write(*message)
        time.sleep(0.02)
    recording.stop()
    assert alive == 60 * 400
    assert all('File too large' in text for text in log.of('error')), log
    assert log.of('error') and recording.status.dropped > 0, recording.status
"""


def test_the_operating_system_refuses_to_write_on(tmp_path):
    """A real refusal: the system allows no file of more than 100 kB."""
    done = subprocess.run([sys.executable, '-c', textwrap.dedent(LIMITED), str(tmp_path)],
                          cwd=RECORDING, env=child_environment(), capture_output=True, text=True,
                          timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    path = Path(done.stdout.strip())
    kept = [(tools.TOPICS.index(m.topic), m.log_time) for m in messages(path)]
    assert len(kept) > 500
    assert kept == [(channel, stamp) for channel, stamp, _ in tools.ticks(60 * 200)][:len(kept)]


def child_environment():
    """A child finds the package and the tools of these tests."""
    import os
    return os.environ | {'PYTHONPATH': os.pathsep.join(
        [str(RECORDING), str(Path(__file__).parent), os.environ.get('PYTHONPATH', '')])}


def test_an_empty_file_is_told_in_one_line(tmp_path):
    path = tmp_path / 'empty.mcap'
    path.touch()
    with pytest.raises(RecordingError, match=f'{path}: is empty: nothing was recorded'):
        describe(path)


def test_fsync_waits_for_the_disk_at_each_flush(tmp_path, monkeypatch):
    synced = []
    fsync = files.os.fsync
    monkeypatch.setattr(files.os, 'fsync', lambda fd: synced.append(fd) or fsync(fd))
    tools.record(tmp_path / 'without', MESSAGES, flush_interval=0.0)
    assert synced == []
    path = tools.record(tmp_path / 'with', MESSAGES, flush_interval=0.0, fsync=True)
    batches = len(MESSAGES) // 20
    assert len(synced) >= 2 + batches  # the file, the folder, then every batch
    assert describe(path).messages == len(MESSAGES)
