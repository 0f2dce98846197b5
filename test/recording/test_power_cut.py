"""With fsync, what a power cut leaves: only what the disk was waited for. The disk is a model."""

import os
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

import recording_tools as tools

from hpv_twin.recording import files
from hpv_twin.recording import recorder as recorder_module
from hpv_twin.recording.reader import messages


class Disk:
    """What would be found after a power cut: the names and the data that fsync was called for.

    A rename is either found or not, as in every file system that keeps a journal of names.
    """

    def __init__(self, monkeypatch):
        self.data, self.names = {}, {}  # by inode; by inode of a folder: name -> inode
        self._fsync = files.os.fsync
        monkeypatch.setattr(files.os, 'fsync', self)

    def __call__(self, fd):
        self._fsync(fd)
        path = Path(os.readlink(f'/proc/self/fd/{fd}'))
        inode = os.fstat(fd).st_ino
        if path.is_dir():
            self.names[inode] = {entry.name: entry.inode() for entry in os.scandir(path)}
        else:
            self.data[inode] = path.read_bytes()

    def found(self, folder):
        """Name and content of every file below the folder of this inode."""
        for name, inode in sorted(self.names.get(folder, {}).items()):
            if inode in self.data:
                yield name, self.data[inode]
            yield from self.found(inode)


@pytest.mark.parametrize('split_time', [0.0, 0.1])
def test_a_power_cut_loses_what_was_not_waited_for(tmp_path, monkeypatch, split_time):
    monkeypatch.setattr(recorder_module, 'MIN_SPLIT_TIME', 0.0)
    disk = Disk(monkeypatch)
    bags = tmp_path / 'new' / 'bags'
    recording = tools.recorder(bags, fsync=True, flush_interval=0.0, split_time=split_time)
    recording.start([(tools.FLOW, tools.START, tools.scalar(7.3e-4))])
    written = [(tools.TOPICS[channel], stamp) for channel, stamp, _ in tools.ticks(400)]
    for count, message in enumerate(tools.ticks(400), 1):
        recording.write(*message)
        if count % 40:
            continue
        tools.wait_until(lambda: not recording._session.queue)
        flushed = recording.status.last_flush
        tools.wait_until(lambda: recording.status.last_flush > flushed)  # noqa: B023 this round
        assert after_the_cut(disk, tmp_path, tmp_path / f'cut_{count}') == written[:count]
    parts = files.own_files(bags, 'hpv_twin')
    assert (len(parts) > 1) == bool(split_time)
    recording.stop()


def after_the_cut(disk, root, place):
    """(topic, stamp) of all messages that could be read, but those of the setpoint."""
    place.mkdir()
    kept = []
    for name, data in disk.found(root.stat().st_ino):
        (place / name).write_bytes(data)
        kept += [(m.topic, m.log_time) for m in messages(place / name)
                 if m.topic != tools.TOPICS[tools.FLOW]] if name.endswith('.mcap') else []
    return kept
