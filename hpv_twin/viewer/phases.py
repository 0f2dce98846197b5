"""The phases of the cyclogram, read off the samples of the plunger.

At 1 kHz a dwell can lie between two samples. So the instants at which the plunger reaches or
leaves a stop are found from position and velocity of the sample beside the stop: it arrives at
constant speed, leaves the seat under a force that grows from nothing, and the full stroke at
constant acceleration. That is good to about a fifth of a sample.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpv_twin.viewer.signals import Machine, Signal

CLOSED, FORWARD, OPEN, RETURN, UNKNOWN = range(5)
# In the paper's names of (6): the times of the plunger.
NAMES = ('build-up', 'forward', 'dwell', 'return', '')
SYMBOLS = ('t_kh', 't_kn', 't_kb', 't_RS')
AT_STOP = 1e-3  # of the stroke; nearer to a stop than that, the plunger rests on it
NOISE = 6.0  # standard deviations of a noisy sensor that are rest as well


@dataclass(frozen=True)
class Phases:
    """Phase `kind` (int8, n; as above) begins at `time` (int64, n; ns); UNKNOWN is in a gap."""

    time: np.ndarray
    kind: np.ndarray

    def begins(self, *kinds: int) -> np.ndarray:
        """Return when (ns) a phase of `kinds` begins behind another known one."""
        known = np.append(False, self.kind[:-1] != UNKNOWN)
        return self.time[known & np.isin(self.kind, kinds)]

    def durations(self, kind: int) -> np.ndarray:
        """Return how long (s) each phase of a kind lasted, those at an edge left out."""
        inner = np.flatnonzero(self.kind == kind)
        inner = inner[(inner > 0) & (inner < len(self.kind) - 1)]
        whole = (self.kind[inner - 1] != UNKNOWN) & (self.kind[inner + 1] != UNKNOWN)
        return (self.time[inner[whole] + 1] - self.time[inner[whole]]) * 1e-9


def find_phases(machine: Machine, stroke: float) -> Phases | None:
    """Return the phases of a plunger that moves by `stroke` (m); None if it is not recorded."""
    position = machine.joints.get('plunger')
    if position is None or len(position) < 3:
        return None
    time, y = position.time, np.nan_to_num(position.values)
    velocity = machine.velocities.get('plunger')
    v = np.gradient(y, time * 1e-9) if velocity is None else np.nan_to_num(velocity.values)
    kind = np.where(v < 0.0, RETURN, FORWARD)
    near = max(AT_STOP * stroke, NOISE * _noise(y, stroke))
    kind[y < near] = CLOSED
    kind[y > stroke - near] = OPEN
    at = np.flatnonzero(np.diff(kind))
    gaps = position.gaps()
    at = at[~np.isin(at, gaps)]
    times, kinds = _switches(time, np.clip(y, 0.0, stroke), np.abs(v), stroke, kind, at)
    edges = np.concatenate([time[:1], time[gaps], time[gaps + 1], time[-1:]])
    states = np.concatenate([kind[:1], np.full(len(gaps), UNKNOWN), kind[gaps + 1], [UNKNOWN]])
    times, kinds = np.append(times, edges), np.append(kinds, states)
    order = np.argsort(times, kind='stable')
    return Phases(times[order], kinds[order].astype(np.int8))


def _noise(y: np.ndarray, stroke: float) -> float:
    """Return the standard deviation (m) of a plunger at rest; 0 if it does not rest."""
    steps = np.abs(np.diff(y[y < 0.1 * stroke]))
    return float(np.median(steps)) if len(steps) else 0.0  # 0.95 of the standard deviation


def _switches(time, y, speed, stroke, kind, at) -> tuple[np.ndarray, np.ndarray]:
    """Return when a phase begins between the samples `at` and the next, and which one."""
    before, after = kind[at], kind[at + 1]
    begin, end = time[at].astype(float), time[at + 1].astype(float)
    middle = (begin + end) / 2.0
    with np.errstate(divide='ignore', invalid='ignore'):
        # The stop that is reached or left: the seat on a return, the full stroke on the way there.
        to_stop = np.where(before == RETURN, y[at], stroke - y[at])
        arrives = begin + 1e9 * to_stop / speed[at]
        from_stop = np.where(after == RETURN, stroke - y[at + 1], y[at + 1])
        power = np.where(after == RETURN, 2e9, 3e9)  # of time, by which it departs
        departs = end - power * from_stop / speed[at + 1]
    arrives = np.clip(np.where(np.isfinite(arrives), arrives, middle), begin, end)
    departs = np.clip(np.where(np.isfinite(departs), departs, middle), begin, end)
    moving_before, moving_after = before % 2 == 1, after % 2 == 1
    single = np.where(moving_before & ~moving_after, arrives,
                      np.where(~moving_before & moving_after, departs, middle))
    # From one stroke to the other: it has been at the stop in between.
    both = moving_before & moving_after
    touched = both & (arrives < departs)
    single = np.where(touched, departs, single)
    stops = np.where(before[touched] == RETURN, CLOSED, OPEN)
    # From stop to stop within one sample: the stroke between is not seen, it begins in the middle.
    return (np.concatenate([single, arrives[touched]]).astype(np.int64),
            np.concatenate([after, stops]))


def pressure_at(pressure: Signal, time: np.ndarray) -> np.ndarray:
    """Return the pressure at instants (ns), between samples on a straight line."""
    return np.interp((time - pressure.time[0]).astype(float),
                     (pressure.time - pressure.time[0]).astype(float), pressure.values)
