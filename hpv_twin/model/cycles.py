"""Cycles and their figures: (6) and what a user reads off a cycle."""
from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from .kernel import (
    CATCH_UP,
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
    ROW_RISE_TIME,
    ROW_SIZE,
    ROW_T_P_MAX,
    ROW_T_P_MIN,
    ROW_T_Y_MAX,
    ROW_TIME,
    ROW_Y_MAX,
    ROW_Y_MIN,
)
from .regimes import OFF_SEAT, PARTIAL, SEAT_REBOUND, SEATED

# Below this share of the full stroke the plunger is not oscillating, it is coming to rest.
LEAST_STROKE = 1e-3
FINER = ('pressure_rise', 'pressure_fall', 'pressure_undershoot', 'pressure_recovery',
         'sleeve_forward', 'sleeve_seated')
# What a cycle can be counted from, the stronger first: opening, start of the return stroke, and
# (written as RETURN_HIGH) a highest position.
RANK = {CLOSED: 3, OPEN: 2, RETURN_HIGH: 1, None: 0}


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
        seated = kind == CLOSED and bool(returns)
        return Cycle(
            start=first[ROW_TIME], period=period, stroke=stroke, peak_pressure=peak[ROW_P_MAX],
            lowest_pressure=min(row[ROW_P_MIN] for row in rows),
            opening_pressure=first[ROW_P] if kind == CLOSED else math.nan,
            return_pressure=returns[0] if returns else math.nan,
            build_up=spent[PHASE_CLOSED], forward=spent[PHASE_FORWARD], dwell=spent[PHASE_OPEN],
            return_stroke=spent[PHASE_RETURN],
            phase_lag=highest[ROW_T_Y_MAX] - peak[ROW_T_P_MAX],
            **(finer_times(first, rows, spent) if seated else dict.fromkeys(FINER, math.nan)),
            regime=self._regime(kind, spent, highest[ROW_Y_MAX]))

    def _regime(self, kind, spent, highest):
        if kind != CLOSED:
            return OFF_SEAT
        if highest < self._stroke:
            return PARTIAL
        return SEATED if spent[PHASE_CLOSED] > 0.0 else SEAT_REBOUND


def finer_times(first, rows, spent) -> dict[str, float]:
    """Rows of (6) for pressure and sleeve of a cycle between two openings; see Cycle."""
    start, end = first[ROW_TIME], rows[-1][ROW_TIME]
    highest = max(rows, key=lambda row: row[ROW_P_MAX])[ROW_T_P_MAX]
    turned = next(row for row in rows if row[ROW_BEFORE] == OPEN and row[ROW_AFTER] == RETURN_HIGH)
    after = [row for row in rows if row[ROW_TIME] > turned[ROW_TIME]]
    lowest = min(after, key=lambda row: row[ROW_P_MIN])[ROW_T_P_MIN]
    risen = next((row[ROW_RISE_TIME] for row in after if row[ROW_RISE_TIME] >= lowest), math.nan)
    picked_up = next(row[ROW_TIME] for row in rows if row[ROW_AFTER] == CATCH_UP)
    stopped = next(row[ROW_TIME] for row in rows if row[ROW_AFTER] == OPEN)
    sleeve_forward = stopped - picked_up
    return {'pressure_rise': (end - risen) + (highest - start),
            'pressure_fall': turned[ROW_TIME] - highest,
            'pressure_undershoot': lowest - turned[ROW_TIME],
            'pressure_recovery': risen - lowest,
            'sleeve_forward': sleeve_forward,
            'sleeve_seated': spent[PHASE_CLOSED] + spent[PHASE_FORWARD] - sleeve_forward}


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
