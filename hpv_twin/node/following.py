"""A running machine followed: measured samples in, estimates, verdicts and the pace out."""
from __future__ import annotations

import math
import threading
import time

from rclpy.callback_groups import CallbackGroup
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from hpv_twin.tracking.condition import Condition
from hpv_twin.tracking.estimator import ESTIMATES
from hpv_twin.tracking.hold import AT_SEAT
from hpv_twin.tracking.phase import phase_error, rate
from hpv_twin.tracking.sensor import SILENCE, PressureWatch
from hpv_twin.tracking.tracker import Tracker

from .interface import MEASURED, SETPOINTS
from .pacing import SECOND

EVERY = 0.02  # s between two looks at what has come in
IDLE_EVERY = 0.1  # s while nothing comes
FAR = SECOND // 2  # ns: a message stamped so far from now would upset the recording's order
FRESH = 0.5  # s for which an estimate holds
TELL_EVERY = 0.25  # s between two reports


class Unspun(CallbackGroup):
    """Of subscriptions that no executor wakes for: 1 kHz of callbacks is half a core."""

    def can_execute(self, entity):
        """Never: the following thread takes the messages itself."""
        return False

    def beginning_execution(self, entity):
        """Never."""
        return False

    def ending_execution(self, entity):
        """Nothing was begun."""


class Following:
    """
    Thread that follows a machine; no other touches what it follows with.

    For /diagnostics it leaves `report` and `condition_report` (level, words, values) and the
    `findings` by fault, each replaced as a whole. The samples' stamps are taken for the machine's
    time, on the clock of this computer.
    """

    def __init__(self, node, loop, steering, ambient, in_step):
        self._loop, self._steering, self._node = loop, steering, node
        self._in_step = in_step  # whether model time may follow the machine
        self._group = Unspun()
        best = QoSProfile(depth=2000, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._subscriptions = {
            name: node.create_subscription(measured.type, name, lambda _message: None, best,
                                           callback_group=self._group, raw=True)
            for name, measured in MEASURED.items()}
        design = loop.plant.simulation.design
        self.watch = PressureWatch(design, ambient)
        self.tracker, self.condition = Tracker(design), Condition()
        self.positions = 0
        self._kept = dict.fromkeys(MEASURED, 0)  # stamp of the last message recorded
        self.phase = math.nan
        self.failure: BaseException | None = None
        self._own = (math.nan, math.nan)  # the twin's last opening, s of wall time, and period
        self._told = {}
        self._tell = False
        self._warned = ''
        self.findings, self.report, self.condition_report = {}, None, None
        self._summarise()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='following', daemon=True)
        loop.after_tick.append(self._own_cycles)

    def start(self) -> None:
        """Begin to listen."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread and wait for it."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(timeout=2.0)

    def _own_cycles(self, cycles, _stopped):
        """Called by the loop's thread: remember when the twin's valve opened."""
        if cycles and cycles[-1].regime in AT_SEAT:
            cycle, simulation = cycles[-1], self._loop.plant.simulation
            since = (simulation.time - cycle.start - cycle.period) / self._loop.trim
            self._own = (self._loop.last_stamp / SECOND - since, cycle.period)

    # The thread ----------------------------------------------------------------------------------

    def _run(self):
        heard = told = -math.inf
        try:
            while not self._stop.wait(EVERY if time.monotonic() - heard < 1.0 else IDLE_EVERY):
                now = time.monotonic()
                times, values = self._take()
                if times:
                    heard = now
                    self._follow(times, values)
                elif self.watch.received and now - heard > SILENCE:
                    self._lose()
                self._say_verdict()
                if now - told > TELL_EVERY:
                    told = now
                    self._summarise()
        except BaseException as error:
            # The twin goes on alone, and says why.
            self.failure = error
            self._let_go()
            self.condition.forget()
            self._summarise()

    def _take(self):
        """Take the messages that have come: pressures, with their stamps in s."""
        times, values = [], []
        for name, subscription in self._subscriptions.items():
            while True:
                with subscription.handle:
                    taken = subscription.handle.take_message(subscription.msg_type, True)
                if taken is None:
                    break
                try:
                    message = deserialize_message(taken[0], subscription.msg_type)
                except Exception:
                    continue  # no message of this type
                stamp = message.header.stamp.sec * SECOND + message.header.stamp.nanosec
                if abs(stamp - time.time_ns()) < FAR and stamp >= self._kept[name]:
                    self._kept[name] = stamp
                    self._node.keep(name, stamp, bytes(taken[0]))
                if name == '~/measured/pressure':
                    times.append(stamp / SECOND)
                    values.append(message.fluid_pressure)
                else:
                    self.positions += 1
        return times, values

    def _follow(self, times, values):
        simulation = self._loop.plant.simulation
        told = {name: getattr(simulation, setpoint.field) for name, setpoint in SETPOINTS.items()}
        if told != self._told:
            self._told = told
            self.tracker.command(times[0], **told)
        times, gauge, gap = self.watch.feed(times, values)
        if not len(times):
            if self.tracker.last is not None:
                self._lose(silent=False)
            return
        if gap:
            self.tracker.interrupt()
        estimates = self.tracker.feed(times, gauge)
        for estimate in estimates:
            trusted = self.tracker.trusted and not self.tracker.misfit
            self.condition.feed(estimate, trusted, bool(self.tracker.candidates))
        if estimates:
            self._tell_estimate(estimates[-1])

    def _tell_estimate(self, estimate):
        self._loop.tell({f'~/estimate/{name}': value for name, value in
                         zip(ESTIMATES, estimate.values, strict=True)}
                        | {'~/residual': estimate.residual})
        if not self.tracker.trusted or self.tracker.misfit:
            self._let_go()
            return
        self.watch.zero(estimate.value('base_pressure'), estimate.uncertainty('base_pressure'))
        if not self._in_step:
            return
        self._steering.measured(1.0 / estimate.period)
        opening, period = self._own
        if abs(estimate.time - opening) < FRESH:
            self.phase = phase_error(opening, estimate.opening, estimate.period)
            self._loop.trim = rate(opening, period, estimate.opening, estimate.period)

    def _lose(self, silent=True):
        """The measurement is of no use: the twin goes on alone."""
        if silent:
            self.watch.silent()
        if self.tracker.last is not None:
            self.tracker.forget()
            self.condition.forget()
            self._let_go()

    def _let_go(self):
        self.phase, self._loop.trim = math.nan, 1.0

    def _say_verdict(self):
        usable = self.watch.verdict in ('fine', 'none')
        text = '' if usable else self.watch.text
        if text and self.watch.verdict != self._warned:
            self._node.say('warning', f'{text}; the twin goes on alone'
                           if self.watch.verdict != 'gauge' else text)
        self._warned = '' if usable else self.watch.verdict

    # For /diagnostics ----------------------------------------------------------------------------

    def _summarise(self):
        self.findings = dict(self.condition.findings)
        self.report, self.condition_report = self._tracking(), self._condition()

    def _tracking(self) -> tuple[int, str, dict]:
        """Level, words and values on how the machine is followed."""
        watch, tracker, estimate = self.watch, self.tracker, self.tracker.last
        values = {'samples of pressure': watch.received, 'samples of position': self.positions}
        if self.failure is not None:
            return 2, f'tracking has died, the twin goes on alone: {self.failure!r}', values
        if watch.verdict not in ('fine', 'none', 'gauge'):
            return 1, watch.text, values
        if not watch.received:
            return 0, watch.text, values
        if estimate is None or not tracker.trusted:
            return 0, 'getting to know the machine', values
        for name, (unit, text) in ESTIMATES.items():
            values[f'{name} [{unit}]'] = (f'{estimate.value(name):.5g} ± '
                                          f'{estimate.uncertainty(name):.2g} ({text})')
        values |= {'residual [Pa]': f'{estimate.residual:.4g}',
                   'noise [Pa]': f'{estimate.noise:.4g}',
                   'measured frequency [Hz]': f'{1.0 / estimate.period:.3f}',
                   'phase error [%]': f'{100.0 * self.phase:.2f}',
                   'rate of model time': f'{self._loop.trim:.5f}'}
        if tracker.misfit:
            return 1, (f'the machine does not move like the model: residual '
                       f'{estimate.residual * 1e-6:.2f} MPa'), values
        if tracker.candidates:
            likely = sorted(tracker.candidates.items(), key=lambda item: -item[1])[:3]
            return 0, 'a change: ' + ', '.join(
                f'{name} {100 * share:.0f} %' for name, share in likely), values
        if watch.verdict == 'gauge':
            return 1, watch.text, values
        phase = '' if math.isnan(self.phase) else f', phase {100.0 * self.phase:+.1f} %'
        return 0, (f'following: {1.0 / estimate.period:.2f} Hz, residual '
                   f'{estimate.residual * 1e-6:.3f} MPa{phase}'), values

    def _condition(self) -> tuple[int, str, dict]:
        """Level, words and values on the condition of the machine."""
        findings = list(self.condition.findings.values())
        values = {f'trend: {fault}': text for fault, text in self.condition.trends().items()}
        values |= {finding.fault: finding.text for finding in findings}
        if findings:
            worst = max(finding.level for finding in findings)
            return worst, '; '.join(finding.text for finding in findings), values
        known = self.tracker.trusted and self.failure is None
        return 0, 'no fault found' if known else 'no machine is followed', values
