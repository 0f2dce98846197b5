"""`sweep`: the map is that of single simulations, is kept, gone on with, and answers questions."""
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip('tqdm')

from hpv_twin.model import Simulation, Vibrator, find_cycles
from hpv_twin.model.batch import FIGURES, run_designs
from hpv_twin.model.regimes import SEATED
from hpv_twin.study import grid as grids
from hpv_twin.study import results, sweep, want
from hpv_twin.study.farm import Farm

BASE = Vibrator()
SMALL = ['--pump-flow', '2e-4:4e-3:12', '--preload', '1e-3:9e-3:9']


def seated_map(count=60):
    axes = {'pump_flow': grids.Axis('pump_flow', 5e-5, 8e-3, count),
            'preload': grids.Axis('preload', 2e-4, 1e-2, count)}
    grid = grids.Grid(BASE, axes)
    return grid, run_designs(grid.designs(0, len(grid)))


def test_map_reaches_15_and_150_hz_seated_and_is_that_of_single_simulations():
    grid, columns = seated_map()
    seated = np.flatnonzero(columns['regime'] == SEATED)
    assert columns['frequency'][seated].min() < 15.0 and columns['frequency'][seated].max() > 150.0
    assert np.nanmax(columns['period_spread'][seated]) < 1e-9
    rng = np.random.default_rng(3)
    for i in rng.choice(seated, 100, replace=False):
        design = grid.designs(i, i + 1).vibrator(0)
        cycles = find_cycles(Simulation(design).advance(6.0 / columns['frequency'][i], 10.0))
        for name in ('frequency', 'stroke', 'peak_pressure', 'return_pressure'):
            assert columns[name][i] == pytest.approx(getattr(cycles, name)[-1], rel=1e-6)


def test_csv_names_its_study_and_has_a_row_per_design(tmp_path, capsys):
    path = tmp_path / 'map.csv'
    assert sweep.main([*SMALL, '-o', str(path)]) == 0
    header, names, *rows = path.read_text().splitlines()
    study = json.loads(header.removeprefix(results.MARK))
    assert study['design']['stroke'] == 0.002 and study['x'].startswith('pump_flow 0.0002:')
    assert names.split(',') == ['pump_flow', 'preload', *FIGURES, 'regime']
    assert len(rows) == 108
    assert 'seated oscillation' in capsys.readouterr().out
    columns = results.read_columns(path)
    again = run_designs(grids.Grid(BASE, {
        'pump_flow': grids.read_setting('pump_flow', SMALL[1]),
        'preload': grids.read_setting('preload', SMALL[3])}).designs(0, 108))
    for name in FIGURES:
        assert np.array_equal(columns[name], again[name], equal_nan=True)


def test_a_file_cut_short_is_gone_on_with_and_another_study_refused(tmp_path, capsys):
    path = tmp_path / 'map.csv'
    sweep.main([*SMALL, '-o', str(path)])
    whole = path.read_bytes()
    path.write_bytes(whole[:len(whole) // 2])  # in the middle of a row
    assert sweep.main([*SMALL, '-o', str(path)]) == 0
    assert path.read_bytes() == whole
    assert ' of 108 designs are there' in capsys.readouterr().err
    assert sweep.main([*SMALL, '-o', str(path), '--load', '100']) == 2
    assert 'load is 0.0, here 100.0' in capsys.readouterr().err
    assert path.read_bytes() == whole
    path.write_text('my own notes\n')
    assert sweep.main([*SMALL, '-o', str(path)]) == 2
    assert path.read_text() == 'my own notes\n'


def test_parquet_holds_the_same(tmp_path):
    parquet = pytest.importorskip('pyarrow.parquet')
    for name in ('map.csv', 'map.parquet'):
        assert sweep.main([*SMALL, '-o', str(tmp_path / name)]) == 0
    table = parquet.read_table(tmp_path / 'map.parquet')
    columns = results.read_columns(tmp_path / 'map.csv')
    assert table.column_names == list(columns)
    assert np.array_equal(table['frequency'].to_numpy(), columns['frequency'])
    assert [path.name for path in tmp_path.iterdir() if path.suffix == '.part'] == []
    assert sweep.main([*SMALL, '-o', str(tmp_path / 'map.parquet')]) == 0


def test_blocks_one_after_the_other_are_the_whole(tmp_path, capsys, monkeypatch):
    path, parquet = tmp_path / 'map.csv', tmp_path / 'map.parquet'
    assert sweep.main([*SMALL, '-o', str(path)]) == 0
    said = capsys.readouterr().out
    whole = results.read_columns(path)
    monkeypatch.setattr(results, 'BLOCK', 25)
    blocks = list(results.read_blocks(path))
    assert [len(block['regime']) for block in blocks] == [25, 25, 25, 25, 8]
    for name, values in results.read_columns(path).items():
        assert (values == whole[name]).all() or np.array_equal(values, whole[name], equal_nan=True)
    # What is told of a map that is there already is what was told of it when it was made.
    assert sweep.main([*SMALL, '-o', str(path)]) == 0
    assert capsys.readouterr().out == said
    pytest.importorskip('pyarrow')
    for _ in range(2):
        assert sweep.main([*SMALL, '-o', str(parquet)]) == 0
        assert capsys.readouterr().out == said


def test_interrupt_keeps_what_is_done(tmp_path):
    path = tmp_path / 'map.csv'
    # More than can be done before the signal comes.
    work = [sys.executable, '-m', 'hpv_twin', 'sweep', '--pump-flow', '1e-4:4e-3:3000',
            '--preload', '1e-3:1e-2:3000', '-o', str(path)]
    process = subprocess.Popen(work, stderr=subprocess.PIPE, text=True, env=os.environ)
    deadline = time.monotonic() + 90.0
    while (not path.exists() or path.stat().st_size < 10_000) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    error = process.communicate(timeout=60)[1]
    assert process.returncode == 130
    kept = len(path.read_text().splitlines()) - 2
    assert kept > 0 and f'stopped: {kept} of 9000000 designs kept' in error


def test_want_frequency_answers_with_settings_that_have_it(capsys):
    grid, columns = seated_map(20)
    designs = grid.designs(0, len(grid))
    columns |= {'pump_flow': designs.pump_flow, 'preload': designs.preload}
    with Farm() as farm:
        found = want.settings_for(grid, columns, 80.0, farm)
        assert len(found['pump_flow']) > 10
        nothing = want.settings_for(grid, columns, 5000.0, farm)
    for i in (0, -1):
        design = BASE.replace(pump_flow=float(found['pump_flow'][i]),
                              preload=float(found['preload'][i]))
        cycles = find_cycles(Simulation(design).advance(0.3, 10.0))
        assert cycles.frequency[-1] == pytest.approx(80.0, rel=1e-6)
        assert cycles.regime[-1] == SEATED
        assert cycles.peak_pressure[-1] == pytest.approx(found['peak_pressure'][i], rel=1e-6)
    text = want.report(grid, found, 80.0)
    assert 'peak pressure' in text and 'pump_flow:=' in text
    assert 'No setting' in want.report(grid, nothing, 5000.0)


def test_any_two_fields_and_a_picture_of_them(tmp_path, capsys):
    pyplot = pytest.importorskip('matplotlib.pyplot')
    path = tmp_path / 'map.png'
    assert sweep.main(['--stroke', '1e-3:3e-3:9', '--slotted-spring-stiffness', '1e5:4e5:8:log',
                       '--load', '200', '--plot', str(path), '-o', str(tmp_path / 'map.csv')]) == 0
    columns = results.read_columns(tmp_path / 'map.csv')
    # The full stroke is not always reached.
    assert (columns['stroke'] <= columns['design_stroke'] * (1.0 + 1e-12)).all()
    assert '9 of stroke (h_b), 1 mm to 3 mm' in capsys.readouterr().out
    image = pyplot.imread(path)
    assert image.shape[0] > 500 and image[..., :3].std() > 0.05


@pytest.mark.parametrize('arguments, words', [
    (['--pump-flow', '1e-4:2'], 'expected a number, or LO:HI:N'),
    (['--pump-flow', '1e-3:1e-4:5'], 'LO must be below HI'),
    (['--stroke', '0.1:0.2:5'], 'stroke (h_b) = 0.2 m is outside'),
    (['--pump-flow', '7e-4', '--preload', '1e-3:2e-3:4'], 'a map needs two ranges'),
    ([*SMALL, '--stroke', '1e-3:2e-3:3'], 'two ranges, these are 3'),
    (['--want-frequency', '-3'], 'above 0 Hz'),
    (['--vibrator', 'nowhere.yaml'], 'nowhere.yaml'),
])
def test_arguments_that_make_no_study_are_one_line(arguments, words, capsys):
    assert sweep.main(arguments) == 2
    error = capsys.readouterr().err
    assert words in error and error.count('\n') == 1
