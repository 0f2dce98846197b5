"""What the machine is doing, by name: judged by what has happened, not by an inequality."""
from __future__ import annotations

from . import kernel

NO_OPENING = 'no opening'  # on the seat, and nothing drives it off
STARTING = 'starting'  # off the seat for the first time, no whole cycle yet
SEATED = 'seated oscillation'  # every cycle visits the seat and the stop; period-1
SEAT_REBOUND = 'seat rebound'  # reaches the seat with the net force already positive
PARTIAL = 'partial stroke'  # visits the seat, not the stop
OFF_SEAT = 'off-seat oscillation'  # never at the seat
HELD_OPEN = 'held open'  # at rest off the seat, by the pump's flow
HOVERING = 'hovering'  # at rest off the seat without that: no flow, a pull, hardly any preload

OSCILLATING = frozenset((SEATED, SEAT_REBOUND, PARTIAL, OFF_SEAT))
# Without a whole cycle for so many periods of the last one, and for so long, it may be at rest,
PATIENCE = 3.0
SHORTEST_PATIENCE = 0.05  # s
# which it is if it would need longer than that for so much of its stroke.
AT_REST = 0.01


def name_regime(simulation, cycle) -> str:
    """
    Name the regime of a simulation, given its last whole cycle (or None).

    On the seat with the pump running the last regime goes on, however slow the build-up is.
    """
    if simulation.stage == kernel.CLOSED and simulation.pump_flow == 0.0:
        return NO_OPENING
    before = cycle.regime if cycle else STARTING if simulation.has_opened else NO_OPENING
    if simulation.stage == kernel.CLOSED or moves_on(simulation, cycle):
        return before
    return HELD_OPEN if held_by_flow(simulation) else HOVERING


def moves_on(simulation, cycle) -> bool:
    """Whether a plunger off its seat is still on its way, or was until a moment ago."""
    if simulation.stage in (kernel.LIFT, kernel.CATCH_UP) and simulation.pump_flow > 0.0:
        return True  # no slot is open: what the pump delivers must move it
    last = cycle.start + cycle.period if cycle else 0.0
    patience = max(PATIENCE * cycle.period if cycle else 0.0, SHORTEST_PATIENCE)
    if simulation.time - max(last, simulation.last_switch) <= patience:
        return True
    slow = AT_REST * simulation.vibrator.stroke / SHORTEST_PATIENCE
    return cycle is None and abs(simulation.plunger_velocity) > slow


def held_by_flow(simulation) -> bool:
    """Whether it is the pump's flow that keeps a resting plunger off its seat."""
    design = simulation.design
    springs = design.slotted_spring_stiffness * (design.preload + design.stroke) + design.load
    at_stop = simulation.stage == kernel.OPEN
    return (simulation.pump_flow > 0.0 and springs > 0.0
            and (at_stop or simulation.pump_flow >= design.critical_flow))
