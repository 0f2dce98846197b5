"""What the benchmark compares must solve the same problem."""
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from hpv_twin.model import Vibrator

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / 'bench'), str(ROOT / 'test' / 'model')]

from oracle import Oracle  # noqa: E402
from rivals import RIVALS  # noqa: E402

SECONDS, RATE = 0.3, 1000.0
needs_compiler = pytest.mark.skipif(shutil.which('cc') is None, reason='no C compiler `cc`')
takes_long = pytest.mark.long
# Least and most relative error: Euler's first order must show, the tolerance of solve_ivp be kept.
EXPECTED = {'Euler': (1e-4, 1e-3), 'euler': (1e-4, 2e-3), 'solve_ivp': (0.0, 1e-5),
            'default': (0.0, 1e-9)}


def rivals():
    for name in RIVALS:
        kind = next(kind for kind in EXPECTED if kind in name)
        marks = [needs_compiler] if name.startswith('C ') else []
        marks += [takes_long] if 'without its store' in name else []
        yield pytest.param(name, *EXPECTED[kind], marks=marks, id=name)


@pytest.fixture(scope='module')
def truth():
    return Oracle(Vibrator()).run(0.1).cycles()[-1]


def run(name):
    rival = RIVALS[name](Vibrator(), SECONDS, RATE)
    return rival.result(rival.run())


@pytest.mark.parametrize('name, least, most', rivals())
def test_rival_runs_the_base_design(name, least, most, truth):
    result = run(name)
    assert least <= abs(result.period / truth.period - 1.0) <= most
    assert least <= abs(result.peak_pressure / truth.peak_pressure - 1.0) <= most
    assert len(result.openings) == len(result.peaks) + 1 == 16
    assert result.samples.shape == (round(SECONDS * RATE), 3)
    # The first build-up is the straight line of (7), sampled from 1/RATE on.
    design = Vibrator()
    line = design.bulk_modulus / design.cavity_volume * design.pump_flow * np.arange(1, 11) / RATE
    np.testing.assert_allclose(result.samples[:10, 0], line, rtol=1e-5)


@needs_compiler
@pytest.mark.parametrize('name', [name for name in RIVALS if name.endswith(' Euler')])
def test_euler_is_one_method_in_every_language(name):
    motion, reference = run(name).samples, run('C Euler, one loop').samples
    np.testing.assert_allclose(motion / np.abs(reference).max(axis=0),
                               reference / np.abs(reference).max(axis=0), atol=1e-9)
