"""
What recording costs the twin: processor, lateness, disk, at 1, 5 and 20 kHz.

    python bench/recorder_cost.py

Each rate stands beside the same twin unrecorded, in turns within one run: share of a core, 99th
percentile of the lateness, bytes a minute. A subscriber to /diagnostics is all that listens.
"""
import argparse
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('ROS_DOMAIN_ID', '95')

import psutil
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor

CASES = {'unrecorded': ('record:=false',), '1 kHz': ('record_rate:=1000.0',),
         '5 kHz': ('record_rate:=5000.0',), '20 kHz': ('record_rate:=20000.0',)}
SETTLING = 2.0  # s


class Listener:
    """Keeps every value of the timing and recorder status."""

    def __init__(self):
        self.node = rclpy.create_node('recorder_cost')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.reports = []
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self.keep, 10)

    def keep(self, report):
        """Remember a report."""
        self.reports.append({status.name.rpartition(': ')[2]: {v.key: v.value
                                                               for v in status.values}
                             for status in report.status})

    def spin(self, seconds):
        """Listen for so long."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.05)


def measure(listener, parameters, seconds):
    """Share of a core, median over the seconds of the p99 lateness (ms), bytes/s, dropped."""
    with tempfile.TemporaryDirectory() as folder:
        arguments = ['-p', f'record_directory:={folder}', '-p', 'record_max_size:=1.0e+10']
        for parameter in parameters:
            arguments += ['-p', parameter]
        command = [sys.executable, '-m', 'hpv_twin', 'twin', '--ros-args', *arguments]
        twin = subprocess.Popen(command, start_new_session=True, stderr=subprocess.DEVNULL)
        listener.reports.clear()
        while len(listener.reports) < SETTLING:
            listener.spin(0.1)
        listener.reports.clear()
        process = psutil.Process(twin.pid)
        before, began = process.cpu_times(), time.monotonic()
        size_before = size_of(folder)
        listener.spin(seconds)
        after, lasted = process.cpu_times(), time.monotonic() - began
        written = size_of(folder) - size_before
        os.killpg(twin.pid, signal.SIGINT)
        twin.wait(30)
        share = (after.user + after.system - before.user - before.system) / lasted
        late = [float(report['timing']['lateness p99 [ms]']) for report in listener.reports]
        dropped = int(listener.reports[-1]['recorder'].get('dropped', 0) or 0)
        return share, statistics.median(late), written / lasted, dropped


def size_of(folder):
    """Bytes in all files below a folder."""
    return sum(path.stat().st_size for path in Path(folder).rglob('*.mcap'))


def main():
    """Measure all cases in turns and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--seconds', type=float, default=15.0, help='of each turn (%(default)s)')
    parser.add_argument('--turns', type=int, default=3)
    arguments = parser.parse_args()
    rclpy.init()
    listener = Listener()
    found = {name: [] for name in CASES}
    for _ in range(arguments.turns):
        for name, parameters in CASES.items():
            found[name].append(measure(listener, parameters, arguments.seconds))
    shares = {name: [turn[0] for turn in turns] for name, turns in found.items()}
    print(f'{arguments.turns} turns of {arguments.seconds:g} s each; lateness: median of the p99 '
          'of every second')
    print(f'{"":12}{"of a core":>12}{"recorder":>12}{"p99 late":>12}{"added":>10}'
          f'{"MB/min":>10}{"GB/week":>10}{"dropped":>9}')
    quiet = statistics.median(turn[1] for turn in found['unrecorded'])
    for name, turns in found.items():
        share = statistics.median(shares[name])
        own = [a - b for a, b in zip(shares[name], shares['unrecorded'], strict=True)]
        late = statistics.median(turn[1] for turn in turns)
        rate = statistics.median(turn[2] for turn in turns)
        print(f'{name:12}{100 * share:>10.1f} %{100 * statistics.median(own):>+10.1f} %'
              f'{late:>9.3f} ms{late - quiet:>+10.3f}{rate * 60e-6:>10.2f}'
              f'{rate * 604800e-9:>10.1f}{max(turn[3] for turn in turns):>9}')


if __name__ == '__main__':
    main()
