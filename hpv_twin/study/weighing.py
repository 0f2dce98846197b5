"""Pace, noise and weights of samples, from what a fit leaves."""
from __future__ import annotations

import math

import numpy as np

from .cycle_wave import CycleWave
from .samples import Samples

SHARP = 2e-6  # s: a clock as good as this is perfect


def left_of(problem, x, k: int, wave: CycleWave) -> tuple[np.ndarray, np.ndarray | None]:
    """Measured minus model of one recording: pressure, Pa, and position, m, or None."""
    samples, position, shift = (problem.pressures[k], problem.positions[k],
                                x[len(problem.names) + k])
    left = samples.value - wave.pressure_at(
        samples.phase + shift, samples.clock) - problem.offset('pressure_offset', x)
    if position is None:
        return left, None
    return left, position.value - wave.position_at(
        position.phase + shift, position.clock) - problem.offset('position_offset', x)


def paced(problem, x):
    """
    Return the problem with the phases that the whole waveform gives, not its falls alone.

    A period that is off lets the phases drift along a recording. The drift is taken out by one
    step of least squares, per recording, beside a shift that is left in.
    """
    wave, pressures, positions, rates = problem.wave(x), [], [], []
    for k, (samples, position) in enumerate(zip(problem.pressures, problem.positions,
                                                strict=True)):
        left = left_of(problem, x, k, wave)[0]
        phase = samples.phase + x[len(problem.names) + k]
        slope = wave.slope(wave.pressure, phase) * wave.period * samples.weight
        middle = float(np.mean(samples.phase))
        # What is off by far is no matter of pace.
        limit = 5.0 * float(np.median(np.abs(left)))
        columns = np.stack([slope, slope * (samples.phase - middle)], axis=1)
        rate = np.linalg.lstsq(columns, np.clip(left, -limit, limit) * samples.weight,
                               rcond=None)[0][1]
        rates.append(rate)
        pressures.append(samples.shifted(rate * (samples.phase - middle)))
        positions.append(position and position.shifted(rate * (position.phase - middle)))
    return problem.with_samples(pressures, positions,
                                problem.period / (1.0 + float(np.mean(rates))))


def weighed(problem, x):
    """
    Return the problem with weights by the residuals at x: noise of the sensor, and of the clock.

    A stamp that is off shows the more, the faster a curve changes.
    """
    wave, pressures, positions = problem.wave(x), [], []
    for k, (samples, position) in enumerate(zip(problem.pressures, problem.positions,
                                                strict=True)):
        shift = x[len(problem.names) + k]
        left, moved = left_of(problem, x, k, wave)
        pressures.append(reweighed(samples, left, wave.slope(wave.pressure,
                                                             samples.phase + shift)))
        positions.append(position and reweighed(
            position, moved, wave.slope(wave.position, position.phase + shift)))
    return problem.with_samples(pressures, positions)


def reweighed(samples: Samples, left: np.ndarray, slope: np.ndarray) -> Samples:
    """Return samples with weights by what is left of them and by the curve's slope, per s."""
    noise, clock = noises(left, slope)
    noise = math.hypot(noise, quantum_of(samples.value) / math.sqrt(12.0))
    return samples.weighted(1.0 / np.sqrt(noise ** 2 + (clock * slope) ** 2), clock)


def quantum_of(values: np.ndarray) -> float:
    """Step of the converter behind these values, where it is seen; else next to nothing."""
    levels = np.unique(values)
    if 1 < len(levels) < 0.5 * len(values):
        return float(np.median(np.diff(levels)))
    return 1e-6 * float(np.ptp(values))


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
