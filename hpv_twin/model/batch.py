"""
The figures of many designs at once, by compiled code alone: what studies are made of.

`run_designs` and `Simulation` with `find_cycles` go through the same compiled functions.
"""
from __future__ import annotations

import os
import threading

import numpy as np

from . import kernel_batch as compiled
from .designs import Designs
from .kernel import constants
from .regimes import REGIMES

IMPOSSIBLE = 'impossible'  # the larger seat is not the larger one
CHATTERS = 'chatters'  # more switches at one instant than the model allows
BATCH_REGIMES = (*REGIMES, IMPOSSIBLE, CHATTERS)
CYCLES = 40  # measured cycles of each design
# Figures as the compiled code has them, then those that follow.
COMPILED = ('period', 'stroke', 'opening_pressure', 'return_pressure', 'build_up', 'forward',
            'dwell', 'return_stroke', 'phase_lag', 'impact_energy', 'seat_energy',
            'peak_pressure', 'lowest_pressure', 'period_spread', 'hydraulic_energy',
            'pressure_rate', 'settled', 'regime_code')
FIGURES = ('frequency', *COMPILED[1:16], 'impact_power', 'hydraulic_power', 'load_work',
           'efficiency', 'settled')
# What a machine that does not oscillate has none of.
NOTHING = ('frequency', 'stroke', 'impact_energy', 'seat_energy', 'impact_power', 'load_work')

# Numba's simplest threading layer ends the process when two threads come at once.
_one_at_a_time = threading.Lock()
_rooms = threading.local()


def threads_available() -> int:
    """Return how many threads numba may use here (NUMBA_NUM_THREADS, else the cores)."""
    import numba
    return min(numba.config.NUMBA_NUM_THREADS, len(os.sched_getaffinity(0)))


def run_designs(designs: Designs, cycles: int = CYCLES, threads: int | None = None) -> dict:
    """
    Run each design from rest until it has settled, then measure `cycles` whole cycles.

    Returns a dict of arrays of shape (n,), SI, pressures gauge: the names in FIGURES, and `regime`
    (names) with `regime_code` (places in BATCH_REGIMES). All runs in one compiled call, which a
    Ctrl-C has to wait for: studies hand over some thousand designs at a time. `threads`: by default
    all there are; with 1 no threading layer is used.

    Settled are two successive cycles of the same period and stroke, to 1e-9; what has not settled
    within 300 cycles is measured as it is, and `settled` is 0. Over the measured cycles:
    `frequency`, `stroke`, times and energies are means, `peak_pressure` and `lowest_pressure`
    extremes, `period_spread` is (longest - shortest)/mean. Where there is no oscillation frequency,
    stroke and energies are 0 and the others not a number.

    impact_energy: ½(m1 + m2)v² with which plunger and sleeve strike the stop at h_b, J per cycle;
    seat_energy: ½ m1 v² at the seat; hydraulic_energy: ∫p Q_H dt over a cycle; load_work: F_T times
    stroke, done on the load by the forward stroke (a constant load gives it back on the return);
    efficiency: (load_work + impact_energy)/hydraulic_energy; impact_power, hydraulic_power: energy
    times frequency; pressure_rate: the greatest |dp/dt| of a cycle, Pa/s.
    """
    con = constants(designs)
    con = np.ascontiguousarray(np.broadcast_to(con, (len(designs), con.shape[-1])))
    figures = np.empty((len(con), compiled.DESIGN_FIGURES))
    threads = threads_available() if threads is None else threads
    if threads == 1:
        compiled.run_serial(con, cycles, figures, room(1))
    else:
        with _one_at_a_time:
            compiled.run_parallel(con, cycles, figures, room(threads))
    return derive(dict(zip(COMPILED, figures.T.copy(), strict=True)), designs)


def room(lanes: int) -> tuple:
    """Return working room for so many lanes, kept for the next call from this thread."""
    kept = getattr(_rooms, 'kept', None)
    if kept is None or len(kept[0]) != lanes:
        kept = _rooms.kept = tuple(compiled.Lanes.make(lanes))
    return kept


def derive(figures: dict, designs: Designs) -> dict:
    """Add what follows from the compiled figures, in the order of FIGURES."""
    code = figures.pop('regime_code').astype(np.int8)
    figures['frequency'] = 1.0 / figures.pop('period')
    figures['impact_power'] = figures['impact_energy'] * figures['frequency']
    figures['hydraulic_power'] = figures['hydraulic_energy'] * figures['frequency']
    figures['load_work'] = designs.load * figures['stroke']
    figures['efficiency'] = ((figures['load_work'] + figures['impact_energy'])
                             / figures['hydraulic_energy'])
    rests = np.isnan(figures['frequency'])
    for name in NOTHING:
        figures[name][rests] = 0.0
    figures = {name: figures[name] for name in FIGURES}
    figures['regime_code'] = code
    figures['regime'] = np.array(BATCH_REGIMES)[code]
    return figures
