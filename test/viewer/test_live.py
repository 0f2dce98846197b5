"""`replay --live` shows a recording while it grows, and whoever records does not notice."""
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rerun')
pytest.importorskip('rclpy')

import rerun
import viewer_recordings as made
from rerun.chunk import RrdReader
from std_msgs.msg import Float64

from hpv_twin.viewer import replay
from hpv_twin.viewer.live import Live

SOFTWARE = sorted(Path('/usr/share/vulkan/icd.d').glob('lvp_icd*.json'))
PRESSURE = '/hpv_twin/pressure'


def follow(path, steps, out):
    """Let `path` grow by `steps` (bytes so far each) under a live scene; return its chunks."""
    data = path.read_bytes()
    path.write_bytes(data[:steps[0]])
    stream = rerun.RecordingStream('hpv_twin', recording_id='live')
    stream.save(out)
    live = Live(stream, path, None, None)
    for size in steps[1:]:
        path.write_bytes(data[:size])
        live.update()
    finished = live.finished
    live.close()
    stream.disconnect()
    return [chunk.to_record_batch() for chunk in RrdReader(out).stream().to_chunks()
            if not chunk.is_static], finished


def column(tables, entity, name='Scalars:scalars'):
    """Return times (s) and values of an entity in ascending time."""
    found = [t for t in tables if t.schema.metadata[b'rerun:entity_path'].decode() == entity
             and name in t.schema.names]
    time = np.concatenate([t.column('time').cast('int64').to_numpy() for t in found]) * 1e-9
    values = np.array([v for t in found for v in t.column(name).flatten().to_pylist()])
    order = np.argsort(time, kind='stable')
    return time[order], values[order]


@pytest.fixture(scope='module')
def grown(tmp_path_factory):
    folder = tmp_path_factory.mktemp('live')
    path = made.write_twin(folder / 'run.mcap', seconds=6.0, gap=(3.0, 3.5), chunk_size=8 * 1024)
    size = path.stat().st_size
    steps = np.linspace(size // 4, size, 40).astype(int).tolist()
    return follow(path, steps, folder / 'live.rrd')


def test_every_sample_comes_once(grown):
    tables, finished = grown
    assert finished
    for entity in (PRESSURE, '/hpv_twin/plunger', '/hpv_twin/valve_sleeve'):
        time, shown = column(tables, entity)
        there = ~np.isnan(shown)
        assert np.count_nonzero(there) == 5500
        assert np.all(np.diff(time[there]) > 0.0005)
    time, shown = column(tables, PRESSURE)
    before = ~np.isnan(shown) & (time < 2.9)
    assert np.allclose(shown[before], made.waveform(time[before])[0] * 1e-6, atol=1e-9)


def test_a_gap_breaks_the_line(grown):
    time, shown = column(grown[0], PRESSURE)
    (at,) = np.flatnonzero(np.isnan(shown))
    assert 2.99 < time[at] < 3.01


def test_setpoints_and_events_follow(grown):
    time, shown = column(grown[0], '/hpv_twin/pump_flow')
    assert shown[time < 2.9] == pytest.approx(43.8)
    assert shown[time > 3.1] == pytest.approx(30.0)
    _, lines = column(grown[0], '/events', 'TextLog:text')
    assert '3.000 s: pump flow 30.0 L/min (was 43.8 L/min)' in lines
    assert not any('damaged' in line for line in lines)


def test_phases_and_marks_are_those_of_the_whole_file(grown, tmp_path):
    whole = made.write_twin(tmp_path / 'run.mcap', seconds=6.0, gap=(3.0, 3.5))
    assert replay.main([str(whole), '--save', str(tmp_path / 'run.rrd')]) == 0
    tables = [chunk.to_record_batch() for chunk in RrdReader(tmp_path / 'run.rrd').stream()
              .to_chunks() if not chunk.is_static]
    for entity, name in (('/hpv_twin/phases', 'StateChange:state'),
                         ('/hpv_twin/pressure/return', 'Scalars:scalars')):
        expected, shown = column(tables, entity, name)[0], column(grown[0], entity, name)[0]
        missing = set(np.round(expected, 5)) - set(np.round(shown, 5))
        assert len(missing) < 0.03 * len(expected)


def test_portrait_and_spectrum_come_each_second(grown):
    time, _ = column(grown[0], '/hpv_twin/spectrum', 'BarChart:values')
    assert np.max(time) > 4.5


class Writer(threading.Thread):
    """Records a cycle in real time until told to stop."""

    def __init__(self, path):
        super().__init__()
        self.path, self.stop = path, threading.Event()

    def run(self):
        with made.Recording(self.path, chunk_size=32 * 1024, metadata=made.metadata(),
                            design=made.DESIGN) as recording:
            written = time.time_ns() // 10**6 * 10**6
            recording.write('/hpv_twin/pump_flow', written, Float64(data=7.3e-4))
            while not self.stop.is_set():
                now = time.time_ns() // 10**6 * 10**6
                times = np.arange(written, now, 10**6)
                if len(times) > 2:
                    made.write_waveforms(recording, '/hpv_twin', times)
                    recording._writer.flush()
                    written = now
                time.sleep(0.2)


@pytest.mark.skipif(not SOFTWARE, reason='no Vulkan driver to draw without a screen')
def test_a_viewer_follows_and_listens_on_this_machine_alone(tmp_path):
    viewer, notes = tmp_path / 'viewer', tmp_path / 'notes'
    from hpv_twin.viewer import viewer_process
    viewer.write_text(f'#!/bin/sh\necho "$$ $@" > {notes}\n'
                      f'exec {viewer_process.executable()} --headless --window-size 1920x1080 '
                      '"$@"\n')
    viewer.chmod(0o755)
    path = tmp_path / 'run.mcap'
    writer = Writer(path)
    writer.start()
    command = 'import sys; from hpv_twin.viewer.replay import main; sys.exit(main(sys.argv[1:]))'
    process = subprocess.Popen(
        [sys.executable, '-c', command, '--live', str(path)], stdout=subprocess.PIPE, text=True,
        env=dict(os.environ, RERUN_CLI_PATH=str(viewer), DISPLAY=':0',
                 VK_ICD_FILENAMES=str(SOFTWARE[0]), XDG_RUNTIME_DIR=str(tmp_path)))
    try:
        assert 'live' in process.stdout.readline()
        time.sleep(4.0)
        words = notes.read_text().split()
        port = int(words[words.index('--port') + 1])
        assert listening(port) == {'0100007F'}
        assert coloured(tmp_path, port) > 1000
        process.send_signal(signal.SIGTERM)
        said = process.communicate(timeout=20)[0]
        assert process.returncode == 0
        (late,) = re.findall(r'([\d.]+) s behind', said)
        assert float(late) < 2.0  # usually 0.2
        with pytest.raises(ProcessLookupError):
            os.kill(int(words[0]), 0)
        assert writer.is_alive()
    finally:
        process.kill()
        process.wait()
        writer.stop.set()
        writer.join()


def listening(port):
    """Return the addresses (hexadecimal) on which somebody listens on `port`."""
    rows = [line.split() for line in Path('/proc/net/tcp').read_text().splitlines()[1:]]
    rows += [line.split() for line in Path('/proc/net/tcp6').read_text().splitlines()[1:]]
    return {row[1].split(':')[0] for row in rows
            if int(row[1].split(':')[1], 16) == port and row[3] == '0A'}


def coloured(folder, port):
    """Return how many pixels of the cycles have a colour."""
    from PIL import Image
    from rerun.experimental import ViewerClient
    client = ViewerClient.connect(f'rerun+http://127.0.0.1:{port}/proxy')
    client.save_screenshot(str(folder / 'live.png'))
    picture = np.asarray(Image.open(folder / 'live.png').convert('RGB')).astype(int)
    return np.count_nonzero(np.ptp(picture[70:530, 785:1520], axis=2) > 60)


def test_live_does_not_go_with_a_part(capsys):
    with pytest.raises(SystemExit) as stop:
        replay.main(['--live', '--from', '3'])
    assert stop.value.code == 2
    assert '--live does not go with --from' in capsys.readouterr().err
