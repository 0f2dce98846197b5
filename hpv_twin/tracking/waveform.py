"""The model's steady cycle as a function of what is estimated: one opening to the next."""
from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hpv_twin.model import Simulation, Vibrator
from hpv_twin.model.kernel import PHASE_CLOSED, PHASE_FORWARD, PHASE_RETURN

CLOSED, FORWARD, RETURN = PHASE_CLOSED, PHASE_FORWARD, PHASE_RETURN
SAMPLE_RATE = 1e5  # Hz: straight lines between samples are then good to a few kPa
OFF_SEAT = 7e-3  # s: about what the plunger spends off its seat
LONGEST = 8.0  # a cycle takes no longer than so many first build-ups


@dataclass(frozen=True)
class Waveform:
    """
    One cycle from the opening on: `since_opening` s, `pressure` Pa gauge, and the `period` s.

    An opening fixes pressure, position and velocity, so every cycle of one design with one set of
    setpoints is this one.
    """

    since_opening: np.ndarray
    pressure: np.ndarray
    period: float
    full_stroke: bool

    def at(self, since_opening: np.ndarray) -> np.ndarray:
        """Pressure, Pa gauge, so long after any opening (s, any sign), shape as given."""
        return np.interp(np.mod(since_opening, self.period), self.since_opening, self.pressure)

    def fall_through(self, level: float) -> float:
        """When, after the opening, the pressure falls through `level` (Pa gauge), s."""
        peak = int(np.argmax(self.pressure))
        below = np.flatnonzero(self.pressure[peak:] < level)
        return float(self.since_opening[peak + below[0]]) if len(below) else 0.5 * self.period


def steady_waveform(vibrator: Vibrator) -> Waveform | None:
    """Return the cycle of a design; None where it has no seated cycle (held open, no flow, …)."""
    stiffness = vibrator.bulk_modulus / vibrator.cavity_volume
    if vibrator.pump_flow <= 0.0 or vibrator.opening_pressure <= 0.0:
        return None
    build_up = vibrator.opening_pressure / (stiffness * vibrator.pump_flow)
    simulation = Simulation(vibrator)
    simulation.tick(0.99 * build_up)
    patience = simulation.time + LONGEST * (build_up + OFF_SEAT)
    # The build-up is a straight line: only the way from the opening to the seat needs samples.
    trace = simulation.advance(0.01 * build_up + OFF_SEAT, SAMPLE_RATE)
    while not len(between(trace.switches, RETURN, CLOSED)):
        if simulation.time > patience:
            return None
        trace = trace.join([trace, simulation.advance(OFF_SEAT, SAMPLE_RATE)])
    switches = trace.switches
    while len(between(switches, CLOSED, FORWARD)) < 2:
        if simulation.time > patience:
            return None
        more = simulation.advance(0.3 * build_up, 1.0 / build_up).switches
        switches = np.concatenate([switches, more])
    first, second = between(switches, CLOSED, FORWARD)[:2]
    seated = between(switches, RETURN, CLOSED)[0]
    start, end = first['time'], second['time']
    here = slice(*np.searchsorted(trace.time, (start, seated['time'])))
    highest = switches['position_max'][switches['time'] <= seated['time']].max()
    return Waveform(
        np.concatenate(([0.0], trace.time[here] - start, [seated['time'] - start, end - start])),
        np.concatenate(([first['pressure']], trace.pressure[here],
                        [seated['pressure'], second['pressure']])),
        end - start, bool(highest >= vibrator.stroke))


def between(switches, before: int, after: int):
    """Rows of the switches from one phase to another."""
    return switches[(switches['before'] == before) & (switches['after'] == after)]


@dataclass(frozen=True)
class Deviation:
    """
    How a machine differs from its design: the estimator's coordinates, all zero for no difference.

    The order of ESTIMATES: log ratio of κ/W0, log ratio of pump flow to its setpoint, change of
    opening force as a share of the design's, log ratio of ξ_H, shift of the whole pressure in MPa,
    and change of viscous friction as a share of `friction_scale`.
    """

    reference: Vibrator

    @property
    def opening_force(self) -> float:
        """Net spring force on the seat, k1*y01 - k2*y02 + F_T, N, of the reference; not below 1."""
        return max(opening_force(self.reference), 1.0)

    @property
    def friction_scale(self) -> float:
        """N·s/m that count as one: the design's friction, or 5 % of critical where it has none."""
        design = self.reference
        critical = 2.0 * math.sqrt(design.slotted_spring_stiffness * design.plunger_mass)
        return design.viscous_friction or 0.05 * critical

    def machine(self, design: Vibrator, x) -> Vibrator:
        """
        Return `design` (the reference with the setpoints in force) changed by `x`.

        The shift of the pressure, x[4], is left to the caller: it is an addition to the waveform.
        """
        friction = design.viscous_friction + self.friction_scale * float(x[5])
        return design.replace(
            bulk_modulus=design.bulk_modulus * math.exp(x[0]),
            pump_flow=design.pump_flow * math.exp(x[1]),
            load=design.load + self.opening_force * float(x[2]),
            flow_coefficient=min(2.0, design.flow_coefficient * math.exp(x[3])),
            viscous_friction=max(0.0, friction))

    def values(self, design: Vibrator, x) -> np.ndarray:
        """Return the estimates in SI, in the order of ESTIMATES."""
        changed = self.machine(design, x)
        return np.array([changed.bulk_modulus / changed.cavity_volume, changed.pump_flow,
                         opening_force(changed), changed.flow_coefficient,
                         design.drain_pressure + 1e6 * x[4], changed.viscous_friction])

    def scales(self, values) -> np.ndarray:
        """d(value)/dx of each estimate, SI, at these `values`."""
        return np.array([values[0], values[1], self.opening_force, values[3], 1e6,
                         self.friction_scale])


def opening_force(vibrator: Vibrator) -> float:
    """Return what the pressure on the seat must overcome, k1*y01 - k2*y02 + F_T, N; (22)."""
    return vibrator.plunger_seat_area * (vibrator.opening_pressure - vibrator.drain_pressure)
