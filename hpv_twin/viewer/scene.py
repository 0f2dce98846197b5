"""A replay as rerun's columns: every quantity an entity, in a person's unit and its colour."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import rerun as rr

from hpv_twin.model.vibrator import Vibrator
from hpv_twin.viewer import palette
from hpv_twin.viewer.cutaway import Cutaway, has_cutaway
from hpv_twin.viewer.events import Event, find_events
from hpv_twin.viewer.palette import Quantity
from hpv_twin.viewer.phases import FORWARD, RETURN, SYMBOLS, Phases, find_phases, pressure_at
from hpv_twin.viewer.phases import NAMES as PHASE_NAMES
from hpv_twin.viewer.portrait import has_portrait, has_spectrum, send_portrait, send_spectrum
from hpv_twin.viewer.signals import Machine, Replay, Signal

TIME, WALL_CLOCK = 'time', 'wall_clock'  # s since the start, and UTC
CARD, DESIGN, EVENTS = '/card', '/design', '/events'
BINS = 4000  # of a whole run
CHUNK = 1 << 15  # rows; the viewer seeks by chunk
PAUSE = 100_000_000  # ns; beyond this a cycle's figure is no longer in force
PHASE_LABELS = [f'{symbol} {name}' for name, symbol in zip(PHASE_NAMES, SYMBOLS, strict=False)]
LEVEL_COLOURS = {'INFO': 0x909AA3FF, 'WARN': 0xF59F00FF, 'ERROR': 0xF03E3EFF}  # on dark and light

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
    estimates: list[Curve]
    overview: list[Curve]
    marks: list[Curve]
    machine: Machine
    cutaway: Cutaway | None
    phases: Phases | None

    @property
    def curves(self) -> list[Curve]:
        """All lines."""
        return self.pressures + self.joints + self.numbers + self.estimates + self.overview


def build_panels(replay: Replay, vibrator: Vibrator | None = None) -> list[Panel]:
    """Return one panel for each machine of a recording; `vibrator` is its design if known."""
    return [_panel(replay, machine, vibrator) for machine in replay.machines]


def _panel(replay: Replay, machine: Machine, vibrator: Vibrator | None) -> Panel:
    """Return the panel of one machine; it is drawn as the base design if its own is not known."""
    pressures, joints = pressure_curves(replay, machine), joint_curves(machine)
    phases = _phases(machine, vibrator)
    cutaway = (Cutaway(machine, vibrator or Vibrator(), replay.ambient)
               if has_cutaway(machine) else None)
    return Panel(
        name=machine.name or 'sensors', pressures=pressures, joints=joints,
        numbers=_numbers(replay, machine), estimates=_estimates(replay, machine),
        overview=overview(pressures or joints), marks=pressure_marks(replay, machine, phases),
        machine=machine, cutaway=cutaway, phases=phases)


def _phases(machine: Machine, vibrator: Vibrator | None) -> Phases | None:
    """Return the phases of the cyclogram; without a design the stroke is what was moved."""
    if 'plunger' not in machine.joints:
        return None
    moved = np.nanmax(machine.joints['plunger'].values)
    return find_phases(machine, vibrator.stroke if vibrator else moved) if moved > 0.0 else None


def pressure_marks(replay: Replay, machine: Machine, phases: Phases | None) -> list[Curve]:
    """Return the pressures at which the plunger leaves its seat and begins its return."""
    pressure = machine.pressures.get('pressure')
    if phases is None or pressure is None:
        return []
    marks = []
    for name, quantity, kind in (('opening', palette.OPENING, FORWARD),
                                 ('return', palette.RETURN, RETURN)):
        time = phases.begins(kind)
        if len(time):
            marks.append(Curve(f'{entity_of(machine, "pressure")}/{name}', quantity,
                               Signal(time, pressure_at(pressure, time) - replay.ambient)))
    return marks


def overview(curves: list[Curve], bins: int = BINS) -> list[Curve]:
    """Return what the whole run shows of waveforms in one unit: their envelopes, darker."""
    return [replace(curve, entity=f'{curve.entity}/whole_run', signal=envelope(curve.signal, bins),
                    brightness=0.6)
            for curve in curves if curve.quantity.unit == curves[0].quantity.unit]


def envelope(signal: Signal, bins: int = BINS) -> Signal:
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


def pressure_curves(replay: Replay, machine: Machine) -> list[Curve]:
    """Return the pressures of a machine, gauge, with a break at each gap."""
    return [Curve(entity_of(machine, label), palette.pressure(label, index),
                  _broken(Signal(signal.time, signal.values - replay.ambient)))
            for index, (label, signal) in enumerate(machine.pressures.items())]


def joint_curves(machine: Machine) -> list[Curve]:
    """Return the joint positions of a machine, with a break at each gap."""
    # Above the gap plunger and sleeve move as one: the wider line stays visible below the other.
    return [Curve(entity_of(machine, label), palette.joint(label, index), _broken(signal),
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
            if name == 'load' and not signal.values.any():
                continue  # the events tell that there is none; a strip of zeros tells nothing
        curves.append(Curve(entity_of(machine, name), quantity, signal, stepped=True))
    return curves


def _estimates(replay: Replay, machine: Machine) -> list[Curve]:
    """Return what a twin says of the machine that it follows."""
    names = filter(palette.is_estimate, sorted(machine.numbers))
    return [
        Curve(entity_of(machine, name), palette.estimate(name, index),
              _paused(machine.numbers[name], machine.waveforms[0], replay.last), stepped=True)
        for index, name in enumerate(names)]


def write_scene(stream: rr.RecordingStream, replay: Replay, panels: list[Panel],
                cards: dict[str, str], progress: Callable[[int, int], None]) -> None:
    """
    Send everything that is shown of `replay` to `stream`; `cards` are Markdown by entity.

    `progress(done, steps)` is told how far it is.
    """
    for entity, text in cards.items():
        stream.log(entity, rr.TextDocument(text, media_type='text/markdown'), static=True)
    steps = [partial(send_events, stream, replay, find_events(replay))]
    for panel in panels:
        steps += _panel_steps(stream, replay, panel)
    for done, step in enumerate(steps):
        step()
        stream.flush()  # so that no more than one quantity waits in memory
        progress(done + 1, len(steps))


def _panel_steps(stream: rr.RecordingStream, replay: Replay, panel: Panel) -> list[Callable]:
    """Return what is to be done to send one machine."""
    machine, columns = panel.machine, partial(indexes, replay)
    steps = [partial(_send_curve, stream, replay, curve) for curve in panel.curves]
    steps += [partial(_send_mark, stream, replay, mark) for mark in panel.marks]
    if panel.cutaway:
        steps.append(partial(panel.cutaway.send, stream, columns))
    if panel.phases:
        steps.append(partial(_send_phases, stream, replay, panel))
    if has_portrait(machine):
        steps.append(partial(send_portrait, stream, machine, columns))
    if has_spectrum(machine):
        steps.append(partial(send_spectrum, stream, machine, columns))
    return steps


def entity_of(machine: Machine, label: str) -> str:
    """Return the entity of one quantity."""
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


def indexes(replay: Replay, time: np.ndarray) -> list[rr.TimeColumn]:
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
    send_rows(stream, replay, curve)


def send_rows(stream: rr.RecordingStream, replay: Replay, curve: Curve) -> None:
    """Send the values of a curve or a mark."""
    values = curve.quantity.show(curve.signal.values)
    for begin in range(0, len(values), CHUNK):
        part = slice(begin, begin + CHUNK)
        stream.send_columns(curve.entity, indexes(replay, curve.signal.time[part]),
                            rr.Scalars.columns(scalars=values[part]))


def _send_mark(stream: rr.RecordingStream, replay: Replay, mark: Curve) -> None:
    """Send one kind of mark on the pressure."""
    stream.log(mark.entity, rr.SeriesPoints(
        names=mark.quantity.title, colors=mark.quantity.rgba(), markers='Circle',
        marker_sizes=5.0), static=True)
    send_rows(stream, replay, mark)


def phases_entity(machine: Machine) -> str:
    """Return the entity of a machine's cyclogram."""
    return f'{machine.name}/phases'


def _send_phases(stream: rr.RecordingStream, replay: Replay, panel: Panel) -> None:
    """Send the phases of the cyclogram; nothing is known in a gap."""
    phases = panel.phases
    stream.log(phases_entity(panel.machine), rr.StateConfiguration(
        values=PHASE_LABELS, labels=PHASE_LABELS,
        colors=np.array(palette.PHASES, dtype=np.uint32)), static=True)
    send_phase_rows(stream, replay, panel.machine, phases.time, phases.kind)


def send_phase_rows(stream: rr.RecordingStream, replay: Replay, machine: Machine,
                    time: np.ndarray, kind: np.ndarray) -> None:
    """Send which phase begins when (ns)."""
    names = np.array([*PHASE_LABELS, ''], dtype=object)[kind].tolist()
    stream.send_columns(phases_entity(machine), indexes(replay, time),
                        rr.StateChange.columns(state=names))


def send_events(stream: rr.RecordingStream, replay: Replay, events: list[Event]) -> None:
    """Send the event log; the time is in the text too, the viewer's column for it is narrow."""
    time = np.array([event.time for event in events], dtype=np.int64)
    stream.send_columns(EVENTS, indexes(replay, time), rr.TextLog.columns(
        text=[f'{replay.seconds(event.time):.3f} s: {event.text}' for event in events],
        level=[event.level for event in events],
        color=np.array([LEVEL_COLOURS[event.level] for event in events], dtype=np.uint32)))
