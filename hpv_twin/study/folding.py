"""Measured pressure laid over one period: when the machine opened, its period, its steadiness."""
from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .measured import AMBIENT, CalibrationError, Measured

HIGH, LOW = 0.6, 0.35  # shares of the range: above the one, then below the other, is a discharge
FEWEST = 6  # cycles
UNSTEADY = 3e-3  # relative change of the period over a recording that is none of a steady machine
IRREGULAR = 0.04  # of a period: how far falls may lie from an even pace
SEGMENTS = 8
RESTLESS = 1.2  # of sample-to-sample differences to the samples: 1.4 is plain noise
FAR = 4.0
UNITS = {'bar': 1e-5, 'MPa': 1e-6, 'kPa': 1e-3, 'psi': 1.450377e-4}
LEAST_RANGE = 1e5  # Pa


@dataclass(frozen=True)
class Fold:
    """
    `period` s, with its standard deviation; `fall` the instant of a discharge, s; `cycles` seen.

    `level` is the pressure, Pa gauge, through which it falls then.
    """

    period: float
    sigma: float
    fall: float
    cycles: int
    level: float
    span: float  # of the pressure, Pa

    def phase(self, time: np.ndarray) -> np.ndarray:
        """Phase of instants, s, counted from the discharge; not wrapped."""
        return (time - self.fall) / self.period


def fold(measured: Measured) -> Fold:
    """Find period and pace of a recording; CalibrationError where no steady machine is in it."""
    low, high = np.percentile(measured.pressure, (0.5, 99.5))
    refuse_stillness(measured, low, high)
    refuse_other_units(measured, low, high)
    falls, level = falls_of(measured, low, high)
    if len(falls) < FEWEST:
        raise CalibrationError(f'{measured.name}: the machine does not oscillate: {len(falls)} '
                               f'discharges in {measured.time[-1]:.2f} s, pressure between '
                               f'{low * 1e-6:.3g} and {high * 1e-6:.3g} MPa gauge')
    steps = np.diff(falls)
    period = float(np.median(steps))
    count = np.concatenate(([0.0], np.cumsum(np.round(steps / period))))
    for _ in range(3):  # missing cycles are counted better with a better period
        period, first = np.polyfit(count, falls, 1)
        count = np.round((falls - first) / period)
    left = falls - first - period * count
    spread = float(np.std(left))
    if spread > IRREGULAR * period:
        raise CalibrationError(f'{measured.name}: the discharges are irregular, by '
                               f'{100.0 * spread / period:.1f} % of a period: no steady machine, '
                               'its settings change, or these are two machines')
    refuse_change(measured, count, falls, period, spread)
    sigma = spread / math.sqrt(float(np.sum((count - count.mean()) ** 2)))
    return Fold(float(period), sigma, float(first), int(count[-1]), level, float(high - low))


def falls_of(measured: Measured, low: float, high: float) -> tuple[np.ndarray, float]:
    """Instants, s, at which the pressure falls from high to low, and through which level, Pa."""
    time, pressure = measured.time, measured.pressure
    side = np.where(pressure > low + HIGH * (high - low), 1,
                    np.where(pressure < low + LOW * (high - low), -1, 0))
    told = np.flatnonzero(side)
    ends = told[1:][(side[told[1:]] < 0) & (side[told[:-1]] > 0)]
    starts = told[:-1][(side[told[1:]] < 0) & (side[told[:-1]] > 0)]
    level = low + 0.5 * (HIGH + LOW) * (high - low)
    # Across a gap nobody knows when it fell.
    seen = time[ends] - time[starts] < 3.0 / measured.rate + 2e-3
    falls = []
    for start, end in zip(starts[seen], ends[seen], strict=True):
        piece = pressure[start:end + 1]
        k = start + int(np.flatnonzero(piece > level)[-1])
        share = (pressure[k] - level) / (pressure[k] - pressure[k + 1])
        falls.append(time[k] + share * (time[k + 1] - time[k]))
    return np.array(falls), level


def refuse_stillness(measured: Measured, low: float, high: float) -> None:
    """Raise CalibrationError where each sample knows nothing of the one before: plain noise."""
    if np.std(np.diff(measured.pressure)) > RESTLESS * np.std(measured.pressure):
        raise CalibrationError(f'{measured.name}: the machine does not oscillate: noise between '
                               f'{low:.4g} and {high:.4g} Pa gauge, without a cycle in it')


def refuse_other_stroke(measured: Measured, stroke: float) -> None:
    """Raise CalibrationError where the position moves by far more or less than a stroke, m."""
    if len(measured.position):
        low, high = np.percentile(measured.position, (0.5, 99.5))
        if not stroke / FAR < high - low < FAR * stroke:
            raise CalibrationError(
                f'{measured.name}: the position moves by {high - low:.4g} m, the stroke is '
                f'{stroke:.4g} m: is it in other units than m? --no-position leaves it out')


def refuse_other_units(measured: Measured, low: float, high: float) -> None:
    """Raise CalibrationError where the numbers are no pascals, or no pressures."""
    span = high - low
    if span >= LEAST_RANGE:
        if low < -0.5 * span:
            raise CalibrationError(f'{measured.name}: pressures down to {low * 1e-6:.3g} MPa gauge '
                                   'are none: is the sensor the wrong way round?')
        if low < -2.5e5 or high < 0.0:
            raise CalibrationError(
                f'{measured.name}: gauge pressure falls to {low * 1e-6:.3f} MPa, below the vacuum: '
                'the recording holds gauge pressure already? then --gauge')
        return
    # Ambient pressure, in Pa, may have been taken off already.
    size = min(abs(high), abs(high + AMBIENT))
    fitting = [f'{unit} ({span / factor * 1e-6:.3g} MPa)' for unit, factor in UNITS.items()
               if 1e6 < span / factor < 1e8 and size / factor < 1e8]
    raise CalibrationError(f'{measured.name}: the pressure moves by {span:.4g} Pa only: '
                           + (f'is it in {" or ".join(fitting)}? Pa are expected' if fitting
                              else 'the machine does not oscillate'))


def refuse_change(measured: Measured, count, falls, period: float, spread: float) -> None:
    """Raise CalibrationError where the period changes in the course of a recording."""
    if len(falls) < 4 * SEGMENTS:
        return
    for part in np.array_split(np.arange(len(falls)), SEGMENTS):
        own, _ = np.polyfit(count[part], falls[part], 1)
        sigma = spread / math.sqrt(float(np.sum((count[part] - count[part].mean()) ** 2)))
        if abs(own - period) > max(UNSTEADY * period, 6.0 * sigma):
            raise CalibrationError(
                f'{measured.name}: {1.0 / own:.2f} Hz from {falls[part[0]]:.1f} to '
                f'{falls[part[-1]]:.1f} s, but {1.0 / period:.2f} Hz on the whole: two machines, '
                'or settings that changed; --from and --to choose a steady part')


def same_machine(recordings: list[Measured], folds: list[Fold]) -> None:
    """Raise CalibrationError where recordings are not of one machine with one setting."""
    for measured, other in zip(recordings[1:], folds[1:], strict=True):
        if abs(other.period / folds[0].period - 1.0) > UNSTEADY:
            raise CalibrationError(
                f'{recordings[0].name} has {1.0 / folds[0].period:.2f} Hz and {measured.name} '
                f'{1.0 / other.period:.2f} Hz: two machines, or two settings; calibrate them one '
                'by one')
