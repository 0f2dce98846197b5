"""When ticks are due: absolute deadlines, bounded catch-up, honest stamps. No ROS, no sleeping."""
from __future__ import annotations

import time
from array import array
from dataclasses import dataclass

MILLISECOND = 1_000_000
SECOND = 1_000_000_000
# A tick up to this late is made good at once; beyond it the lag is dropped.
CATCH_UP = 20 * MILLISECOND
# The wall clock may wander from the steady one, or be set. Below the first bound the stamps ignore
# it; up to the second they follow by a thousandth of a tick per tick; beyond it they jump, and the
# jump is reported.
CLOCK_WANDER = MILLISECOND // 2
CLOCK_STEP = 50 * MILLISECOND
CLOCK_CHECK = SECOND
# Two clocks read further apart than this (the thread lost the processor) are not compared.
CLOCK_READING = MILLISECOND // 10


@dataclass(frozen=True)
class Gap:
    """
    A jump in the stamps: `ticks` that never were, `duration` ns (negative: stamps go back).

    `stamp`, ns, is the first one behind the jump.
    """

    ticks: int
    duration: int
    reason: str
    stamp: int = 0


class Pacer:
    """
    Tells which ticks are due, each with its own stamp (ns of wall time, `period` ns apart).

    Deadlines are absolute on the steady clock, so lateness never adds up. `monotonic` and `wall`
    are clocks in ns, injected by tests. One thread uses it.
    """

    def __init__(self, period: int, monotonic=time.monotonic_ns, wall=time.time_ns):
        self.period = period
        self._monotonic, self._wall = monotonic, wall
        self.gaps: list[Gap] = []
        self.lateness = array('q')
        self.ticks = self.late = self.dropped_ticks = self.dropped_time = 0
        self.restart()

    def restart(self) -> None:
        """Make the next tick due one period from now."""
        now = self._monotonic()
        self._due = now + self.period
        self._offset = self._wall() - now
        self._next_check = now + CLOCK_CHECK
        self._slew = 0

    def delay(self) -> float:
        """Seconds until the next tick is due; not positive when it is."""
        return (self._due - self._monotonic()) * 1e-9

    def due(self) -> list[int]:
        """Stamps of the ticks that are due now, oldest first; the lag beyond 20 ms is dropped."""
        now = self._monotonic()
        lag = now - self._due
        if lag < 0:
            return []
        if lag > CATCH_UP:
            self._drop(lag // self.period, 'fell behind')
        if now >= self._next_check:
            self._follow_wall_clock()
        stamps = []
        while self._due <= now:
            lateness = now - self._due
            self.lateness.append(lateness)
            self.late += lateness > MILLISECOND
            if self._slew:
                part = max(-self.period // 1000, min(self.period // 1000, self._slew))
                self._offset += part
                self._slew -= part
            stamps.append(self._due + self._offset)
            self._due += self.period
        self.ticks += len(stamps)
        return stamps

    def take_lateness(self) -> array:
        """Lateness, ns, of the ticks since the last call. Any thread may call."""
        taken, self.lateness = self.lateness, array('q')
        return taken

    def take_gaps(self) -> list[Gap]:
        """Gaps since the last call."""
        taken, self.gaps = self.gaps, []
        return taken

    def _drop(self, ticks, reason):
        self._due += ticks * self.period
        self.dropped_ticks += ticks
        self.dropped_time += ticks * self.period
        self.gaps.append(Gap(ticks, ticks * self.period, reason, self._due + self._offset))

    def _follow_wall_clock(self):
        before, wall, after = self._monotonic(), self._wall(), self._monotonic()
        if after - before > CLOCK_READING:
            return
        self._next_check = after + CLOCK_CHECK
        error = wall - before - self._offset
        if abs(error) > CLOCK_STEP:
            self._offset += error
            self._slew = 0
            self.gaps.append(Gap(0, error, 'wall clock set', self._due + self._offset))
        elif abs(error) > CLOCK_WANDER:
            self._slew = error
