"""The model's steady cycle fitted to measured waveforms by least squares, with its covariance."""
from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from hpv_twin.model import Vibrator, VibratorError
from hpv_twin.model.designs import FIELDS

from .cycle_wave import CycleWave, cycle_wave
from .folding import Fold
from .measured import Measured

FREE = ('bulk_modulus', 'pump_flow', 'preload', 'flow_coefficient', 'viscous_friction',
        'pressure_offset', 'position_offset')
CHOICES = ('bulk_modulus', 'flow_coefficient', 'viscous_friction', 'line_damping', 'pump_flow',
           'preload', 'slotted_spring_stiffness', 'plunger_mass', 'sleeve_seat_diameter', 'load',
           'pressure_offset', 'position_offset')
# Offsets of the sensors, and the size of each that counts as one.
OFFSETS = {'pressure_offset': 1e5, 'position_offset': 1e-4}  # Pa, m
# Fields that may be 0 are moved in units of these, the others by their logarithm.
LINEAR = {'viscous_friction': 20.0, 'line_damping': 3e-3, 'load': 1000.0}
# What is thought possible before anything is measured, in those coordinates: so wide that it
# decides nothing that the data tell, and keeps in place what they do not.
PRIOR = 2.0
STEP = 2e-3  # of the derivatives: well above the wiggles of the interpolated cycle
PERIOD_FLOOR = 3e-5  # relative: how well a clock and this model can agree at best
COARSE = 6000  # samples of each sensor for the first, rough fits
BADNESS = 30.0  # residual, in standard deviations, where the model has no cycle
SHARP = 2e-6  # s: a clock as good as this is perfect


@dataclass(frozen=True)
class Samples:
    """Samples of one sensor laid over one period: `phase` from the discharge, `value`, `weight`."""

    phase: np.ndarray
    value: np.ndarray
    weight: np.ndarray  # 1/standard deviation
    clock: float = 0.0  # standard deviation of the stamps, s

    def some(self, count: int) -> Samples:
        """At most about `count` of them, evenly chosen."""
        every = max(1, len(self.phase) // count)
        return Samples(self.phase[::every], self.value[::every], self.weight[::every],
                       self.clock)


class Problem:
    """
    Residuals of the model against folded samples, as a function of coordinates x.

    `names` are the free parameters; behind them stands one phase per recording: by how much of a
    period the discharge of the fold comes after the opening.
    """

    def __init__(self, start: Vibrator, names: tuple[str, ...], pressures: list[Samples],
                 positions: list[Samples | None], folds: list[Fold]):
        self.start, self.names = start, names
        self.pressures, self.positions, self.folds = pressures, positions, folds
        self.period = folds[0].period
        self.period_sigma = max(math.hypot(folds[0].sigma, 0.0), PERIOD_FLOOR * self.period)

    def with_samples(self, count: int) -> Problem:
        """The same with so many samples of each sensor."""
        return Problem(self.start, self.names, [s.some(count) for s in self.pressures],
                       [s and s.some(count) for s in self.positions], self.folds)

    def design(self, x) -> Vibrator:
        """Return the design at these coordinates; VibratorError outside the bounds."""
        return self.start.replace(**{name: self.value(name, x) for name in self.names
                                     if name not in OFFSETS})

    def value(self, name: str, x) -> float:
        """Return one parameter at these coordinates, SI."""
        at = float(x[self.names.index(name)])
        if name in OFFSETS:
            return OFFSETS[name] * at
        if name in LINEAR:
            value = field_value(self.start, name) + LINEAR[name] * at
            return value if name == 'load' else max(0.0, value)
        return field_value(self.start, name) * math.exp(at)

    def scale(self, name: str, x) -> float:
        """d(value)/dx, SI."""
        return OFFSETS.get(name) or LINEAR.get(name) or self.value(name, x)

    def offset(self, name: str, x) -> float:
        """Return an offset, 0 where it is not free."""
        return self.value(name, x) if name in self.names else 0.0

    def wave(self, x) -> CycleWave | None:
        """Return the model's cycle; None where there is none."""
        try:
            return cycle_wave(self.design(x))
        except VibratorError:
            return None

    def residuals(self, x) -> np.ndarray:
        """Return (model - measured) in standard deviations: samples, the period, the prior."""
        wave = self.wave(x)
        phases = x[len(self.names):]
        parts = []
        for samples, position, shift in zip(self.pressures, self.positions, phases, strict=True):
            if wave is None:
                parts += [np.full(len(s.phase), BADNESS) for s in (samples, position) if s]
                continue
            parts.append((wave.pressure_at(samples.phase + shift, samples.clock) + self.offset(
                'pressure_offset', x) - samples.value) * samples.weight)
            if position:
                parts.append((wave.position_at(position.phase + shift, position.clock)
                              + self.offset('position_offset', x)
                              - position.value) * position.weight)
        period = BADNESS if wave is None else (wave.period - self.period) / self.period_sigma
        parts += [np.array([np.clip(period, -1e5, 1e5)]), x[:len(self.names)] / PRIOR]
        return np.concatenate(parts)

    def jacobian(self, x) -> np.ndarray:
        """Return the derivatives of the residuals, by central differences."""
        columns = []
        for k in range(len(x)):
            away = np.zeros(len(x))
            away[k] = STEP
            columns.append((self.residuals(x + away) - self.residuals(x - away)) / (2.0 * STEP))
        return np.stack(columns, axis=1)


@dataclass(frozen=True)
class Fit:
    """
    Where a fit ended: `x`, its `covariance`, the `cost` (chi² per sample) and the `wave`.

    `order`: by how much the residuals are more than noise, see `order_of`.
    """

    problem: Problem
    x: np.ndarray
    covariance: np.ndarray
    cost: float
    wave: CycleWave
    order: float

    @property
    def design(self) -> Vibrator:
        """The design there."""
        return self.problem.design(self.x)

    def value(self, name: str) -> float:
        """One parameter, SI."""
        return self.problem.value(name, self.x)

    def sigma(self, name: str) -> float:
        """Its standard deviation, SI."""
        k = self.problem.names.index(name)
        return math.sqrt(self.covariance[k, k]) * self.problem.scale(name, self.x)

    def correlation(self, one: str, other: str) -> float:
        """Correlation of two parameters."""
        i, j = (self.problem.names.index(name) for name in (one, other))
        return float(self.covariance[i, j]
                     / math.sqrt(self.covariance[i, i] * self.covariance[j, j]))


def field_value(design: Vibrator, name: str) -> float:
    """A field of a design; the line's damping in force where (19) gives it."""
    return design.line_damping_in_force if name == 'line_damping' else getattr(design, name)


def fit(problem: Problem, starts: list[np.ndarray], tick: Callable[[], None] = lambda: None,
        rounds: int = 3) -> Fit | None:
    """
    Fit from several starts with few samples, go on from the best with all, weigh them anew.

    Returns None where the model has no cycle anywhere near.
    """
    coarse, best = problem.with_samples(COARSE), None
    for start in starts:
        tick()
        if coarse.wave(start) is None:
            continue
        found = least_squares(coarse.residuals, start, jac=coarse.jacobian, x_scale='jac',
                              max_nfev=200)
        if best is None or found.cost < best.cost:
            best = found
    if best is None or coarse.wave(best.x) is None:
        return None
    x = best.x
    for _ in range(rounds):
        tick()
        problem = weighed(problem, x)
        coarse = problem.with_samples(COARSE)
        x = least_squares(coarse.residuals, x, jac=coarse.jacobian, x_scale='jac',
                          max_nfev=100).x
    for _ in range(2):
        tick()
        problem = weighed(problem, x)
        x = least_squares(problem.residuals, x, jac=problem.jacobian, x_scale='jac', xtol=1e-12,
                          ftol=1e-12, gtol=1e-12, max_nfev=12).x
    return finished(problem, x)


def finished(problem: Problem, x) -> Fit:
    """Return the fit at x with a covariance scaled by the residuals' size and their order."""
    jacobian, residuals = problem.jacobian(x), problem.residuals(x)
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    wave = problem.wave(x)
    count = len(residuals) - len(problem.names) - 1
    cost = float(residuals[:count] @ residuals[:count]) / max(1, count - len(x))
    order = order_of(problem, x, wave)
    return Fit(problem, x, inverse * max(1.0, order) * max(1.0, cost), cost, wave, order)


def order_of(problem: Problem, x, wave: CycleWave) -> float:
    """
    Return by how much the residuals' means over stretches of phase exceed those of plain noise.

    Noise gives 1. What the model cannot show stands in one place of every cycle: it does not
    average out, so many samples do not make the parameters as sure as they would.
    """
    excess = []
    for samples, shift in zip(problem.pressures, x[len(problem.names):], strict=True):
        phase = samples.phase + shift
        left = (samples.value - wave.pressure_at(phase, samples.clock)
                - problem.offset('pressure_offset', x)) * samples.weight
        bins = np.floor(np.mod(phase, 1.0) * 200).astype(int)
        count = np.bincount(bins, minlength=200)
        total = np.bincount(bins, left, 200)
        full = count > 3
        excess.append(float(np.mean(total[full] ** 2 / count[full])))
    return max(excess)


def weighed(problem: Problem, x) -> Problem:
    """
    Return the problem with weights by the residuals at x: noise of the sensor, and of the clock.

    A stamp that is off shows the more, the faster the pressure changes.
    """
    wave, pressures, positions = problem.wave(x), [], []
    for samples, position, shift in zip(problem.pressures, problem.positions,
                                        x[len(problem.names):], strict=True):
        left = samples.value - wave.pressure_at(
            samples.phase + shift, samples.clock) - problem.offset('pressure_offset', x)
        slope = wave.slope(wave.pressure, samples.phase + shift)
        noise, clock = noises(left, slope)
        pressures.append(Samples(samples.phase, samples.value,
                                 1.0 / np.sqrt(noise ** 2 + (clock * slope) ** 2), clock))
        if position:
            left = position.value - wave.position_at(
                position.phase + shift, position.clock) - problem.offset('position_offset', x)
            slope = wave.slope(wave.position, position.phase + shift)
            noise, own = noises(left, slope)
            position = Samples(position.phase, position.value,
                               1.0 / np.sqrt(noise ** 2 + (own * slope) ** 2), own)
        positions.append(position)
    return Problem(problem.start, problem.names, pressures, positions, problem.folds)


def noises(left: np.ndarray, slope: np.ndarray) -> tuple[float, float]:
    """Return the standard deviations of the sensor and of the clock, s, from residuals."""
    size = np.abs(slope)
    noise = 1.4826 * float(np.median(np.abs(left[size <= np.median(size)]))) or 1e-12
    steep = size > np.quantile(size, 0.95)
    if not steep.any():
        return noise, 0.0
    # left² = noise² + (clock*slope)² where the pressure falls.
    ratio = (left[steep] ** 2 - noise ** 2) / size[steep] ** 2
    clock = math.sqrt(max(0.0, float(np.mean(np.clip(ratio, *np.quantile(ratio, (0.02, 0.98)))))))
    return noise, clock if clock > SHARP else 0.0


def first_samples(measured: Measured, fold: Fold) -> tuple[Samples, Samples | None]:
    """Lay the samples of a recording over one period, with equal weights at first."""
    pressure = Samples(fold.phase(measured.time), measured.pressure,
                       np.full(len(measured.time), 1.0 / (0.01 * fold.span)))
    if len(measured.position) < 10:
        return pressure, None
    size = max(float(np.ptp(measured.position)), 1e-6)
    return pressure, Samples(fold.phase(measured.position_time), measured.position,
                             np.full(len(measured.position), 1.0 / (0.01 * size)))


def first_guesses(start: Vibrator, names: tuple[str, ...], measured: Measured,
                  fold: Fold) -> list[np.ndarray]:
    """
    Return starts by closed forms: preload by the peak pressure, stiffness times flow by the period.

    The build-up tells only their product, so the split is tried in several ways.
    """
    opening = opening_pressure_of(measured, fold)
    design = start
    area = start.plunger_seat_area
    force = area * (opening - start.opening_pressure)
    guess = dict.fromkeys(names, 0.0)
    if 'preload' in names:
        wanted = start.preload + force / start.slotted_spring_stiffness
        if wanted > 0.05 * start.preload:
            guess['preload'] = math.log(wanted / start.preload)
            design = design.replace(preload=min(wanted, FIELDS['preload'].metadata['high']))
    guesses = []
    for split in (0.0, 0.12, -0.12, 0.25, -0.25):
        trial, own = dict(guess), design
        for _ in range(12):
            # By period and pace: the cycle of the model is made as long as the machine's.
            wave = cycle_wave(own)
            if wave is None:
                break
            ratio = wave.period / fold.period
            if abs(ratio - 1.0) < 3e-3:
                break
            factor = math.exp(max(-0.5, min(0.5, 1.15 * math.log(ratio))))
            trial, own = moved(trial, start, names, own, factor)
        if split:
            trial, own = split_again(trial, start, names, own, split)
        wave = cycle_wave(own)
        phase = 0.0 if wave is None else fall_phase(wave, fold.level)
        guesses.append(np.array([*trial.values(), phase]))
    return guesses


def moved(trial: dict, start: Vibrator, names, own: Vibrator, factor: float):
    """Speed the machine up by `factor`: by its stiffness where that is free, else by its flow."""
    name = 'bulk_modulus' if 'bulk_modulus' in names else 'pump_flow'
    if name not in names:
        return trial, own
    value = getattr(own, name) * factor
    return {**trial, name: math.log(value / getattr(start, name))}, own.replace(**{name: value})


def split_again(trial: dict, start: Vibrator, names, own: Vibrator, split: float):
    """Give more to the flow and as much less to the stiffness."""
    if not {'bulk_modulus', 'pump_flow'} <= set(names):
        return trial, own
    own = own.replace(pump_flow=own.pump_flow * math.exp(split),
                      bulk_modulus=own.bulk_modulus * math.exp(-split))
    return {**trial, 'pump_flow': math.log(own.pump_flow / start.pump_flow),
            'bulk_modulus': math.log(own.bulk_modulus / start.bulk_modulus)}, own


def opening_pressure_of(measured: Measured, fold: Fold) -> float:
    """Estimate the pressure, Pa gauge, where the plunger lifts: the peak less a little."""
    return 0.97 * float(np.percentile(measured.pressure, 99.0))


def fall_phase(wave: CycleWave, level: float) -> float:
    """Phase at which the model's pressure falls through `level`, counted from the opening."""
    peak = int(np.argmax(wave.pressure))
    below = np.flatnonzero(wave.pressure[peak:] < level)
    return float(wave.since[peak + below[0]] / wave.period) if len(below) else 0.3
