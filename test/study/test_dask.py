"""Studies on a dask cluster: two real worker processes, the same figures, a worker killed."""
import os
import signal
import threading
import time

import numpy as np
import pytest

pytest.importorskip('distributed')
pytest.importorskip('joblib')
import distributed

from hpv_twin.model import Vibrator
from hpv_twin.study import farm, optimise, sweep
from hpv_twin.study import grid as grids
from hpv_twin.study.farm import Farm
from hpv_twin.study.results import read_columns

# Its own sockets, closed when they are collected, are not ours to mend.
pytestmark = [pytest.mark.filterwarnings('ignore'), pytest.mark.timeout(300)]


@pytest.fixture(scope='module')
def cluster():
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True,
                                  host='127.0.0.1', dashboard_address=None,
                                  silence_logs=50) as cluster:
        yield cluster


def seated_grid(count):
    return grids.Grid(Vibrator(), {'pump_flow': grids.Axis('pump_flow', 2e-4, 2e-3, count),
                                   'preload': grids.Axis('preload', 3e-3, 8e-3, count)})


def test_a_map_by_two_workers_is_the_map_by_this_machine(cluster, tmp_path, capsys):
    arguments = ['--pump-flow', '2e-4:2e-3:30', '--preload', '3e-3:8e-3:30']
    here, there = tmp_path / 'here.csv', tmp_path / 'there.csv'
    assert sweep.main([*arguments, '-o', str(here)]) == 0
    assert sweep.main([*arguments, '-o', str(there), '--dask', cluster.scheduler_address]) == 0
    capsys.readouterr()
    assert here.read_text() == there.read_text()


def test_a_front_by_two_workers_is_the_front_by_this_machine(cluster, tmp_path, capsys):
    fronts = []
    for name, more in (('here', []), ('there', ['--dask', cluster.scheduler_address])):
        path = tmp_path / f'{name}.csv'
        assert optimise.main(['--evaluations', '300', '--population', '60', '-o', str(path),
                              *more]) == 0
        fronts.append(read_columns(path))
    capsys.readouterr()
    assert (fronts[0]['impact_energy'] == fronts[1]['impact_energy']).all()


def test_a_killed_worker_costs_time_and_no_result(cluster):
    grid = seated_grid(60)
    with Farm() as workers:
        expected = workers.run(grid.designs(0, len(grid)))
    victim = {}

    def kill_one():
        time.sleep(0.3)
        with distributed.Client(cluster.scheduler_address) as client:
            victim['pid'] = next(iter(client.run(os.getpid).values()))
        os.kill(victim['pid'], signal.SIGKILL)
    with Farm(scheduler=cluster.scheduler_address, chunk=100) as workers:
        killer = threading.Thread(target=kill_one)
        killer.start()
        found = workers.run(grid.designs(0, len(grid)))
        killer.join()
    assert victim['pid']
    assert (np.nan_to_num(found['frequency']) == np.nan_to_num(expected['frequency'])).all()
    assert (found['regime'] == expected['regime']).all()


def test_a_scheduler_that_is_not_there_is_told_in_one_line(capsys, monkeypatch):
    monkeypatch.setattr(farm, 'ANSWER', 2)
    assert sweep.main(['--pump-flow', '2e-4:2e-3:3', '--preload', '3e-3:8e-3:3', '--dask',
                       'tcp://127.0.0.1:9']) == 2
    said = capsys.readouterr().err
    assert 'tcp://127.0.0.1:9' in said and 'Traceback' not in said
