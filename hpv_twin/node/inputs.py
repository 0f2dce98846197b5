"""Setpoints from outside: accepted or refused, counted, with a reason a person can act on."""
from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import dataclass

from .units import both

WARN_EVERY = 2.0  # s, per setpoint and reason


@dataclass(frozen=True)
class Limits:
    """Bounds of a setpoint with the names of the parameters they come from; SI."""

    low: float
    high: float
    low_name: str
    high_name: str


class Inputs:
    """Checks setpoints; `warn(text)` is called for refusals, at most every 2 s for each kind."""

    def __init__(self, warn, clock=time.monotonic):
        self._warn, self._clock = warn, clock
        self._warned: dict[object, float] = {}
        self.accepted: Counter = Counter()
        self.refused: Counter = Counter()
        self.last_accepted: dict[str, float] = {}
        self.strangers: Counter = Counter()
        self.namesakes = 0
        self.failures = 0

    def check(self, name: str, value: float | None, limits: Limits, in_force: float) -> bool:
        """
        Whether the setpoint may be obeyed; a refusal is counted, and warned of in words.

        None stands for a message that could not be read.
        """
        if value is None:
            reason, bound = 'not a Float64', 'a std_msgs/msg/Float64 is expected'
        elif not math.isfinite(value):
            reason, bound = 'not finite', 'a finite number is expected'
        elif value < limits.low:
            reason, bound = 'below its limit', f'{limits.low_name} is {both(name, limits.low)}'
        elif value > limits.high:
            reason, bound = 'above its limit', f'{limits.high_name} is {both(name, limits.high)}'
        else:
            self.accepted[name] += 1
            self.last_accepted[name] = self._clock()
            return True
        self.refused[name, reason] += 1
        shown = '' if value is None else f'{both(name, value)} '
        self._warn_at_times((name, reason), (
            f'{name} setpoint {shown}refused, {reason}: {bound}; '
            f'{both(name, in_force)} stays in force'))
        return False

    def _warn_at_times(self, kind, text):
        now = self._clock()
        if now - self._warned.get(kind, -math.inf) >= WARN_EVERY:
            self._warned[kind] = now
            self._warn(text)

    def stranger(self, name: str, what: str) -> None:
        """Count and warn of a publisher that this node cannot hear: its type or QoS is wrong."""
        self.strangers[name, what] += 1
        if self.strangers[name, what] == 1:
            self._warn(f'somebody publishes {name} with an incompatible {what}: it cannot be '
                       'heard; std_msgs/msg/Float64, reliable, is expected')

    def namesake(self, name: str, count: int) -> None:
        """Note how many other nodes bear this twin's name now, and warn of a new one."""
        if count > self.namesakes:
            self._warn(f'another node is called {name} too: both hear the same setpoints and '
                       'answer the same services; give one a namespace (-r __ns:=/left)')
        self.namesakes = count

    def failed(self, error: Exception) -> None:
        """Count and tell an error in a callback: a fault of ours, and no reason to fall silent."""
        self.failures += 1
        self._warn_at_times(repr(error), f'a callback failed, the twin goes on: {error!r}')

    def age(self, name: str) -> float | None:
        """Seconds since a setpoint was last accepted; None if never."""
        since = self.last_accepted.get(name)
        return None if since is None else self._clock() - since
