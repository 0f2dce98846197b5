"""
Ways to run the same vibrator, each behind one small interface, for model_speed.py.

All start at rest, sample at the same rate, and find the openings and the highest pressure of each
cycle. Constants come from the package's own table of phases, so that every rival solves the same
equations; the loops, and in SciPy's case the switches, are its own.
"""
from __future__ import annotations

import ctypes
import math
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import row_by_row

from hpv_twin.model import Simulation, find_cycles, kernel
from hpv_twin.model.cycles import CycleFinder
from hpv_twin.model.kernel import (
    CATCH_UP,
    CLOSED,
    LIFT,
    OPEN,
    RETURN_HIGH,
    RETURN_LOW,
    SLOT,
    VACUUM,
)

STEP = 1e-5  # s, the paper's
CYCLE_RATE = 400.0  # Hz: no vibrator opens more often
LOG_RATE = 4000.0  # rows a second, with room to spare


class Result(NamedTuple):
    """Samples of p, y, v, shape (n, 3); instants of opening, s; the highest pressure between."""

    samples: np.ndarray
    openings: np.ndarray
    peaks: np.ndarray

    @property
    def period(self) -> float:
        """Mean period of all cycles but the first, s."""
        return (self.openings[-1] - self.openings[1]) / (len(self.openings) - 2)

    @property
    def peak_pressure(self) -> float:
        """Mean of their highest pressures, Pa gauge."""
        return float(np.mean(self.peaks[1:]))


class Rival:
    """`Rival(vibrator, seconds, rate)` prepares, `run()` is what is timed, `result()` reads it."""

    longest = math.inf  # model s worth running; slower ones are timed on less
    step = STEP  # s, of Euler's method

    def __init__(self, vibrator, seconds, rate):
        self.seconds, self.rate = seconds, rate
        self.table = kernel.stage_table(vibrator, vibrator.preload, vibrator.load)
        self.par = kernel.parameters(vibrator)
        self.steps, self.every = round(seconds / self.step), round(1.0 / (rate * self.step))

    def result(self, found):
        """Read what `run` returned: samples, openings, highest pressures before each of these."""
        samples, openings, peaks = map(np.asarray, found)
        return Result(samples, openings, peaks[1:])


# Euler in Python --------------------------------------------------------------------------------


def next_row(row, y, v, rows):
    """Row of a moving plunger after a step; OPEN and CLOSED stop it."""
    gap, stroke = rows[CATCH_UP][-1], rows[SLOT][-1]
    if y >= stroke and v > 0.0:
        return OPEN, stroke, 0.0
    if y <= 0.0 and v < 0.0:
        return CLOSED, 0.0, 0.0
    if row >= OPEN or (y > gap and v < 0.0):
        return (RETURN_HIGH if y >= rows[RETURN_HIGH][-2] else RETURN_LOW), y, v
    if y > gap:
        return SLOT, y, v
    return (CATCH_UP if y > rows[LIFT][-1] else LIFT), y, v


def euler_loop(rows, par, step, steps, every, root):  # noqa: C901 - a call per step would cost
    """Explicit Euler in scalars of whatever type the arguments have; switches on whole steps."""
    stiffness, pump_flow, drain, friction, orifice = par[:5]
    gain = step * stiffness
    p = y = v = peak = 0.0 * step
    samples, openings, peaks = [], [], []
    row = CLOSED
    area, mass, displaced, s0, s1, force0, ks, flow, low, high = rows[row]
    for n in range(1, steps + 1):
        balance = pump_flow - displaced * v
        slot = s0 + s1 * y
        if slot != 0.0 and p > drain:
            balance -= orifice * slot * root(p - drain)
        force = area * p + force0 - ks * y - friction * v + flow * balance
        p += gain * balance
        if p < VACUUM:
            p = VACUUM
        if p > peak:
            peak = p
        after = row
        if row == CLOSED:
            if force > 0.0:
                after = LIFT
                openings.append(n * step)
                peaks.append(peak)
                peak = 0.0
        elif row == OPEN:
            if force < 0.0:
                after = RETURN_HIGH
        else:
            before = v
            y += step * v
            v += step * force / mass
            if not low <= y <= high or (v < 0.0) != (before < 0.0):
                after, y, v = next_row(row, y, v, rows)
        if after != row:
            row = after
            area, mass, displaced, s0, s1, force0, ks, flow, low, high = rows[row]
        if n % every == 0:
            samples.append((p, y, v))
    return samples, openings, peaks


class PythonEuler(Rival):
    """Python's own numbers."""

    number, root = float, staticmethod(math.sqrt)

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.rows = [tuple(map(self.number, line)) for line in self.table.tolist()]
        self.constants = tuple(map(self.number, self.par.tolist()))

    def run(self):
        """Run; returns what `result` reads."""
        return euler_loop(self.rows, self.constants, self.number(self.step), self.steps, self.every,
                          self.root)


class NumpyEuler(PythonEuler):
    """The same loop on what one gets by indexing NumPy arrays."""

    longest = 2.0
    number, root = np.float64, staticmethod(np.sqrt)


# Euler in C -------------------------------------------------------------------------------------


class COutput(ctypes.Structure):
    """`struct result` of euler.c."""

    _fields_ = [(name, ctypes.c_void_p) for name in ('samples', 'openings', 'peaks')] + [
        (name, ctypes.c_long) for name in ('room', 'found')]


def compile_c(folder: Path, flags=('-O3', '-march=native')) -> ctypes.CDLL:
    """Compile euler.c into `folder` with the machine's C compiler and load it."""
    library = folder / 'euler.so'
    subprocess.run(['cc', *flags, '-shared', '-fPIC', '-o', library,
                    Path(__file__).with_name('euler.c'), '-lm'], check=True)
    return ctypes.CDLL(library)


class CEuler(Rival):
    """A loop for each kind of row; called through ctypes."""

    function = 'euler'
    library = None

    def __init__(self, *arguments):
        super().__init__(*arguments)
        if CEuler.library is None:
            with tempfile.TemporaryDirectory() as folder:
                CEuler.library = compile_c(Path(folder))
        self.call = CEuler.library[self.function]
        self.call.restype = None
        self.design = np.concatenate([self.par[:6], self.table.ravel()])
        self.room = int(CYCLE_RATE * self.seconds) + 1

    def run(self):
        """Run; returns what `result` reads."""
        samples = np.empty((self.steps // self.every, 3))
        openings, peaks = np.empty((2, self.room))
        output = COutput(samples.ctypes.data, openings.ctypes.data, peaks.ctypes.data, self.room, 0)
        self.call(self.design.ctypes, ctypes.c_double(self.step), ctypes.c_long(self.steps),
                  ctypes.c_long(self.every), ctypes.byref(output))
        return samples, openings[:output.found], peaks[:output.found]


class COneLoop(CEuler):
    """One loop over all steps."""

    function = 'euler_one_loop'


# SciPy ------------------------------------------------------------------------------------------


class RK45(Rival):
    """solve_ivp, phase by phase; see row_by_row.py."""

    longest = 1.0
    method = 'RK45'

    def run(self):
        """Run; returns what `result` reads."""
        return row_by_row.run(self.table, self.par, self.seconds, self.rate, self.method)


class LSODA(RK45):
    """The same with the multistep method."""

    method = 'LSODA'


# This package -----------------------------------------------------------------------------------


class Package(Rival):
    """Simulation.advance, as users call it."""

    method = 'default'

    def __init__(self, vibrator, seconds, rate):
        super().__init__(vibrator, seconds, rate)
        self.simulation = Simulation(vibrator, self.method, self.step)

    def run(self):
        """Run; returns what `result` reads."""
        return self.simulation.advance(self.seconds, self.rate)

    def result(self, trace):
        """Read a Trace."""
        cycles = find_cycles(trace)
        openings = np.append(cycles.start, cycles.start[-1] + cycles.period[-1])
        samples = np.stack((trace.pressure, trace.plunger_position, trace.plunger_velocity), 1)
        return Result(samples, openings, cycles.peak_pressure)


class PackageEuler(Package):
    """The paper's method."""

    method = 'euler'


class Kernel(Package):
    """The compiled function alone, into arrays that are in memory: no Trace is put together."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        simulation = self.simulation
        self.samples = np.ones((kernel.SAMPLE_SIZE, round(self.seconds * self.rate)))
        simulation._log = np.ones((int(LOG_RATE * self.seconds) + 64, kernel.ROW_SIZE))
        self.integrate, how = simulation._integrator
        # Let the simulation itself say what it calls the compiled function with.
        calls = []

        def note(*call):
            calls.append(call)
            return kernel.DONE, 0, 0
        simulation._integrator = note, how
        simulation._run(self.seconds, self.samples, 1, self.rate)
        self.call, = calls

    def run(self):
        """Run; returns what `result` reads."""
        return self.integrate(*self.call)

    def result(self, found):
        """Read the arrays."""
        code, _, used = found
        assert code == kernel.DONE
        simulation = self.simulation
        cycles = CycleFinder(simulation.vibrator.stroke).feed(simulation._log[:used])
        openings = [cycle.start for cycle in cycles] + [cycles[-1].start + cycles[-1].period]
        return Result(self.samples[[kernel.SAMPLE_P, kernel.SAMPLE_Y, kernel.SAMPLE_V]].T,
                      np.array(openings), np.array([cycle.peak_pressure for cycle in cycles]))


class KernelEuler(Kernel):
    """The same of the paper's method."""

    method = 'euler'


class WithoutStore(Package):
    """The default integrator, every cycle computed anew."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        room_for_none = np.zeros((1, *kernel.WORKSPACE[1:]))
        self.simulation._integrator = kernel.advance_exact, room_for_none


class KernelWithoutStore(Kernel, WithoutStore):
    """The compiled function alone of that."""


RIVALS = {
    'NumPy-scalar Euler': NumpyEuler,
    'plain-Python Euler': PythonEuler,
    f'solve_ivp RK45, rtol {row_by_row.RELATIVE:.0e}': RK45,
    f'solve_ivp LSODA, rtol {row_by_row.RELATIVE:.0e}': LSODA,
    'C Euler, one loop': COneLoop,
    'C Euler': CEuler,
    'hpv_twin euler': PackageEuler,
    'hpv_twin euler, kernel alone': KernelEuler,
    'hpv_twin default': Package,
    'hpv_twin default, kernel alone': Kernel,
    'default without its store': WithoutStore,
    'default without its store, kernel alone': KernelWithoutStore,
}
