"""Phase portrait and spectrum of the plunger, a second at a time, as rerun's columns."""
from __future__ import annotations

from itertools import pairwise

import numpy as np
import rerun as rr

from hpv_twin.viewer import palette
from hpv_twin.viewer.cutaway import ANNOTATION
from hpv_twin.viewer.signals import Machine, Signal

SECOND = 1_000_000_000  # ns
MINUTE = 60  # s
WIDTH, HEIGHT = 1.5, 1.0  # of the portrait's frame; a 2D view has one scale for both axes
HIGHEST = 400.0  # Hz; the ninth harmonic is the last to be seen
GRID = 0x495057FF
FINE = 4  # points between two samples of the line


def portrait_entity(machine: Machine) -> str:
    """Return the entity of a machine's phase portrait."""
    return f'{machine.name}/phase_portrait'


def spectrum_entity(machine: Machine) -> str:
    """Return the entity of a machine's spectrum."""
    return f'{machine.name}/spectrum'


def has_portrait(machine: Machine) -> bool:
    """Whether the plunger's velocity is recorded too."""
    return 'plunger' in machine.velocities and bool(_seconds(machine.joints['plunger']))


def has_spectrum(machine: Machine) -> bool:
    """Whether there are enough samples of the plunger, often enough."""
    position = machine.joints.get('plunger')
    return position is not None and bool(_spectral(position)) and _rate(position) > 20.0


def send_portrait(stream: rr.RecordingStream, machine: Machine, indexes) -> None:
    """Send velocity over position of the plunger: the last second as a line, and where it is."""
    frame = Frame(machine)
    frame.send(stream)
    send_lines(stream, machine, indexes, frame)
    send_place(stream, machine, indexes, frame)


def send_lines(stream: rr.RecordingStream, machine: Machine, indexes, frame: Frame) -> None:
    """Send the path of each second."""
    position, velocity = machine.joints['plunger'], machine.velocities['plunger']
    spans = _seconds(position)
    for at in range(0, len(spans), MINUTE):
        part = spans[at:at + MINUTE]
        strips = [frame.place(*_smooth(position.time[begin:end], position.values[begin:end],
                                       velocity.values[begin:end])) for begin, end in part]
        stream.send_columns(f'{frame.entity}/last_second',
                            indexes(position.time[[begin for begin, _ in part]]),
                            rr.LineStrips2D.columns(strips=strips))
        stream.flush()  # so that no more than this waits in memory


def send_place(stream: rr.RecordingStream, machine: Machine, indexes, frame: Frame) -> None:
    """Send where the plunger is."""
    position, velocity = machine.joints['plunger'], machine.velocities['plunger']
    points = frame.place(position.values * 1e3, velocity.values)
    moved = np.append(True, np.any(np.abs(np.diff(points, axis=0)) > 1e-3, axis=1))
    stream.send_columns(f'{frame.entity}/now', indexes(position.time[moved]),
                        rr.Points2D.columns(positions=points[moved]))


def _seconds(signal: Signal) -> list[tuple[int, int]]:
    """Return begin and end of each second's samples, none of them across a gap."""
    marks = np.arange(signal.time[0], signal.time[-1], SECOND)
    edges = np.unique(np.concatenate([np.searchsorted(signal.time, marks), signal.gaps() + 1,
                                      [len(signal)]]))
    return [(int(begin), int(end)) for begin, end in pairwise(edges)
            if end - begin > 1]


def _smooth(time: np.ndarray, y: np.ndarray, v: np.ndarray):
    """Return the path between samples by the cubic that meets position and velocity (mm, m/s)."""
    h = (np.diff(time) * 1e-9)[:, None]
    s = (np.arange(FINE) / FINE)[None, :]
    y0, y1, v0, v1 = y[:-1, None], y[1:, None], v[:-1, None], v[1:, None]
    # Where a stop lies between two samples there is no such cubic: a straight line then.
    jump = np.abs((y1 - y0) / h - (v0 + v1) / 2.0) > 0.25 * np.maximum(np.abs(v0), np.abs(v1))
    at = (y0 * (1 + 2 * s) * (1 - s) ** 2 + y1 * s * s * (3 - 2 * s)
          + h * v0 * s * (1 - s) ** 2 + h * v1 * s * s * (s - 1))
    speed = (6 * s * (s - 1) * (y0 - y1) / h + v0 * (1 - s) * (1 - 3 * s) + v1 * s * (3 * s - 2))
    at = np.where(jump, y0 + s * (y1 - y0), at)
    speed = np.where(jump, v0 + s * (v1 - v0), speed)
    at = np.clip(at, y.min(), y.max())
    return 1e3 * np.append(at.ravel(), y[-1]), np.append(speed.ravel(), v[-1])


class Frame:
    """Axes of a machine's portrait: position (mm) to the right, velocity (m/s) up."""

    def __init__(self, machine: Machine):
        self.entity = portrait_entity(machine)
        position = machine.joints['plunger'].values * 1e3
        velocity = machine.velocities['plunger'].values
        self._x = _limits(np.nanmin(position), np.nanmax(position))
        self._y = _limits(np.nanmin(velocity), np.nanmax(velocity))

    def holds(self, machine: Machine) -> bool:
        """Whether what `machine` did lies within."""
        return all(low <= np.nanmin(values) and np.nanmax(values) <= high
                   for (low, high, _), values in (
                       (self._x, machine.joints['plunger'].values * 1e3),
                       (self._y, machine.velocities['plunger'].values)))

    def place(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return points of the view; its y axis points down."""
        (x0, x1, _), (y0, y1, _) = self._x, self._y
        return np.stack([WIDTH * (x - x0) / (x1 - x0), -HEIGHT * (y - y0) / (y1 - y0)],
                        axis=-1).astype(np.float32)

    def send(self, stream: rr.RecordingStream) -> None:
        """Draw the grid, with a number on each line; say how path and place are drawn."""
        entity = self.entity
        stream.log(f'{entity}/last_second', rr.LineStrips2D.from_fields(
            colors=palette.PLUNGER.rgba(0.75), radii=rr.components.Radius.ui_points(0.8)),
            static=True)
        stream.log(f'{entity}/now', rr.Points2D.from_fields(
            colors=0xFFFFFFFF, radii=rr.components.Radius.ui_points(5.0), draw_order=50.0),
            static=True)
        (x0, x1, dx), (y0, y1, dy) = self._x, self._y
        xs, ys = np.arange(x0, x1 + dx / 2, dx), np.arange(y0, y1 + dy / 2, dy)
        lines = [self.place(np.array([x, x]), np.array([y0, y1])) for x in xs]
        lines += [self.place(np.array([x0, x1]), np.array([y, y])) for y in ys]
        stream.log(f'{entity}/grid', rr.LineStrips2D(
            lines, colors=GRID, radii=rr.components.Radius.ui_points(0.5)), static=True)
            # The viewer writes a label below its point.
        below, left = np.array([0.0, 0.01]), np.array([-0.09, -0.07])
        places = [self.place(x, np.float64(y0)) + below for x in xs]
        places += [self.place(np.float64(x0), y) + left for y in ys]
        texts = [f'{x:g}' for x in np.round(xs, 6)] + [f'{y:g}' for y in np.round(ys, 6)]
        stream.log(f'{entity}/numbers', rr.Points2D(
            places, labels=texts, radii=0.0, colors=ANNOTATION, show_labels=True), static=True)


def _limits(low: float, high: float) -> tuple[float, float, float]:
    """Return round limits and the step between lines."""
    low, high = min(low, 0.0), max(high, 1e-3)
    step = 10.0 ** np.floor(np.log10(high - low))
    step *= next(f for f in (1.0, 0.5, 0.2, 0.1) if (high - low) / (f * step) >= 3.0)
    return step * np.floor(low / step + 1e-6), step * np.ceil(high / step - 1e-6), step


def _spectral(position: Signal) -> list[tuple[int, int]]:
    """Return the stretches long enough for a spectrum."""
    return [span for span in _seconds(position) if span[1] - span[0] > 15]


def _rate(signal: Signal) -> float:
    """Return the usual sampling rate (Hz)."""
    return float(1e9 / np.median(np.diff(signal.time)))


def send_spectrum(stream: rr.RecordingStream, machine: Machine, indexes) -> None:
    """Send the amplitude spectrum (mm) of each second of the plunger."""
    position = machine.joints['plunger']
    spans = _spectral(position)
    size = max(end - begin for begin, end in spans)
    frequency = np.fft.rfftfreq(size, 1.0 / _rate(position))
    shown = (frequency > 0.5) & (frequency <= HIGHEST)
    entity = spectrum_entity(machine)
    # Frequencies and colour hold from the first row on.
    held = {'abscissa': [frequency[shown].astype(np.float32)], 'color': [palette.PLUNGER.rgba()]}
    for begin, end in spans:
        y, window = np.nan_to_num(position.values[begin:end]), np.hanning(end - begin)
        row = 2e3 * np.abs(np.fft.rfft((y - y.mean()) * window, size))[shown] / window.sum()
        stream.send_columns(entity, indexes(position.time[begin:begin + 1]),
                            rr.BarChart.columns(values=[row.astype(np.float32)], **held))
        held = {}
