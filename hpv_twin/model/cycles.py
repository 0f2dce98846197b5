"""Cycles and their figures: (6) and what a user reads off a cycle."""
from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from . import kernel_cycles as compiled
from .kernel import ROW_AFTER, ROW_BEFORE, ROW_P, ROW_SIZE, ROW_TIME
from .regimes import REGIMES


@dataclass(frozen=True)
class Cycle:
    """
    One whole cycle. Times in s, pressures in Pa gauge, lengths in m, NaN for what it has not.

    A cycle that visits the seat runs from one opening to the next, so `opening_pressure` stands at
    its start and `build_up` is its last part; others run from one start of the return stroke, or
    from one highest position, to the next. `phase_lag` is how long after the highest pressure the
    stroke is complete.

    The rows of (6), each of which sums to the period: plunger `forward` t_kn, `dwell` t_kb,
    `return_stroke` t_RS, `build_up` t_kh; pressure `pressure_rise` t_H from p2 to the highest,
    `pressure_fall` t_BT back to p2, `pressure_undershoot` t_rT on to the lowest,
    `pressure_recovery` t_HT back to p2, where p2 is the `return_pressure`; valve sleeve
    `sleeve_forward` t'_kn from its lift at 0.1 h_b to the stop, `dwell`, `return_stroke` and
    `sleeve_seated` t'_kh. The last two rows belong to cycles that visit the seat and the stop.

    `stop_speed` and `seat_speed`, m/s: with what speed the plunger strikes the stop, with the
    sleeve, and its seat, without it; the hardest blow of the cycle.
    """

    start: float
    period: float
    stroke: float
    peak_pressure: float
    lowest_pressure: float
    opening_pressure: float
    return_pressure: float
    build_up: float
    forward: float
    dwell: float
    return_stroke: float
    phase_lag: float
    pressure_rise: float
    pressure_fall: float
    pressure_undershoot: float
    pressure_recovery: float
    sleeve_forward: float
    sleeve_seated: float
    stop_speed: float
    seat_speed: float
    regime: str

    @property
    def frequency(self) -> float:
        """1/period, Hz."""
        return 1.0 / self.period


@dataclass(frozen=True)
class Cycles:
    """Figures of successive whole cycles, one array per field of Cycle, shape (cycles,)."""

    start: np.ndarray
    period: np.ndarray
    frequency: np.ndarray
    stroke: np.ndarray
    peak_pressure: np.ndarray
    lowest_pressure: np.ndarray
    opening_pressure: np.ndarray
    return_pressure: np.ndarray
    build_up: np.ndarray
    forward: np.ndarray
    dwell: np.ndarray
    return_stroke: np.ndarray
    phase_lag: np.ndarray
    pressure_rise: np.ndarray
    pressure_fall: np.ndarray
    pressure_undershoot: np.ndarray
    pressure_recovery: np.ndarray
    sleeve_forward: np.ndarray
    sleeve_seated: np.ndarray
    stop_speed: np.ndarray
    seat_speed: np.ndarray
    regime: np.ndarray

    def __len__(self):
        return len(self.start)


class CycleFinder:
    """Finds cycles in the kernel's rows as they come: feed() returns those completed."""

    def __init__(self, stroke: float):
        self._stroke = stroke
        self._rows, self._hand = compiled.new_search()

    def feed(self, rows) -> list[Cycle]:
        """Take rows of shape (n, ROW_SIZE) in order of time; return the cycles they complete."""
        if not len(rows):
            return []
        return [Cycle(*figures[:-1], regime=REGIMES[int(figures[-1])])
                for figures in self.figures(rows).tolist()]

    def figures(self, rows) -> np.ndarray:
        """Take rows as feed() does; return figures, shape (cycles, fields of Cycle)."""
        found = np.empty((len(rows), compiled.FIGURES))
        return found[:compiled.take_rows(rows, self._rows, self._hand, self._stroke, found)]


def find_cycles(trace) -> Cycles:
    """Find the whole cycles of a Trace; `len` of the result may be 0."""
    switches = trace.switches
    rows = np.empty((len(switches), ROW_SIZE))
    rows[:, ROW_TIME] = switches['time']
    rows[:, ROW_BEFORE], rows[:, ROW_AFTER] = switches['stage_before'], switches['stage_after']
    for column, name in enumerate(switches.dtype.names[5:], start=ROW_P):
        rows[:, column] = switches[name]
    figures = CycleFinder(trace.vibrator.stroke).figures(rows).T
    columns = dict(zip([field.name for field in fields(Cycle)], figures.copy(), strict=True))
    columns['regime'] = np.array([REGIMES[int(code)] for code in columns['regime']], dtype=object)
    return Cycles(frequency=1.0 / columns['period'], **columns)
