"""
How fast and how exact the model is, beside other ways to run the same equations.

    python bench/model_speed.py [--seconds 10] [--repeats 7] [--only default,'C Euler']
                                [--tables speed,length,designs,calls,start]

Every repeat runs every rival, one after the other (those that take milliseconds in five rounds, of
which the median counts), so that what else the machine does falls on all of them; what counts are
the ratios within one run. It takes two to four minutes. A C compiler (`cc`) is needed.
docs/benchmarks.md explains the tables.
"""
import argparse
import gc
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
import tracemalloc
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from rivals import RIVALS, CEuler, KernelEuler, Package

from hpv_twin.model import Simulation, Vibrator, find_cycles

ROOT = Path(__file__).resolve().parents[1]
BASE = Vibrator()
RATE = 1000.0  # Hz of output
WARM_UP = 0.3  # model s: compiles, loads and pages in
SHORT, ROUNDS = 0.02, 5  # s; a run as short as this is made so often in each repeat
WORKERS = 2


def say(text):
    """Tell on standard error what is being done."""
    print(f'... {text}', file=sys.stderr, flush=True)


def timed(call, before=None):
    """Wall time of a call, s, and what it returned; no garbage is collected meanwhile."""
    gc.collect()
    gc.disable()
    try:
        if before is not None:
            before()
        start = time.perf_counter()
        found = call()
        return time.perf_counter() - start, found
    finally:
        gc.enable()


def table(title, heads, rows):
    """Print rows of text under their heads, the first column to the left."""
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    print(f'\n{title}\n')
    for line in [heads, ['-' * width for width in widths], *rows]:
        cells = [cell.rjust(width) for cell, width in zip(line, widths, strict=True)]
        print('  '.join([line[0].ljust(widths[0]), *cells[1:]]).rstrip())


def spread(values, scale, form):
    """Median (least .. most)."""
    values = [value * scale for value in values]
    return (f'{statistics.median(values):{form}} '
            f'({min(values):{form}} .. {max(values):{form}})')


def machine() -> str:
    """What this ran on."""
    model = platform.machine()
    info = Path('/proc/cpuinfo')
    if info.exists():
        names = [line.split(':')[1].strip() for line in info.read_text().splitlines()
                 if line.startswith('model name')]
        model = names[0] if names else model
    compiler = subprocess.run(['cc', '--version'], capture_output=True, text=True, check=True)
    packages = ', '.join(f'{name} {version(name)}' for name in ('numpy', 'numba', 'scipy'))
    return (f'{model}, {os.cpu_count()} cores, {platform.system()}; Python '
            f'{platform.python_version()}, {packages}; {compiler.stdout.splitlines()[0]}, '
            '-O3 -march=native')


def oracle():
    """Period, s, and highest pressure, Pa, of the base design by the tests' second model."""
    sys.path.insert(0, str(ROOT / 'test' / 'model'))
    from oracle import Oracle
    cycle = Oracle(BASE).run(0.15).cycles()[-1]
    return cycle.period, cycle.peak_pressure


# Speed and error --------------------------------------------------------------------------------


def speed(seconds, repeats, names):
    """The main table: all rivals, interleaved."""
    period, peak = oracle()
    spans = {name: min(seconds, RIVALS[name].longest) for name in names}
    took = {name: [] for name in names}
    results = {}
    for repeat in range(repeats):
        say(f'speed: repeat {repeat + 1} of {repeats}')
        walls = {name: [] for name in names}
        for turn in range(ROUNDS):
            for name in names:
                if turn == 0 or walls[name][0] < SHORT:
                    # The first call compiles and loads; after another rival the caches are cold.
                    warm_up = RIVALS[name](BASE, WARM_UP, RATE)
                    rival = RIVALS[name](BASE, spans[name], RATE)
                    wall, found = timed(rival.run, warm_up.run)
                    walls[name].append(wall)
                    results[name] = rival.result(found)
        for name in names:
            took[name].append(statistics.median(walls[name]) / spans[name])
    rows = []
    for name in names:
        say(f'memory of {name}')
        ratios = [statistics.median(one / other for one, other
                                    in zip(took[name], took[rival], strict=True))
                  for rival in ('C Euler', 'C Euler, one loop')]
        rows.append([
            name, f'{spans[name]:g}', spread(took[name], 1e9, ',.0f'),
            f'{1.0 / statistics.median(took[name]):,.0f}', *(f'{ratio:.3g}' for ratio in ratios),
            f'{results[name].period / period - 1.0:+.1e}',
            f'{results[name].peak_pressure / peak - 1.0:+.1e}',
            f'{memory(name, spans[name]):.1f}'])
    table(f'{seconds:g} model seconds of the base design, output at {RATE:g} Hz; {repeats} repeats',
          ['rival', 'model s', 'ns per model s', 'x real time', '/ C Euler', '/ one loop',
           'period', 'peak', 'MB'], rows)
    print('\nns: median (least .. most) of the repeats. Ratios: median of those within a repeat. '
          'period, peak: relative error\nof the mean over the cycles. MB: most memory allocated at '
          'once in a run; the kernel alone gets its arrays from\noutside.')


def memory(name, seconds) -> float:
    """MB that a run allocates and holds at its peak, by Python's and NumPy's own count."""
    rival = RIVALS[name](BASE, seconds, RATE)
    gc.collect()
    tracemalloc.start()
    try:
        rival.run()
        return tracemalloc.get_traced_memory()[1] * 1e-6
    finally:
        tracemalloc.stop()


# Length of the run, number of designs -----------------------------------------------------------


class Slices(Package):
    """Ten seconds at a time, each trace dropped when the next comes."""

    def run(self):
        """Run; returns the last trace."""
        simulation = self.simulation
        while simulation.time < self.seconds:
            trace = simulation.advance(min(10.0, self.seconds - simulation.time), self.rate)
        return trace


def length(repeats):
    """Cost of a model second against the number of them."""
    period, _ = oracle()
    rows = []
    for seconds in (1.0, 10.0, 100.0, 1000.0, 10_000.0):
        say(f'{seconds:g} model seconds')
        took = {Package: [], Slices: [], CEuler: []}
        # The trace of the longest run would need gigabytes: nobody makes it in one piece.
        ways = took if seconds <= 1000.0 else [Slices]
        count = max(1, int(10.0 / seconds))
        for _ in range(max(1, min(repeats, int(1000.0 / seconds)))):
            for way in ways:
                rivals = [way(BASE, seconds, RATE) for _ in range(count)]
                wall, _ = timed(lambda r=rivals: [rival.run() for rival in r],
                                way(BASE, WARM_UP, RATE).run)
                took[way].append(wall / (count * seconds))
        last = find_cycles(Slices(BASE, seconds, RATE).run()).period[-1]
        rows.append([f'{seconds:,.0f}',
                     *(f'{statistics.median(values) * 1e9:,.0f}' if values else '-'
                       for values in took.values()), f'{last / period - 1.0:+.0e}'])
    table('ns per model second against the length of the run, output at 1 kHz',
          ['model s', 'default, one call', 'default, 10 s a call', 'C Euler, one call',
           'error of the last period'], rows)


def task(flow):
    """One design: what a study repeats."""
    return Simulation(BASE.replace(pump_flow=flow)).advance(1.0, RATE).pressure[-1]


def c_task(flow):
    """The same by the C Euler."""
    return CEuler(BASE.replace(pump_flow=flow), 1.0, RATE).run()[0][-1, 0]


def designs(repeats):
    """Cost of a design against their number, one after the other and abreast."""
    start, processes = timed(lambda: ProcessPoolExecutor(WORKERS, get_context('spawn')))
    start += timed(lambda: list(processes.map(task, [BASE.pump_flow] * 2 * WORKERS)))[0]
    threads = ThreadPoolExecutor(WORKERS)
    rows = []
    for number in (1, 10, 100, 1000):
        say(f'{number} designs')
        flows = np.linspace(0.3, 1.0, number) * BASE.pump_flow
        chunk = max(1, number // (4 * WORKERS))
        ways = (lambda f=flows: list(map(task, f)),
                lambda f=flows: list(threads.map(task, f)),
                lambda f=flows, c=chunk: list(processes.map(task, f, chunksize=c)),
                lambda f=flows: list(map(c_task, f)),
                lambda f=flows: list(threads.map(c_task, f)))
        took = [[] for _ in ways]
        for _ in range(repeats):
            for values, way in zip(took, ways, strict=True):
                values.append(timed(way)[0] / number)
        rows.append([f'{number:,d}', *(f'{statistics.median(values) * 1e6:,.0f}'
                                       for values in took)])
    gains = [gain(threads, rival, repeats) for rival in (KernelEuler, CEuler)]
    threads.shutdown()
    processes.shutdown()
    table(f'us per design and model second, different flows, output at 1 kHz; {WORKERS} workers',
          ['designs', 'default, serial', 'threads', 'processes', 'C Euler, serial', 'threads'],
          rows)
    print(f'\nStarting the {WORKERS} processes took {start:.1f} s. Two runs of 100 s in two '
          'threads, against one after the other:\n'
          f'the kernel of euler is {gains[0]:.2f} times as fast, C (which releases the '
          f'interpreter) {gains[1]:.2f} times.')


def gain(threads, rival, repeats):
    """How much faster two runs of a rival are in two threads than one after the other."""
    ratios = []
    for _ in range(repeats):
        # Long enough for the system to give the second thread a core of its own.
        runs = [rival(BASE, 100.0, RATE) for _ in range(4)]
        one, _ = timed(lambda r=runs: [run.run() for run in r[:2]], rival(BASE, 1.0, RATE).run)
        both, _ = timed(lambda r=runs: list(threads.map(lambda run: run.run(), r[2:])))
        ratios.append(one / both)
    return statistics.median(ratios)


# Single calls, start ----------------------------------------------------------------------------


def each(call, count):
    """Wall times of `count` calls, s."""
    clock = time.perf_counter
    took = np.empty(count)
    for i in range(count):
        start = clock()
        call()
        took[i] = clock() - start
    return took


def calls(_):
    """Cost of what a real-time loop and a study call one by one."""
    rows = []

    def row(name, took):
        p50, p99 = np.percentile(took, (50, 99)) * 1e6
        rows.append([name, f'{p50:.2f}', f'{p99:.2f}', f'{np.mean(took) * 1e6:.2f}'])
    for method in ('default', 'euler'):
        say(f'single calls, {method}')
        simulation = Simulation(BASE, method)
        simulation.advance(WARM_UP)
        row(f'{method}: tick(1e-3)', each(lambda s=simulation: s.tick(1e-3), 20_000))
        flows = (BASE.pump_flow, 1.001 * BASE.pump_flow)

        def change(s=simulation, flows=flows):
            s.pump_flow = flows[s.pump_flow == flows[0]]

        def both(s=simulation, change=change):
            change()
            s.tick(1e-3)
        row(f'{method}: new pump_flow, then tick(1e-3)', each(both, 20_000))
    row('new pump_flow alone', each(change, 5000))
    row('Simulation()', each(lambda: Simulation(BASE), 2000))
    trace = Simulation(BASE).advance(1.0, RATE)
    row('find_cycles of 1 s (55 cycles)', each(lambda: find_cycles(trace), 200))
    table('Single calls, us (1000 ticks are a model second)', ['call', 'p50', 'p99', 'mean'], rows)


def environment(**variables):
    """Environment of a new process that finds this package."""
    paths = [str(ROOT), os.environ.get('PYTHONPATH', '')]
    return {**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, paths)), **variables}


def start(repeats):
    """Import and first advance in new processes, without and with machine code on disk."""
    code = ('import time; t = time.perf_counter()\n'
            'from hpv_twin.model import Simulation\n'
            'u = time.perf_counter(); Simulation().advance(0.1, 1000)\n'
            'print(u - t, time.perf_counter() - u)')
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, count in (('cold', 1), ('warm', repeats)):
            took = []
            for _ in range(count):
                say(f'start, {name} cache')
                wall, answer = timed(lambda: subprocess.run(
                    [sys.executable, '-c', code], env=environment(NUMBA_CACHE_DIR=folder),
                    stdout=subprocess.PIPE, text=True, check=True))
                first, second = map(float, answer.stdout.split())
                took.append((first, second, first + second, wall))
            rows.append([name, *(spread(values, 1.0, '.2f')
                                 for values in zip(*took, strict=True))])
    table('Start of a process, s', ['cache', 'import', 'first advance', 'both', 'whole process'],
          rows)


# ------------------------------------------------------------------------------------------------

TABLES = {'speed': None, 'length': length, 'designs': designs, 'calls': calls, 'start': start}


def main() -> None:
    """Read the arguments and print the tables asked for."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seconds', type=float, default=10.0,
                        help='model seconds of the first table; slow rivals run fewer, and say so')
    parser.add_argument('--repeats', type=int, default=7, help='how often each rival runs')
    parser.add_argument('--only', default='',
                        help='rivals whose names contain one of these, comma-separated; the two '
                        f'of C always run. All: {"; ".join(RIVALS)}')
    parser.add_argument('--tables', default=','.join(TABLES), help='all of them: %(default)s')
    arguments = parser.parse_args()
    chosen = arguments.tables.split(',')
    wanted = arguments.only.lower().split(',')
    unknown = sorted(set(chosen) - set(TABLES))
    if unknown:
        parser.error(f'no table is called {", ".join(unknown)}; there are {", ".join(TABLES)}')
    if arguments.repeats < 1 or arguments.seconds < WARM_UP:
        parser.error(f'at least one repeat and {WARM_UP} model seconds are needed')
    print(machine())
    for name in chosen:
        if name == 'speed':
            speed(arguments.seconds, arguments.repeats,
                  [rival for rival in RIVALS
                   if rival.startswith('C Euler') or any(w in rival.lower() for w in wanted)])
        else:
            TABLES[name](arguments.repeats)


if __name__ == '__main__':
    main()
