"""`optimise`: a front that nothing tried beats, the same from its seed, and designs that run."""
import os
import signal
import subprocess
import sys
import time
from itertools import product

import numpy as np
import pytest

pytest.importorskip('pymoo')

from hpv_twin.model import Simulation, Vibrator, VibratorError, find_cycles
from hpv_twin.study import optimise
from hpv_twin.study.farm import Farm
from hpv_twin.study.front import Front, beaten, choose, minimised
from hpv_twin.study.goals import OBJECTIVES, read_goals
from hpv_twin.study.optimise import read_front
from hpv_twin.study.problem import DesignProblem
from hpv_twin.study.search import search

BASE = Vibrator()


@pytest.fixture(scope='module')
def found():
    """The default study, small: goals, problem and front."""
    goals = read_goals(BASE)
    with Farm() as farm:
        front, done = search(BASE, goals, farm, 100, 6000, 1)
        yield goals, DesignProblem(BASE, goals, farm), front
    assert done == 6000


def test_every_point_keeps_the_constraints_and_none_beats_another(found):
    goals, problem, front = found
    x = np.stack([front.columns[name] for name in goals.bounds], axis=1)
    again = problem.measure(x)
    assert (problem.constraints(again) <= 0.0).all()
    assert (problem.objectives(again) == front.objectives).all()
    assert not beaten(front.objectives, front.objectives).any()
    assert (again['regime'] == 'seated oscillation').all()
    assert (again['period_spread'] <= 1e-6).all()


def test_front_contains_the_extremes_of_a_coarse_grid(found):
    goals, problem, front = found
    axes = [np.linspace(low, high, 6) for low, high in goals.bounds.values()]
    columns = problem.measure(np.array(list(product(*axes))))
    kept = (problem.constraints(columns) <= 0.0).all(axis=1)
    grid = problem.objectives(columns)[kept]
    assert kept.sum() > 50
    assert (front.objectives.min(axis=0) <= grid.min(axis=0)).all()


def test_the_same_seed_gives_the_same_front_whatever_the_threads():
    goals = read_goals(BASE)
    fronts = []
    for threads, seed in ((1, 7), (None, 7), (None, 8)):
        with Farm(threads) as farm:
            fronts.append(search(BASE, goals, farm, 40, 400, seed)[0])
    assert (fronts[0].objectives == fronts[1].objectives).all()
    for name in goals.bounds:
        assert (fronts[0].columns[name] == fronts[1].columns[name]).all()
    assert fronts[0].objectives.shape != fronts[2].objectives.shape or (
        fronts[0].objectives != fronts[2].objectives).any()


def test_front_file_and_a_chosen_point_as_a_design(tmp_path, capsys):
    csv, design, picture = (tmp_path / name for name in ('front.csv', 'best.yaml', 'front.png'))
    small = ['--evaluations', '1000', '--population', '50']
    assert optimise.main([*small, '-o', str(csv), '--design', str(design), '--choose',
                          'best:impact_energy', '--plot', str(picture)]) == 0
    study, columns = read_front(csv)
    assert picture.stat().st_size > 20_000
    best = int(np.argmax(columns['impact_energy']))
    vibrator = Vibrator.load(design)
    for name in study['free']:
        assert getattr(vibrator, name) == columns[name][best]
    # The plunger carries its spring: k1 by (21) and m1 by (4) go together.
    assert vibrator.plunger_mass != BASE.plunger_mass
    assert f'seed 1, point {best + 1}' in design.read_text()
    cycles = find_cycles(Simulation(vibrator).advance(8.0 / columns['frequency'][best], 10.0))
    assert cycles.frequency[-1] == pytest.approx(columns['frequency'][best], rel=1e-6)
    assert cycles.peak_pressure[-1] == pytest.approx(columns['peak_pressure'][best], rel=1e-6)
    # Another point later, from the file; and no file is overwritten.
    assert optimise.main(['--from', str(csv), '--choose', '1', '--design', str(design)]) == 0
    assert 'point 1' in design.read_text()
    assert optimise.main([*small, '-o', str(csv)]) == 2
    assert 'exists' in capsys.readouterr().err


def test_ctrl_c_keeps_the_front_so_far(tmp_path):
    csv = tmp_path / 'front.csv'
    child = subprocess.Popen(
        [sys.executable, '-m', 'hpv_twin', 'optimise', '--evaluations', '100000000', '-o',
         str(csv)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True)
    # What a kill would leave is there before it ends.
    deadline = time.monotonic() + 90.0
    while not csv.exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    on_the_way = read_front(csv)[0]['tried']
    os.killpg(child.pid, signal.SIGINT)
    out, err = child.communicate(timeout=60)
    assert child.returncode == 130, err
    assert 'Traceback' not in err
    assert 'points on the front' in out
    study, columns = read_front(csv)
    assert len(columns['frequency']) > 10 and on_the_way <= study['tried'] < 100_000_000
    assert [path.name for path in tmp_path.iterdir()] == ['front.csv']


@pytest.mark.parametrize('text, words', [
    ('free: {gap_ratio: [0.2, 0.9]}', ['gap_ratio', '0.9', '[0.2, 0.5]']),
    ('free: {gap_ratio: [0.4, 0.3]}', ['gap_ratio', '0.4 is not below 0.3']),
    ('free: {gap_ration: [0.2, 0.3]}', ['no field "gap_ration"']),
    ('free: [gap_ratio]', ['free', 'expected']),
    ('limits: {stress: 1.0}', ['limits', 'spring_stress']),
    ('limits: {spring_stress: -1}', ['spring_stress', 'above 0']),
    ('frequency_band: 50', ['frequency_band', '[low, high]']),
    ('goals: 1', ['expected the keys']),
    ('a: [', ['study.yaml']),
])
def test_a_bad_study_is_one_line_and_exit_code_2(tmp_path, capsys, text, words):
    path = tmp_path / 'study.yaml'
    path.write_text(text)
    assert optimise.main([str(path)]) == 2
    said = capsys.readouterr().err
    assert said.startswith('hpv-twin optimise: ') and 'Traceback' not in said
    for word in words:
        assert word in said


@pytest.mark.parametrize('arguments, words', [
    (['--free', 'gap'], ['no field "gap"']),
    (['--objectives', 'speed'], ['no objective "speed"']),
    (['--without', 'luck'], ['no constraint "luck"']),
    (['--population', '2'], ['--population']),
    (['--from', 'absent.csv'], ['absent.csv', 'No such file']),
])
def test_bad_arguments_are_one_line_and_exit_code_2(capsys, arguments, words):
    assert optimise.main(arguments) == 2
    said = capsys.readouterr().err
    for word in words:
        assert word in said


def test_where_nothing_keeps_the_constraints_it_says_so(tmp_path, capsys):
    path = tmp_path / 'study.yaml'
    path.write_text('limits: {spring_stress: 1.0}')
    assert optimise.main([str(path), '--evaluations', '200', '--population', '50']) == 1
    assert 'no design met' in capsys.readouterr().err


def test_the_example_study_says_what_holds_without_it():
    import os.path
    here = os.path.dirname(__file__)
    goals = read_goals(BASE, os.path.join(here, '..', '..', 'config', 'optimise.yaml'))
    default = read_goals(BASE)
    assert (goals.limits, goals.spring, goals.band) == (default.limits, default.spring,
                                                        default.band)
    assert tuple(goals.bounds) == tuple(default.bounds)


def test_what_is_beaten_and_what_is_chosen():
    points = np.array([[0.0, 3.0], [1.0, 1.0], [3.0, 0.0], [2.0, 2.0], [1.0, 1.0]])
    assert beaten(points, points).tolist() == [False, False, False, True, False]
    front = points[:3]
    assert choose(front, ('a', 'b'), 'knee') == 1
    assert choose(front, ('a', 'b'), 'best:b') == 2
    assert choose(front, ('a', 'b'), '1') == 0
    for wish in ('0', '4', 'best:c', 'middle'):
        with pytest.raises(VibratorError, match='--choose'):
            choose(front, ('a', 'b'), wish)


def test_a_front_loses_nothing_and_keeps_no_beaten_point():
    random = np.random.default_rng(2)
    points = random.normal(size=(600, 3))
    front = Front()
    for part in np.split(points, 6):
        front.take_in({'x': part[:, 0]}, part, np.zeros((len(part), 1)))
    best = points[~beaten(points, points)]
    front = front.sorted()
    assert (front.objectives == best[np.lexsort(best.T[::-1])]).all()
    assert (front.columns['x'] == front.objectives[:, 0]).all()


def test_objectives_that_are_to_be_large_are_turned():
    columns = {'impact_energy': np.array([1.0]), 'peak_pressure': np.array([2.0])}
    assert minimised(columns, ('impact_energy', 'peak_pressure')).tolist() == [[-1.0, 2.0]]
    assert set(OBJECTIVES) == {'impact_energy', 'mean_power', 'efficiency', 'frequency_band',
                               'peak_pressure', 'pressure_rate'}
