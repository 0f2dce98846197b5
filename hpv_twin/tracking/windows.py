"""Measured samples as they come, cut into whole cycles where the pressure falls."""
from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

HIGH, LOW = 0.6, 0.35  # shares of the range: above the one, then below the other, is a discharge
SHORTEST = 0.015  # s: a window holds at least this, and one cycle
FEWEST = 6  # samples of a window
LONGEST = 2.0  # s without a discharge after which the range is learned anew
CYCLES = 4  # whose extremes make the range


@dataclass(frozen=True)
class Window:
    """
    Samples from one discharge to a later one: `time` s, `pressure` Pa, both shape (samples,).

    `start` and `end` are when the pressure fell through `level`; `cycles` lie between them.
    """

    time: np.ndarray
    pressure: np.ndarray
    start: float
    end: float
    level: float
    cycles: int
    range: float

    @property
    def period(self) -> float:
        """Mean period by the falls alone, s: good to some hundredths of the sample spacing."""
        return (self.end - self.start) / self.cycles


class WindowFinder:
    """Finds windows in samples of any rate from about five a cycle; feed() returns the complete."""

    def __init__(self, least_range: float):
        self.least_range = least_range
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a gap."""
        self._times, self._values = [], []
        self._highs, self._lows = deque(maxlen=CYCLES), deque(maxlen=CYCLES)
        self._high = self._past_high = -math.inf
        self._low = self._past_low = math.inf
        self._armed = False
        self._start = None
        self._level = 0.0
        self._cycles = 0
        self.last_fall = None

    def feed(self, times, values) -> list[Window]:
        """Take samples in order of time; return the windows they complete."""
        found = []
        for time, value in zip(times, values, strict=True):
            self._times.append(time)
            self._values.append(value)
            self._high, self._low = max(self._high, value), min(self._low, value)
            low = min(self._low, self._past_low)
            span = max(self._high, self._past_high) - low
            if span < self.least_range:
                self._forget(time)
            elif not self._armed:
                self._armed = value > low + HIGH * span
            elif value < low + LOW * span:
                found += self._fall(time, low, span)
            if self.last_fall is not None and time - self.last_fall > LONGEST:
                self.reset()
        return found

    def _forget(self, now):
        """Without oscillation keep no more than is needed to see one begin."""
        if len(self._times) > 1 and now - self._times[0] > LONGEST:
            self.reset()

    def _fall(self, time, low, span):
        """Take note of a discharge; return the window that it ends, if any."""
        self._armed = False
        self._highs.append(self._high)
        self._lows.append(self._low)
        self._past_high, self._past_low = max(self._highs), min(self._lows)
        self._high, self._low = -math.inf, math.inf
        level = low + 0.5 * span
        fell = self._crossing(level)
        window = []
        if self._start is not None:
            self._cycles += 1
            if fell - self._start < SHORTEST or len(self._times) < FEWEST:
                self.last_fall = time
                return []
            window = [Window(np.array(self._times), np.array(self._values), self._start, fell,
                             self._level, self._cycles, span)]
        self._times, self._values = [], []
        self._start, self._level, self._cycles = fell, level, 0
        self.last_fall = time
        return window

    def _crossing(self, level):
        """When the last fall passed `level`, by linear interpolation between two samples."""
        times, values = self._times, self._values
        k = len(values) - 1
        while k > 0 and values[k - 1] < level:
            k -= 1
        if k == 0 or values[k] >= level:
            return times[k]
        share = (values[k - 1] - level) / (values[k - 1] - values[k])
        return times[k - 1] + share * (times[k] - times[k - 1])
