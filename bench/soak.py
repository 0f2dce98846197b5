"""
The twin for as long as you like: memory, gaps against reported drops, lateness, drift.

    python bench/soak.py --minutes 20

The twin runs at its defaults with one subscriber to both waveforms in this process. Every step of
the recorded stamps that is not one period is a gap; the twin must have reported as much dropped
time. What this process has heard stands beside it: a subscriber in Python can lose messages itself.
"""
import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('ROS_DOMAIN_ID', '93')

import numpy as np
import psutil
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import FluidPressure, JointState

from hpv_twin.model import Simulation, find_cycles
from hpv_twin.recording.reader import messages, read_signals

PERIOD = 1_000_000  # ns
EVERY = 10.0  # s between two looks at the process
SETTLED = 120.0  # s after which memory is to be flat


class Listener:
    """Counts messages and gaps as they come, without keeping them."""

    def __init__(self):
        self.node = rclpy.create_node('soak')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.last, self.count, self.gaps, self.first = {}, {}, {}, {}
        self.report = None
        for kind, name in ((FluidPressure, 'pressure'), (JointState, 'plunger_position')):
            self.node.create_subscription(kind, f'/hpv_twin/{name}',
                                          lambda m, name=name: self.note(name, m), 5000)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self.keep, 10)

    def keep(self, report):
        """Remember the newest diagnostics."""
        self.report = {status.name.rpartition(': ')[2]: {v.key: v.value for v in status.values}
                       for status in report.status}

    def note(self, name, message):
        """Take in one message."""
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        before = self.last.get(name)
        if before is None:
            self.first[name] = stamp
        elif abs(stamp - before - PERIOD) > 1000:
            self.gaps.setdefault(name, []).append(stamp - before - PERIOD)
        self.last[name] = stamp
        self.count[name] = self.count.get(name, 0) + 1


def main():
    """Run the soak and print its findings."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--minutes', type=float, default=20.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        twin = subprocess.Popen(
            [sys.executable, '-m', 'hpv_twin', 'twin', '--ros-args', '-p',
             f'record_directory:={folder}'], start_new_session=True)
        rclpy.init()
        listener = Listener()
        try:
            samples = watch(listener, twin, arguments.minutes * 60.0)
        finally:
            os.killpg(twin.pid, signal.SIGINT)
            print(f'twin ended with {twin.wait(30)}')
        recorded(folder)
        findings(listener, samples, sum(path.stat().st_size
                                        for path in Path(folder).rglob('*.mcap')))


def watch(listener, twin, seconds):
    """Listen for so long; rows of (time s, memory bytes, processor seconds) of the twin."""
    while listener.report is None:
        listener.executor.spin_once(timeout_sec=0.1)
    process = psutil.Process(twin.pid)
    began, samples = time.monotonic(), []
    while (now := time.monotonic() - began) < seconds:
        if not samples or now - samples[-1][0] >= EVERY:
            used = process.cpu_times()
            samples.append((now, process.memory_info().rss, used.user + used.system))
            if sys.stderr.isatty():
                print(f'\r{now:.0f} s, {samples[-1][1] * 1e-6:.1f} MB, gaps '
                      f'{sum(map(len, listener.gaps.values()))}', end='', file=sys.stderr)
        listener.executor.spin_once(timeout_sec=0.1)
    return np.array(samples)


def recorded(folder):
    """Print what the recording says: gaps against reported drops, and the frequency."""
    dropped = '0'
    for message in messages(folder, ['/diagnostics']):
        for status in deserialize_message(message.payload, DiagnosticArray).status:
            if status.name.endswith(': timing'):
                dropped = next(v.value for v in status.values if v.key == 'dropped time [s]')
    pressure = read_signals(folder, ['/hpv_twin/pressure'])['/hpv_twin/pressure']
    time_, level = pressure.time, pressure.pressure - 8e6
    steps = np.diff(time_)
    gaps = np.where(np.abs(steps - PERIOD) > PERIOD // 1000, steps - PERIOD, 0)
    print(f'recorded: {len(time_)} pressures, {np.count_nonzero(gaps)} gaps of '
          f'{gaps.sum() * 1e-9:.3f} s in all; the last report says {dropped} s dropped')
    k = np.flatnonzero((level[:-1] < 0.0) & (level[1:] >= 0.0))
    rises = time_[k] - steps[k] * level[k] / (level[k + 1] - level[k])
    # Model time stands still in a gap: wall time without the gaps is what it is compared with.
    span = rises[-1] - rises[0] - gaps[k[0] + 1:k[-1]].sum()
    model = find_cycles(Simulation().advance(1.0, sample_rate=10)).frequency[-1]
    whole = 1e9 * (len(rises) - 1) / span
    print(f'frequency by wall time, {len(rises) - 1} recorded cycles: {whole:.5f} Hz; model '
          f'{model:.5f} Hz, off by {whole / model - 1.0:+.1e}')


def findings(listener, samples, size):
    """Print the table."""
    timing = listener.report['timing']
    for name, count in sorted(listener.count.items()):
        gaps = np.array(listener.gaps.get(name, [0])) * 1e-9
        span = (listener.last[name] - listener.first[name]) * 1e-9
        print(f'{name}: {count} messages in {span:.3f} s by stamp, {gaps.sum() + 0.0:.3f} s in '
              f'{len(listener.gaps.get(name, []))} gaps; reported dropped '
              f'{timing["dropped time [s]"]} s (from the start)')
    for key in ('ticks', 'late by more than 1 ms', 'dropped ticks',
                'lateness p99 since start [ms]', 'real-time factor'):
        print(f'twin, {key}: {timing[key]}')
    time_, memory, used = samples.T
    print(f'processor: {100.0 * (used[-1] - used[0]) / (time_[-1] - time_[0]):.1f} % of a core')
    late = time_ >= min(SETTLED, time_[-1] / 2)
    slope = np.polyfit(time_[late], memory[late], 1)[0]
    print(f'memory: {memory[0] * 1e-6:.1f} MB at the start, {memory[late][0] * 1e-6:.1f} MB after '
          f'{time_[late][0]:.0f} s, {memory[-1] * 1e-6:.1f} MB at the end; slope since then '
          f'{slope * 3600 * 1e-6:+.2f} MB/h')
    print(f'recordings: {size * 1e-6:.1f} MB, {size / time_[-1] * 60e-6:.2f} MB/min; '
          f'recorder dropped {listener.report["recorder"]["dropped"]}')


if __name__ == '__main__':
    main()
