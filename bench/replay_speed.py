"""
Opening a long recording: time and memory of the replay, beside rerun's own conversion of the file.

    python bench/replay_speed.py                 10 and 60 minutes at 1 kHz
    python bench/replay_speed.py --minutes 10 --folder /tmp/replay

The recordings are the model's, written here with both joints and their velocities. "scene" is
`hpv-twin replay FILE --save OUT.rrd`; "shown" is how long rerun's viewer, without a screen, then
takes until its picture has curves in it; "rerun" is `rerun mcap convert FILE -o OUT.rrd`.
Memory is the highest resident set of each process. What must hold: an hour in 20 s and 2 GB.
"""
import argparse
import os
import socket
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rerun.experimental import ViewerClient

from hpv_twin.model import Simulation, Vibrator
from hpv_twin.recording.files import DataFile
from hpv_twin.recording.measurements import (
    HASHES,
    JOINT_TYPE,
    PRESSURE_TYPE,
    SCHEMAS,
    pressure_payload,
)
from hpv_twin.recording.schemas import Channel, qos_text
from hpv_twin.recording.segment import Segment
from hpv_twin.viewer import viewer_process

BEGIN = 1_760_000_000_000_000_000  # ns
RATE = 1000  # Hz
# CDR: encapsulation, stamp, no frame, two names, two positions, two velocities, no effort.
JOINTS = struct.Struct('<4s iI I1s3x I I8s I13s3x I 2d I4x 2d I')
SOFTWARE = sorted(Path('/usr/share/vulkan/icd.d').glob('lvp_icd*.json'))


def main():
    """Measure each length asked for."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--minutes', type=float, nargs='+', default=[10.0, 60.0])
    parser.add_argument('--folder', type=Path, help='keep recordings and scenes there')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for minutes in options.minutes:
            report(folder, minutes)
    return 0


def report(folder, minutes):
    """Print one block of the table."""
    file = folder / f'{minutes:g}_minutes.mcap'
    if not file.exists():
        write(file, minutes)
    size = file.stat().st_size / 1e6
    print(f'{minutes:g} minutes at {RATE} Hz, {size:.1f} MB', flush=True)
    ours, theirs = (file.with_suffix(f'.{name}.rrd') for name in ('scene', 'rerun'))
    rows = [('scene', ours, [sys.executable, '-m', 'hpv_twin', 'replay', file, '--save', ours]),
            ('rerun', theirs, [viewer_process.executable(), 'mcap', 'convert', file, '-o', theirs])]
    for name, out, command in rows:
        seconds, memory = measured(command)
        print(f'  {name:6s} {seconds:6.1f} s {memory:6.0f} MB, writes '
              f'{out.stat().st_size / 1e6:.0f} MB', flush=True)
    if SOFTWARE:
        seconds, memory = shown(ours)
        print(f'  shown  {seconds:6.1f} s {memory:6.0f} MB', flush=True)


def write(path, minutes):
    """Write the model's pressure and both joints."""
    path.unlink(missing_ok=True)
    channels = [Channel(f'/hpv_twin/{topic}', kind, SCHEMAS[kind], HASHES[kind], qos_text())
                for topic, kind in (('pressure', PRESSURE_TYPE), ('plunger_position', JOINT_TYPE))]
    design = Vibrator()
    segment = Segment(DataFile(path), channels,
                      {'node': '/hpv_twin', 'ambient_pressure': '101325.0'},
                      {'vibrator.yaml': design.to_yaml().encode()})
    simulation, count = Simulation(design), 0
    for _ in range(round(minutes)):
        trace = simulation.advance(60.0, sample_rate=RATE)
        columns = (trace.pressure, trace.plunger_position, trace.sleeve_position,
                   trace.plunger_velocity)
        for p, y, y2, v in zip(*(column[1:].tolist() for column in columns), strict=True):
            stamp = BEGIN + count * (1_000_000_000 // RATE)
            segment.append(0, stamp, pressure_payload(stamp, p + 101_325.0), count)
            segment.append(1, stamp, joints(stamp, y, y2, v), count)
            count += 1
    segment.finish({})


def joints(stamp, plunger, sleeve, velocity):
    """Return a serialized JointState of plunger and valve sleeve."""
    return JOINTS.pack(b'\0\1\0\0', stamp // 10**9, stamp % 10**9, 1, b'\0', 2, 8, b'plunger\0',
                       13, b'valve_sleeve\0', 2, plunger, sleeve, 2, velocity, velocity, 0)


def measured(command):
    """Run a command; return its time (s) and highest resident set (MB)."""
    began = time.monotonic()
    child = subprocess.Popen([str(part) for part in command], stdout=subprocess.DEVNULL,
                             env={'RUST_LOG': 'error', **os.environ})
    _, status, usage = os.wait4(child.pid, 0)
    if status:
        raise SystemExit(f'{command[0]} failed')
    return time.monotonic() - began, usage.ru_maxrss / 1e3


def shown(scene):
    """Open a scene in a viewer without a screen; return time (s) and memory (MB) until it shows."""
    with socket.create_server(('127.0.0.1', 0)) as free:
        port = free.getsockname()[1]
    picture = scene.with_suffix('.png')
    began = time.monotonic()
    viewer = subprocess.Popen(
        [viewer_process.executable(), '--headless', '--bind', '127.0.0.1', '--port', str(port),
         '--window-size', '1920x1080', str(scene)],
        env={**os.environ, 'RUST_LOG': 'error', 'VK_ICD_FILENAMES': str(SOFTWARE[0]),
             'XDG_RUNTIME_DIR': str(scene.parent)})
    try:
        client = patiently(lambda: ViewerClient.connect(f'rerun+http://127.0.0.1:{port}/proxy'))
        patiently(lambda: has_curves(client, picture))
        seconds = time.monotonic() - began
        status = Path(f'/proc/{viewer.pid}/status').read_text()
        peak = next(line for line in status.splitlines() if line.startswith('VmHWM'))
        return seconds, int(peak.split()[1]) / 1e3
    finally:
        viewer.terminate()
        viewer.wait(10)


def has_curves(client, picture):
    """Raise AssertionError unless the plots in the middle have curves."""
    from PIL import Image
    client.save_screenshot(str(picture))
    middle = np.asarray(Image.open(picture).convert('RGB')).astype(int)[70:820, 785:1520]
    coloured = np.ptp(middle, axis=2) > 60
    assert coloured[:200].sum() > 1000  # cycles
    assert coloured[590:].sum() > 5000  # the whole run


def patiently(action, seconds=180.0):
    """Return what `action` returns, tried until it does not fail."""
    end = time.monotonic() + seconds
    while True:
        try:
            return action()
        except Exception:
            if time.monotonic() > end:
                raise
            time.sleep(0.2)


if __name__ == '__main__':
    sys.exit(main())
