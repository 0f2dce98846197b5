"""
The vibrator by SciPy: solve_ivp for one row of the table of phases after the other.

Written as one would who knows solve_ivp: terminal events end a row, the highest pressure is an
event too, and what already holds on entry is tested there. SI units, pressures are gauge.
"""
from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp

from hpv_twin.model.kernel import (
    CATCH_UP,
    CLOSED,
    LIFT,
    OPEN,
    RETURN_HIGH,
    RETURN_LOW,
    SLOT,
)

RELATIVE = 1e-6  # tolerance of solve_ivp
SIZES = np.array([1e7, 2e-3, 1.0])  # of p in Pa, y in m and v in m/s, for the absolute tolerance
UPWARDS = {LIFT: CATCH_UP, CATCH_UP: SLOT, SLOT: OPEN, RETURN_LOW: RETURN_HIGH, RETURN_HIGH: OPEN}
DOWNWARDS = {CATCH_UP: LIFT, LIFT: CLOSED, RETURN_HIGH: RETURN_LOW, RETURN_LOW: CLOSED}


class Row:
    """One row of the table: rates and events for solve_ivp. `line` and `par` as in the kernel."""

    def __init__(self, name, line, par):
        self.name = name
        (self.area, self.mass, self.displaced, self.s0, self.s1, self.force0, self.ks, self.flow,
         self.low, self.high) = line
        self.stiffness, self.pump_flow, self.drain, self.friction, self.orifice = par[:5]
        self.rates = self.standing if name in (CLOSED, OPEN) else self.moving
        self.events = self.list_events()

    def balance(self, p, y, v):
        """Q_H - Q_slot - A_v*v, m³/s."""
        balance = self.pump_flow - self.displaced * v
        if p > self.drain:
            balance -= self.orifice * (self.s0 + self.s1 * y) * math.sqrt(p - self.drain)
        return balance

    def force(self, p, y, v):
        """Net force on the plunger, N."""
        return (self.area * p + self.force0 - self.ks * y - self.friction * v
                + self.flow * self.balance(p, y, v))

    def standing(self, _, state):
        """Rates on seat and stop."""
        return self.stiffness * self.balance(*state.tolist()), 0.0, 0.0

    def moving(self, _, state):
        """Rates elsewhere."""
        p, y, v = state.tolist()
        return self.stiffness * self.balance(p, y, v), v, self.force(p, y, v) / self.mass

    def list_events(self):
        """One or two ends of the row, and the highest pressure."""
        if self.name in (CLOSED, OPEN):
            ends = [(lambda t, s: self.force(*s), 1.0 if self.name == CLOSED else -1.0)]
        elif self.name == SLOT:
            ends = [(lambda t, s: s[1] - self.high, 1.0), (lambda t, s: s[2], -1.0)]
        else:
            ends = [(lambda t, s: s[1] - self.high, 1.0), (lambda t, s: s[1] - self.low, -1.0)]
        functions = []
        for function, direction in [*ends, (lambda t, s: self.balance(*s), -1.0)]:
            function.terminal, function.direction = True, direction
            functions.append(function)
        functions[-1].terminal = False
        return functions


def following(row, end, state, rows):
    """Name of the row that event number `end` of `row` leads to; puts the state exactly there."""
    after = LIFT if row.name == CLOSED else RETURN_HIGH
    if row.name == SLOT and end == 1:
        after = RETURN_HIGH if state[1] >= rows[RETURN_HIGH].low else RETURN_LOW
    elif row.name not in (CLOSED, OPEN):
        after = (UPWARDS, DOWNWARDS)[end][row.name]
        state[1] = row.low if end else row.high
    if after in (CLOSED, OPEN):
        state[2] = 0.0
        force = rows[after].force(*state)
        if after == OPEN and force < 0.0:
            return RETURN_HIGH
        if after == CLOSED and force > 0.0:
            return LIFT
    return after


def run(table, par, seconds, rate, method):
    """
    Run from rest; `table` and `par` are the kernel's stage table and parameters.

    Returns samples of p, y, v, shape (n, 3), the instants of opening, s, and the highest pressure
    before each, Pa.
    """
    rows = [Row(name, line, par.tolist()) for name, line in enumerate(table.tolist())]
    grid = np.arange(1, round(seconds * rate) + 1) / rate
    time, row, state, peak, written = 0.0, rows[CLOSED], np.zeros(3), 0.0, 0
    samples, openings, peaks = [], [], []
    while True:
        leg = solve_ivp(row.rates, (time, grid[-1]), state, method=method, events=row.events,
                        t_eval=grid[written:], rtol=RELATIVE, atol=RELATIVE * SIZES)
        if len(leg.t):
            samples.append(leg.y.T)
            written += len(leg.t)
        if leg.status != 1:
            return np.concatenate(samples), openings, peaks
        end = next(i for i, times in enumerate(leg.t_events) if len(times))
        time, state = leg.t_events[end][-1], leg.y_events[end][-1]
        peak = max([peak, state[0], *(s[0] for s in leg.y_events[-1])])
        before, row = row, rows[following(row, end, state, rows)]
        if row.name == LIFT and before.name in (CLOSED, RETURN_LOW):
            openings.append(time)
            peaks.append(peak)
            peak = 0.0
