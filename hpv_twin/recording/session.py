"""The thread that writes one recording, file after file, gently to the loop that feeds it.

It wakes every few milliseconds and takes a few messages at a time, so that it never keeps the
interpreter from the loop for long.
"""

import errno
import shutil
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from operator import index
from pathlib import Path

from . import files
from .files import readable_size
from .schemas import Channel
from .segment import CHUNK_SIZE, Segment

BATCH = 20  # messages taken at a time: about 0.1 ms of the interpreter; a flush takes more
PAUSE = 1e-4  # s, between two batches: lets the loop in
WAKE = 5e-3  # s, between two looks at an empty queue
SPACE_INTERVAL = 1.0  # s, between two looks at the free space
INTERLEAVING = 1_000_000_000  # ns that one topic may lag behind another in the queue
RESERVE = 100e6  # bytes of the disk left to others
END_OF_TIME = 2**63 - 1


@dataclass(frozen=True)
class Settings:
    """What a recorder was asked for: sizes in bytes, times in seconds."""

    directory: Path
    channels: tuple[Channel, ...]
    name: str
    max_total_size: float
    split_size: float
    fsync: bool
    flush_interval: float
    metadata: dict[str, str]
    attachments: dict[str, bytes]
    reserve: float
    log: Callable[[str, str], None]


class Session(threading.Thread):
    """One recording, from `start` to `finish`. Raises OSError if it cannot begin.

    `queue` takes (channel index, stamp in ns, payload) while `accepting`; `overflow` the channel
    of each message that found it full. Appending to either needs no lock.
    """

    def __init__(self, settings: Settings, opening: Sequence[tuple[int, int, bytes]] = ()):
        super().__init__(name='recorder', daemon=True)
        self.accepting = False
        self.queue: deque[tuple[int, int, bytes]] = deque()
        self.overflow: deque[int] = deque()
        self.free_space = 0
        self.last_flush: float | None = None
        self.error = ''
        self._settings = settings
        self._stopping = False
        self._drops: Counter[int] = Counter()  # by channel, since the start
        self._drops_noted: Counter[int] = Counter()  # those that earlier files tell of
        self._sequences: Counter[int] = Counter()
        self._latched: dict[int, tuple[bytes, int]] = {}  # payload and sequence
        self._rejected = 0
        self._parts = 0
        self._next_file_because = ''
        settings.directory.mkdir(parents=True, exist_ok=True)
        self._space_checked = time.monotonic()
        if self._space_is_short():
            raise OSError(errno.ENOSPC, self.error, str(settings.directory))
        self._open('')
        try:
            for message in opening:
                self._record(*message)
            self._flush()
        except BaseException:
            self.segment.abandon()
            self.segment.path.unlink(missing_ok=True)
            raise
        self.accepting = True

    @property
    def dropped(self) -> int:
        """Messages that found the queue full."""
        return self._drops.total() + len(self.overflow)

    def finish(self, timeout: float) -> Path | None:
        """Have what is queued written and the file finished; its path, None if that failed."""
        self.accepting = False
        self._stopping = True
        self.join(timeout)
        if self.is_alive():
            self.error = f'the disk has not answered for {timeout:g} s'
            self._settings.log('error', f'{self.segment.path} is not finished: {self.error}')
        return None if self.error else self.segment.path

    def run(self) -> None:
        """Write until told to stop, until the disk is short of space, or until it fails."""
        self._settings.log('info', f'recording into {self.segment.path}')
        try:
            more, stopping = True, False
            while more or not stopping:
                stopping = self._stopping  # before the queue is seen empty, so that it stays so
                more = self._write_batch()
                if self._space_is_short():
                    self._settings.log('error', f'recording stops: {self.error}')
                    break
                time.sleep(PAUSE if more else WAKE)
            self.accepting = False
            self._finish_file(self.error or 'stopped')
        except Exception as error:  # whatever it is: the twin goes on
            self._fail(error)

    def _write_batch(self) -> bool:
        """Record a few messages, flush if it is time; whether there may be more."""
        more = True
        for _ in range(BATCH):
            try:
                message = self.queue.popleft()
            except IndexError:
                more = False
                break
            self._record(*message)
        while self.overflow:
            self._drops[self.overflow.popleft()] += 1
        if time.monotonic() - self.last_flush >= self._settings.flush_interval:
            self._flush()
        if self.segment.size >= self._settings.split_size:
            self._next_file_because = 'the file was full'
        return more

    def _record(self, channel: int, stamp: int, payload: bytes) -> None:
        """Write a message, into a further file if it is time for one."""
        if not self._acceptable(channel, stamp, payload):
            return
        if (stamp < self._stamps.get(channel, 0)) or stamp < self._newest - INTERLEAVING:
            self._next_file_because = 'the clock went back'
        if self._next_file_because:
            self._next_file(channel, stamp)
        sequence = self._sequences[channel] = self._sequences[channel] + 1
        self.segment.append(channel, stamp, payload, sequence)
        self._stamps[channel] = stamp
        self._newest = max(self._newest, stamp)
        if self._settings.channels[channel].latched:
            self._latched[channel] = payload, sequence

    def _acceptable(self, channel: int, stamp: int, payload: bytes) -> bool:
        """Whether a message can be written without spoiling the chunk it would lie in."""
        try:
            if (0 <= index(channel) < len(self._settings.channels)
                    and 0 <= index(stamp) <= END_OF_TIME and type(payload) is bytes):
                return True
        except TypeError:
            pass
        self._rejected += 1
        if self._rejected == 1:
            self._settings.log('warning', f'not recorded: channel {channel!r}, stamp {stamp!r}, '
                               f'a payload of type {type(payload).__name__}')
        return False

    def _open(self, previous: str) -> None:
        """Make room, then open a file."""
        wanted = self._settings
        self._make_room()
        self._parts += 1
        self._stamps: dict[int, int] = {}  # last of each channel in this file, ns
        self._newest = 0
        now = datetime.now(UTC)
        told = {'recording.opened': now.isoformat(timespec='milliseconds'),
                'recording.part': str(self._parts), 'recording.continues': previous}
        self.segment = Segment(files.create(wanted.directory, wanted.name, now), wanted.channels,
                               wanted.metadata | told, wanted.attachments, wanted.fsync)

    def _make_room(self) -> None:
        """Remove old files, so that a further one of full size keeps within the total."""
        wanted = self._settings
        limit = wanted.max_total_size - 1.05 * wanted.split_size - CHUNK_SIZE
        for outcome in files.make_room(wanted.directory, wanted.name, limit):
            if isinstance(outcome, OSError):
                wanted.log('warning', f'an old recording cannot be removed: {outcome}')
            else:
                wanted.log('info', f'removed {outcome}, to keep recordings within '
                           f'{readable_size(wanted.max_total_size)}')

    def _next_file(self, channel: int, stamp: int) -> None:
        """Finish the file and open a further one, which repeats the latched messages."""
        self._finish_file(self._next_file_because)
        self._next_file_because = ''
        self._open(self.segment.path.name)
        self._settings.log('info', f'recording goes on in {self.segment.path}')
        for latched, (payload, sequence) in self._latched.items():
            if latched != channel:
                self.segment.append(latched, stamp, payload, sequence)

    def _flush(self) -> None:
        self.segment.flush()
        self.last_flush = time.monotonic()

    def _finish_file(self, because: str) -> None:
        """Finish the file and say so, or what is wrong with it."""
        drops = self._drops - self._drops_noted
        self._drops_noted = self._drops.copy()
        problem = self.segment.finish({
            'recording.closed': datetime.now(UTC).isoformat(timespec='milliseconds'),
            'recording.closed_because': because, 'recording.messages': str(self.segment.messages),
            'recording.dropped': str(drops.total()), 'recording.rejected': str(self._rejected),
            **{f'recording.dropped{self._topic(channel)}': str(count)
               for channel, count in sorted(drops.items())}})
        if problem:
            self.error = f'{self.segment.path}: {problem}'
            self._settings.log('error', self.error)
        else:
            lost = f', {drops.total()} dropped' if drops else ''
            self._settings.log('info', f'recorded {self.segment.messages} messages{lost} '
                               f'({readable_size(self.segment.size)}) in {self.segment.path}')

    def _topic(self, channel: int) -> str:
        channels = self._settings.channels
        return channels[channel].topic if 0 <= channel < len(channels) else f'/{channel}'

    def _space_is_short(self) -> bool:
        """Look at the free space now and then; say in `error` if it is below the reserve."""
        now, reserve = time.monotonic(), self._settings.reserve
        if self.free_space and now - self._space_checked < SPACE_INTERVAL:
            return False
        self._space_checked = now
        self.free_space = shutil.disk_usage(self._settings.directory).free
        if self.free_space >= reserve:
            return False
        self.error = (f'only {readable_size(self.free_space)} of the disk are free, '
                      f'{readable_size(reserve)} are left to others')
        return True

    def _fail(self, error: Exception) -> None:
        """Leave the file as it is: the MCAP writer must not be touched after an error."""
        self.accepting = False
        damaged = self.segment.open
        self.segment.abandon()
        self.queue.clear()
        self.error = str(error) if isinstance(error, OSError) else repr(error)
        hint = f'; what it holds until then: hpv-twin recover {self.segment.path}'
        self._settings.log('error', f'recording stops: {self.error}{hint if damaged else ""}')
