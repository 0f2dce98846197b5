"""A recording while it grows: what is new in the file goes on to the viewer, ten times a second.

Whoever records does not notice: the file is only read, and a viewer that is slow makes this process
wait, nobody else.
"""
from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import rerun as rr

from hpv_twin.model.vibrator import Vibrator
from hpv_twin.recording.follow import Follower
from hpv_twin.recording.reader import Message, RecordingError, describe
from hpv_twin.viewer import card, diagnostics, events, layout, plots, reading, scene
from hpv_twin.viewer.phases import find_phases
from hpv_twin.viewer.portrait import (
    Frame,
    has_portrait,
    has_spectrum,
    send_lines,
    send_place,
    send_spectrum,
)
from hpv_twin.viewer.scene import Panel
from hpv_twin.viewer.signals import Machine, Replay, Signal

SECOND = 1_000_000_000  # ns
HISTORY = 10.0  # s of the recording that are shown at first
SETTLED = 5_000_000  # ns; what is younger may still become another phase
THINNED = 50  # samples of which the long plot keeps the two extremes
PATIENCE = 2.0  # s for which a slow viewer is waited for


class Live:
    """Follows the recording at `path` into `stream`; raises RecordingError while it is empty."""

    def __init__(self, stream: rr.RecordingStream, path: Path, vibrator: Vibrator | None,
                 ambient: float | None):
        self._stream = stream
        self._follower = Follower(path, from_end=True)
        try:
            self._replay = _recent(path, ambient)
        except RecordingError:
            self._follower.close()
            raise
        design, problem = card.design_of(self._replay, vibrator)
        self._panels = scene.build_panels(self._replay, design)
        self._machines = [_Following(stream, self._replay, panel, design)
                          for panel in self._panels]
        self._last = dict.fromkeys(describe(path).topics, self._replay.last)
        self._levels: dict[str, int] = {}
        events.health(self._replay, self._levels)
        self._card_due = 0
        cards = {}
        if design or problem:
            cards[scene.DESIGN] = card.write_design(design, problem)
        stream.send_blueprint(layout.build_blueprint(self._panels, scene.DESIGN in cards,
                                                     plots.LIVE))
        scene.write_scene(stream, self._replay, self._panels, cards, lambda *_: None)
        self._write_card()

    @property
    def last(self) -> int:
        """The stamp (ns) of the newest sample that was sent."""
        return max(self._last.values())

    @property
    def names(self) -> str:
        """The names of what is shown."""
        return ', '.join(panel.name for panel in self._panels)

    @property
    def finished(self) -> bool:
        """Whether the recording has ended."""
        return self._follower.finished

    def update(self) -> bool:
        """Send what has been recorded since the last call; False if there was nothing."""
        signals, messages = self._follower.read()
        fresh = {}
        for topic, signal in signals.items():
            newer = _newer(signal, self._last.get(topic, self._replay.last))
            if len(newer.time):
                fresh[topic], self._last[topic] = newer, int(newer.time[-1])
        machines = [Machine(following.name) for following in self._machines]
        if not any(machine.name == '' for machine in machines):
            machines.append(Machine(''))  # of no interest
        reading.place(machines, fresh)
        lines = self._health(messages)
        for following in self._machines:
            machine = next(m for m in machines if m.name == following.name)
            lines += following.send(machine)
        if lines:
            scene.send_events(self._stream, self._replay, sorted(lines, key=lambda e: e.time))
        if self.last >= self._card_due:
            self._write_card()
        self._stream.flush(timeout_sec=PATIENCE)
        return bool(fresh)

    def _write_card(self) -> None:
        """Write the card anew, once a second."""
        self._card_due = self.last + SECOND
        rows = [row for following in self._machines for row in following.figures()]
        text = card.write_live_card(self._replay, self._replay.seconds(self.last), rows)
        self._stream.log(scene.CARD, rr.TextDocument(text, media_type='text/markdown'),
                         static=True)

    def _health(self, messages: list[Message]) -> list[events.Event]:
        """Return what the diagnostics among `messages` say that is new."""
        statuses = [status for message in messages if message.type_name == diagnostics.TYPE
                    for status in diagnostics.statuses(message.log_time, message.payload)]
        now = dataclasses.replace(self._replay, statuses=statuses, last=self.last)
        return events.health(now, self._levels)

    def close(self) -> None:
        """Let go of the file."""
        self._follower.close()


class _Following:
    """One machine: what of it was shown, and what has to be known to go on."""

    def __init__(self, stream: rr.RecordingStream, replay: Replay, panel: Panel,
                 design: Vibrator | None):
        self._stream, self._replay, self._panel = stream, replay, panel
        self.name = panel.machine.name
        self._stroke = (design or Vibrator()).stroke
        self._tail = panel.machine  # the last seconds of everything
        self._judged = replay.last  # phases are known up to here
        self._second = replay.last  # portrait and spectrum are drawn up to here
        self._held = {name: float(signal.values[-1])
                      for name, signal in panel.machine.numbers.items()}
        self._frame = Frame(panel.machine) if has_portrait(panel.machine) else None

    def send(self, fresh: Machine) -> list[events.Event]:
        """Send the new samples; return what happened."""
        signals = [*fresh.waveforms, *fresh.numbers.values()]
        if not signals:
            return []
        last = max(int(signal.time[-1]) for signal in signals)
        if fresh.waveforms:
            last = max(int(signal.time[-1]) for signal in fresh.waveforms)
            self._send_waveforms(fresh)
            self._tail = _joined(self._tail, fresh, last - 3 * SECOND)
            self._send_phases(last)
            self._send_second(last)
        return self._send_numbers(fresh, last)

    def figures(self) -> list[tuple[str, str]]:
        """Return the cycle figures, setpoints and estimates of this moment in words."""
        return [(curve.quantity.label, curve.quantity.text(self._held[self._label(curve)]))
                for curve in self._panel.numbers + self._panel.estimates]

    def _label(self, curve: scene.Curve) -> str:
        return self._panel.machine.below(curve.entity)

    def _indexes(self, time: np.ndarray) -> list[rr.TimeColumn]:
        return scene.indexes(self._replay, time)

    def _send_waveforms(self, fresh: Machine) -> None:
        """Send pressures and positions, and move the machine."""
        bridged = Machine(
            self.name, pressures=_bridged(self._tail.pressures, fresh.pressures),
            joints=_bridged(self._tail.joints, fresh.joints))
        curves = scene.pressure_curves(self._replay, bridged)
        joints = scene.joint_curves(bridged)
        long = scene.overview(curves or joints, max(len(fresh.waveforms[0]) // THINNED, 1))
        for curve in curves + joints + long:
            scene.send_rows(self._stream, self._replay, curve)
        if self._panel.cutaway and {'plunger', 'valve_sleeve'} <= fresh.joints.keys():
            self._panel.cutaway.send_motion(self._stream, self._indexes, fresh)
        if self._frame and 'plunger' in fresh.velocities:
            if not self._frame.holds(fresh):
                self._frame = Frame(_joined(self._tail, fresh, 0))
                self._frame.send(self._stream)
            send_place(self._stream, fresh, self._indexes, self._frame)

    def _send_numbers(self, fresh: Machine, last: int) -> list[events.Event]:
        """Send setpoints, cycle figures and estimates, each up to `last`; report new setpoints."""
        lines = []
        for curve in self._panel.numbers + self._panel.estimates:
            name = self._label(curve)
            new = fresh.numbers.get(name, Signal(np.empty(0, np.int64), np.empty(0)))
            if name in events.SETPOINTS:
                lines += [events.setpoint('', curve.quantity, time, value, self._held[name])
                          for time, value in zip(new.time, new.values, strict=True)
                          if value != self._held[name]]
            if len(new):
                self._held[name] = float(new.values[-1])
            # The value holds until now.
            now = max(last, int(new.time[-1])) if len(new) else last
            time, values = np.append(new.time, now), np.append(new.values, self._held[name])
            scene.send_rows(self._stream, self._replay,
                            dataclasses.replace(curve, signal=Signal(time, values)))
        return lines

    def _send_phases(self, last: int) -> None:
        """Send the phases, and the marks on the pressure, that are settled by now."""
        if 'plunger' not in self._tail.joints:
            return
        phases = find_phases(self._tail, self._stroke)
        if phases is None:
            return
        new = ((phases.time > self._judged) & (phases.time <= last - SETTLED)
               & (np.arange(len(phases.time)) > 0))
        if new.any():
            scene.send_phase_rows(self._stream, self._replay, self._panel.machine,
                                  phases.time[new], phases.kind[new])
        for mark in scene.pressure_marks(self._replay, self._tail, phases):
            there = (mark.signal.time > self._judged) & (mark.signal.time <= last - SETTLED)
            if there.any():
                scene.send_rows(self._stream, self._replay, dataclasses.replace(
                    mark, signal=Signal(mark.signal.time[there], mark.signal.values[there])))
        self._judged = max(self._judged, last - SETTLED)

    def _send_second(self, last: int) -> None:
        """Draw portrait and spectrum of the last second, once a second."""
        if last - self._second < SECOND:
            return
        self._second = last
        second = _joined(Machine(self.name), self._tail, last - SECOND + 1)
        if self._frame and has_portrait(second):
            send_lines(self._stream, second, self._indexes, self._frame)
        if has_spectrum(second):
            send_spectrum(self._stream, second, self._indexes)


def _recent(path: Path, ambient: float | None) -> Replay:
    """Return the last seconds of a recording. Raises RecordingError if there are none."""
    replay = reading.load(path, ambient=ambient) if _is_short(path) else None
    if replay is None:
        about = describe(path)
        length = ((about.end or 0) - (about.start or 0)) * 1e-9
        replay = reading.load(path, since=max(length - HISTORY, 0.0), ambient=ambient)
    return dataclasses.replace(replay, missing='')  # that it is not finished is no damage


def _is_short(path: Path) -> bool:
    """Whether a recording is read in no time."""
    return path.is_file() and path.stat().st_size < 2_000_000


def _newer(signal, after: int):
    """Return what a recorded signal holds behind `after` (ns)."""
    keep = signal.time > after
    return type(signal)(*(field[keep] if isinstance(field, np.ndarray) else field
                          for field in signal))


def _bridged(before: dict[str, Signal], fresh: dict[str, Signal]) -> dict[str, Signal]:
    """Return new samples; a NaN comes first where some are missing in between."""
    bridged = {}
    for name, signal in fresh.items():
        old = before.get(name)
        if old is not None and len(old) > 2:
            usual = int(np.median(np.diff(old.time[-100:])))
            if signal.time[0] - old.time[-1] > 1.5 * usual:
                signal = Signal(np.insert(signal.time, 0, old.time[-1] + usual),
                                np.insert(signal.values, 0, np.nan))
        bridged[name] = signal
    return bridged


def _joined(before: Machine, fresh: Machine, since: int) -> Machine:
    """Return a machine's waveforms, old and new, from `since` (ns)."""
    joined = Machine(fresh.name)
    for kind in ('pressures', 'joints', 'velocities'):
        old, new = getattr(before, kind), getattr(fresh, kind)
        for name in old.keys() | new.keys():
            parts = [signals[name] for signals in (old, new) if name in signals]
            time = np.concatenate([part.time for part in parts])
            values = np.concatenate([part.values for part in parts])
            keep = time >= since
            getattr(joined, kind)[name] = Signal(time[keep], values[keep])
    return joined
