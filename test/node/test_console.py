"""What a person at a terminal sees."""
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip('rclpy')


def read_until(descriptor, pattern, deadline=40.0):
    """Text from a terminal up to the first match of a pattern."""
    text, end = '', time.monotonic() + deadline
    while not re.search(pattern, text):
        assert time.monotonic() < end, f'waited for {pattern!r}, saw: {text}'
        if select.select([descriptor], [], [], 0.2)[0]:
            text += os.read(descriptor, 65536).decode(errors='replace')
    return text


@pytest.fixture
def terminal(tmp_path):
    """A twin at a terminal of 80 columns: (process, descriptor)."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, '-m', 'hpv_twin', 'twin'], stdin=theirs, stdout=theirs, stderr=theirs,
        cwd=tmp_path, start_new_session=True, env=dict(os.environ, COLUMNS='80'))
    os.close(theirs)
    yield process, ours
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait(10)
    os.close(ours)


def test_banner_then_one_status_line_a_second(terminal):
    process, screen = terminal
    text = read_until(screen, r'55\.0 Hz.*55\.0 Hz')
    for words in ('publishes', '/hpv_twin/pressure', 'absolute', 'listens to',
                  '/hpv_twin/pump_flow_setpoint', 'serves', '/hpv_twin/reset', 'records',
                  'bags/hpv_twin_', 'Ctrl-C'):
        assert words in text
    [line] = set(re.findall(r'55\.0 Hz  2\.00 mm  peak 16\.0 MPa gauge  43\.8 L/min  preload '
                            r'5\.20 mm', text))
    assert len(line + '  margin 100%') <= 79
    assert re.search(r'margin \d+%', text)
    os.killpg(process.pid, signal.SIGINT)
    read_until(screen, r'recorded \d+ messages')
    assert process.wait(10) == 0


def test_help_teaches():
    done = subprocess.run([sys.executable, '-m', 'hpv_twin', 'twin', '--help'],
                          capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    for words in ('examples', '--ros-args', 'publish_rate', 'pump_flow_setpoint', '[1000.0]'):
        assert words in done.stdout
