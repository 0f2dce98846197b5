"""Cycles and their figures: (6) and what a user reads off a cycle."""
from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from .kernel import (
    CLOSED,
    LIFT,
    OPEN,
    PHASE_CLOSED,
    PHASE_FORWARD,
    PHASE_OF_STAGE,
    PHASE_OPEN,
    PHASE_RETURN,
    RETURN_HIGH,
    ROW_AFTER,
    ROW_BEFORE,
    ROW_P,
    ROW_P_MAX,
    ROW_P_MIN,
    ROW_SIZE,
    ROW_T_P_MAX,
    ROW_T_Y_MAX,
    ROW_TIME,
    ROW_Y_MAX,
    ROW_Y_MIN,
)

SEATED = 'seated oscillation'
SEAT_REBOUND = 'seat rebound'
OFF_SEAT = 'off-seat oscillation'
PARTIAL = 'partial stroke'
# Below this share of the full stroke the plunger is not oscillating, it is coming to rest.
LEAST_STROKE = 1e-3
# What a cycle can be counted from, the stronger first: opening, start of the return stroke, and
# (written as RETURN_HIGH) a highest position.
RANK = {CLOSED: 3, OPEN: 2, RETURN_HIGH: 1, None: 0}


@dataclass(frozen=True)
class Cycle:
    """
    One whole cycle. Times in s, pressures in Pa gauge, lengths in m, NaN for what it has not.

    A cycle that visits the seat runs from one opening to the next, so `opening_pressure` stands at
    its start and `build_up` is its last part; others run from one start of the return stroke, or
    from one highest position, to the next. The four phase times of (6) sum to the period.
    `phase_lag` is how long after the highest pressure the stroke is complete.
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
    regime: np.ndarray

    def __len__(self):
        return len(self.start)


class CycleFinder:
    """Finds cycles in the kernel's rows as they come: feed() returns those completed."""

    def __init__(self, stroke: float):
        self._stroke = stroke
        self._rows = []
        self._anchor = None

    def feed(self, rows) -> list[Cycle]:
        """Take rows of shape (n, ROW_SIZE) in order of time; return the cycles they complete."""
        found = []
        for row in rows:
            # Plain lists: single elements of numpy arrays are several times slower to read.
            self._rows.append(row.tolist())
            kind = self._kind(self._rows[-1])
            if kind is not None:
                cycle = self._complete(kind)
                if cycle is not None:
                    found.append(cycle)
        return found

    @staticmethod
    def _kind(row):
        """What a row can begin a cycle with: an opening, a return stroke, a highest position."""
        before, after = row[ROW_BEFORE], row[ROW_AFTER]
        if before == CLOSED and after == LIFT:
            return CLOSED
        if before == OPEN and after == RETURN_HIGH:
            return OPEN
        return RETURN_HIGH if before == after else None

    def _complete(self, kind):
        """Close the cycle that the newest row ends, if it ends one, and begin the next."""
        rows = self._rows
        earlier = [i for i, row in enumerate(rows[:-1]) if self._kind(row) == kind]
        # A seated cycle may well turn back on its way; only a third time is it off the seat.
        needed = 2 if kind == RETURN_HIGH and self._anchor != RETURN_HIGH else 1
        ends_one = len(earlier) >= needed
        if not ends_one and RANK[kind] < RANK[self._anchor]:
            return None
        cycle = self._measure(rows[earlier[-1]], rows[earlier[-1] + 1:], kind) if ends_one else None
        self._rows = rows[-1:]
        self._anchor = kind
        return cycle

    def _measure(self, first, rows, kind):
        """Figures of the cycle from row `first` to the last of `rows`; None where it is at rest."""
        spent = [0.0] * 4
        earlier = first[ROW_TIME]
        for row in rows:
            spent[PHASE_OF_STAGE[int(row[ROW_BEFORE])]] += row[ROW_TIME] - earlier
            earlier = row[ROW_TIME]
        highest = max(rows, key=lambda row: row[ROW_Y_MAX])
        peak = max(rows, key=lambda row: row[ROW_P_MAX])
        stroke = highest[ROW_Y_MAX] - min(row[ROW_Y_MIN] for row in rows)
        period = earlier - first[ROW_TIME]
        if stroke < LEAST_STROKE * self._stroke or period <= 0.0:
            return None
        returns = [row[ROW_P] for row in rows + [first] if self._kind(row) == OPEN]
        return Cycle(
            start=first[ROW_TIME], period=period, stroke=stroke, peak_pressure=peak[ROW_P_MAX],
            lowest_pressure=min(row[ROW_P_MIN] for row in rows),
            opening_pressure=first[ROW_P] if kind == CLOSED else math.nan,
            return_pressure=returns[0] if returns else math.nan,
            build_up=spent[PHASE_CLOSED], forward=spent[PHASE_FORWARD], dwell=spent[PHASE_OPEN],
            return_stroke=spent[PHASE_RETURN],
            phase_lag=highest[ROW_T_Y_MAX] - peak[ROW_T_P_MAX],
            regime=self._regime(kind, spent, highest[ROW_Y_MAX]))

    def _regime(self, kind, spent, highest):
        if kind != CLOSED:
            return OFF_SEAT
        if highest < self._stroke:
            return PARTIAL
        return SEATED if spent[PHASE_CLOSED] > 0.0 else SEAT_REBOUND


def find_cycles(trace) -> Cycles:
    """Find the whole cycles of a Trace; `len` of the result may be 0."""
    switches = trace.switches
    rows = np.empty((len(switches), ROW_SIZE))
    rows[:, ROW_TIME] = switches['time']
    rows[:, ROW_BEFORE], rows[:, ROW_AFTER] = switches['stage_before'], switches['stage_after']
    for column, name in enumerate(switches.dtype.names[5:], start=ROW_P):
        rows[:, column] = switches[name]
    found = CycleFinder(trace.vibrator.stroke).feed(rows)
    return Cycles(**{field.name: np.array([getattr(cycle, field.name) for cycle in found],
                                          dtype=object if field.name == 'regime' else float)
                     for field in fields(Cycles)})
