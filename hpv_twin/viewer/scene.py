"""A replay as rerun's columns: every quantity an entity, in a person's unit and its colour."""
from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import rerun as rr

from hpv_twin.viewer import palette
from hpv_twin.viewer.events import Event, find_events
from hpv_twin.viewer.palette import Quantity
from hpv_twin.viewer.signals import Machine, Replay, Signal

TIME, WALL_CLOCK = 'time', 'wall_clock'  # s since the start, and UTC
CARD, EVENTS = '/card', '/events'
CHUNK = 1 << 15  # rows; the viewer seeks by chunk
PAUSE = 100_000_000  # ns; beyond this a cycle's figure is no longer in force
LEVEL_COLOURS = {'INFO': 0xCED4DAFF, 'WARN': 0xFFD43BFF, 'ERROR': 0xFF6B6BFF}

# Without it the viewer draws the mean of what falls on a pixel: 55 Hz would be a flat line.
MIN_MAX = rr.components.AggregationPolicy.MinMax
STEP = rr.components.InterpolationMode.StepAfter
LINE = rr.components.InterpolationMode.Linear


@dataclass(frozen=True)
class Curve:
    """One line of a plot: its entity, how it is shown, and its signal in SI (pressure: gauge)."""

    entity: str
    quantity: Quantity
    signal: Signal
    stepped: bool = False
    width: float = 2.0
    brightness: float = 1.0


@dataclass(frozen=True)
class Panel:
    """The curves of one machine, by the views they belong to."""

    name: str
    pressures: list[Curve]
    joints: list[Curve]
    numbers: list[Curve]
    overview: list[Curve]

    @property
    def curves(self) -> list[Curve]:
        """All of them."""
        return self.pressures + self.joints + self.numbers + self.overview


def build_panels(replay: Replay) -> list[Panel]:
    """Return one panel for each machine of a recording."""
    panels = []
    for machine in replay.machines:
        pressures, joints = _pressures(replay, machine), _joints(machine)
        panels.append(Panel(machine.name or 'sensors', pressures, joints,
                            _numbers(replay, machine), _overview(pressures or joints)))
    return panels


def _overview(curves: list[Curve]) -> list[Curve]:
    """Return what the whole run shows of waveforms in one unit: their envelopes, darker."""
    return [replace(curve, entity=f'{curve.entity}/whole_run', signal=envelope(curve.signal),
                    brightness=0.6)
            for curve in curves if curve.quantity.unit == curves[0].quantity.unit]


def envelope(signal: Signal, bins: int = 4000) -> Signal:
    """
    Return minimum and maximum of each of `bins` stretches, in turn: as a plot, a band.

    A screen has fewer columns than that, so the band looks as the signal would, and an hour needs
    no more memory than a minute. A short signal is returned as it is; NaN stays where it is.
    """
    if len(signal) <= 4 * bins:
        return signal
    breaks = np.flatnonzero(np.isnan(signal.values))
    regular = np.linspace(0, len(signal), bins, endpoint=False).astype(np.int64)
    starts = np.unique(np.concatenate([regular, breaks, breaks + 1]))
    starts = starts[starts < len(signal)]
    low, high = (f.reduceat(signal.values, starts) for f in (np.fmin, np.fmax))
    ends = np.append(starts[1:], len(signal)) - 1
    middle = (signal.time[starts] + signal.time[ends]) // 2
    return Signal(np.column_stack([signal.time[starts], middle]).ravel(),
                  np.column_stack([low, high]).ravel())


def _pressures(replay: Replay, machine: Machine) -> list[Curve]:
    """Return the pressures of a machine, gauge, with a break at each gap."""
    return [Curve(_entity(machine, label), palette.pressure(label, index),
                  _broken(Signal(signal.time, signal.values - replay.ambient)))
            for index, (label, signal) in enumerate(machine.pressures.items())]


def _joints(machine: Machine) -> list[Curve]:
    """Return the joint positions of a machine, with a break at each gap."""
    # Above the gap plunger and sleeve move as one: the wider line stays visible below the other.
    return [Curve(_entity(machine, label), palette.joint(label, index), _broken(signal),
                  width=4.0 if label == 'plunger' else 2.0)
            for index, (label, signal) in enumerate(machine.joints.items())]


def _numbers(replay: Replay, machine: Machine) -> list[Curve]:
    """Return setpoints and cycle figures as steps; each value holds until the next."""
    curves = []
    for name, quantity in palette.NUMBERS.items():
        if name not in machine.numbers:
            continue
        if name in palette.CYCLE_FIGURES:
            signal = _paused(machine.numbers[name], machine.waveforms[0], replay.last)
        else:
            signal = machine.numbers[name].in_force(replay.first, replay.last)
        curves.append(Curve(_entity(machine, name), quantity, signal, stepped=True))
    return curves


def write_scene(stream: rr.RecordingStream, replay: Replay, panels: list[Panel],
                card: str) -> None:
    """Send everything that is shown of `replay` to `stream`."""
    stream.log(CARD, rr.TextDocument(card, media_type='text/markdown'), static=True)
    for panel in panels:
        for curve in panel.curves:
            _send_curve(stream, replay, curve)
    _send_events(stream, replay, find_events(replay))


def _entity(machine: Machine, label: str) -> str:
    return f'{machine.name}/{label}'


def _broken(signal: Signal) -> Signal:
    """Return the signal with a NaN behind each gap's first edge: the line breaks there."""
    at = signal.gaps() + 1
    if not len(at):
        return signal
    usual = int(np.median(np.diff(signal.time)))
    return Signal(np.insert(signal.time, at, signal.time[at - 1] + usual),
                  np.insert(signal.values, at, np.nan))


def _paused(figure: Signal, waveform: Signal, last: int) -> Signal:
    """Return a cycle figure up to `last` (ns) that breaks where the waveform pauses."""
    gaps = waveform.gaps()
    long = gaps[waveform.time[gaps + 1] - waveform.time[gaps] > PAUSE]
    breaks = waveform.time[long]
    at = np.searchsorted(figure.time, breaks, side='right')
    return Signal(np.append(np.insert(figure.time, at, breaks), last),
                  np.append(np.insert(figure.values, at, np.nan), figure.values[-1]))


def _indexes(replay: Replay, time: np.ndarray) -> list[rr.TimeColumn]:
    """Return both timelines for `time` (int64, ns)."""
    return [rr.TimeColumn(TIME, duration=(time - replay.start).astype('timedelta64[ns]')),
            rr.TimeColumn(WALL_CLOCK, timestamp=time.astype('datetime64[ns]'))]


def _send_curve(stream: rr.RecordingStream, replay: Replay, curve: Curve) -> None:
    """Send one curve with its name, colour and the way it is drawn."""
    style = rr.SeriesLines(
        names=curve.quantity.title, colors=curve.quantity.rgba(curve.brightness),
        widths=curve.width,
        aggregation_policy=MIN_MAX, interpolation_mode=STEP if curve.stepped else LINE)
    stream.log(curve.entity, style, static=True)
    values = curve.quantity.show(curve.signal.values)
    for begin in range(0, len(values), CHUNK):
        part = slice(begin, begin + CHUNK)
        stream.send_columns(curve.entity, _indexes(replay, curve.signal.time[part]),
                            rr.Scalars.columns(scalars=values[part]))


def _send_events(stream: rr.RecordingStream, replay: Replay, events: list[Event]) -> None:
    """Send the event log; the time is in the text too, the viewer's column for it is narrow."""
    time = np.array([event.time for event in events], dtype=np.int64)
    stream.send_columns(EVENTS, _indexes(replay, time), rr.TextLog.columns(
        text=[f'{replay.seconds(event.time):.3f} s: {event.text}' for event in events],
        level=[event.level for event in events],
        color=np.array([LEVEL_COLOURS[event.level] for event in events], dtype=np.uint32)))
