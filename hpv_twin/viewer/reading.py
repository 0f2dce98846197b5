"""From a recording's topics to machines and their signals."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from hpv_twin.recording.reader import (
    JointSignal,
    PressureSignal,
    Recording,
    RecordingError,
    ScalarSignal,
    describe,
    messages,
    read_signals,
)
from hpv_twin.viewer import diagnostics, palette
from hpv_twin.viewer.signals import STANDARD_ATMOSPHERE, Machine, Replay, Signal

PRESSURE = 'sensor_msgs/msg/FluidPressure'
JOINTS = 'sensor_msgs/msg/JointState'
NUMBER = 'std_msgs/msg/Float64'
SETPOINTS = ('pump_flow', 'preload', 'load')
CYCLE_FIGURES = ('frequency', 'stroke')
MINUTE = 60 * 10**9

Progress = Callable[[int, int], None]


def load(path: Path, since: float | None = None, until: float | None = None, *,
         ambient: float | None = None, progress: Progress | None = None) -> Replay:
    """
    Read `path` from `since` to `until` (s after its first sample; None: no bound).

    `ambient` (Pa) overrides what the file says. `progress(done, size)` is told bytes. A damaged
    file is read as far as it goes. Raises RecordingError, whose text names the file.
    """
    about = describe(path)
    start = _first_sample(about)
    first = start if since is None else start + round(since * 1e9)
    last = None if until is None else start + round(until * 1e9)
    machines = _machines(about)
    signals = _read(about, machines, None if since is None else first, last, progress)
    place(machines, signals)
    machines = sorted((m for m in machines if m.waveforms), key=lambda machine: machine.name)
    if not machines:
        end = 'the end' if until is None else f'{until:g} s'
        raise RecordingError(f'{path}: nothing was recorded from {since or 0:g} s to {end}; it '
                             f'lasts {(about.end - start) * 1e-9:.3f} s')
    begin, end = _span(machines)
    if not start - MINUTE <= begin <= (about.end or 0) + MINUTE:
        start = begin  # the sensors have a clock of their own
    recorded = _number(about.metadata.get('ambient_pressure'))
    return Replay(
        path, start, begin, end, machines, _statuses(about, first, last),
        version=about.metadata.get('package_version', ''),
        ambient=next(p for p in (ambient, recorded, STANDARD_ATMOSPHERE) if p is not None),
        ambient_is_recorded=ambient is None and recorded is not None, design=_design(about),
        missing=_missing(about, signals, since is not None or until is not None))


def _sensors(about: Recording) -> list[str]:
    return [topic for topic, (kind, count) in about.topics.items()
            if kind in (PRESSURE, JOINTS) and count and topic.startswith('/')]


def _first_sample(about: Recording) -> int:
    """Return the log time (ns) of the first sample. Raises RecordingError if there is none."""
    for message in messages(about.path, _sensors(about)):
        return message.log_time
    there = ', '.join(sorted(f'{t} ({kind})' for t, (kind, _) in about.topics.items()))
    raise RecordingError(
        f'{about.path}: no sensor_msgs/FluidPressure and no sensor_msgs/JointState in it; the '
        f'topics are: {there or "none"}' + (f'; {about.problem}' if about.problem else ''))


def _machines(about: Recording) -> list[Machine]:
    """
    Return the machines in a recording, still empty; the longest name first.

    A machine is the recording's own node, or has a plunger_position. All other sensors share one
    machine without a name.
    """
    names = {topic.removesuffix('/plunger_position').removesuffix('/measured')
             for topic, (kind, _) in about.topics.items()
             if kind == JOINTS and topic.endswith('/plunger_position')}
    names.update(n for n in about.metadata.get('node', '').split(',') if n.startswith('/'))
    return [Machine(n) for n in sorted(names, key=lambda name: (-len(name), name))] + [Machine('')]


def _owner(machines: list[Machine], topic: str) -> Machine:
    return next(machine for machine in machines if machine.owns(topic))


def _read(about: Recording, machines: list[Machine], first: int | None, last: int | None,
          progress: Progress | None) -> dict:
    """Read the sensors, and the machines' own numbers, between two log times (ns)."""
    def numbers(names):
        topics = (f'{machine.name}/{name}' for machine in machines if machine.name
                  for name in names)
        return [t for t in topics if t in about.topics and about.topics[t].type_name == NUMBER]

    wanted = _sensors(about) + numbers(SETPOINTS + CYCLE_FIGURES) + _estimates(about, machines)
    signals = read_signals(about.path, wanted, first, last, progress)
    if first is not None:
        # A setpoint in force may be older than what is shown.
        signals |= read_signals(about.path, numbers(SETPOINTS), None, last)
    return signals


def _estimates(about: Recording, machines: list[Machine]) -> list[str]:
    """Return the topics of what a twin says of the machine that it follows."""
    return [topic for topic, (kind, _) in about.topics.items() if kind == NUMBER
            and any(m.name and m.owns(topic) and palette.is_estimate(m.below(topic))
                    for m in machines)]


def place(machines: list[Machine], signals: dict) -> None:
    """Give each signal to the machine that owns its topic, a twin's own before measured ones."""
    for topic, signal in signals.items():
        _place(_owner(machines, topic), topic, signal)
    for machine in machines:
        machine.pressures = dict(sorted(machine.pressures.items(), key=_is_measured))
        machine.joints = dict(sorted(machine.joints.items(), key=_is_measured))


def _place(machine: Machine, topic: str, signal) -> None:
    """Give a signal to its machine; a joint is called by its topic too unless that is clear."""
    label = machine.below(topic)
    if not len(signal.time):
        return
    if isinstance(signal, PressureSignal):
        machine.pressures[label] = Signal(signal.time, signal.pressure)
    elif isinstance(signal, ScalarSignal):
        machine.numbers[label] = Signal(signal.time, signal.value)
    elif isinstance(signal, JointSignal):
        for index, name in enumerate(signal.names):
            joint = name if label == 'plunger_position' else f'{label}/{name}'
            # Copies: a column would keep the whole table.
            machine.joints[joint] = Signal(signal.time, signal.position[:, index].copy())
            velocity = signal.velocity[:, index]
            if joint == 'plunger' and np.isfinite(velocity).any():
                machine.velocities[joint] = Signal(signal.time, velocity.copy())


def _is_measured(item: tuple[str, Signal]) -> bool:
    return item[0].startswith('measured/')


def _span(machines: list[Machine]) -> tuple[int, int]:
    """Return the first and the last time (ns) of all waveforms."""
    signals = [signal for machine in machines for signal in machine.waveforms]
    return min(int(s.time[0]) for s in signals), max(int(s.time[-1]) for s in signals)


def _statuses(about: Recording, first: int, last: int | None) -> list[diagnostics.Status]:
    """Return every diagnostic status, in order of time."""
    topics = [t for t, (kind, _) in about.topics.items() if kind == diagnostics.TYPE]
    found = [status for message in (messages(about.path, topics, first, last) if topics else ())
             for status in diagnostics.statuses(message.log_time, message.payload)]
    return sorted(found, key=lambda status: status.time)


def _design(about: Recording) -> str | None:
    content = about.attachments.get('vibrator.yaml')
    return None if content is None else content.decode(errors='replace')


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None


def _missing(about: Recording, signals: dict, is_part: bool) -> str:
    """Say what of the file is lost; of a part of it only what is known without counting."""
    parts = [about.problem] if about.problem else []
    expected = sum(about.topics[topic].count for topic in signals)
    lost = sum(signal.malformed for signal in signals.values()) if is_part else (
        expected - sum(len(signal.time) for signal in signals.values()))
    if lost > 0:
        parts.append(f'{lost:,} of {expected:,} messages are damaged and left out')
    return '; '.join(parts)
