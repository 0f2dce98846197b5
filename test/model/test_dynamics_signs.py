"""
The sign of every term of the dynamics matters: flipped, the motion leaves the oracle's.

Each mutant is the kernel's own text with one sign changed, run as plain Python on a design in which
every term is large (the line's dashpot, the drain's pressure and the load too), and held against
the oracle as test_against_oracle.py holds the kernel.
"""
import re
import signal
import types
import warnings
from pathlib import Path

import numpy as np
import pytest
from oracle import Oracle
from oracle_designs import EVERY_TERM

from hpv_twin.model import Simulation, kernel, simulation

pytestmark = pytest.mark.compiled
DURATION = 0.04  # s: two openings
RATE = 2000.0  # Hz
TRUE = {'default': 1e-6, 'euler': 9e-3}  # share of the range that a true kernel is off at most
STEP = 1e-6  # s, of Euler
PATIENCE = 4.0  # s of the processor: some mutants never come to an end
# The parts of the kernel as one text, each after those that it imports from.
PARTS = ('layout', 'machine', 'switches', 'ledger', 'euler', 'series', 'expand', 'standing',
         'exact')
SOURCE = '\n\n'.join(re.sub(r'(?m)^from \.kernel_\w+ import (\([^)]*\)|.*)\n', '',
                            Path(kernel.__file__).with_name(f'kernel_{part}.py').read_text())
                     for part in PARTS)

# Method that a mutant is run with, function, what stands there, what is put in its place.
MUTANTS = [line.split(' | ') for line in """\
default | fill_stages | - con[K1] * preload - load | - con[K1] * preload + load
default | fill_stages | - con[K1] * preload - load | + con[K1] * preload - load
default | fill_stages | = -area * con[P_DP] | = area * con[P_DP]
default | fill_stages | += con[K2] * con[Y02] | -= con[K2] * con[Y02]
default | fill_stages | [stage, KS] += con[K2] | [stage, KS] -= con[K2]
default | fill_stages | -gap,   1.0 | gap,   1.0
euler | flow_balance | - displaced * v | + displaced * v
euler | flow_balance | balance -= orifice | balance += orifice
euler | flow_balance | pump_flow - | -pump_flow -
euler | net_force | return area * p | return -area * p
euler | net_force | + force0 | - force0
euler | net_force | - ks * y | + ks * y
euler | net_force | - friction * v | + friction * v
euler | net_force | + flow * balance | - flow * balance
euler | euler_moving | balance = pump_flow - displaced * v | balance = pump_flow + displaced * v
euler | euler_moving | p + to_pressure * balance | p - to_pressure * balance
euler | euler_moving | y + step * v | y - step * v
euler | euler_moving | v + to_velocity * force | v - to_velocity * force
euler | euler_closed | p + step * rate | p - step * rate
euler | euler_open | p + step * par | p - step * par
default | free_series | par[PUMP_FLOW] - displaced * v | par[PUMP_FLOW] + displaced * v
default | free_series | par[PUMP_FLOW] - displaced * v | -par[PUMP_FLOW] - displaced * v
default | free_series | balance = -displaced * v | balance = displaced * v
default | free_series | force = area * (above | force = -area * (above
default | free_series | + row[FORCE0] - ks * y | - row[FORCE0] - ks * y
default | free_series | + row[FORCE0] - ks * y | + row[FORCE0] + ks * y
default | free_series | - ks * y - friction * v | - ks * y + friction * v
default | free_series | force = area * level | force = -area * level
default | free_series | - ks * position | + ks * position
default | free_series | - ks * position - friction * v | - ks * position + friction * v
default | free_series | friction * v + flow * balance | friction * v - flow * balance
default | root_series | pump - orifice * | pump + orifice *
default | root_series | (s0 * c[LEVEL, k] + position) | (s0 * c[LEVEL, k] - position)
default | root_series | (s0 * c[LEVEL, k] + position) | (-s0 * c[LEVEL, k] + position)
default | root_series | - displaced * c[VELOCITY, k] | + displaced * c[VELOCITY, k]
default | root_series | balance = pump - | balance = -pump -
default | root_series | constant + pressing * square | constant - pressing * square
default | root_series | (constant + pressing | (-constant + pressing
default | root_series | - ks * c[POSITION, k] | + ks * c[POSITION, k]
default | root_series | - friction * c[VELOCITY, k] | + friction * c[VELOCITY, k]
default | root_series | + flow * balance | - flow * balance
default | exact_closed | + max(limit - state[ANCHOR_P], 0.0) | - max(limit - state[ANCHOR_P], 0.0)
default | straight_samples | p + rise * (time | p - rise * (time
default | time_to_root | reduced = root - target | reduced = target - root
default | time_to_root | reduced += still | reduced -= still
default | leaving_root | (push + math | (-push + math
default | leaving_root | - row[KS] * par[STROKE] | + row[KS] * par[STROKE]
default | root_after | excess * gone + still * x | excess * gone - still * x
default | root_after | return still + excess | return still - excess
""".splitlines()]


def plain_kernel(function='', old='', new=''):
    """The kernel as an uncompiled module, with one place of one function changed."""
    text = SOURCE
    if function:
        body = re.search(rf'def {function}\(.*?(?=\n\n\n|\Z)', text, re.DOTALL).group()
        assert old in body, f'{function} no longer reads {old!r}'
        text = text.replace(body, body.replace(old, new))
    text = re.sub(r'(?m)^@(inner|entry)\n', '', text)
    module = types.ModuleType('plain_kernel')
    module.__package__ = 'hpv_twin.model'
    exec(compile(text, 'plain_kernel', 'exec'), module.__dict__)
    return module


def mismatch(module, method, expected, monkeypatch):
    """Largest difference from the oracle, as a share of the range; infinite for nonsense."""
    monkeypatch.setattr(simulation, 'kernel', module)
    with np.errstate(all='ignore'), warnings.catch_warnings():
        warnings.simplefilter('ignore')
        signal.setitimer(signal.ITIMER_VIRTUAL, PATIENCE)
        try:
            trace = Simulation(EVERY_TERM, method=method, step=STEP).advance(DURATION, RATE)
        except (ArithmeticError, ValueError, TimeoutError, simulation.ModelError):
            return np.inf
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    differences = [np.abs(getattr(trace, name) - expected[name]).max() / np.ptp(expected[name])
                   for name in expected]
    return np.inf if np.isnan(differences).any() else max(differences)


def give_up(_number, _frame):
    raise TimeoutError


@pytest.fixture(autouse=True)
def patience():
    before = signal.signal(signal.SIGVTALRM, give_up)
    yield
    signal.signal(signal.SIGVTALRM, before)


@pytest.fixture(scope='module')
def expected():
    record = Oracle(EVERY_TERM).run(DURATION, [], sample_rate=RATE)
    return {name: record.column(name) for name in ('pressure', 'plunger_position')}


@pytest.mark.parametrize('method', ['default', 'euler'])
def test_the_kernel_as_it_stands_agrees(method, expected, monkeypatch):
    assert mismatch(plain_kernel(), method, expected, monkeypatch) < TRUE[method]


@pytest.mark.parametrize('method, function, old, new', MUTANTS)
def test_a_flipped_sign_is_caught(method, function, old, new, expected, monkeypatch):
    mutant = plain_kernel(function, old, new)
    assert mismatch(mutant, method, expected, monkeypatch) > TRUE[method]
