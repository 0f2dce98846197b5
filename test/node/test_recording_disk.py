"""A real disk that is full: the twin goes on, every file can be read, recording resumes."""
import os
import subprocess
from itertools import pairwise
from pathlib import Path

import pytest

pytest.importorskip('rclpy')
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import FluidPressure

from hpv_twin.recording.files import own_files
from hpv_twin.recording.reader import describe

SIZE = 8_388_608  # bytes of the disk


@pytest.fixture
def disk(tmp_path):
    """A small disk of its own, in memory, seen by those who know the path."""
    script = f'mount -t tmpfs -o size={SIZE} tmpfs "$1" && echo mounted && exec cat'
    try:
        keeper = subprocess.Popen(['unshare', '--map-root-user', '--mount', 'sh', '-c', script,
                                   'sh', str(tmp_path)], stdin=subprocess.PIPE, text=True,
                                  stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    except FileNotFoundError:
        pytest.skip('no unshare here')
    try:
        if keeper.stdout.readline() != 'mounted\n':
            pytest.skip('no disk can be mounted here')
        yield Path(f'/proc/{keeper.pid}/root{tmp_path}')
    finally:
        keeper.stdin.close()
        keeper.wait(10)
        keeper.stdout.close()


def status(reports, part):
    """The latest diagnostic status of a part of the twin."""
    found, = (s for s in reports[-1].status if s.name.endswith(f': {part}'))
    return found


@pytest.mark.parametrize('reserve, said', [
    ('0.0', 'No space left'),
    pytest.param('3.0e+6', 'are left to others', marks=pytest.mark.long)])
def test_a_full_disk(start_twin, ear, disk, reserve, said):
    filler = disk / 'filler'
    filler.write_bytes(bytes(3_000_000))
    bags = disk / 'bags'
    twin = start_twin(f'record_directory:={bags}', 'record_rate:=20000.0',
                      f'record_reserve:={reserve}')
    pressure = ear.listen(FluidPressure, '/hpv_twin/pressure')
    reports = ear.listen(DiagnosticArray, '/diagnostics')
    ear.until(lambda: 'recording waits' in twin.log, 'a full disk')
    assert said in twin.log
    ear.until(lambda: reports and status(reports, 'recorder').level == DiagnosticStatus.ERROR,
              'an error in the diagnostics')
    assert said in status(reports, 'recorder').message
    filler.unlink()
    ear.until(lambda: 'recording goes on' in twin.log, 'recording to go on')
    heard = len(reports)
    ear.until(lambda: len(reports) > heard + 1, 'more diagnostics')
    assert status(reports, 'recorder').message == 'recording'
    told = {value.key: value.value for value in status(reports, 'timing').values}
    assert twin.stop() == 0
    files = own_files(bags, 'hpv_twin')
    about = [describe(path) for path in files]
    assert len(files) == 2 and about[1].complete
    assert all(part.topics['/hpv_twin/pump_flow'].count == 1 for part in about)
    assert about[1].metadata['recording.resumed_after']
    assert about[0].complete == (reserve != '0.0')
    # The disk has kept no tick waiting: every stamp was published, or reported as dropped.
    stamps = [m.header.stamp.sec * 1_000_000_000 + m.header.stamp.nanosec for m in pressure]
    missing = sum(b - a for a, b in pairwise(stamps)) // 1_000_000 + 1 - len(stamps)
    assert len(stamps) > 1000 and 0 <= missing <= int(told['dropped ticks'])
    if reserve != '0.0':
        assert os.stat(files[0]).st_size < SIZE - float(reserve)
