"""The running model: state, setpoints and advance()."""
from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from . import kernel
from .cycles import CycleFinder
from .ledger import Account, EnergyLedger
from .regimes import name_regime
from .vibrator import Vibrator

SWITCH = np.dtype([
    ('time', float), ('stage_before', np.int8), ('stage_after', np.int8),
    ('before', np.int8), ('after', np.int8), ('pressure', float), ('plunger_position', float),
    ('plunger_velocity', float), ('pressure_max', float), ('pressure_max_time', float),
    ('pressure_min', float), ('pressure_min_time', float), ('position_max', float),
    ('position_max_time', float), ('position_min', float), ('rise_time', float)])
LOG_ROWS = 1024
RECENT = 40  # rows of the log that tell the regime: some four cycles
METHODS = ('default', 'euler')
SETPOINTS = ('pump_flow', 'preload', 'load')
# They say where the plunger can be: changed under a moving plunger they would strand it.
PLACES = ('stroke', 'gap_ratio')


class ModelError(RuntimeError):
    """The model cannot go on; the message names state, setpoints and design."""


@dataclass(frozen=True)
class Trace:
    """
    What a simulation did: samples of equal spacing, and the located switches between them.

    Arrays of shape (samples,): `time` s, `pressure` Pa gauge, `plunger_position` m,
    `plunger_velocity` m/s, `sleeve_position` m, `phase` (0 closed, 1 forward, 2 open, 3 return).
    `switches` is a structured array, one row per located switch: `time`, the phases `before` and
    `after` it (and the finer stages), the state there (velocity before the impact), and the
    extremes of pressure and position since the row before it, with their times; `rise_time` is
    when, since then, the pressure rose through that of the last return stroke's start (or NaN).
    Where before == after the sleeve was reached or left, or the plunger turned back.
    """

    time: np.ndarray
    pressure: np.ndarray
    plunger_position: np.ndarray
    plunger_velocity: np.ndarray
    sleeve_position: np.ndarray
    phase: np.ndarray
    switches: np.ndarray
    vibrator: Vibrator

    @staticmethod
    def join(traces) -> Trace:
        """Put successive traces of one simulation together."""
        traces = list(traces)
        fields = ('time', 'pressure', 'plunger_position', 'plunger_velocity', 'sleeve_position',
                  'phase', 'switches')
        columns = {name: np.concatenate([getattr(trace, name) for trace in traces])
                   for name in fields}
        return Trace(vibrator=traces[-1].vibrator, **columns)


def as_switches(rows: np.ndarray) -> np.ndarray:
    """Name the columns of the kernel's log of switches; shape (n, ROW_SIZE) to (n,) records."""
    switches = np.empty(len(rows), dtype=SWITCH)
    before = rows[:, kernel.ROW_BEFORE].astype(np.int8)
    after = rows[:, kernel.ROW_AFTER].astype(np.int8)
    switches['stage_before'], switches['stage_after'] = before, after
    switches['before'] = kernel.PHASE_OF_STAGE[before]
    switches['after'] = kernel.PHASE_OF_STAGE[after]
    switches['time'] = rows[:, kernel.ROW_TIME]
    for column, name in enumerate(SWITCH.names[5:], start=kernel.ROW_P):
        switches[name] = rows[:, column]
    return switches


class Simulation:
    """
    One vibrator in model time, starting from rest: p = 0 gauge, y = v = 0, valve closed.

    `method` is 'default', or 'euler' (the paper's, with fixed `step` in s). The setpoints
    `pump_flow` (Q_H, m³/s), `preload` (y01, m) and `load` (F_T, N, signed) can be set at any
    time and act from the present instant on; `redesign` changes the vibrator itself. Equal inputs
    give bit-identical results, however `advance` is sliced. With `ledger`, `energy` tells where the
    pump's work went; that is slower.
    """

    def __init__(self, vibrator: Vibrator | None = None, method: str = 'default',
                 step: float = 1e-5, ledger: bool = False):
        if method not in METHODS:
            raise ValueError(f'method "{method}" is none of: {", ".join(METHODS)}')
        if not (step > 0.0 and math.isfinite(step)):
            raise ValueError(f'step = {step} s must be positive and finite')
        self.vibrator = Vibrator() if vibrator is None else vibrator
        self.method = method
        self.step = step
        self._setpoints = [self.vibrator.pump_flow, self.vibrator.preload, self.vibrator.load]
        self._constants = kernel.constants(self.vibrator)
        self._parameters = kernel.parameters(self.vibrator)
        self._table = np.empty(kernel.TABLE)
        self._log = np.empty((LOG_ROWS, kernel.ROW_SIZE))
        if method == 'euler':
            self._integrator = kernel.advance_euler, float(step)
        else:
            self._integrator = kernel.advance_exact, np.zeros(kernel.WORKSPACE)
        self._no_samples = np.empty((kernel.SAMPLE_SIZE, 0))
        self._state = np.empty(kernel.STATE_SIZE)
        self._no_ledger = np.empty(0)
        self._account = Account(self) if ledger else None
        self._apply()
        self.reset()

    def reset(self) -> None:
        """Go back to rest at time 0; setpoints stay."""
        self._state[:] = 0.0
        self._state[kernel.LAST_SWITCH] = -1.0
        self._state[kernel.RETURN_P] = self._state[kernel.RISE_TIME] = math.nan
        self._time_rest = 0.0
        self._changed = True
        self._recent = deque(maxlen=RECENT)
        if self._account is not None:
            self._account.reset()

    def _apply(self):
        flow, preload, load = self._setpoints
        self._parameters[kernel.PUMP_FLOW] = flow
        kernel.fill_stages(self._constants, preload, load, self._table)
        self._design = None
        self._changed = True

    def _set(self, index, name, unit, value, low):
        value = float(value)
        if not (math.isfinite(value) and value >= low):
            bound = f'at least {low:g} {unit} and finite' if math.isfinite(low) else 'finite'
            raise ValueError(f'{name} = {value:g} {unit} must be {bound}')
        if value != self._setpoints[index]:
            after = list(self._setpoints)
            after[index] = value
            if self._account is not None:
                self._account.note_setpoints(after[1], after[2])
            self._setpoints = after
            self._apply()

    @property
    def pump_flow(self) -> float:
        """Q_H, m³/s, in force."""
        return self._setpoints[0]

    @pump_flow.setter
    def pump_flow(self, value):
        self._set(0, 'pump_flow', 'm^3/s', value, 0.0)

    @property
    def preload(self) -> float:
        """y01, m, in force."""
        return self._setpoints[1]

    @preload.setter
    def preload(self, value):
        self._set(1, 'preload', 'm', value, 0.0)

    @property
    def load(self) -> float:
        """F_T, N, in force; a pull is negative."""
        return self._setpoints[2]

    @load.setter
    def load(self, value):
        self._set(2, 'load', 'N', value, -math.inf)

    @property
    def design(self) -> Vibrator:
        """The vibrator with the setpoints in force as its pump flow, preload and load."""
        if self._design is None:
            self._design = self.vibrator.replace(pump_flow=self.pump_flow, preload=self.preload,
                                                 load=self.load)
        return self._design

    def redesign(self, **changes) -> None:
        """
        Change fields of the vibrator from the present instant on; setpoints in force stay.

        Pressure, position and velocity are continuous. `stroke` and `gap_ratio` can change only
        while the plunger is on its seat. Raises VibratorError for a design that cannot be,
        ValueError for a setpoint among the changes, for a plunger off its seat, and with
        `ledger=True`, which has no term for energy that a change of stiffness puts in; nothing is
        changed then.
        """
        for name in changes:
            if name in SETPOINTS:
                raise ValueError(f'{name} is a setpoint: set simulation.{name}')
        vibrator = self.vibrator.replace(**changes)
        if vibrator == self.vibrator:
            return
        if self._account is not None:
            raise ValueError('the energy ledger has no term for a change of the design: '
                             'Simulation(..., ledger=False) can be redesigned')
        for name in PLACES:
            if self.stage != kernel.CLOSED and (
                    getattr(vibrator, name) != getattr(self.vibrator, name)):
                raise ValueError(f'{name} cannot change while the plunger is off its seat '
                                 f'(y = {self.plunger_position:g} m)')
        self.vibrator = vibrator
        self._constants = kernel.constants(vibrator)
        self._parameters = kernel.parameters(vibrator)
        self._apply()

    @property
    def time(self) -> float:
        """Model time since rest, s."""
        return float(self._state[kernel.TIME])

    @property
    def pressure(self) -> float:
        """p, Pa gauge, in cavity A."""
        return float(self._state[kernel.P])

    @property
    def plunger_position(self) -> float:
        """y, m, from the seat."""
        return float(self._state[kernel.Y])

    @property
    def plunger_velocity(self) -> float:
        """v, m/s, opening is positive."""
        return float(self._state[kernel.V])

    @property
    def stage(self) -> int:
        """Row of the phase table in which the machine is, see kernel.STAGE_NAMES."""
        return int(self._state[kernel.STAGE])

    @property
    def phase(self) -> int:
        """0 closed, 1 forward, 2 open, 3 return."""
        return int(kernel.PHASE_OF_STAGE[self.stage])

    @property
    def sleeve_position(self) -> float:
        """y2, m, from its seat."""
        return float(kernel.sleeve_position(self.plunger_position, self.stage, self._parameters))

    @property
    def sleeve_velocity(self) -> float:
        """dy2/dt, m/s."""
        return float(kernel.sleeve_velocity(self.plunger_velocity, self.stage, self._parameters))

    @property
    def machine(self):
        """State, stage table and parameters, as the kernel has them: to be read only."""
        return self._state, self._table, self._parameters

    @property
    def last_switch(self) -> float:
        """Instant of the last located switch, s; 0 before the first or if it is long past."""
        for rows in reversed(self._recent):
            moved = rows[rows[:, kernel.ROW_BEFORE] != rows[:, kernel.ROW_AFTER]]
            if len(moved):
                return float(moved[-1, kernel.ROW_TIME])
        return 0.0

    @property
    def has_opened(self) -> bool:
        """Whether the valve has opened since rest."""
        return bool(self._recent)

    @property
    def regime(self) -> str:
        """What the machine is doing, by the names of hpv_twin.model.regimes."""
        finder, cycles = CycleFinder(self.vibrator.stroke), []
        for rows in self._recent:
            cycles += finder.feed(rows)
        return name_regime(self, cycles[-1] if cycles else None)

    @property
    def plunger_force(self) -> float:
        """Net force on the plunger, N: (22); on seat and stop, what those then carry."""
        state = self._state
        return float(kernel.force_at(state[kernel.P], state[kernel.Y], state[kernel.V],
                                     self.stage, self._table, self._parameters))

    @property
    def sleeve_force(self) -> float:
        """Pressure force on the valve sleeve, N: on the ring A2 - A1 once the plunger is off."""
        if self.stage == kernel.CLOSED:
            return 0.0
        ring = self.vibrator.sleeve_seat_area - self.vibrator.plunger_seat_area
        return ring * (self.pressure - self.vibrator.drain_pressure)

    @property
    def energy(self) -> EnergyLedger:
        """The energy ledger since rest; needs `ledger=True`."""
        if self._account is None:
            raise ValueError('energies were not kept: Simulation(..., ledger=True) keeps them')
        return self._account.ledger()

    def advance(self, duration: float, sample_rate: float = 10_000.0) -> Trace:
        """
        Run for `duration` s of model time and return what happened.

        Samples are taken at the multiples of 1/sample_rate (Hz) of model time after the present
        instant, the last instant included, so that successive traces join without a seam.
        Raises ValueError for a negative or infinite duration, ModelError where the model chatters.
        """
        if not (sample_rate > 0.0 and math.isfinite(sample_rate)):
            raise ValueError(f'sample_rate = {sample_rate} Hz must be positive and finite')
        rows, samples = self.sampled_tick(duration, float(sample_rate))
        return Trace(*samples[:kernel.SAMPLE_PHASE],
                     phase=samples[kernel.SAMPLE_PHASE].astype(np.int8),
                     switches=as_switches(rows), vibrator=self.design)

    def tick(self, duration: float) -> np.ndarray:
        """
        Run for `duration` s without samples: what a real-time loop calls.

        Returns the kernel's rows of the switches located on the way, shape (n, ROW_SIZE).
        """
        return self._run(self._end(duration), self._no_samples, 0, 1.0)

    def sampled_tick(self, duration: float, sample_rate: float) -> tuple[np.ndarray, np.ndarray]:
        """
        As `tick`, with samples as `advance` takes them: the rows of the switches, and the samples.

        `samples` has one row per quantity (kernel.SAMPLE_TIME, …) and one column per sample.
        """
        until = self._end(duration)
        first, last = self._grid(self.time, sample_rate) + 1, self._grid(until, sample_rate)
        samples = np.empty((kernel.SAMPLE_SIZE, max(0, last - first + 1)))
        return self._run(until, samples, first, sample_rate), samples

    def _end(self, duration):
        if not (duration >= 0.0 and math.isfinite(duration)):
            raise ValueError(f'duration = {duration} s must be finite and not negative')
        # Compensated sum: a million ticks of 1 ms are 1000 s to the last bit.
        compensated = duration + self._time_rest
        until = self.time + compensated
        self._time_rest = compensated - (until - self.time)
        return until

    @staticmethod
    def _grid(time, rate):
        """Index of the last sample at or before `time`."""
        position = time * rate
        return math.floor(position + 1e-9 + 4e-16 * position)

    def _run(self, until, samples, first, rate):
        logs = []
        written = 0
        while True:
            integrate, how = self._integrator
            code, written, used = integrate(
                self._state, self._table, self._parameters, self._changed, until, how,
                first, rate, samples, written, self._log,
                self._no_ledger if self._account is None else self._account.integrals)
            self._changed = False
            if code == kernel.CHATTER:
                raise ModelError(self._chatter())
            logs.append(self._log[:used].copy())
            if used:
                self._recent.append(logs[-1][-RECENT:])
            if self._account is not None:
                self._account.note_rows(logs[-1])
            if code == kernel.DONE:
                return logs[0] if len(logs) == 1 else np.concatenate(logs)

    def _chatter(self):
        return (f'more than {kernel.SWITCHES_AT_ONCE} switches at one instant: t = {self.time} s, '
                f'p = {self.pressure} Pa gauge, y = {self.plunger_position} m, '
                f'v = {self.plunger_velocity} m/s, stage "{kernel.STAGE_NAMES[self.stage]}", '
                f'{self.design}')
