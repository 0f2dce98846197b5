"""
Studies of many designs: time, speed-up, memory; one process, two threads, a dask cluster.

    python bench/studies.py

Every figure is measured in this run; rivals alternate. The map is 100 x 100 designs over pump flow
and preload, each settled and then measured over 40 cycles.
"""
import argparse
import os
import resource
import signal
import statistics
import threading
import time

import numpy as np

from hpv_twin.model import Simulation, Vibrator, find_cycles
from hpv_twin.model.batch import run_designs, threads_available
from hpv_twin.model.designs import Designs
from hpv_twin.model.regimes import SEATED
from hpv_twin.study.farm import Farm
from hpv_twin.study.goals import read_goals
from hpv_twin.study.grid import Axis, Grid
from hpv_twin.study.search import search

BASE = Vibrator()


def timed(function, turns=3):
    """Median and spread (least, most) of the time that a call takes, s."""
    times = []
    for _ in range(turns):
        began = time.perf_counter()
        function()
        times.append(time.perf_counter() - began)
    return statistics.median(times), min(times), max(times)


def text(times):
    """Print a time with its spread."""
    return f'{times[0]:8.2f} s  ({times[1]:.2f} to {times[2]:.2f})'


def map_of(count):
    """The operating map as a grid of count x count designs."""
    return Grid(BASE, {'pump_flow': Axis('pump_flow', 5e-5, 4e-3, count),
                       'preload': Axis('preload', 2e-4, 1e-2, count)})


def scattered(count):
    """Seated designs all alike in cost, as many as asked for."""
    random = np.random.default_rng(1)
    return Designs(BASE, pump_flow=random.uniform(4e-4, 1.2e-3, count),
                   preload=random.uniform(4e-3, 7e-3, count))


def the_map(turns):
    """The 100 x 100 map by threads, and its agreement with single simulations."""
    grid = map_of(100)
    designs = grid.designs(0, len(grid))
    print('a map of 100 x 100 designs, 40 settled cycles each')
    for threads in sorted({1, threads_available()}):
        print(f'  {threads} thread{"s" if threads > 1 else ""}: '
              f'{text(timed(lambda t=threads: run_designs(designs, threads=t), turns))}')
    found = run_designs(designs)
    seated = np.flatnonzero(found['regime'] == SEATED)
    frequency = found['frequency'][seated]
    print(f'  seated motion from {frequency.min():.2f} to {frequency.max():.2f} Hz, {len(seated)} '
          'designs')
    worst = 0.0
    for i in np.random.default_rng(3).choice(seated, 100, replace=False):
        cycles = find_cycles(Simulation(designs.vibrator(i)).advance(
            8.0 / found['frequency'][i], 10.0))
        for name in ('frequency', 'stroke', 'peak_pressure', 'return_pressure'):
            worst = max(worst, abs(getattr(cycles, name)[-1] / found[name][i] - 1.0))
    print(f'  100 random points beside single simulations: off by at most {worst:.1e}')


def per_design(turns):
    """Cost per design and memory, from a hundred to a hundred thousand."""
    print('cost of a design, all threads, chunks of 2000')
    with Farm() as farm:
        for count in (100, 1000, 10_000, 100_000):
            designs = scattered(count)
            times = timed(lambda d=designs: [None for _ in farm.work_off(
                len(d), lambda a, b: d[a:b])], turns if count < 100_000 else 1)
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
            print(f'  {count:7d} designs: {1e6 * times[0] / count:7.1f} µs each, memory so far at '
                  f'most {peak:.0f} MB')


def the_front():
    """A three-objective study of 20,000 evaluations, twice from one seed."""
    goals, fronts = read_goals(BASE), []
    with Farm() as farm:
        def run():
            fronts.append(search(BASE, goals, farm, 200, 20_000, 1)[0])
        times = timed(run, 2)
    same = (fronts[0].objectives == fronts[1].objectives).all()
    print(f'optimise, three objectives, 20,000 evaluations: {text(times)}; '
          f'{len(fronts[0])} points; two runs of one seed {"are identical" if same else "DIFFER"}')


def the_cluster(turns):
    """The map by two dask workers, and once more with one of them killed half-way."""
    import distributed
    grid = map_of(100)
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, host='127.0.0.1',
                                  dashboard_address=None, silence_logs=50) as cluster, \
            Farm(scheduler=cluster.scheduler_address, chunk=500) as farm:
        def run():
            return farm.run(grid.designs(0, len(grid)))
        run()  # each worker loads the compiled model
        times = timed(run, turns)
        print(f'the map by dask, two workers of one thread: {text(times)}')

        def kill():
            time.sleep(times[0] / 2)
            with distributed.Client(cluster.scheduler_address) as client:
                pid = next(iter(client.run(os.getpid).values()))
            os.kill(pid, signal.SIGKILL)
        whole = run()
        killer = threading.Thread(target=kill)
        killer.start()
        began = time.perf_counter()
        found = run()
        lasted = time.perf_counter() - began
        killer.join()
        same = (found['regime_code'] == whole['regime_code']).all() and np.array_equal(
            found['frequency'], whole['frequency'], equal_nan=True)
        print(f'  with a worker killed half-way: {lasted:.2f} s; results '
              f'{"the same" if same else "DIFFER"}')


def main():
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--turns', type=int, default=3)
    arguments = parser.parse_args()
    run_designs(scattered(10))  # compile
    run_designs(scattered(10), threads=1)
    the_map(arguments.turns)
    per_design(arguments.turns)
    the_front()
    the_cluster(arguments.turns)


if __name__ == '__main__':
    main()
