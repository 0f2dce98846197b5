"""What happened in a recording, as lines of a log: setpoints, gaps, changes of health."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpv_twin.viewer import palette
from hpv_twin.viewer.signals import Machine, Replay

LEVELS = ('INFO', 'WARN', 'ERROR', 'WARN')  # of OK, WARN, ERROR, STALE
WORDS = ('OK', 'WARN', 'ERROR', 'STALE')
SETPOINTS = ('pump_flow', 'preload', 'load')
MOST_GAPS = 1000  # of one machine, the longest; a log of more is not read


@dataclass(frozen=True)
class Event:
    """One line at `time` (ns); `level` as rerun names it."""

    time: int
    level: str
    text: str


def find_events(replay: Replay) -> list[Event]:
    """Return every event of a recording in order of time."""
    events = health(replay, {})
    several = len(replay.machines) > 1
    for machine in replay.machines:
        prefix = f'{machine.name}: ' if several else ''
        events += _setpoints(replay, machine, prefix) + _gaps(machine, prefix)
    if replay.missing:
        events.append(Event(replay.last, 'WARN', f'the file is damaged: {replay.missing}'))
    if not events:
        events = [Event(replay.first, 'INFO', 'the recording begins')]
    return sorted(events, key=lambda event: event.time)


def health(replay: Replay, levels: dict[str, int]) -> list[Event]:
    """
    Report each diagnostic status when it is first seen and whenever its level changes.

    `levels` is what was known before; it is kept up to date.
    """
    events = []
    for status in replay.statuses:
        level = min(max(status.level, 0), 3)
        if levels.get(status.name) == level:
            continue
        before = f' (was {WORDS[levels[status.name]]})' if status.name in levels else ''
        levels[status.name] = level
        events.append(Event(int(np.clip(status.time, replay.first, replay.last)), LEVELS[level],
                            f'{status.name} {WORDS[level]}: {status.message}{before}'))
    return events


def _setpoints(replay: Replay, machine: Machine, prefix: str) -> list[Event]:
    """Report each setpoint in force at the beginning and each change."""
    events = []
    for name in SETPOINTS:
        if name not in machine.numbers:
            continue
        quantity = palette.NUMBERS[name]
        signal = machine.numbers[name].in_force(replay.first, replay.last)
        before = None
        for time, value in zip(signal.time, signal.values, strict=True):
            if value != before:
                events.append(setpoint(prefix, quantity, time, value, before))
            before = value
    return events


def setpoint(prefix: str, quantity: palette.Quantity, time: int, value: float,
             before: float | None) -> Event:
    """Report that a setpoint has become `value`; it was `before`, if that is known."""
    was = '' if before is None else f' (was {quantity.text(before)})'
    return Event(int(time), 'INFO', f'{prefix}{quantity.label} {quantity.text(value)}{was}')


def _gaps(machine: Machine, prefix: str) -> list[Event]:
    """Report where samples are missing."""
    signal = machine.waveforms[0]
    at = signal.gaps()
    if not len(at):
        return []
    steps = np.diff(signal.time)
    usual = np.median(steps)
    longest = np.sort(at[np.argsort(steps[at])[::-1][:MOST_GAPS]])
    return [Event(int(signal.time[i]), 'WARN',
                  f'{prefix}gap of {steps[i] * 1e-6:g} ms: '
                  f'{round(steps[i] / usual) - 1:,} samples missing') for i in longest]
