"""What the machine is doing, by name: judged by what has happened, not by an inequality."""
from __future__ import annotations

from . import kernel_cycles as compiled

NO_OPENING = 'no opening'  # on the seat, and nothing drives it off
STARTING = 'starting'  # off the seat for the first time, no whole cycle yet
SEATED = 'seated oscillation'  # every cycle visits the seat and the stop; period-1
SEAT_REBOUND = 'seat rebound'  # reaches the seat with the net force already positive
PARTIAL = 'partial stroke'  # visits the seat, not the stop
OFF_SEAT = 'off-seat oscillation'  # never at the seat
HELD_OPEN = 'held open'  # at rest off the seat, by the pump's flow
HOVERING = 'hovering'  # at rest off the seat without that: no flow, a pull, hardly any preload

# In the order of the codes in kernel_cycles.
REGIMES = (NO_OPENING, STARTING, SEATED, SEAT_REBOUND, PARTIAL, OFF_SEAT, HELD_OPEN, HOVERING)
OSCILLATING = frozenset((SEATED, SEAT_REBOUND, PARTIAL, OFF_SEAT))


def name_regime(simulation, cycle) -> str:
    """Name the regime of a simulation, given its last whole cycle (or None)."""
    last = (0.0, 0.0, 0) if cycle is None else (
        cycle.start + cycle.period, cycle.period, REGIMES.index(cycle.regime))
    return REGIMES[compiled.judge(*simulation.machine, *last, simulation.last_switch,
                                  simulation.has_opened)]
