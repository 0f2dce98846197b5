"""Holding a frequency by the pump flow, while the machine drifts away from its model."""
from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from .frequency_map import AT_SEAT, FrequencyMap

OFF, HOLDING, SETTLING, LIMITED, IDLE = 'off', 'holding', 'settling', 'at a limit', 'idle'
CLOSE = 2e-3  # relative error of the frequency below which it is held
RANGE = 3.0  # the machine may need so many times the model's flow, or less by that factor
# Only cycles run at one flow tell how much it needs: with a greater change they are passed over.
SAME_FLOW = 0.02
DEAD_BAND = 1e-4  # relative change of flow that is not worth a command
SETTLED = 1e-3  # relative difference of two cycles that are alike
BACK_OFF = 0.8  # of the flow, when the plunger no longer returns to its seat


@dataclass(frozen=True)
class Gains:
    """
    How fast the observer believes a cycle: shares of the difference for level and slope.

    `settling` s after a large change of flow it believes nothing: a pump needs time to obey.
    """

    level: float
    slope: float
    settling: float


# The twin's own cycles are exact, and its pump obeys at once. A frequency from samples 1 ms apart
# scatters by some tenths of a percent.
OWN, MEASURED = Gains(0.5, 0.1, 0.0), Gains(0.12, 0.004, 0.25)


class FrequencyHold:
    """
    Steers the pump flow so that a frequency is held: feed-forward by the model, corrected.

    The correction is the ratio of the flow the machine needs for a frequency to the flow the model
    needs. Each cycle shows it; level and slope are observed, so that a steady drift leaves no
    error. This is integral feedback that cannot wind up: it learns from the flow in force, also
    where a limit holds it, and whether or not a target is set. Not for more than one thread.
    """

    def __init__(self, frequency_map: FrequencyMap):
        self._map = frequency_map
        self._level = self._slope = 0.0  # log of the ratio, and its change per cycle
        self.target = 0.0
        self.frequency = math.nan
        self._flow_before = math.nan
        self._ceiling = math.inf
        self._time = self._deaf_until = -math.inf
        self._recent = deque(maxlen=2)

    # What is wanted ----------------------------------------------------------------------------

    def engage(self, target: float, flow: float, frequency_map: FrequencyMap) -> float:
        """
        Hold `target`, Hz; return the pump flow to begin with, `flow` being in force, m³/s.

        Switched on in settled motion at the frequency it has, it changes nothing.
        """
        if not self.active:
            self._level = self._slope = 0.0
            if self._settled(flow) and frequency_map.covers(self.frequency):
                self._level = math.log(flow / frequency_map.flow_for(self.frequency))
        self.target = target
        return self.use(frequency_map, flow)

    def _settled(self, flow):
        first, *rest = self._recent or [math.nan]
        return flow == self._flow_before and bool(rest) and (
            abs(rest[0] / first - 1.0) < SETTLED)

    def release(self) -> None:
        """Leave the pump flow as it is, to whoever sets it."""
        self.target = 0.0

    def use(self, frequency_map: FrequencyMap, flow: float) -> float:
        """Preload or load have changed: steer by this map; return the flow, `flow` in force."""
        self._map, self._ceiling = frequency_map, math.inf
        self._flow_before = math.nan  # the present cycle is of neither setting
        return self.command(flow)

    @property
    def active(self) -> bool:
        """Whether a frequency is to be held."""
        return self.target > 0.0

    # What happens ------------------------------------------------------------------------------

    def cycle(self, time: float, frequency: float, flow: float, regime: str = AT_SEAT[0],
              gains: Gains = OWN) -> float:
        """
        Take a whole cycle, ended at `time` s, at which `flow` was in force; return the flow.

        `frequency` Hz; `regime` by the names of hpv_twin.model.regimes.
        """
        before, self._flow_before = self._flow_before, flow
        if time < self._time:  # begun anew
            self._deaf_until = -math.inf
        self._time = time
        if regime not in AT_SEAT:
            self.lost(flow)
            return self.command(flow)
        self.frequency = frequency
        self._recent.append(frequency)
        steady = abs(flow - before) < SAME_FLOW * flow
        if not steady:
            self._deaf_until = time + gains.settling
        if steady and time >= self._deaf_until and self._map.covers(frequency):
            self._learn(math.log(flow / self._map.flow_for(frequency)), gains)
        return self.command(flow)

    def lost(self, flow: float) -> None:
        """Oscillation at the seat has ended at this flow: do not go there again."""
        if self.active:
            self._ceiling = min(self._ceiling, BACK_OFF * flow)
        self.frequency = math.nan
        self._recent.clear()

    def _learn(self, seen, gains):
        most = math.log(RANGE)
        expected = self._level + self._slope
        missing = min(most, max(-most, seen)) - expected
        self._level = expected + gains.level * missing
        self._slope = min(0.01, max(-0.01, self._slope + gains.slope * missing))

    # What follows ------------------------------------------------------------------------------

    @property
    def ratio(self) -> float:
        """Flow the machine needs over the flow the model needs, for the coming cycle."""
        return math.exp(self._level + self._slope)

    def command(self, flow: float) -> float:
        """Return the pump flow for the target, m³/s; `flow` where there is nothing to steer."""
        if not self.active or not self._map.usable:
            return flow
        low, high = self.limits
        wanted = min(high, max(low, self.ratio * self._map.flow_for(self.target)))
        inside = low < wanted < high and low <= flow <= high
        return flow if inside and abs(wanted / flow - 1.0) < DEAD_BAND else wanted

    @property
    def limits(self) -> tuple[float, float]:
        """Least and greatest pump flow that is commanded, m³/s."""
        low, high = float(self._map.flow[0]), float(self._map.flow[-1])
        return low, max(low, min(high, self._ceiling))

    @property
    def limited(self) -> str:
        """In words, what keeps the target out of reach; empty where nothing does."""
        if not self.active:
            return ''
        if not self._map.usable:
            return self._map.limit
        (low, high), wanted = self.limits, self.ratio * self._map.flow_for(self.target)
        reach = self._map.frequency_at
        if wanted > high or self.target > self._map.frequency[-1]:
            why = (self._map.limit if high < self._ceiling else
                   'with more, the plunger did not return to its seat')
            return (f'{self.target:.1f} Hz is out of reach: {litres(high)} is the most ({why}), '
                    f'which gives {reach(high / self.ratio):.1f} Hz')
        if wanted < low or self.target < self._map.frequency[0]:
            return (f'{self.target:.1f} Hz is out of reach: {litres(low)} is the least, '
                    f'which gives {reach(low / self.ratio):.1f} Hz')
        return ''

    @property
    def state(self) -> str:
        """One of OFF, HOLDING, SETTLING, LIMITED, IDLE (no oscillation to steer)."""
        if not self.active:
            return OFF
        if self.limited:
            return LIMITED
        if math.isnan(self.frequency):
            return IDLE
        return HOLDING if self.error < CLOSE else SETTLING

    @property
    def error(self) -> float:
        """Relative error of the last cycles' frequency."""
        if not self._recent or not self.active:
            return math.nan
        return abs(sum(self._recent) / len(self._recent) / self.target - 1.0)


def litres(flow: float) -> str:
    """43.8 L/min, for m³/s."""
    return f'{flow * 6e4:.1f} L/min'
