"""The compiled core: order of its series, no stale machine code, slices and setpoints."""
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hpv_twin.model import Simulation, Vibrator, kernel

PACKAGE = Path(kernel.__file__).parents[1]
SHORT_RUN = ('from hpv_twin.model import Simulation; '
             "s = Simulation(method='euler'); s.advance(0.03); print(repr(s.pressure))")


def discharge(steps, order, duration=0.8e-3):
    """State after the first part of a return stroke in equal steps: MPa, mm, m/s."""
    vibrator = Vibrator()
    par = kernel.parameters(vibrator)
    row = kernel.stage_table(vibrator, vibrator.preload, 0.0)[kernel.RETURN_HIGH]
    above, y, v = 0.999 * vibrator.return_pressure, vibrator.stroke, 0.0
    c = np.zeros(kernel.WORKSPACE[1:])
    for _ in range(steps):
        kernel.root_series(c, above, y, v, row, par, order)
        at = step = duration / steps
        for _ in range(20):  # Newton: the place of the series at which the step's time is over
            at -= ((kernel.horner(c[kernel.CLOCK], order, at) - step)
                   / kernel.horner(c[kernel.LEVEL], order, at))
        above *= kernel.horner(c[kernel.LEVEL], order, at) ** 2
        y, v = (kernel.horner(c[row_], order, at) for row_ in (kernel.POSITION, kernel.VELOCITY))
    return np.array([above * 1e-6, y * 1e3, v])


@pytest.mark.compiled
@pytest.mark.parametrize('order, coarse, fine', [(4, 64, 128), (6, 64, 128), (8, 32, 64)])
def test_series_converge_with_their_order(order, coarse, fine):
    exact = discharge(64, kernel.ORDER_SLOT)
    errors = [np.abs(discharge(steps, order) - exact).max() for steps in (coarse, fine)]
    slope = math.log(errors[0] / errors[1]) / math.log(fine / coarse)
    assert slope == pytest.approx(order, abs=0.3)


@pytest.mark.compiled
def test_order_in_use_reaches_rounding_in_a_few_steps():
    # Order 24 falls from 1e-3 to rounding within one halving of the step: no slope can be read.
    exact = discharge(64, kernel.ORDER_SLOT)
    assert np.abs(discharge(3, kernel.ORDER_SLOT) - exact).max() < 1e-1
    assert np.abs(discharge(6, kernel.ORDER_SLOT) - exact).max() < 1e-10


def run_copy(folder, environment, code=SHORT_RUN):
    done = subprocess.run(
        [sys.executable, '-W', 'always', '-c', code], cwd=folder, capture_output=True, text=True,
        timeout=100, env=dict(os.environ, PYTHONPATH=str(folder), **environment))
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture
def copied(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / 'hpv_twin', ignore=shutil.ignore_patterns('__pycache__'))
    return tmp_path


@pytest.mark.compiled
def test_a_changed_callee_is_seen_in_spite_of_the_cache(copied):
    cache = {'NUMBA_CACHE_DIR': str(copied / 'cache')}
    before = run_copy(copied, cache).stdout
    assert run_copy(copied, cache).stdout == before
    assert list((copied / 'cache').rglob('*.nbc'))
    source = copied / 'hpv_twin' / 'model' / 'kernel_machine.py'
    text = source.read_text()
    changed = text.replace('balance = pump_flow - displaced * v',
                           'balance = 2.0 * pump_flow - displaced * v')
    assert changed != text
    source.write_text(changed)
    assert run_copy(copied, cache).stdout != before


@pytest.mark.compiled
def test_a_changed_file_is_seen_by_compiled_code_in_another(copied):
    code = ('from hpv_twin.model import Simulation, find_cycles; s = Simulation(method="euler"); '
            'print(repr(find_cycles(s.advance(0.06)).forward[-1]))')
    cache = {'NUMBA_CACHE_DIR': str(copied / 'cache')}
    before = run_copy(copied, cache, code).stdout
    assert run_copy(copied, cache, code).stdout == before
    source = copied / 'hpv_twin' / 'model' / 'kernel_layout.py'
    text = source.read_text()
    changed = text.replace('np.array([0, 1, 1, 1, 2, 3, 3]', 'np.array([0, 1, 1, 2, 2, 3, 3]')
    assert changed != text
    source.write_text(changed)
    # What counts the times of a cycle stands in kernel_cycles.py.
    assert run_copy(copied, cache, code).stdout != before


@pytest.mark.compiled
def test_without_a_writable_place_it_compiles_in_memory_and_says_so(copied):
    (copied / 'hpv_twin' / 'model' / '__pycache__').write_text('in the way')
    nowhere = {'HOME': '/proc/1/none', 'XDG_CACHE_HOME': '/proc/1/none',
               'PYTHONDONTWRITEBYTECODE': '1'}
    done = run_copy(copied, nowhere)
    assert float(done.stdout) > 0.0
    assert 'no writable place for the compiled model' in done.stderr


def test_slices_of_any_length_evaluate_the_same_motion():
    whole = Simulation().advance(0.2, sample_rate=1e4)
    rng = np.random.default_rng(7)
    simulation, pieces = Simulation(), []
    while simulation.time < 0.2:
        pieces.append(simulation.advance(min(rng.uniform(0.0, 3e-3), 0.2 - simulation.time), 1e4))
    joined = np.concatenate([piece.pressure for piece in pieces])
    switches = np.concatenate([piece.switches['time'] for piece in pieces])
    assert np.allclose(joined, whole.pressure, rtol=1e-12, atol=0.0)
    assert np.array_equal(switches, whole.switches['time'])


@pytest.mark.parametrize('phase', range(4))
def test_a_setpoint_acts_at_its_instant_in_every_phase(phase):
    trace = Simulation().advance(0.06, sample_rate=1e5)
    instant = float(trace.time[(trace.phase == phase) & (trace.time > 0.03)][7]) + 3.3e-6
    simulation = Simulation()
    simulation.advance(instant)
    assert simulation.phase == phase
    state = simulation.pressure, simulation.plunger_position, simulation.plunger_velocity
    force = simulation.plunger_force
    simulation.load = 400.0
    simulation.advance(0.0)
    assert simulation.plunger_force == pytest.approx(force - 400.0, rel=1e-9)
    assert (simulation.pressure, simulation.plunger_position,
            simulation.plunger_velocity) == state
    if phase in (kernel.PHASE_FORWARD, kernel.PHASE_RETURN):
        velocity, mass = state[2], 0.50345885 if state[1] < 0.8e-3 else 0.60345885
        simulation.advance(1e-7)
        assert simulation.plunger_velocity - velocity == pytest.approx(
            (force - 400.0) / mass * 1e-7, rel=1e-2)
