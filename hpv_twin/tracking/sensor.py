"""Is what a pressure sensor shows usable? If not: lost, nonsense, stuck or in another unit."""
from __future__ import annotations

import math
from collections import deque
from functools import cached_property

import numpy as np

from hpv_twin.model import Vibrator

from .waveform import steady_waveform

SILENCE = 0.5  # s without a sample: the measurement is lost
GAP = 0.03  # s between samples across which no cycle is followed
LOOK = 0.6  # s of samples that are judged together,
LEAST_LOOK = 0.3  # s once so many are there
NONSENSE = 0.2  # share of samples that are no numbers, or out of order
MOST = 1e9  # Pa; no pressure
UNITS = {'bar': 1e-5, 'MPa': 1e-6, 'kPa': 1e-3, 'psi': 1.450377e-4}
NEAR = 6.0  # a span within this factor of the model's is taken for that unit
VACUUM = 0.3  # of ambient: absolute pressure does not stay below it
GAUGE_ERROR = 3e4  # Pa: a zero this near to minus ambient is taken for a gauge sensor's
FINE, NONE, LOST, NONSENSICAL, STUCK, UNIT, GAUGE = (
    'fine', 'none', 'lost', 'nonsense', 'stuck', 'unit', 'gauge')


class PressureWatch:
    """
    Looks at samples of absolute pressure before anybody follows them.

    `verdict` is one of the names above, `text` says it in words; only while it is FINE or GAUGE
    are samples passed on.
    """

    def __init__(self, design: Vibrator, ambient: float):
        self._design, self._ambient = design, ambient
        self._zero = ''
        self.received = 0
        self.reset()

    @cached_property
    def _range(self) -> float:
        """Range of the design's pressure, Pa; not before it is needed: the model may compile."""
        wave = steady_waveform(self._design)
        return (float(np.ptp(wave.pressure)) if wave
                else max(self._design.opening_pressure, 1e6))

    def reset(self) -> None:
        """Begin anew, as with another sensor."""
        self._recent = deque()  # (times, values, how many were no use)
        self._last = -math.inf
        self.verdict, self.text = NONE, 'no machine is measured'

    def feed(self, times, values) -> tuple[np.ndarray, np.ndarray, bool]:
        """
        Take samples (s; Pa absolute). Return those that can be followed, and whether a gap is in.

        Times s and pressures Pa gauge, both empty while the verdict is against it.
        """
        self.received += len(times)
        times, values = np.asarray(times, dtype=float), np.asarray(values, dtype=float)
        ahead = np.maximum.accumulate(np.append(self._last, times))[:-1]
        good = np.isfinite(values) & (np.abs(values) < MOST) & (times > ahead)
        gap = bool(good.any()) and bool(
            np.any(np.diff(np.append(self._last, times[good])) > GAP)) and self._last > 0.0
        self._recent.append((times[good], values[good], len(times) - int(good.sum())))
        if good.any():
            self._last = float(times[good][-1])
            while self._recent and (not len(self._recent[0][0])
                                    or self._recent[0][0][-1] < self._last - LOOK):
                self._recent.popleft()
        elif len(self._recent) > 100:
            self._recent.popleft()
        self._judge()
        usable = self.verdict in (FINE, GAUGE)
        return times[good & usable], values[good & usable] - self._ambient, gap

    def silent(self) -> None:
        """No sample has come for SILENCE."""
        if self.received:
            self._recent.clear()
            self.verdict, self.text = LOST, f'no measured pressure for more than {SILENCE:g} s'

    def zero(self, base: float, sigma: float) -> None:
        """Take what tracking says of the sensor's zero, Pa, with its standard deviation."""
        away = abs(base + self._ambient)
        self._zero = '' if away > GAUGE_ERROR or sigma > GAUGE_ERROR / 3.0 else (
            f'the measured pressure is {-base * 1e-6:.3f} MPa too low: a gauge sensor? absolute '
            'pressure is expected')

    def _judge(self):
        bad = sum(entry[2] for entry in self._recent)
        values = np.concatenate([entry[1] for entry in self._recent] or [np.empty(0)])
        if bad > NONSENSE * (bad + len(values)):
            self.verdict = NONSENSICAL
            self.text = (f'{bad} of {bad + len(values)} samples are no pressures (not a number, '
                         f'beyond {MOST:g} Pa, or stamped out of order)')
            return
        if not len(values):
            return
        first = next(entry[0][0] for entry in self._recent if len(entry[0]))
        if self._last - first < LEAST_LOOK:
            if self.verdict in (NONE, LOST, NONSENSICAL):
                self.verdict, self.text = NONE, 'looking at the measured pressure'
            return
        self.verdict, self.text = self._look(values)

    def _look(self, values):
        """Return verdict and text on samples of some time, Pa absolute if all is well."""
        low, high = float(values.min()), float(values.max())
        share = (high - low) / self._range
        if high == low:
            return STUCK, f'the measured pressure stands at {low:.6g}: a stuck sensor'
        if high < VACUUM * self._ambient and (unit := self._unit(share)):
            return UNIT, (f'the measured pressure is between {low:.4g} and {high:.4g}: in {unit}? '
                          'Pa, absolute, is expected')
        if high < 0.0 or low < -self._range:
            return NONSENSICAL, f'{low:.4g} to {high:.4g} Pa is no absolute pressure'
        middle = float(np.median(values))
        if middle < VACUUM * self._ambient:
            return NONSENSICAL, (f'the measured pressure stays about {middle:.3g} Pa, a vacuum: '
                                 'no sensor, or a gauge sensor of a machine at rest?')
        if share > NEAR:
            return UNIT, (f'the measured pressure spans {share:.3g} times what the design has: '
                          'another unit, or another machine')
        return (GAUGE, self._zero) if self._zero else (FINE, 'usable')

    @staticmethod
    def _unit(share):
        """Name the unit in which the span would be the model's; the nearest one."""
        name = min(UNITS, key=lambda unit: abs(math.log(share / UNITS[unit])))
        return name if abs(math.log(share / UNITS[name])) < math.log(NEAR) else ''
