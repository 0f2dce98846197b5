"""Frequency against pump flow at the preload and load in force, as far as it may be used."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpv_twin.model import Vibrator
from hpv_twin.model.batch import run_designs
from hpv_twin.model.designs import Designs
from hpv_twin.model.regimes import SEAT_REBOUND, SEATED

POINTS = 64
LEAST_SHARE = 0.005  # of the critical flow, where the map begins
# Up to this share of the critical flow the frequency rises with flow at any preload from 0.5 mm
# on; beyond it peaks, and at the critical flow the valve never closes.
SAFE_SHARE = 0.35
AT_SEAT = (SEATED, SEAT_REBOUND)


@dataclass(frozen=True)
class FrequencyMap:
    """
    Settled frequency, Hz, at pump flows, m³/s; both rise, shape (n,).

    `limit` says in words what ends the map above. With n < 2 there is no seated oscillation.
    """

    flow: np.ndarray
    frequency: np.ndarray
    limit: str

    @classmethod
    def of(cls, design: Vibrator, pump_flow_max: float) -> FrequencyMap:
        """Compute the map of a design at its preload and load: 64 steady cycles, about 5 ms."""
        critical = design.critical_flow
        highest, limit = SAFE_SHARE * critical, f'{SAFE_SHARE:.0%} of the critical flow'
        if pump_flow_max < highest:
            highest, limit = pump_flow_max, 'pump_flow_max'
        lowest = LEAST_SHARE * critical
        if not 0.0 < lowest < highest:
            return cls.none()
        flow = np.geomspace(lowest, highest, POINTS)
        figures = run_designs(Designs(design, pump_flow=flow), cycles=1, threads=1)
        frequency = figures['frequency']
        good = np.isin(figures['regime'], AT_SEAT)
        if not good.any():
            return cls.none()
        first = int(np.argmax(good))
        bad = np.flatnonzero(~good[first:])
        end = first + int(bad[0]) if len(bad) else len(flow)
        if end < len(flow):
            limit = 'beyond, the plunger does not return to its seat'
        falls = np.flatnonzero(np.diff(frequency[first:end]) <= 0.0)
        if len(falls):
            end, limit = first + int(falls[0]) + 1, 'beyond, more flow lowers the frequency'
        return cls(flow[first:end], frequency[first:end], limit)

    @classmethod
    def none(cls, limit: str = 'no pump flow gives seated oscillation') -> FrequencyMap:
        """Return the map of a machine that does not oscillate at its seat."""
        return cls(np.empty(0), np.empty(0), limit)

    @property
    def usable(self) -> bool:
        """Whether there is any range to steer in."""
        return len(self.flow) > 1

    def covers(self, frequency: float) -> bool:
        """Whether a frequency, Hz, lies within the map."""
        return self.usable and self.frequency[0] < frequency < self.frequency[-1]

    def flow_for(self, frequency: float) -> float:
        """Pump flow, m³/s, for a frequency, Hz; the map's ends beyond it."""
        return float(np.exp(np.interp(np.log(frequency), np.log(self.frequency),
                                      np.log(self.flow))))

    def frequency_at(self, flow: float) -> float:
        """Frequency, Hz, at a pump flow, m³/s; that of the map's ends beyond it."""
        return float(np.exp(np.interp(np.log(flow), np.log(self.flow), np.log(self.frequency))))
