"""
A second, plain implementation of the vibrator, to hold the package's own against.

scipy's solve_ivp integrates one stage at a time to about twelve digits; every condition is a
terminal event, and is tested as a level before each leg. Nothing here is fast, and nothing is
shared with the package but the fields of Vibrator. SI units; pressures are gauge.
"""
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from oracle_record import CLOSED, FORWARD, OPEN, RETURN, Record, Switch
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

VACUUM = -101_325.0  # Pa gauge
RELATIVE, ABSOLUTE = 1e-12, 1e-13  # tolerances; the latter times the size of each state
MAX_STEP = 2e-5  # s unless on the seat: the slot does not open and close inside a step
SWITCHES_AT_ONCE = 4
# What the state carries after p, y, v: volumes in m³, energies in J.
VOLUMES = ('slot_volume', 'displaced_volume', 'added_volume')
ENERGIES = ('pump_work', 'slot_loss', 'displaced_work', 'clamp_work', 'pressure_work',
            'dashpot_work', 'sleeve_spring_work', 'friction_loss')
# What changes in jumps, J.
JUMPS = ('stop_loss', 'seat_loss', 'mass_switched_in', 'mass_switched_out', 'setpoint_work')


class Stage(NamedTuple):
    """One row of the table of phases; `low` and `high` bound y, m; slot = y - slot_starts, m."""

    phase: int
    area: float
    mass: float
    displaced: float
    slot_starts: float | None
    twisted_spring: bool
    low: float
    high: float


def stages(v) -> dict[str, Stage]:
    """Table of stages by name: closed; lift, slide, carry (forward); open; fall, drop (return)."""
    a1, a2 = (math.pi * d * d / 4 for d in (v.plunger_seat_diameter, v.sleeve_seat_diameter))
    m1, both = v.plunger_mass, v.plunger_mass + v.sleeve_mass
    h_b = v.stroke
    h_s, starts = v.gap_ratio * h_b, 0.1 * h_b
    sliding = a1 + (a2 - a1) * h_s / (h_s - starts)
    return {
        'closed': Stage(CLOSED, a1, m1, 0.0, None, True, 0.0, 0.0),
        'lift': Stage(FORWARD, a1, m1, a1, None, True, 0.0, starts),
        'slide': Stage(FORWARD, a1, m1, sliding, None, True, starts, h_s),
        'carry': Stage(FORWARD, a2, both, a2, h_s, False, h_s, h_b),
        'open': Stage(OPEN, a2, both, 0.0, 0.0, False, h_b, h_b),
        'fall': Stage(RETURN, a2, both, a2, 0.0, False, h_b - h_s, h_b),
        'drop': Stage(RETURN, a1, m1, a2, 0.0, False, 0.0, h_b - h_s),
    }


UP = {'lift': 'slide', 'slide': 'carry', 'carry': 'open', 'fall': 'open', 'drop': 'fall'}
DOWN = {'lift': 'closed', 'slide': 'lift', 'fall': 'drop', 'drop': 'closed'}


class Oracle:
    """One vibrator from rest; run() may be called again and goes on from where it was."""

    def __init__(self, vibrator):
        v = vibrator
        self.pump_flow, self.preload, self.load = v.pump_flow, v.preload, v.load
        self._take(v)
        self.name = 'closed'
        self.time, self.state = 0.0, np.zeros(3 + len(VOLUMES) + len(ENERGIES))
        self.sizes = np.array([1e7, v.stroke, 1.0] + [1e-5] * len(VOLUMES) + [1e2] * len(ENERGIES))
        self.jumps = dict.fromkeys(JUMPS, 0.0)
        self._at_once, self._refilling, self._return_pressure = 0, False, math.inf
        self._record = Record(v)

    def _take(self, v):
        """Let the machine be this one from now on."""
        self.design, self.stages = v, stages(v)
        self.line_area = v.cavity_volume / v.line_length
        self.stiffness = v.bulk_modulus / v.cavity_volume
        self.damping = v.line_damping
        if self.damping is None:
            self.damping = v.dynamic_viscosity * self.line_area / v.line_length

    @property
    def stage(self) -> Stage:
        """Row of the table in force."""
        return self.stages[self.name]

    # The equations ---------------------------------------------------------------------------

    def slot_flow(self, stage, p, y):
        """(26), (27) with the pressure of the moment, m³/s."""
        v = self.design
        drop = p - v.drain_pressure
        if stage.slot_starts is None or drop <= 0.0:
            return 0.0
        gap = math.pi * v.sleeve_seat_diameter * (y - stage.slot_starts)
        return v.flow_coefficient * gap * math.sqrt(2.0 * drop / v.density)

    def balance(self, stage, p, y, v):
        """Flow that compresses the oil of the cavity, m³/s."""
        return self.pump_flow - self.slot_flow(stage, p, y) - stage.displaced * v

    def drives(self, stage, p, y, v):
        """Forces of the pressure, the dashpot and the twisted spring, N."""
        design = self.design
        dashpot = (math.sqrt(stage.area / self.line_area) * self.damping
                   * self.balance(stage, p, y, v) / stage.area)
        spring = design.twisted_spring_stiffness * (design.twisted_spring_preload - y)
        return (stage.area * (p - design.drain_pressure), dashpot,
                spring if stage.twisted_spring else 0.0)

    def force(self, stage, p, y, v):
        """Net force on the plunger, (22) and (23), N."""
        spring = self.design.slotted_spring_stiffness * (y + self.preload)
        return (sum(self.drives(stage, p, y, v)) - spring - self.load
                - self.design.viscous_friction * v)

    def sleeve(self, stage, y):
        """y2, m."""
        v = self.design
        h_s, starts = v.gap_ratio * v.stroke, 0.1 * v.stroke
        if stage.phase != FORWARD or y >= h_s:
            return y
        return max(0.0, (y - starts) * h_s / (h_s - starts))

    def _rates(self, stage, held):
        moves = stage.low < stage.high

        def rates(_, state):
            p, y, v = state[:3]
            slot, displaced = self.slot_flow(stage, p, y), stage.displaced * v
            net = self.pump_flow - slot - displaced
            added = -net if held else 0.0
            return [self.stiffness * (net + added), v,
                    self.force(stage, p, y, v) / stage.mass if moves else 0.0,
                    slot, displaced, added,
                    p * self.pump_flow, p * slot, p * displaced, p * added,
                    *(drive * v for drive in self.drives(stage, p, y, v)),
                    self.design.viscous_friction * v * v]
        return rates

    # Conditions, as levels and as events -----------------------------------------------------

    def _held(self):
        """Tell whether the pressure is at vacuum and bound to stay there."""
        refilling, self._refilling = self._refilling, False
        if refilling or self.state[0] > VACUUM:
            return False
        return self.balance(self.stage, *self.state[:3]) < 0.0

    def _level(self):
        """Name of the stage to which a condition that already holds leads, or None."""
        stage = self.stage
        p, y, v = self.state[:3]
        if stage.low < stage.high:
            if y >= stage.high and v > 0.0:
                return UP[self.name]
            if y <= stage.low and v < 0.0 and self.name in DOWN:
                return DOWN[self.name]
        if stage.phase == CLOSED and self.force(stage, p, y, v) > 0.0:
            return 'lift'
        if stage.phase == OPEN and self.force(stage, p, y, v) < 0.0:
            return 'fall'
        if self.name == 'carry' and v < 0.0:
            return self._returning()
        return None

    def _returning(self):
        return 'fall' if self.state[1] >= self.stages['fall'].low else 'drop'

    def _way(self):
        """Sign of the velocity, or of what it is about to be; 0 on seat and stop."""
        stage = self.stage
        _, y, v = self.state[:3]
        if stage.low == stage.high:
            return 0.0
        if v == 0.0 and y in (0.0, self.design.stroke):
            return 1.0 if y == 0.0 else -1.0
        return math.copysign(1.0, v if v != 0.0 else self.force(stage, *self.state[:3]))

    def _terminal(self, stage, held, way):
        """What ends a leg in this stage, as (kind, function, direction)."""
        if way:
            bound = stage.high if way > 0.0 else stage.low
            yield 'bound', lambda t, s: s[1] - bound, way
            yield 'turn', lambda t, s: s[2], -way
        else:
            sign = 1 if stage.phase == CLOSED else -1
            yield 'force', lambda t, s: self.force(stage, *s[:3]), sign
        if held:
            yield 'refill', lambda t, s: self.balance(stage, *s[:3]), 1
        else:
            yield 'vacuum', lambda t, s: s[0] - VACUUM, -1

    def _passing(self, stage):
        """What is only noted: extremes of pressure, the rise through p2."""
        def rise(_, s):
            return s[0] - self._return_pressure
        rise.direction = 1
        known = [rise] if math.isfinite(self._return_pressure) else []
        return [lambda t, s: self.balance(stage, *s[:3]), *known]

    # Going on --------------------------------------------------------------------------------

    def _leg(self, until, rate):
        """Integrate to the next terminal event, or to `until`."""
        while (name := self._level()) is not None:
            self._switch(name)
        stage, held, way = self.stage, self._held(), self._way()
        kinds, events = [], []
        for kind, event, direction in self._terminal(stage, held, way):
            event.terminal, event.direction = True, direction
            kinds.append(kind)
            events.append(event)
        solution = solve_ivp(
            self._rates(stage, held), (0.0, until - self.time), self.state, method='DOP853',
            rtol=RELATIVE, atol=ABSOLUTE * self.sizes, events=events + self._passing(stage),
            dense_output=True, max_step=np.inf if stage.phase == CLOSED else MAX_STEP)
        if solution.status < 0:
            raise RuntimeError(f'{solution.message} at {self.time} s in {self.name}')
        span, kind = solution.t[-1], None
        if solution.status == 1:
            kind = next(kind for kind, times in zip(kinds, solution.t_events, strict=False)
                        if len(times))
        if way:
            # It may have crossed and turned in one step: between turns the position is monotone.
            bound = stage.high if way > 0.0 else stage.low
            if kind != 'bound' and way * (solution.y[1, -1] - bound) > 0.0:
                kind = 'bound'
                span = brentq(lambda t: solution.sol(t)[1] - bound, 0.0, span, xtol=1e-18)
        self._record.note(solution, len(events), self.time, span)
        self._sample(solution, span, rate)
        self.state = solution.sol(span) if span < solution.t[-1] else solution.y[:, -1].copy()
        self.time = until if kind is None else self.time + span
        if span > 0.0:
            self._at_once = 0
        if kind is not None:
            self._arrive(kind, way)

    def _sample(self, solution, span, rate):
        if rate is None:
            return
        start = self.time
        first, last = (math.floor(t * rate + 1e-9) for t in (start, start + span))
        grid = np.arange(first + 1, last + 1) / rate
        if len(grid):
            p, y, v = solution.sol(np.clip(grid - start, 0.0, span))[:3]
            sleeve = [self.sleeve(self.stage, value) for value in y]
            phase = np.full(len(grid), self.stage.phase)
            self._record.samples.append(np.array([grid, p, y, v, sleeve, phase]))

    def _arrive(self, kind, way):
        """Put the state exactly where the event is, and switch."""
        if kind == 'vacuum':
            self.state[0] = VACUUM
        elif kind == 'refill':
            self._refilling = True  # the balance is zero here, to the last bit or not
        elif kind == 'force':
            self._switch('lift' if self.stage.phase == CLOSED else 'fall')
        elif kind == 'bound':
            self.state[1] = self.stage.high if way > 0.0 else self.stage.low
            self._switch((UP if way > 0.0 else DOWN)[self.name])
        else:
            self.state[2] = 0.0
            if self.name == 'carry':
                self._switch(self._returning())

    def _switch(self, name):
        """Enter another stage; an impact takes the velocity."""
        before, after = self.stage, self.stages[name]
        p, y, v = self.state[:3].tolist()
        energy = v * v / 2
        if before.phase != after.phase:
            self._at_once += 1
            if self._at_once > SWITCHES_AT_ONCE:
                raise RuntimeError(f'chatter at {self.time} s: {self.state[:3]}, {self.design}')
        self._record.switches.append(
            Switch(float(self.time), before.phase, after.phase, name, p, y, v))
        if after.phase in (CLOSED, OPEN):
            self.state[2] = 0.0
            self.jumps['stop_loss' if y else 'seat_loss'] += before.mass * energy
        else:
            switched = 'mass_switched_in' if after.mass > before.mass else 'mass_switched_out'
            self.jumps[switched] += abs(after.mass - before.mass) * energy
        if before.phase == OPEN:
            self._return_pressure = p
        self.name = name

    def set(self, **setpoints):
        """Change `pump_flow`, `preload`, `load` or fields of the design now."""
        k1, y = self.design.slotted_spring_stiffness, self.state[1]
        preload, load = (setpoints.get(name, getattr(self, name)) for name in ('preload', 'load'))
        self.jumps['setpoint_work'] += (
            k1 / 2 * ((y + preload) ** 2 - (y + self.preload) ** 2) + (load - self.load) * y)
        self.preload, self.load = preload, load
        self.pump_flow = setpoints.get('pump_flow', self.pump_flow)
        fields = {name: value for name, value in setpoints.items()
                  if name not in ('pump_flow', 'preload', 'load')}
        self._take(self.design.replace(**fields))

    def run(self, duration, changes=(), sample_rate=None) -> Record:
        """
        Run for `duration` s; `changes` are (time, {setpoint: value}) at absolute times, in order.

        `sample_rate` in Hz asks for samples at its multiples. The totals count from rest.
        """
        until = self.time + duration
        record = self._record = Record(self.design)
        for instant, setpoints in [*changes, (until, {})]:
            while self.time < instant:
                self._leg(instant, sample_rate)
            self.set(**setpoints)
        names = VOLUMES + ENERGIES
        record.totals = dict(zip(names, self.state[3:].tolist(), strict=True)) | self.jumps
        return record
