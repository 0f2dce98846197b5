"""The model's steady cycle fitted to measured waveforms by least squares, with its covariance."""
from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from hpv_twin.model import Vibrator, VibratorError

from .cycle_wave import CycleWave, cycle_wave
from .folding import Fold
from .samples import Samples
from .weighing import left_of, paced, weighed

FREE = ('bulk_modulus', 'pump_flow', 'preload', 'flow_coefficient', 'viscous_friction',
        'pressure_offset', 'position_offset')
CHOICES = ('bulk_modulus', 'flow_coefficient', 'viscous_friction', 'line_damping', 'pump_flow',
           'preload', 'slotted_spring_stiffness', 'plunger_mass', 'sleeve_seat_diameter', 'load',
           'pressure_offset', 'position_offset')
# Offsets of the sensors, and the size of each that counts as one.
OFFSETS = {'pressure_offset': 1e5, 'position_offset': 1e-4}  # Pa, m
# Fields that may be 0 are moved in units of these, the others by their logarithm.
LINEAR = {'viscous_friction': 20.0, 'line_damping': 3e-3, 'load': math.nan}
# What is thought possible before anything is measured, in those coordinates: so wide that it
# decides nothing that the data tell, and keeps in place what they do not.
PRIOR = 2.0
STEP = 1e-4  # of the derivatives; a longer one is off where the curves bend, and the fit crawls
PERIOD_FLOOR = 3e-5  # relative: how well a clock and this model can agree at best
COARSE, FINE = 600, 4096  # parts of the period, for the first fits and for the last
STRETCHES = 200  # of a period, in each of which the residuals' mean is looked at
BADNESS = 30.0  # residual, in standard deviations, where the model has no cycle


class Problem:
    """
    Residuals of the model against folded samples, as a function of coordinates x.

    `names` are the free parameters; behind them stands one phase per recording: by how much of a
    period the discharge of the fold comes after the opening.
    """

    def __init__(self, start: Vibrator, names: tuple[str, ...], pressures: list[Samples],
                 positions: list[Samples | None], folds: list[Fold], period: float | None = None):
        self.start, self.names = start, names
        self.pressures, self.positions, self.folds = pressures, positions, folds
        self.period = period or float(np.mean([fold.period for fold in folds]))
        self.period_sigma = max(max(fold.sigma for fold in folds), PERIOD_FLOOR * self.period)

    def binned(self, bins: int) -> Problem:
        """The same with means over so many parts of the period."""
        return self.with_samples([s.binned(bins) for s in self.pressures],
                                 [s and s.binned(bins) for s in self.positions])

    def with_samples(self, pressures: list[Samples], positions: list[Samples | None],
                     period: float | None = None) -> Problem:
        """The same with other samples, and another period where one is given."""
        return Problem(self.start, self.names, pressures, positions, self.folds,
                       period or self.period)

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
            value = field_value(self.start, name) + self.unit(name) * at
            return value if name == 'load' else max(0.0, value)
        return field_value(self.start, name) * math.exp(at)

    def scale(self, name: str, x) -> float:
        """d(value)/dx, SI."""
        return OFFSETS.get(name) or self.unit(name) or self.value(name, x)

    def unit(self, name: str) -> float:
        """
        What a field that may be 0 is moved in, SI; 0 for the others.

        A load and a preload that do the same must be moved by as much: else their derivatives
        differ by an error of the difference quotients, and seem to tell the two apart.
        """
        if name == 'load':
            return self.start.slotted_spring_stiffness * self.start.preload
        return LINEAR.get(name, 0.0)

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
    Fit from several starts in few bins, go on from the best in many, paced and weighed anew.

    Returns None where the model has no cycle anywhere near.
    """
    coarse, best = problem.binned(COARSE), None
    for start in starts:
        tick()
        if coarse.wave(start) is None:
            continue
        found = solve(coarse, start, 1e-8, 60)
        if best is None or found.cost < best.cost:
            best = found
    if best is None or coarse.wave(best.x) is None:
        return None
    x = best.x
    for _ in range(rounds):
        tick()
        problem = weighed(paced(problem, x), x)
        x = solve(problem.binned(FINE), x, 1e-12, 40).x
    return finished(problem, x)


def solve(problem: Problem, x: np.ndarray, tolerance: float, most: int):
    """Run least squares from x; the valley of kappa against Q_H is narrow and long."""
    return least_squares(problem.residuals, x, jac=problem.jacobian, x_scale='jac',
                         xtol=tolerance, ftol=tolerance, gtol=tolerance, max_nfev=most)


def finished(problem: Problem, x) -> Fit:
    """Return the fit at x with a covariance scaled by the residuals' size and their order."""
    binned, wave = problem.binned(FINE), problem.wave(x)
    jacobian = binned.jacobian(x)
    # Columns of one size: the inverse is then as good as it can be.
    size = np.linalg.norm(jacobian, axis=0)
    inverse = np.linalg.pinv((jacobian / size).T @ (jacobian / size)) / np.outer(size, size)
    cost = float(np.mean(problem.residuals(x)[:-len(problem.names) - 1] ** 2))
    order = order_of(problem, x, wave)
    wider = np.maximum(math.sqrt(max(1.0, cost)), widening(problem, x, jacobian, inverse))
    wider *= math.sqrt(max(1.0, order))
    return Fit(problem, x, inverse * np.outer(wider, wider), cost, wave, order)


def sensors(problem: Problem, x, wave: CycleWave):
    """Yield recording, samples, their phase, measured minus model: in the residuals' order."""
    for k, pair in enumerate(zip(problem.pressures, problem.positions, strict=True)):
        for samples, left in zip(pair, left_of(problem, x, k, wave), strict=True):
            if samples is not None:
                yield k, samples, samples.phase + x[len(problem.names) + k], left


def widening(problem: Problem, x, jacobian, inverse) -> np.ndarray:
    """
    Return by how much noise that is alike from sample to sample widens each interval, 1 or more.

    Cycles are taken for independent, samples within one are not: the covariance of sums over
    cycles (cluster-robust, the sandwich of Huber and White) against that of independent samples.
    """
    scores, row = {}, 0
    for k, samples, phase, left in sensors(problem, x, problem.wave(x)):
        where, weights = samples.places(FINE)
        slopes = jacobian[row:row + len(weights)] / weights[:, None]
        row += len(weights)
        cycle = np.floor(phase).astype(int)
        cycle -= cycle.min()
        force = samples.weight ** 2 * left
        score = np.stack([np.bincount(cycle, column[where] * force) for column in slopes.T])
        if k in scores:  # pressure and position of one cycle belong together
            most = min(score.shape[1], scores[k].shape[1])
            score = score[:, :most] + scores[k][:, :most]
        scores[k] = score
    meat = sum(score @ score.T for score in scores.values())
    robust = np.diag(inverse @ meat @ inverse)
    return np.sqrt(np.maximum(1.0, robust / np.diag(inverse)))


def order_of(problem: Problem, x, wave: CycleWave) -> float:
    """
    Return by how much the residuals' means over stretches of phase exceed those of plain noise.

    Noise gives 1. What the model cannot show stands in one place of every cycle: it does not
    average out, so many samples do not make the parameters as sure as they would.
    """
    excess = []
    for _, samples, phase, left in sensors(problem, x, wave):
        bins = np.floor(np.mod(phase, 1.0) * STRETCHES).astype(int)
        count = np.bincount(bins, minlength=STRETCHES)
        total = np.bincount(bins, left * samples.weight, STRETCHES)
        full = count > 3
        excess.append(float(np.mean(total[full] ** 2 / count[full])))
    return max(excess)
