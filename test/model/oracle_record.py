"""What the oracle saw: samples, switches, extremes, totals; and the figures of its cycles."""
from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

CLOSED, FORWARD, OPEN, RETURN = range(4)


class Switch(NamedTuple):
    """A switch of stage, to the one `named`; the velocity is the one before an impact."""

    time: float
    before: int
    after: int
    named: str
    pressure: float
    plunger_position: float
    plunger_velocity: float


class OracleCycle(NamedTuple):
    """Figures of the cycle from one opening to the next, named as in the package."""

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


class Record:
    """
    What a run did.

    `extremes`: (time, pressure, position) wherever one of the two may have its highest or lowest
    value; `rises`: times at which the pressure rose through that of the last OPEN to RETURN;
    `totals`: volumes in m³ and energies in J.
    """

    def __init__(self, design):
        self.design = design
        self.samples = []
        self.switches = []
        self.extremes = []
        self.rises = []
        self.totals = {}

    def note(self, solution, terminals, start, span):
        """Take in the ends of a leg up to `span` and the events after its `terminals` ones."""
        times = [0.0, *solution.t_events[terminals], span]
        self.extremes += [(start + t, *solution.sol(t)[:2]) for t in times if t <= span]
        for times in solution.t_events[terminals + 1:]:
            self.rises += [start + t for t in times if t <= span]

    def column(self, name):
        """Samples of `time`, `pressure`, `plunger_position`, … as the package's Trace has them."""
        names = ('time', 'pressure', 'plunger_position', 'plunger_velocity', 'sleeve_position',
                 'phase')
        return np.concatenate([block[names.index(name)] for block in self.samples])

    @property
    def phase_switches(self) -> list[Switch]:
        """The switches at which the phase changes."""
        return [switch for switch in self.switches if switch.before != switch.after]

    def cycles(self) -> list[OracleCycle]:
        """Whole cycles from opening to opening that have full stroke."""
        starts = [i for i, switch in enumerate(self.switches) if switch.before == CLOSED]
        pieces = [self.switches[i:j + 1] for i, j in pairwise(starts)]
        return [self._cycle(piece) for piece in pieces
                if OPEN in [switch.before for switch in piece]]

    def _cycle(self, switches):
        first, last = switches[0], switches[-1]
        spent = [0.0] * 4
        for one, other in pairwise(switches):
            spent[one.after] += other.time - one.time
        inside = np.array([row for row in self.extremes if first.time <= row[0] <= last.time])
        peak, low, high = inside[:, 1].argmax(), inside[:, 1].argmin(), inside[:, 2].argmax()
        peak_time, low_time = inside[peak, 0], inside[low, 0]
        back = next(switch for switch in switches if switch.before == OPEN)
        slides = next(switch.time for switch in switches if switch.named == 'slide')
        stops = next(switch.time for switch in switches if switch.named == 'open')
        risen = next((t for t in self.rises if low_time <= t <= last.time), math.nan)
        return OracleCycle(
            start=first.time, period=last.time - first.time,
            stroke=inside[high, 2], peak_pressure=inside[peak, 1],
            lowest_pressure=inside[low, 1], opening_pressure=first.pressure,
            return_pressure=back.pressure, build_up=spent[CLOSED], forward=spent[FORWARD],
            dwell=spent[OPEN], return_stroke=spent[RETURN], phase_lag=inside[high, 0] - peak_time,
            pressure_rise=last.time - risen + peak_time - first.time,
            pressure_fall=back.time - peak_time, pressure_undershoot=low_time - back.time,
            pressure_recovery=risen - low_time, sleeve_forward=stops - slides,
            sleeve_seated=spent[CLOSED] + spent[FORWARD] - (stops - slides))
