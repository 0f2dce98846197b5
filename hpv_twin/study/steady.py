"""Steady cycles of a design: what most studies ask the model for."""
from __future__ import annotations

from hpv_twin.model import Cycle, CycleFinder, Simulation, Vibrator

SLICE = 0.02  # s between looks at the cycles
SAME = 1e-9  # relative change of the period below which the motion is period-1
LONGEST = 20.0  # s of model time


def steady_cycle(vibrator: Vibrator, settle: int = 6, **how) -> Cycle | None:
    """
    Return a cycle of the settled motion, None where there is none in 20 s of model time.

    Settled is a motion of which two successive cycles have the same period, or `settle` cycles
    have passed; `how` goes to Simulation (method, step).
    """
    simulation = Simulation(vibrator, **how)
    finder, cycles = CycleFinder(vibrator.stroke), []
    while simulation.time < LONGEST and len(cycles) < settle + 1:
        cycles += finder.feed(simulation.tick(SLICE))
        if len(cycles) >= 3 and period_1(cycles[-2:]):
            break
    return cycles[-1] if cycles else None


def period_1(cycles, same: float = SAME) -> bool:
    """Whether these cycles have one period and one regime."""
    periods = [cycle.period for cycle in cycles]
    return (max(periods) - min(periods) <= same * periods[-1]
            and len({cycle.regime for cycle in cycles}) == 1)
