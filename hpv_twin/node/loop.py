"""The pacing thread: ticks the plant on time, publishes, feeds the recorder."""
from __future__ import annotations

import math
import threading
import time
from collections import deque

from .messages import position_template, pressure_template
from .pacing import SECOND, Pacer
from .plant import Plant

# Setpoints must act within 2 ms, however slowly the twin publishes.
LONGEST_TICK = SECOND // 1000
LONGEST_SLEEP = 0.05  # s, so that a stop is noticed
LATCH_EVERY = 10_000_000  # ns between publications of one setpoint under a flood


class Loop:
    """
    Runs the plant in a thread of its own; everything from outside reaches it through queues.

    `outlet(name, stamp, payload)` publishes and records, `fine(stamp, samples, pace)` takes what
    a plant with a sample rate has sampled, `pace` in model seconds per second; they are called
    from this thread alone.
    """

    def __init__(self, plant: Plant, publish_rate: float, speed: float, outlet, float_payload,
                 fine=None):
        publish_period = SECOND / publish_rate
        self._ticks_per_publication = max(1, math.ceil(publish_period / LONGEST_TICK))
        period = round(publish_period / self._ticks_per_publication)
        self._speed, self._step = speed, speed * period / SECOND
        self.plant = plant
        self.pacer = Pacer(period)
        self._outlet, self._float_payload = outlet, float_payload
        self._fine = fine
        self._pressure, self._position = pressure_template(), position_template()
        self._calls: deque = deque()
        self._setpoints: deque = deque()
        self._to_latch: dict[str, int] = {}
        self._latched: dict[str, int] = {}
        self._until_publication = self._ticks_per_publication
        self._stop = threading.Event()
        self.paused = False
        # Called after each tick with the cycles it completed and whether oscillation has stopped.
        self.after_tick = []
        self.trim = 1.0  # model time runs by this factor faster, to keep step with a machine
        self.published = 0
        self.busy = 0  # ns spent in ticks since the start
        self.slowest_setpoint = 0  # ns from receipt to being in force
        self.heartbeat = time.monotonic()
        self.last_stamp = time.time_ns()
        self.failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name='pacing', daemon=True)

    @property
    def exact_templates(self) -> bool:
        """Whether both templates passed the comparison with the serializer."""
        return self._pressure.exact and self._position.exact

    def start(self) -> None:
        """Begin to tick; model time starts now."""
        self.pacer.restart()
        self._thread.start()

    def stop(self) -> None:
        """End the thread and wait for it."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(timeout=2.0)

    def silence(self) -> float:
        """Seconds since the last sign of life; infinite once the thread has ended."""
        return time.monotonic() - self.heartbeat if self._thread.is_alive() else math.inf

    def set(self, field: str, value: float) -> None:
        """Ask for a setpoint to be put in force at the next tick. Any thread may call."""
        self._setpoints.append((field, value, time.monotonic_ns()))

    def post(self, function) -> None:
        """Have `function(stamp)` run between two ticks. Any thread may call."""
        self._calls.append(function)

    def tell(self, values: dict[str, float]) -> None:
        """Have numbers published by topic, with the stamp of the next tick. Any thread may call."""
        payloads = {name: self._float_payload(value) for name, value in values.items()}
        self.post(lambda stamp: [self._outlet(name, stamp, payload)
                                 for name, payload in payloads.items()])

    def call(self, function, timeout: float = 1.0) -> bool:
        """Run `function()` between two ticks; False if the thread did not get to it in time."""
        done = threading.Event()

        def run(_stamp):
            function()
            done.set()
        self.post(run)
        return done.wait(timeout)

    def pause(self, paused: bool) -> None:
        """Let model time stand still, or go on."""
        self.paused = paused

    def _run(self):
        try:
            while not self._stop.is_set():
                delay = self.pacer.delay()
                if delay > 0.0:
                    time.sleep(min(delay, LONGEST_SLEEP))
                    continue
                began = time.monotonic_ns()
                for stamp in self.pacer.due():
                    self._tick(stamp)
                ended = time.monotonic_ns()
                self.busy += ended - began
                self.heartbeat = ended * 1e-9
        except BaseException as error:
            # A thread's exception would vanish; health reports this one and the node ends.
            self.failure = error

    def _tick(self, stamp):
        self.last_stamp = stamp
        while self._calls:
            self._calls.popleft()(stamp)
        if not self.paused:
            trim = self.trim
            cycles = self.plant.tick(self._step * trim)
            self._publish(stamp, cycles)
            if self._fine is not None:
                self._fine(stamp, self.plant.samples, self._speed * trim)
        if self._setpoints or self._to_latch:
            self._apply_setpoints(stamp)

    def _publish(self, stamp, cycles):
        self._until_publication -= 1
        if self._until_publication == 0:
            self._until_publication = self._ticks_per_publication
            self._outlet('~/pressure', stamp,
                         self._pressure.message(stamp, *self.plant.pressure_values()))
            self._outlet('~/plunger_position', stamp,
                         self._position.message(stamp, *self.plant.position_values()))
            self.published += 1
        for cycle in cycles:
            self._outlet('~/frequency', stamp, self._float_payload(cycle.frequency))
            self._outlet('~/stroke', stamp, self._float_payload(cycle.stroke))
        stopped = not cycles and self.plant.stopped()
        if stopped:
            self._outlet('~/frequency', stamp, self._float_payload(0.0))
            self._outlet('~/stroke', stamp, self._float_payload(0.0))
        for look in self.after_tick:
            look(cycles, stopped)

    def _apply_setpoints(self, stamp):
        """Put what has come in force for the ticks to come, and say what is in force."""
        while self._setpoints:
            field, value, received = self._setpoints.popleft()
            self.plant.set(field, value)
            self.slowest_setpoint = max(self.slowest_setpoint,
                                        time.monotonic_ns() - received)
            self._to_latch[field] = stamp
        for field in list(self._to_latch):
            if stamp - self._latched.get(field, -LATCH_EVERY) >= LATCH_EVERY:
                del self._to_latch[field]
                self.latch(field, stamp)

    def latch(self, field: str, stamp: int) -> None:
        """Publish a setpoint in force. From this thread, or before it starts."""
        self._latched[field] = stamp
        value = getattr(self.plant.simulation, field)
        self._outlet(f'~/{field}', stamp, self._float_payload(value))
