"""What the machines in a recording did, as NumPy arrays in SI units."""
from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hpv_twin.viewer.diagnostics import Status

STANDARD_ATMOSPHERE = 101_325.0  # Pa


@dataclass
class Signal:
    """Values (float64, n) at `time` (int64, n; ns since 1970, ascending)."""

    time: np.ndarray
    values: np.ndarray

    def __len__(self) -> int:
        return len(self.time)

    def gaps(self) -> np.ndarray:
        """
        Return the indices (int64) of the samples that are followed by a gap in the stamps.

        A gap is a step beyond one and a half usual ones, and beyond what these stamps jitter.
        """
        steps = np.diff(self.time)
        if len(steps) < 3:
            return np.empty(0, dtype=np.int64)
        usual = np.median(steps)
        jitter = np.median(np.abs(steps - usual))
        return np.flatnonzero(steps > usual + max(0.5 * usual, 10.0 * jitter))

    def in_force(self, first: int, last: int) -> Signal:
        """Return a held value from `first` to `last` (ns): the one before `first` moves there."""
        start = max(np.searchsorted(self.time, first, side='right') - 1, 0)
        stop = max(np.searchsorted(self.time, last, side='right'), start + 1)
        time, values = self.time[start:stop], self.values[start:stop]
        return Signal(np.append(np.clip(time, first, last), last), np.append(values, values[-1]))


@dataclass
class Machine:
    """
    One vibrator, or all the sensors of somebody else's file (`name` is empty then).

    `pressures` (Pa, absolute) by topic below the name, `joints` (m) and `velocities` (m/s) by
    joint, and `numbers`: pump_flow (m³/s), preload (m), load (N), frequency (Hz), stroke (m) and
    what others it publishes, as far as recorded.
    """

    name: str
    pressures: dict[str, Signal] = field(default_factory=dict)
    joints: dict[str, Signal] = field(default_factory=dict)
    velocities: dict[str, Signal] = field(default_factory=dict)
    numbers: dict[str, Signal] = field(default_factory=dict)

    @property
    def waveforms(self) -> list[Signal]:
        """Everything that is sampled steadily."""
        return [*self.pressures.values(), *self.joints.values()]

    def owns(self, topic: str) -> bool:
        """Whether `topic` is in the namespace of this machine."""
        return topic.startswith(f'{self.name}/')

    def below(self, topic: str) -> str:
        """Return what follows the machine's name in `topic`, as in measured/pressure."""
        return topic.removeprefix(self.name).strip('/')


@dataclass
class Replay:
    """What one recording shows from `first` to `last` (ns); its seconds count from `start` (ns).

    `ambient` in Pa; `ambient_is_recorded` tells whether it is assumed. `design` is YAML text.
    `missing` says in words what of the file is lost; empty if nothing is.
    """

    path: Path
    start: int
    first: int
    last: int
    machines: list[Machine]
    statuses: list[Status]
    version: str
    ambient: float
    ambient_is_recorded: bool
    design: str | None
    missing: str

    def seconds(self, time):
        """Return `time` (ns) as seconds since the recording's start."""
        return (time - self.start) * 1e-9
