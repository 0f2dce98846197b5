"""The thread that writes one recording, gently to the loop that feeds it, and outlives the disk.

It wakes every few milliseconds and takes a few messages at a time, so that it never keeps the
interpreter from the loop for long. When the disk fails or fills it waits, and goes on in a new
file.
"""

import errno
import shutil
import threading
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from .files import make_directory, readable_size
from .series import Series, Settings

BATCH = 20  # messages taken at a time: about 0.1 ms of the interpreter; a flush takes more
PAUSE = 1e-4  # s, between two batches: lets the loop in
WAKE = 5e-3  # s, between two looks at an empty queue
ROWS_AT_ONCE = 500  # messages in rows are gathered before they are laid out, until a flush at most
SPACE_INTERVAL = 1.0  # s, between two looks at the free space
AGE_INTERVAL = 60.0  # s, between two looks for recordings that are too old
RESUMING = 1.1  # times the reserve must be free before recording goes on
FIRST_RETRY, LAST_RETRY = 1.0, 60.0  # s, until the disk is tried again; doubled each time
STEADY = 10.0  # s without an error, after which the next one is a first one again


class Source(Protocol):
    """Makes rows of what was handed over at a tick, in the recorder's thread."""

    channels: tuple[int, ...]

    def rows(self, items: list) -> list[tuple[int, np.ndarray, np.ndarray]]:
        """Channel, stamps (ns) and values (n × fields) of the messages in `items`, in order."""


class Handful(NamedTuple):
    """What `source` makes `count` messages of each of its channels of."""

    source: Source
    item: object
    count: int


class Session(threading.Thread):
    """One recording, from `start` to `finish`.

    `queue` takes (channel index, stamp in ns, payload), or a Handful, while the thread is alive;
    `overflow` channel and number of the messages that found it full. Appending to either needs no
    lock. `recording` tells whether a file is open, `error` why none is.
    """

    def __init__(self, settings: Settings, opening: Sequence[tuple[int, int, bytes]] = ()):
        super().__init__(name='recorder', daemon=True)
        self.recording = self.stopping = False
        self.queue: deque[tuple[int, int, bytes] | Handful] = deque()
        self.overflow: deque[tuple[int, int]] = deque()
        self.free_space = 0
        self.last_flush: float | None = None
        self.error = ''
        self.series = Series(settings)
        self._settings = settings
        self._opening = opening
        self._finished = False
        self._retry = FIRST_RETRY
        self.next_try = 0.0  # s of time.monotonic
        self._opened = self._space_checked = self._age_checked = time.monotonic()
        self._handfuls: list[Handful] = []
        self._gathered = 0
        self._try_to_open()

    @property
    def dropped(self) -> int:
        """Messages that were lost."""
        return self.series.dropped.total() + sum(count for _, count in list(self.overflow))

    def finish(self, timeout: float) -> Path | None:
        """Have what is queued written and the file finished; the recording, None if it failed."""
        self.stopping = True
        self.join(timeout)
        if self.is_alive():
            self.error = f'the disk has not answered for {timeout:g} s'
            self._settings.log('error', f'{self.series.where} is not finished: {self.error}')
        return self.series.where if self._finished else None

    def run(self) -> None:
        """Write until told to stop; wait while the disk fails or is short of space."""
        if self.recording:
            self._settings.log('info', f'recording into {self.series.segment.path}')
        while self.recording or self._wait_for_the_disk():
            try:
                if self._write_until_stopped():
                    self._finished = not self.series.problem
                    return
            except Exception as error:  # whatever it is: the twin goes on
                self._fail(error)

    def _write_until_stopped(self) -> bool:
        """Write; True when told to stop, False when the disk is short of space. The file ends."""
        more, stopping = True, False
        while more or not stopping:
            stopping = self.stopping  # before the queue is seen empty, so that it stays so
            more = self._write_batch()
            self._look_at_ages()
            if self._space_is_short():
                self._settings.log('error', f'recording waits: {self.error}')
                self._close(self.error)
                return False
            time.sleep(PAUSE if more else WAKE)
        self._close('stopped')
        self.error = self.series.problem
        return True

    def _close(self, because: str) -> None:
        self._lay_out()
        self.recording = False
        self.series.finish(because)

    def _write_batch(self) -> bool:
        """Record a few messages, flush if it is time; whether there may be more."""
        more = True
        for _ in range(BATCH):
            try:
                message = self.queue.popleft()
            except IndexError:
                more = False
                break
            if isinstance(message, Handful):
                self._gather(message)
            else:
                self.series.record(*message)
        self._count_overflow()
        if time.monotonic() - self.last_flush >= self._settings.flush_interval:
            self._lay_out()
            self.series.flush()
            self.last_flush = time.monotonic()
            self._retry = FIRST_RETRY if self.last_flush - self._opened > STEADY else self._retry
        self.series.look_at_size()
        return more

    def _gather(self, handful: Handful) -> None:
        """Keep rows until they are many: laying them out costs per call, not per message."""
        if self._handfuls and handful.source is not self._handfuls[0].source:
            self._lay_out()
        self._handfuls.append(handful)
        self._gathered += handful.count
        if self._gathered >= ROWS_AT_ONCE:
            self._lay_out()

    def _lay_out(self) -> None:
        """Record the rows gathered."""
        handfuls, self._handfuls, self._gathered = self._handfuls, [], 0
        if handfuls:
            self._record_rows(handfuls[0].source.rows([handful.item for handful in handfuls]))

    def _record_rows(self, parts: list[tuple[int, np.ndarray, np.ndarray]]) -> None:
        for place, part in enumerate(parts):
            try:
                self.series.record_rows(*part)
            except BaseException:
                for channel, stamps, _ in parts[place + 1:]:
                    self.series.pass_over(channel, len(stamps))
                raise

    def _count_overflow(self) -> None:
        while self.overflow:
            channel, count = self.overflow[0]
            self.series.dropped[channel] += count
            self.overflow.popleft()

    def _try_to_open(self) -> bool:
        """Open a file if the disk lets us; `error` says why not."""
        before, opening = self.error, self._opening
        try:
            make_directory(self._settings.directory, self._settings.fsync)
            if self._space_is_short(1.0 if self.series.segment is None else RESUMING):
                raise OSError(errno.ENOSPC, self.error, str(self._settings.directory))
            self.series.open(opening, before)
        except OSError as error:
            where = error.filename or self._settings.directory
            self.error = f'{error.strerror or error} ({where})'
            return False
        self.error, self._opening = '', ()
        self._opened = self.last_flush = time.monotonic()
        self.recording = True
        return True

    def _wait_for_the_disk(self) -> bool:
        """Try it again and again, ever more rarely; False when told to stop meanwhile."""
        began, lost = time.monotonic(), self.series.dropped.total()
        for message in self._opening:
            self.series.latch(*message)
        self._opening = ()
        while True:
            self.next_try = time.monotonic() + self._retry
            while time.monotonic() < self.next_try:
                self._pass_over()
                if self.stopping:
                    return False
                time.sleep(WAKE)
            self._retry = min(2 * self._retry, LAST_RETRY)
            if self._try_to_open():
                lost = self.series.dropped.total() - lost
                self._settings.log('warning', f'recording goes on in {self.series.segment.path} '
                                   f'after {time.monotonic() - began:.1f} s, in which {lost} '
                                   'messages were lost')
                return True

    def _pass_over(self) -> None:
        """Count what cannot be written; the setpoints in force are kept for the next file."""
        while self.queue:
            message = self.queue.popleft()
            if isinstance(message, Handful):
                for channel in message.source.channels:
                    self.series.pass_over(channel, message.count)
            else:
                self.series.pass_over(message[0])
                self.series.latch(*message)
        self._count_overflow()

    def _look_at_ages(self) -> None:
        """Now and then remove recordings that are too old."""
        if self._settings.max_age and time.monotonic() - self._age_checked >= AGE_INTERVAL:
            self._age_checked = time.monotonic()
            self.series.make_room()

    def _space_is_short(self, at_once: float = 0.0) -> bool:
        """Look at the free space now and then; say in `error` if it is below the reserve.

        With `at_once`: now, and whether it is below so many times the reserve.
        """
        reserve = self._settings.reserve * (at_once or 1.0)
        if not at_once and time.monotonic() - self._space_checked < SPACE_INTERVAL:
            return False
        self._space_checked = time.monotonic()
        self.free_space = shutil.disk_usage(self._settings.directory).free
        if self.free_space >= reserve:
            return False
        self.error = (f'only {readable_size(self.free_space)} of the disk are free, '
                      f'{readable_size(reserve)} are left to others')
        return True

    def _fail(self, error: Exception) -> None:
        """Abandon the file; what was written of it stays."""
        self.recording = False
        was_open, path = self.series.segment.open, self.series.segment.path
        self._handfuls, handfuls = [], self._handfuls
        self.series.abandon()
        for handful in handfuls:
            for channel in handful.source.channels:
                self.series.pass_over(channel, handful.count)
        self.error = str(error) if isinstance(error, OSError) else repr(error)
        hint = f'; what it holds until then: hpv-twin recover {path}' if was_open else ''
        self._settings.log('error', f'recording waits: {self.error}{hint}')
