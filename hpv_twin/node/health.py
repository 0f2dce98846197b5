"""The twin's report on itself: /diagnostics, from the pacing thread's own heartbeat."""
from __future__ import annotations

import time

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from .interface import INPUTS
from .units import both, gauge, megabytes, preload_with_force

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
HEARTBEAT_LIMIT = 0.5  # s without a tick: the pacing thread has stalled
# Classes of lateness for the percentiles since the start: 1 us to 100 s, 50 to the decade.
CLASSES = np.geomspace(1e-3, 1e5, 401)  # ms
HIGHEST_PRESSURE = 40e6  # Pa gauge: there is no relief valve in the model, so it says so


class Health:
    """Builds the report. `report()` is called once a second, from the executor's thread."""

    def __init__(self, node_name: str, loop, inputs, recorder, say, steering, following):
        self._name, self._loop, self._inputs = node_name, loop, inputs
        self._recorder, self._say, self._steering = recorder, say, steering
        self._held_before, self._following = True, following
        self._findings_before = {}
        self._refused_before = self._failed_before = 0
        self._recorder_dropped_before = 0
        self._before = (time.monotonic(), loop.pacer.ticks, loop.busy)
        self._classes = np.zeros(len(CLASSES) + 1, dtype=int)
        self.margin = 1.0

    def report(self) -> DiagnosticArray:
        """All seven statuses; whoever publishes them adds the stamp."""
        array = DiagnosticArray()
        array.status = [self._status('model', *self._model()),
                        self._status('timing', *self._timing()),
                        self._status('inputs', *self._input()),
                        self._status('recorder', *self._recording()),
                        self._status('hold', *self._hold()),
                        self._status('tracking', *_as_levels(self._following.report)),
                        self._status('condition', *self._condition())]
        return array

    def _status(self, part, level, message, values):
        return DiagnosticStatus(
            level=level, name=f'{self._name}: {part}', message=message, hardware_id=self._name,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()])

    def _model(self):
        plant = self._loop.plant
        simulation, cycle = plant.simulation, plant.cycle
        level, message = OK, plant.regime
        values = {'regime': plant.regime, 'model time [s]': f'{simulation.time:.3f}',
                  'pump flow in force': both('pump_flow', simulation.pump_flow),
                  'preload in force': preload_with_force(
                      simulation.preload, simulation.vibrator.slotted_spring_stiffness),
                  'load in force': both('load', simulation.load)}
        if cycle is not None:
            values |= {'frequency [Hz]': f'{cycle.frequency:.3f}',
                       'stroke [mm]': f'{cycle.stroke * 1e3:.4f}',
                       'peak pressure': gauge(cycle.peak_pressure)}
            message = (f'{plant.regime}, {cycle.frequency:.1f} Hz, {cycle.stroke * 1e3:.2f} mm, '
                       f'peak {gauge(cycle.peak_pressure)}')
        if simulation.pressure > HIGHEST_PRESSURE or (
                cycle is not None and cycle.peak_pressure > HIGHEST_PRESSURE):
            level = WARN
            message = f'above {gauge(HIGHEST_PRESSURE)}, where a relief valve would open: {message}'
        if self._loop.paused:
            message = f'paused: {message}'
        return level, message, values

    def _timing(self):
        loop, pacer = self._loop, self._loop.pacer
        lateness = np.array(pacer.take_lateness(), dtype=float) * 1e-6
        now = time.monotonic()
        (then, ticks, busy), self._before = self._before, (now, pacer.ticks, loop.busy)
        p50, p99, most = (np.percentile(lateness, (50, 99, 100)) if len(lateness)
                          else (0.0, 0.0, 0.0))
        self._classes += np.bincount(np.searchsorted(CLASSES, lateness),
                                     minlength=len(self._classes))
        self.margin = 1.0 - (loop.busy - busy) * 1e-9 / (now - then)
        achieved = (pacer.ticks - ticks) * pacer.period * 1e-9 / (now - then)
        values = {'ticks': pacer.ticks, 'late by more than 1 ms': pacer.late,
                  'dropped ticks': pacer.dropped_ticks,
                  'dropped time [s]': f'{pacer.dropped_time * 1e-9:.3f}',
                  'lateness p50 [ms]': f'{p50:.3f}', 'lateness p99 [ms]': f'{p99:.3f}',
                  'lateness max [ms]': f'{most:.3f}',
                  'lateness p99 since start [ms]': f'{self._since_start(0.99):.3f}',
                  'real-time factor': f'{achieved:.4f}',
                  'margin [%]': f'{100.0 * self.margin:.1f}'}
        gaps = []
        for gap in pacer.take_gaps():
            gaps.append(in_words(gap))
            if self._recorder is not None:
                self._recorder.note_gap(gap.stamp, gaps[-1])
        for text in gaps[:3]:
            self._say('warning', text)
        silent = loop.silence()
        if loop.failure is not None:
            return ERROR, f'the pacing thread has died: {loop.failure!r}', values
        if silent > HEARTBEAT_LIMIT:
            return ERROR, f'the pacing thread has been silent for {silent:.1f} s', values
        if gaps:
            more = f' and {len(gaps) - 1} more gaps' if len(gaps) > 1 else ''
            return WARN, gaps[-1] + more, values
        return OK, 'in real time', values

    def _since_start(self, share):
        """Upper bound of the class in which this share of all ticks is reached, ms."""
        reached = np.cumsum(self._classes)
        index = int(np.searchsorted(reached, share * reached[-1]))
        return CLASSES[min(index, len(CLASSES) - 1)]

    def _input(self):
        inputs = self._inputs
        values = {'longest from receipt to force [ms]':
                  f'{self._loop.slowest_setpoint * 1e-6:.3f}'}
        for name in INPUTS:
            age = inputs.age(name)
            values[f'{name} accepted'] = inputs.accepted[name]
            values[f'{name} age [s]'] = 'never set' if age is None else f'{age:.1f}'
        for (name, reason), count in sorted(inputs.refused.items()):
            values[f'{name} refused, {reason}'] = count
        for (name, what), count in sorted(inputs.strangers.items()):
            values[f'{name} publishers with incompatible {what}'] = count
        refused = sum(inputs.refused.values())
        recent, self._refused_before = refused - self._refused_before, refused
        values['refused'] = refused
        failed, self._failed_before = inputs.failures - self._failed_before, inputs.failures
        values['failed callbacks'] = inputs.failures
        if inputs.namesakes:
            values['other nodes of this name'] = inputs.namesakes
        if failed:
            return ERROR, f'{failed} callbacks failed in the last second: see the log', values
        if recent:
            return WARN, f'{recent} setpoints refused in the last second', values
        if inputs.namesakes:
            return WARN, f'another node is called {self._name} too', values
        return OK, 'listening', values

    def _hold(self):
        held, text, values = self._steering.report()
        if not held and self._held_before:
            self._say('warning', text)
        self._held_before = held
        return OK if held else WARN, text, values

    def _condition(self):
        findings, report = self._following.findings, self._following.condition_report
        for fault, finding in findings.items():
            if finding.level != self._findings_before.get(fault):
                self._say('warning' if finding.level == 1 else 'error', finding.text)
        for fault in self._findings_before.keys() - findings.keys():
            self._say('info', f'no longer: {fault}')
        self._findings_before = {fault: finding.level for fault, finding in findings.items()}
        return _as_levels(report)

    def _recording(self):
        if self._recorder is None:
            return OK, 'not recording', {}
        status = self._recorder.status
        flushed = status.last_flush
        ago = 'never' if flushed is None else f'{time.monotonic() - flushed:.2f}'
        values = {'file': status.file or '', 'size': megabytes(status.bytes),
                  'messages': status.messages, 'dropped': status.dropped,
                  'free space': megabytes(status.free_space), 'last flush [s ago]': ago}
        recent = status.dropped - self._recorder_dropped_before
        self._recorder_dropped_before = status.dropped
        if status.error:
            return ERROR, status.error, values
        if recent:
            return WARN, f'{recent} messages not recorded in the last second', values
        return OK, 'recording' if status.recording else 'not recording', values


def _as_levels(report):
    level, message, values = report
    return (OK, WARN, ERROR)[level], message, values


def in_words(gap) -> str:
    """What a gap in the stamps is, for the log and for /diagnostics."""
    if gap.ticks:
        return (f'{gap.reason}: {gap.ticks} ticks dropped, the stamps jump by '
                f'{gap.duration * 1e-9:.3f} s, model time does not')
    return f'{gap.reason}: the stamps jump by {gap.duration * 1e-9:+.3f} s, model time does not'
