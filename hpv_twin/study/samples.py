"""Samples of one sensor laid over one period, and the same in fewer numbers."""
from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .folding import Fold
from .measured import Measured


@dataclass(frozen=True)
class Samples:
    """Samples of one sensor: `phase` from the discharge, not wrapped, `value`, `weight`."""

    phase: np.ndarray
    value: np.ndarray
    weight: np.ndarray  # 1/standard deviation
    clock: float = 0.0  # standard deviation of the stamps, s

    def binned(self, bins: int) -> Samples:
        """
        Return the weighted means over `bins` equal parts of the period.

        Least squares see no difference while the model is a straight line within a bin: what they
        lose is the scatter about the mean, which no parameter changes.
        """
        where, weight = self.places(bins)
        square = self.weight ** 2
        phase, value = (np.bincount(where, square * column) / weight ** 2
                        for column in (np.mod(self.phase, 1.0), self.value))
        return Samples(phase, value, weight, self.clock)

    def places(self, bins: int) -> tuple[np.ndarray, np.ndarray]:
        """Return, for every sample, which of the means it goes into; and the means' weights."""
        where = np.floor(np.mod(self.phase, 1.0) * bins).astype(int).clip(max=bins - 1)
        total = np.bincount(where, self.weight ** 2, bins)
        rank = np.cumsum(total > 0.0) - 1
        return rank[where], np.sqrt(total[total > 0.0])

    def weighted(self, weight: np.ndarray, clock: float) -> Samples:
        """The same with other weights."""
        return replace(self, weight=weight, clock=clock)

    def shifted(self, by: np.ndarray) -> Samples:
        """The same with `by` added to the phases."""
        return replace(self, phase=self.phase + by)


def first_samples(measured: Measured, fold: Fold) -> tuple[Samples, Samples | None]:
    """Lay the samples of a recording over one period, with equal weights at first."""
    pressure = Samples(fold.phase(measured.time), measured.pressure,
                       np.full(len(measured.time), 1.0 / (0.01 * fold.span)))
    if len(measured.position) < 10:
        return pressure, None
    size = max(float(np.ptp(measured.position)), 1e-6)
    return pressure, Samples(fold.phase(measured.position_time), measured.position,
                             np.full(len(measured.position), 1.0 / (0.01 * size)))
