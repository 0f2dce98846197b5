"""The demonstration, as one command."""
import subprocess
import sys
import time

import psutil
import pytest

pytest.importorskip('rclpy')
from hpv_twin.recording.reader import describe


def test_demo_finds_the_fault_and_leaves_a_recording(tmp_path):
    demo = subprocess.Popen(
        [sys.executable, '-m', 'hpv_twin', 'demo', '--fault', 'pump_leakage', '--severity', '0.5',
         '--after', '2', '--no-replay', '--directory', tmp_path / 'bags'],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True)
    nodes = {}
    try:
        end = time.monotonic() + 30.0
        while len(nodes) < 2 and time.monotonic() < end:
            nodes = {child.pid: child for child in psutil.Process(demo.pid).children()}
            time.sleep(0.05)
        said = demo.communicate(timeout=90.0)[0]
    finally:
        if demo.poll() is None:
            demo.terminate()
            demo.wait(20.0)
    assert demo.returncode == 0, said
    assert 'demo: alarm after' in said and 'the pump is worn or leaks' in said, said
    assert len(nodes) == 2 and not any(node.is_running() for node in nodes.values())
    recording, = (tmp_path / 'bags').glob('*.mcap')
    assert not describe(recording).problem
    assert f'hpv-twin replay {recording}' in said
