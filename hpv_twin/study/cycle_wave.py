"""One steady cycle of a design as curves: pressure and position from one opening to the next."""
from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hpv_twin.model import ModelError, Simulation, Vibrator
from hpv_twin.model.kernel import PHASE_CLOSED, PHASE_FORWARD

RATE = 2e5  # Hz: straight lines between samples are then good to about a kPa
OFF_SEAT = 7e-3  # s: about what the plunger spends off its seat
LONGEST = 8.0  # a cycle takes no longer than so many first build-ups


@dataclass(frozen=True)
class CycleWave:
    """
    `since` the opening, s, shape (n,); `pressure` Pa gauge; `position` m; the `period`, s.

    An opening fixes the state, so every cycle of a machine with steady setpoints is this one.
    """

    since: np.ndarray
    pressure: np.ndarray
    position: np.ndarray
    period: float

    def pressure_at(self, phase: np.ndarray, clock: float = 0.0) -> np.ndarray:
        """
        Pressure, Pa gauge, at these phases (any real; 0 is the opening).

        `clock`: standard deviation of the stamps, s; what is expected of stamps that are off is
        returned then, by Gauss's rule of three points.
        """
        return self._expected(self.pressure, phase, clock)

    def position_at(self, phase: np.ndarray, clock: float = 0.0) -> np.ndarray:
        """Position, m, at these phases; `clock` as in `pressure_at`."""
        return self._expected(self.position, phase, clock)

    def _expected(self, curve, phase, clock):
        if not clock:
            return np.interp(np.mod(phase, 1.0) * self.period, self.since, curve)
        away = math.sqrt(3.0) * clock / self.period
        return (4.0 * self._expected(curve, phase, 0.0) + self._expected(curve, phase - away, 0.0)
                + self._expected(curve, phase + away, 0.0)) / 6.0

    def slope(self, curve: np.ndarray, phase: np.ndarray) -> np.ndarray:
        """Rate of change of `pressure` or `position`, per s, at these phases."""
        since = np.mod(phase, 1.0) * self.period
        at = np.clip(np.searchsorted(self.since, since), 1, len(self.since) - 1)
        return (curve[at] - curve[at - 1]) / np.maximum(self.since[at] - self.since[at - 1], 1e-9)


def cycle_wave(design: Vibrator, rate: float = RATE) -> CycleWave | None:
    """Return the cycle of a design; None where it has no seated one (held open, no flow, …)."""
    stiffness = design.bulk_modulus / design.cavity_volume
    if design.pump_flow <= 0.0 or design.opening_pressure <= 0.0:
        return None
    build_up = design.opening_pressure / (stiffness * design.pump_flow)
    try:
        simulation = Simulation(design)
        simulation.tick(0.999 * build_up)
        patience = simulation.time + LONGEST * (build_up + OFF_SEAT)
        trace = simulation.advance(1.2 * (build_up + OFF_SEAT), rate)
        while len(openings(trace)) < 2:
            if simulation.time > patience:
                return None
            trace = trace.join([trace, simulation.advance(0.3 * (build_up + OFF_SEAT), rate)])
    except ModelError:
        return None
    first, second = openings(trace)[:2]
    start, end = first['time'], second['time']
    inside = (trace.time > start) & (trace.time < end)
    # The curves bend sharply at switches: these stand among the samples.
    bends = trace.switches[(trace.switches['time'] >= start) & (trace.switches['time'] <= end)]
    since, order = np.unique(np.concatenate([bends['time'], trace.time[inside]]) - start,
                             return_index=True)
    pressure, position = (np.concatenate([bends[name], getattr(trace, name)[inside]])[order]
                          for name in ('pressure', 'plunger_position'))
    return CycleWave(since, pressure, position, float(end - start))


def openings(trace):
    """Rows of the switches at which the plunger leaves its seat."""
    switches = trace.switches
    return switches[(switches['before'] == PHASE_CLOSED) & (switches['after'] == PHASE_FORWARD)]
