"""What a sensor makes of a quantity: gain, offset, noise, steps, and samples that go missing."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

GAP = 20  # samples missing at a time, on the average


@dataclass(frozen=True)
class Sensor:
    """
    `gain` (1: right), `offset`, standard deviation of the `noise`, `quantum` of the converter.

    In the unit of the quantity, the quantum 0 for none.
    """

    gain: float = 1.0
    offset: float = 0.0
    noise: float = 0.0
    quantum: float = 0.0

    def read(self, value, random: np.random.Generator):
        """Return what the sensor shows for a true value, or for an array of them."""
        shown = self.gain * value + self.offset
        if self.noise:
            shown = shown + self.noise * random.standard_normal(np.shape(value) or None)
        if self.quantum:
            shown = self.quantum * np.round(shown / self.quantum)
        return shown


class Dropouts:
    """Samples that never arrive: a `share` of all, in gaps of random length, 20 on the average."""

    def __init__(self, random: np.random.Generator):
        self._random = random
        self._lost, self._left = True, 0

    def lost(self, share: float) -> bool:
        """Whether the next sample is missing."""
        if share <= 0.0:
            return False
        if self._left == 0:
            self._lost = not self._lost
            mean = GAP if self._lost else GAP * (1.0 - share) / share
            self._left = self._random.geometric(min(1.0, 1.0 / mean))
        self._left -= 1
        return self._lost
