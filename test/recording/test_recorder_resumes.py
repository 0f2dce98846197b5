"""When the disk is back, recording goes on in a new file, and nothing is lost uncounted."""

import errno
import itertools
import os
import shutil

import pytest

pytest.importorskip('rclpy')

import recording_tools as tools

from hpv_twin.recording import files, session
from hpv_twin.recording.reader import describe, messages


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr(session, 'FIRST_RETRY', 0.02)


def record_slowly(recording, count, first=0):
    """Write `count` ms of messages and wait until the recorder has seen them."""
    for message in tools.ticks(count, first):
        recording.write(*message)
    tools.wait_until(lambda: not recording._session.queue)


def kept_in(directory):
    """(topic, stamp) of all messages that lie in the files of a folder, in order."""
    return [(m.topic, m.log_time) for path in files.own_files(directory, 'hpv_twin')
            for m in messages(path) if m.topic != tools.TOPICS[tools.FLOW]]


def fail_once(monkeypatch, n, fault):
    """Have the n-th write from now on fail; a function that tells how many there were."""
    write, calls = files.os.write, 0

    def failing(fd, data):
        nonlocal calls
        calls += 1
        if calls == n:
            if fault == 'short':
                write(fd, data[:len(data) // 2])
            raise OSError(getattr(errno, fault, errno.EIO), 'the disk failed')
        return write(fd, data)
    monkeypatch.setattr(files.os, 'write', failing)
    return lambda: calls


@pytest.mark.parametrize('fault', ['ENOSPC', 'EIO', 'short'])
def test_a_write_fails_once_for_every_n(tmp_path, monkeypatch, fault):
    written = [(tools.TOPICS[channel], stamp) for first in (0, 1000)
               for channel, stamp, _ in tools.ticks(30, first)]
    resumed = 0
    for n in itertools.count(1):
        directory = tmp_path / str(n)
        with monkeypatch.context() as patch:
            calls = fail_once(patch, n, fault)
            recording = tools.recorder(directory, flush_interval=0.0)
            first = recording.start([(tools.FLOW, tools.START, tools.scalar(7.3e-4))])
            record_slowly(recording, 30)
            tools.wait_until(lambda: recording.status.recording)  # noqa: B023 this very round
            went_on = recording.status.file != first
            record_slowly(recording, 30, 1000)
            last = recording.stop()
        if calls() < n:
            break
        kept = kept_in(directory)
        assert kept == [message for message in written if message in kept]
        # Of a chunk that failed at its end the messages may be legible, though counted as lost.
        assert len(kept) <= 120 <= len(kept) + recording.status.dropped, n
        if went_on:
            resumed += 1
            assert kept[-60:] == written[60:]
            about = describe(last)
            assert about.complete
            # The setpoint in force stands in the new file too.
            assert about.topics[tools.TOPICS[tools.FLOW]].count == 1
    assert resumed >= 5


def test_the_folder_vanishes_at_a_write_for_every_n(tmp_path, monkeypatch):
    directory = tmp_path / 'bags'
    write, vanished = files.os.write, 0
    for n in itertools.count(1):
        calls = 0

        def write_and_vanish(fd, data):
            nonlocal calls
            calls += 1
            if calls == n:  # noqa: B023 this very round
                shutil.rmtree(directory)
            return write(fd, data)
        with monkeypatch.context() as patch:
            patch.setattr(files.os, 'write', write_and_vanish)
            recording = tools.recorder(directory, flush_interval=0.0)
            recording.start([(tools.FLOW, tools.START, tools.scalar(7.3e-4))])
            record_slowly(recording, 30)
            tools.wait_until(lambda: recording.status.recording  # noqa: B023 this very round
                             and recording.status.file.exists())  # noqa: B023
            record_slowly(recording, 30, 1000)
            last = recording.stop()
        if calls < n:
            break
        vanished += 1
        if last is None:  # at the very last writes
            assert recording.status.error, n
            continue
        about = describe(last)
        assert about.complete and about.topics[tools.TOPICS[tools.FLOW]].count == 1
        assert about.messages + recording.status.dropped >= 61, n
        shutil.rmtree(directory)
    assert vanished >= 5


def test_a_folder_that_vanishes_is_made_anew(tmp_path):
    log = tools.Log()
    recording = tools.recorder(tmp_path / 'bags', flush_interval=0.01, log=log)
    recording.start([(tools.FLOW, tools.START, tools.scalar(7.3e-4))])
    record_slowly(recording, 50)
    shutil.rmtree(tmp_path / 'bags')
    tools.wait_until(lambda: log.of('error'))
    tools.wait_until(lambda: recording.status.recording)
    record_slowly(recording, 50, 1000)
    last = recording.stop()
    assert describe(last).topics[tools.TOPICS[tools.PRESSURE]].count == 50
    assert describe(last).topics[tools.TOPICS[tools.FLOW]].count == 1
    assert any('recording goes on' in text for text in log.of('warning'))


@pytest.mark.skipif(os.geteuid() == 0, reason='nothing is forbidden to root')
def test_a_forbidden_folder_is_tried_again(tmp_path):
    tmp_path.chmod(0o500)
    try:
        becomes_possible(tmp_path, lambda: tmp_path.chmod(0o700))
    finally:
        tmp_path.chmod(0o700)


def test_a_file_where_the_folder_should_be_is_waited_out(tmp_path):
    (tmp_path / 'bags').write_text('in the way')
    becomes_possible(tmp_path / 'bags', (tmp_path / 'bags').unlink)


def becomes_possible(directory, allow):
    log = tools.Log()
    recording = tools.recorder(directory, log=log)
    assert recording.start([(tools.FLOW, tools.START, tools.scalar(7.3e-4))]) is None
    assert str(directory) in recording.status.error and 'next try' in recording.status.error
    record_slowly(recording, 10)
    tools.wait_until(lambda: recording.status.dropped == 20)
    allow()
    tools.wait_until(lambda: recording.status.recording)
    record_slowly(recording, 10, 100)
    about = describe(recording.stop())
    assert about.topics[tools.TOPICS[tools.PRESSURE]].count == 10
    assert about.topics[tools.TOPICS[tools.FLOW]].count == 1
    assert len(log.of('error')) == 1
