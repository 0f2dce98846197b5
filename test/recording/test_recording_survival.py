"""A killed process loses at most half a second, and what is left can be read by everyone."""

import mmap
import os
import signal
import struct
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

import recording_tools as tools

from hpv_twin.recording.reader import describe, messages
from hpv_twin.recording.recover import main

MOST_LOST = 500_000_000  # ns
PACKAGE = Path(__file__).parents[2]
RECORDING = """
    import mmap, struct, sys, time
    import recording_tools as tools
    from recording_tools import PRESSURE, POSITION
    notes = open(sys.argv[2], 'r+b')
    progress = mmap.mmap(notes.fileno(), 8)
    first, second = tools.pressure(0, 1e5), tools.position(0, 1e-3)
    recording = tools.recorder(sys.argv[1], metadata={'a': 'b'}, fsync=sys.argv[3] == 'fsync')
    print(recording.start([(tools.FLOW, time.time_ns(), tools.scalar(7.3e-4))]), flush=True)
    while True:
        stamp = time.time_ns()
        assert recording.write(PRESSURE, stamp, first)
        assert recording.write(POSITION, stamp, second)
        progress[:] = struct.pack('<q', stamp)
        time.sleep(1e-3)
"""


def kill_while_recording(directory, seconds, fsync):
    """Kill a recording process; its file and the stamp of the last message it handed over."""
    directory.mkdir()
    notes = directory / 'progress'
    notes.write_bytes(b'\0' * 8)
    paths = os.pathsep.join([str(PACKAGE), str(Path(__file__).parent),
                             os.environ.get('PYTHONPATH', '')])
    child = subprocess.Popen(
        [sys.executable, '-c', textwrap.dedent(RECORDING), str(directory / 'bags'), str(notes),
         'fsync' if fsync else ''], stdout=subprocess.PIPE, text=True,
        env=os.environ | {'PYTHONPATH': paths})
    try:
        path = Path(child.stdout.readline().strip())
        time.sleep(seconds)
    finally:
        child.send_signal(signal.SIGKILL)
        child.wait()
        child.stdout.close()
    with notes.open('rb') as file, mmap.mmap(file.fileno(), 8, access=mmap.ACCESS_READ) as seen:
        return path, struct.unpack('<q', seen[:])[0]


@pytest.mark.parametrize('seconds, fsync', [(0.05, False), (0.61, False), (1.13, False),
                                            (0.87, True)])
def test_a_killed_process_loses_little(tmp_path, capsys, seconds, fsync):
    path, last = kill_while_recording(tmp_path / 'run', seconds, fsync)
    about = describe(path)
    assert not about.complete
    assert about.metadata['a'] == 'b'
    assert about.topics[tools.TOPICS[tools.FLOW]].count == 1
    assert last - about.end <= MOST_LOST
    stamps = [m.log_time for m in messages(path)]
    assert stamps == sorted(stamps)
    assert main([str(path)]) == 3
    assert 'the recording was not finished' in capsys.readouterr().out
    copy = describe(path.with_name(f'{path.stem}_recovered.mcap'))
    assert copy.complete and copy.topics == about.topics


def test_other_tools_read_what_was_recovered(tmp_path):
    from mcap_ros2.reader import read_ros2_messages
    path, _ = kill_while_recording(tmp_path / 'run', 0.6, False)
    assert main([str(path)]) == 3
    copy = path.with_name(f'{path.stem}_recovered.mcap')
    assert sum(1 for _ in read_ros2_messages(str(copy))) == describe(path).messages
    cli = Path(str(pytest.importorskip('rerun_cli').__file__)).with_name('rerun')
    done = subprocess.run([cli, 'mcap', 'check', copy], capture_output=True, text=True, timeout=60,
                          check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.long
def test_fifty_kills(tmp_path):
    """At fifty moments spread over two flushes."""
    worst = 0
    for i in range(50):
        path, last = kill_while_recording(tmp_path / str(i), 0.5 + 0.01 * i, False)
        worst = max(worst, last - describe(path).end)
        assert main([str(path)]) == 3
    print(f'largest loss of fifty kills: {worst / 1e6:.0f} ms')
    assert worst <= MOST_LOST
