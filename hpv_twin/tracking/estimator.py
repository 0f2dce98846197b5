"""
An iterated extended Kalman filter over cycles: what the waveform says about the machine.

The state is the machine's Deviation from its design, a slow random walk, and the instant of its
last opening. One window of samples is one measurement; the model of it is the steady waveform,
exact and cheap, and its sensitivities are finite differences of it.
"""
from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from .waveform import Deviation, Waveform, steady_waveform
from .windows import Window

ESTIMATES = {
    'cavity_stiffness': ('Pa/m³', 'kappa/W0, effective bulk modulus over cavity volume'),
    'pump_flow': ('m³/s', 'flow that reaches the cavity, Q_H'),
    'opening_force': ('N', 'what the pressure on the seat overcomes, k1*y01 - k2*y02 + F_T'),
    'flow_coefficient': ('1', 'of the open slot, xi_H'),
    'base_pressure': ('Pa', 'drain pressure plus the offset of the sensor, gauge'),
    'viscous_friction': ('N s/m', 'of plunger and sleeve in their guides, c1'),
}
SIZE = len(ESTIMATES)
PHASE = SIZE
SHIFT = list(ESTIMATES).index('base_pressure')
# In the coordinates of Deviation: what is thought possible before anything is measured, how far
# each wanders in a second, and what a sudden change may be.
AT_FIRST = np.array([0.2, 0.15, 0.15, 0.15, 0.1, 0.5])
WANDER = np.array([2e-3, 1.5e-3, 1e-3, 1.5e-3, 1.5e-3, 0.02])
SUDDEN = np.array([0.3, 0.3, 0.3, 0.3, 0.5, 5.0])
STEP = np.array([1e-3, 1e-3, 1e-3, 1e-3, 0.0, 0.02])  # of the finite differences
LOWEST = np.array([-1.5, -1.5, -0.8, -1.5, -2.0, -1.0])
HIGHEST = np.array([1.0, 1.0, 2.0, 1.0, 20.0, 50.0])
JITTER = 5e-4  # of a period: how irregularly the machine itself is thought to open
ITERATIONS = 6
GUESSES = 4
PERIOD_SHARE, PERIOD_ERROR = 0.01, 2e-4  # of the period, and s: how well the falls tell it
SETTLED = 0.02  # a correction below this share of SUDDEN is not repeated


class NoCycleError(Exception):
    """The model has no seated cycle at these values."""


@dataclass(frozen=True)
class Estimate:
    """
    What one window said. SI; `values` and `sigma` in the order of ESTIMATES.

    `opening` is an instant at which the machine opened, s, `period` s; `residual` the RMS of
    measured minus model, Pa; `surprise` how many standard deviations the window's squared
    innovation lies above what was expected of it.
    """

    time: float
    values: np.ndarray
    sigma: np.ndarray
    deviation: np.ndarray
    covariance: np.ndarray
    opening: float
    period: float
    residual: float
    noise: float
    surprise: float
    flow_sensitivity: float
    cycles: int

    def value(self, name: str) -> float:
        """One estimate, SI."""
        return float(self.values[list(ESTIMATES).index(name)])

    def uncertainty(self, name: str) -> float:
        """Its standard deviation, SI."""
        return float(self.sigma[list(ESTIMATES).index(name)])


@dataclass
class Filter:
    """State of the estimation; `predict` and `update` return new ones, so hypotheses can branch."""

    coordinates: Deviation
    x: np.ndarray
    covariance: np.ndarray  # (SIZE + 1, SIZE + 1), the last row is the phase's, s
    opening: float  # an instant of opening, s
    period: float
    period_slope: np.ndarray  # d(period)/dx, s, shape (SIZE,)

    @classmethod
    def at_first(cls, coordinates: Deviation) -> Filter:
        """Know the design and little else."""
        return cls(coordinates, np.zeros(SIZE), np.diag([*AT_FIRST ** 2, 0.0]), math.nan, math.nan,
                   np.zeros(SIZE))

    def predict(self, window: Window) -> Filter:
        """Let the parameters wander and the opening go on to the last one before the window."""
        wandered = self.covariance.copy()
        wandered[range(SIZE), range(SIZE)] += WANDER ** 2 * (window.end - window.start)
        cycles = math.floor((window.start - self.opening) / self.period)
        carry = np.eye(SIZE + 1)
        carry[PHASE, :SIZE] = cycles * self.period_slope
        wandered = carry @ wandered @ carry.T
        wandered[PHASE, PHASE] += (JITTER * self.period) ** 2 * max(1, abs(cycles))
        return replace(self, covariance=wandered, opening=self.opening + cycles * self.period)

    def locate(self, window: Window, design, share: float = 0.05) -> Filter:
        """Take the phase from the window's first fall alone, good to `share` of a period."""
        wave = self._wave(design, self.x)
        opening = window.start - wave.fall_through(window.level - 1e6 * self.x[SHIFT])
        covariance = self.covariance.copy()
        covariance[PHASE, :] = covariance[:, PHASE] = 0.0
        covariance[PHASE, PHASE] = (share * wave.period) ** 2
        return replace(self, covariance=covariance, opening=opening, period=wave.period)

    def widen(self, which) -> Filter:
        """Think a sudden change of the parameters `which` (indices) possible."""
        covariance = self.covariance.copy()
        for index in which:
            covariance[index, index] += SUDDEN[index] ** 2
        return replace(self, covariance=covariance)

    def _wave(self, design, x) -> Waveform:
        wave = steady_waveform(self.coordinates.machine(design, x))
        if wave is None:
            raise NoCycleError
        return wave

    def model(self, window: Window, design, x, opening):
        """Pressure the model has at the window's instants, its sensitivities, and the waveform."""
        wave = self._wave(design, x)
        since = window.time - opening
        pressure = wave.at(since) + 1e6 * x[SHIFT]
        slopes = np.empty((len(since), SIZE + 1))
        period_slope = np.zeros(SIZE)
        for index in range(SIZE):
            if index == SHIFT:
                slopes[:, index] = 1e6
                continue
            beside = x.copy()
            beside[index] += STEP[index]
            other = self._wave(design, beside)
            slopes[:, index] = (other.at(since) + 1e6 * x[SHIFT] - pressure) / STEP[index]
            period_slope[index] = (other.period - wave.period) / STEP[index]
        little = 1e-4 * wave.period
        slopes[:, PHASE] = (wave.at(since - little) - wave.at(since + little)) / (2.0 * little)
        return pressure, slopes, wave, period_slope

    def _guess(self, window, design):
        """
        Return where to begin the search: where the model's period is about the measured one.

        The fall is steep: from further off, the waveforms would not overlap and lead astray.
        """
        x, opening = self.x, self.opening
        spread = self.covariance[:SIZE, :SIZE]
        for _ in range(GUESSES):
            wave = self._wave(design, x)
            missing = window.period - wave.period
            if abs(missing) < max(PERIOD_SHARE * wave.period, PERIOD_ERROR):
                break
            slope = np.array([(self._wave(design, x + STEP * unit).period - wave.period)
                              / max(STEP @ unit, 1e-9) for unit in np.eye(SIZE)])
            gain = spread @ slope / (slope @ spread @ slope + PERIOD_ERROR ** 2)
            x = np.clip(x + gain * missing, LOWEST, HIGHEST)
            opening = window.start - self._wave(design, x).fall_through(
                window.level - 1e6 * x[SHIFT])
        return x, opening

    def update(self, window: Window, design, noise: float,
               search: bool = False) -> tuple[Filter, Update]:
        """
        Correct by a window, given the setpoints in force (in `design`) and the noise, Pa.

        `search` where the parameters may be far off, as after `locate`.
        Raises NoCycleError where the model does not oscillate at the values tried.
        """
        prior = np.linalg.inv(self.covariance)
        x, opening = self._guess(window, design) if search else (self.x, self.opening)
        move = np.append(x - self.x, opening - self.opening)
        first = None
        for _ in range(ITERATIONS):
            pressure, slopes, wave, period_slope = self.model(window, design, x, opening)
            difference = window.pressure - pressure
            scale = max(noise, 1.5 * float(np.median(np.abs(difference))))
            weight = np.minimum(1.0, 4.0 * scale / np.maximum(np.abs(difference), 1e-9))
            weighted = slopes.T * (weight / noise ** 2)
            information = prior + weighted @ slopes
            gradient = weighted @ difference - prior @ move
            change = np.linalg.solve(information, gradient)
            if first is None:
                # Squared innovation by its own covariance, from the prior on: before correction.
                innovation = difference + slopes @ move
                squared = float(innovation @ innovation) / noise ** 2
                at_once = slopes.T @ innovation / noise ** 2
                exact = prior + slopes.T @ slopes / noise ** 2
                first = squared - float(at_once @ np.linalg.solve(exact, at_once))
                # Which way it points: along each sensitivity, with the variance expected of that.
                known = exact - prior
                score = (at_once - known @ np.linalg.solve(exact, at_once))[:SIZE]
                spread = np.diag(known - known @ np.linalg.solve(exact, known))[:SIZE]
            limit = np.max(np.abs(change[:SIZE]) / SUDDEN)
            change *= min(1.0, 0.7 / limit) if limit > 0.7 else 1.0
            after = np.clip(x + change[:SIZE], LOWEST, HIGHEST)
            move[:SIZE] += after - x
            move[PHASE] += change[PHASE]
            x, opening = after, opening + change[PHASE]
            small = (np.max(np.abs(change[:SIZE]) / SUDDEN) < SETTLED
                     and abs(change[PHASE]) < 0.003 * wave.period)
            if small:
                break
        left = difference - slopes @ change
        cost = (float(np.sum(weight * left ** 2)) / noise ** 2 + float(move @ prior @ move))
        evidence = -0.5 * (cost + np.linalg.slogdet(information)[1]
                           + np.linalg.slogdet(self.covariance)[1])
        period = wave.period + float(period_slope @ change[:SIZE])
        after = replace(self, x=x, covariance=np.linalg.inv(information), opening=opening,
                        period=period, period_slope=period_slope)
        count = len(window.time)
        return after, Update(residual=math.sqrt(float(left @ left) / count),
                             surprise=(first - count) / math.sqrt(2.0 * count),
                             evidence=float(evidence), cost=cost, count=count,
                             score=score, spread=spread)

    def estimate(self, window: Window, design, update: Update, noise: float) -> Estimate:
        """Put the state into SI, with what the window said."""
        values = self.coordinates.values(design, self.x)
        scales = self.coordinates.scales(values)
        covariance = self.covariance[:SIZE, :SIZE]
        last = math.floor((window.end - self.opening) / self.period)
        return Estimate(
            time=window.end, values=values, sigma=np.sqrt(np.diag(covariance)) * scales,
            deviation=self.x.copy(), covariance=covariance.copy(),
            opening=self.opening + last * self.period, period=self.period,
            residual=update.residual, noise=noise, surprise=update.surprise,
            flow_sensitivity=-float(self.period_slope[1]) / self.period, cycles=window.cycles)


@dataclass(frozen=True)
class Update:
    """
    How well a window was met: RMS of what is left, Pa; surprise; log evidence; cost; samples.

    `score` is the innovation along the sensitivity to each parameter, `spread` the variance that
    it has while nothing changes; both of shape (SIZE,).
    """

    residual: float
    surprise: float
    evidence: float
    cost: float
    count: int
    score: np.ndarray
    spread: np.ndarray
