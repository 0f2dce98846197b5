"""
Each fault against each alarm: detections, false alarms, confusions; and a healthy hour.

    python bench/fault_matrix.py [--runs 20] [--severity 0.4] [--healthy 3600]

The pure room: the stand-in machine measured at 1 kHz with noise, the tracker and the condition as
the node runs them. After 6 s a fault is switched on; what is said 6 s later counts. In the healthy
hour (model time) the setpoints change every 20 s.
"""
import argparse
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from hpv_twin.model import Vibrator
from hpv_twin.model.faults import FAULTS
from hpv_twin.model.machine import Machine
from hpv_twin.tracking.condition import Condition
from hpv_twin.tracking.tracker import Tracker

RATE, SLICE = 1000.0, 0.02
NOISE = 8e4  # Pa
ALARMS = (*FAULTS, 'slow_build_up')


class Bench:
    """A machine, its sensor, its tracker and its condition."""

    def __init__(self, seed):
        self.random = np.random.default_rng(seed)
        self.machine = Machine(Vibrator())
        self.machine.tick(0.3 + 0.02 * self.random.random())
        self.tracker, self.condition = Tracker(Vibrator()), Condition()
        self.alarms = Counter()
        self.first = {}

    def go(self, duration):
        """Let `duration` s pass."""
        for _ in range(round(duration / SLICE)):
            trace = self.machine.simulation.advance(SLICE, RATE)
            shown = trace.pressure + NOISE * self.random.standard_normal(len(trace.time))
            for estimate in self.tracker.feed(trace.time, shown):
                self.condition.feed(estimate, self.tracker.trusted,
                                    bool(self.tracker.candidates))
            for fault in self.condition.findings:
                self.first.setdefault(fault, trace.time[-1])
                self.alarms[fault] += 1

    def say(self, **setpoints):
        """Tell machine and tracker of setpoints."""
        for name, value in setpoints.items():
            self.machine.set(name, value)
        self.tracker.command(self.machine.simulation.time, **setpoints)


def faulty(fault, severity, seed):
    """Return the alarms before and after a fault, and how long the right one took, s."""
    bench = Bench(seed)
    bench.go(6.0)
    before = set(bench.alarms)
    if fault != 'none':
        bench.machine.set_fault(fault, severity)
    began = bench.machine.simulation.time
    bench.go(6.0)
    took = bench.first.get(fault, np.nan) - began
    return before, set(bench.condition.findings), took


def healthy(duration, seed):
    """Return the alarms in a healthy run with a change of setpoints every 20 s."""
    bench = Bench(seed)
    while bench.machine.simulation.time < duration:
        bench.go(min(20.0, duration))
        bench.say(pump_flow=bench.random.uniform(4e-4, 1.2e-3),
                  preload=bench.random.uniform(4e-3, 7e-3))
    return dict(bench.alarms), bench.tracker.skipped


def main():
    """Print the matrix; exit status 1 for a false alarm, a confusion or a fault not found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=20)
    parser.add_argument('--severity', type=float, default=0.4)
    parser.add_argument('--healthy', type=float, default=3600.0, help='s of model time, in all')
    parser.add_argument('--processes', type=int, default=1)
    arguments = parser.parse_args()
    faults = ('none', *FAULTS)
    jobs = [(fault, arguments.severity, seed) for fault in faults
            for seed in range(arguments.runs)]
    good = True
    with ProcessPoolExecutor(arguments.processes) as pool:
        rows = list(pool.map(faulty, *zip(*jobs, strict=True)))
        print(f'{arguments.runs} runs each, severity {arguments.severity:g}: runs in which the '
              'alarm (column) stands 6 s after the fault (row)\n')
        print(' ' * 18 + ''.join(f'{alarm:>18}' for alarm in ALARMS) + f'{"median s":>10}'
              f'{"false before":>14}')
        for fault in faults:
            mine = [row for job, row in zip(jobs, rows, strict=True) if job[0] == fault]
            counts = [sum(alarm in after for _, after, _ in mine) for alarm in ALARMS]
            early = sum(bool(before) for before, _, _ in mine)
            took = np.nanmedian([row[2] for row in mine]) if fault != 'none' else np.nan
            print(f'{fault:18}' + ''.join(f'{count:18}' for count in counts)
                  + f'{took:10.2f}{early:14}', flush=True)
            right = [count for alarm, count in zip(ALARMS, counts, strict=True) if alarm == fault]
            good &= early == 0 and sum(counts) == sum(right)
            good &= not right or right[0] == len(mine)
        parts = max(1, round(arguments.healthy / 600.0))
        for k, (alarms, skipped) in enumerate(pool.map(
                healthy, [arguments.healthy / parts] * parts, range(100, 100 + parts))):
            print(f'healthy, {arguments.healthy / parts:.0f} s with setpoint changes, part '
                  f'{k + 1} of {parts}: alarms {alarms or "none"}, {skipped} windows not used',
                  flush=True)
            good &= not alarms
    return 0 if good else 1


if __name__ == '__main__':
    sys.exit(main())
