"""The files of one recording, one after the other: opened, filled, split, finished, bounded."""

import contextlib
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from operator import index
from pathlib import Path

import numpy as np

from . import bag, files
from .files import readable_size
from .parts import folder_of
from .schemas import Channel
from .segment import CHUNK_SIZE, Segment

INTERLEAVING = 1_000_000_000  # ns that one topic may lag behind another in the queue
END_OF_TIME = 2**63 - 1
MOST_GAPS_TOLD = 1000  # in one file, each by itself
SPLIT = ('the file was full', 'its time was over')


@dataclass(frozen=True)
class Settings:
    """What a recorder was asked for: sizes in bytes, times in seconds; 0 is no bound."""

    directory: Path
    channels: tuple[Channel, ...]
    name: str
    max_total_size: float
    max_age: float
    split_size: float
    split_time: float
    fsync: bool
    flush_interval: float
    metadata: Callable[[], Mapping[str, str]]
    attachments: dict[str, bytes]
    reserve: float
    log: Callable[[str, str], None]


class Series:
    """One recording, for one thread. Every method raises OSError when the disk refuses.

    Then `abandon` what is open, and `open` a further file when the disk is back. `dropped` counts
    the lost messages by channel.
    """

    def __init__(self, settings: Settings):
        self.segment: Segment | None = None
        self.dropped: Counter[int] = Counter()
        self.gaps: deque[tuple[int, str]] = deque()  # appended to by any thread
        self.problem = ''
        self._settings = settings
        self._dropped_noted: Counter[int] = Counter()  # those that earlier files tell of
        self._rejected = self._parts = self._gaps_told = self._gaps_met = 0
        self._sequences: Counter[int] = Counter()
        self._latched: dict[int, tuple[bytes, int]] = {}  # payload and sequence
        self._stamps: dict[int, int] = {}  # last of each channel in this file, ns
        self._newest = 0
        self._folder: Path | None = None  # once it was split
        self._next_file_because = ''
        self._previous = ''  # name of the file before this one
        self._opened = 0.0
        self._size_opened = 0

    @property
    def where(self) -> Path:
        """The recording: its file, or its folder once it was split."""
        return self._folder or self.segment.path

    def open(self, opening: Sequence[tuple[int, int, bytes]] = (), resumed_after: str = '') -> None:
        """Open a bare file that begins with `opening`, or with the latched messages so far."""
        self._folder = None
        self._open(resumed_after)
        try:
            for message in opening:
                self.record(*message)
            if not opening:
                self._repeat_latched(time.time_ns(), None)
            self.segment.flush()
        except BaseException:
            self.segment.abandon()
            self.segment.path.unlink(missing_ok=True)
            raise
        self._size_opened = self.segment.size

    def record(self, channel: int, stamp: int, payload: bytes) -> None:
        """Write a message, into a further file if it is time for one."""
        if not self._acceptable(channel, stamp, payload):
            return
        if stamp < self._stamps.get(channel, 0) or stamp < self._newest - INTERLEAVING:
            self._next_file_because = 'the clock went back'
        self._go_on(channel, stamp, 1)
        sequence = self._sequences[channel] = self._sequences[channel] + 1
        self.segment.append(channel, stamp, payload, sequence)
        self._stamps[channel] = stamp
        self._newest = max(self._newest, stamp)
        if self._settings.channels[channel].latched:
            self._latched[channel] = payload, sequence

    def record_rows(self, channel: int, stamps: np.ndarray, values: np.ndarray) -> None:
        """Write messages of a channel with a layout; where their stamps go back, a further file."""
        done = 0
        backwards = np.flatnonzero(np.diff(stamps) < 0) + 1
        for part, rows in zip(np.split(stamps, backwards), np.split(values, backwards),
                              strict=True):
            if not len(part):
                continue
            first, last = int(part[0]), int(part[-1])
            if first < self._stamps.get(channel, 0) or first < self._newest - INTERLEAVING:
                self._next_file_because = 'the clock went back'
            self._go_on(channel, first, len(stamps) - done)
            done += len(part)
            self.segment.append_rows(channel, part, rows, self._sequences[channel] + 1)
            self._sequences[channel] += len(part)
            self._stamps[channel] = last
            self._newest = max(self._newest, last)

    def pass_over(self, channel: int, count: int = 1) -> None:
        """Count messages that cannot be written."""
        self.dropped[channel] += count

    def latch(self, channel: int, stamp: int, payload: bytes) -> None:
        """Keep a message of a latched channel for the next file, while none is open."""
        if self._acceptable(channel, stamp, payload) and self._settings.channels[channel].latched:
            self._latched[channel] = payload, self._sequences[channel]

    def flush(self) -> None:
        """Hand all to the operating system; ask for a further file if this one is full."""
        told = {}
        while self.gaps:
            stamp, reason = self.gaps.popleft()
            self._gaps_met += 1
            if self._gaps_told + len(told) < MOST_GAPS_TOLD:
                told[str(stamp)] = reason
        if told:
            self._gaps_told += len(told)
            self.segment.tell_gaps(told)
        self.segment.flush()

    def look_at_size(self) -> None:
        """Ask for a further file if this one is full, or old."""
        wanted = self._settings
        if self.segment.size >= wanted.split_size:
            self._next_file_because = SPLIT[0]
        elif wanted.split_time and time.monotonic() - self._opened >= wanted.split_time:
            self._next_file_because = SPLIT[1]

    def finish(self, because: str) -> None:
        """Finish the file and say so; `problem` is '' or what is wrong with it."""
        self.flush()
        dropped = self.dropped.copy()
        drops = dropped - self._dropped_noted
        self.problem = self.segment.finish({
            'recording.closed': _now(), 'recording.closed_because': because,
            'recording.messages': str(self.segment.messages),
            'recording.dropped': str(drops.total()), 'recording.rejected': str(self._rejected),
            'recording.gaps': str(self._gaps_met),
            **{f'recording.dropped{self._topic(channel)}': str(count)
               for channel, count in sorted(drops.items())}})
        self._dropped_noted = dropped
        if self.problem:
            self.problem = f'{self.segment.path}: {self.problem}'
            self._settings.log('error', self.problem)
        else:
            lost = f', {drops.total()} dropped' if drops else ''
            self._settings.log('info', f'recorded {self.segment.messages} messages{lost} '
                               f'({readable_size(self.segment.size)}) in {self.segment.path}')
        if self._folder:
            self._write_metadata()

    def abandon(self) -> None:
        """Leave the file as it is: the MCAP writer must not be touched after an error."""
        if self.segment.open:
            self.segment.abandon()
            self.dropped += self.segment.unwritten
            if self._parts > 1 and self.segment.size <= self._size_opened:
                with contextlib.suppress(OSError):  # nothing but its opening lies in it
                    self.segment.path.unlink(missing_ok=True)
        if self._folder:
            self._write_metadata()

    def make_room(self) -> None:
        """Remove old files: a further one of full size keeps within the total, none is too old."""
        wanted = self._settings
        limit = wanted.max_total_size - 1.05 * wanted.split_size - CHUNK_SIZE
        touched = set()
        for outcome in files.make_room(wanted.directory, wanted.name, limit, wanted.max_age):
            if isinstance(outcome, OSError):
                wanted.log('warning', f'an old recording cannot be removed: {outcome}')
                continue
            wanted.log('info', f'removed {outcome}, to keep recordings within '
                       f'{readable_size(wanted.max_total_size)}'
                       + (f' and {wanted.max_age:g} s' if wanted.max_age else ''))
            touched.add(outcome.parent)
        for folder in touched - {wanted.directory}:
            with contextlib.suppress(OSError):
                bag.tidy(folder)

    def _open(self, resumed_after: str = '') -> None:
        """Make room, then open a file."""
        wanted = self._settings
        with contextlib.suppress(FileNotFoundError):  # the folder is yet to be made
            self.make_room()
        told = {'recording.opened': _now(), 'recording.part': str(self._parts + 1),
                'recording.continues': self._previous}
        if resumed_after:
            told['recording.resumed_after'] = resumed_after
        self.segment = Segment(
            files.create(self._folder or wanted.directory, wanted.name, datetime.now(UTC)),
            wanted.channels, dict(wanted.metadata()) | told, wanted.attachments, wanted.fsync)
        self._parts += 1
        self._previous = self.segment.path.name
        self._stamps, self._newest = {}, 0
        self._gaps_told = self._gaps_met = 0
        self._opened, self._size_opened = time.monotonic(), self.segment.size

    def _go_on(self, channel: int, stamp: int, count: int) -> None:
        """Go on in a further file if it is time for one, before `count` messages."""
        if not self._next_file_because:
            return
        try:
            self._next_file(channel, stamp)
        except BaseException:
            self.dropped[channel] += count
            raise

    def _next_file(self, channel: int, stamp: int) -> None:
        """Finish the file and open a further one, which repeats the latched messages."""
        because, self._next_file_because = self._next_file_because, ''
        self.finish(because)
        if because in SPLIT:
            self._gather()
        else:
            self._folder = None
        self._open()
        self._settings.log('info', f'recording goes on in {self.segment.path}')
        self._repeat_latched(stamp, channel)

    def _gather(self) -> None:
        """Have the parts in a folder of their own, with metadata.yaml, as `ros2 bag` has them."""
        first = self.segment.path
        if self._folder is not None:
            return
        folder = folder_of(first)
        try:
            folder.mkdir()
            first.rename(folder / first.name)
            for place in (folder, folder.parent) if self._settings.fsync else ():
                files.sync_directory(place)
        except OSError as error:
            self._settings.log('warning', f'the parts of {first} stay side by side: {error}')
            return
        self._folder = folder
        self._write_metadata()

    def _write_metadata(self) -> None:
        try:
            bag.write_metadata(self._folder)
        except OSError as error:
            self._settings.log('warning', f'no metadata.yaml in {self._folder}: {error}')

    def _repeat_latched(self, stamp: int, but: int | None) -> None:
        for latched, (payload, sequence) in self._latched.items():
            if latched != but:
                self.segment.append(latched, stamp, payload, sequence)

    def _acceptable(self, channel: int, stamp: int, payload: bytes) -> bool:
        """Whether a message can be written without spoiling the chunk it would lie in."""
        try:
            if (self._is_channel(channel) and 0 <= index(stamp) <= END_OF_TIME
                    and type(payload) is bytes):
                return True
        except TypeError:
            pass
        self._rejected += 1
        if self._rejected == 1:
            self._settings.log('warning', f'not recorded: channel {channel!r}, stamp {stamp!r}, '
                               f'a payload of type {type(payload).__name__}')
        return False

    def _is_channel(self, channel: int) -> bool:
        return 0 <= index(channel) < len(self._settings.channels)

    def _topic(self, channel: int) -> str:
        channels = self._settings.channels
        return channels[channel].topic if 0 <= channel < len(channels) else f'/{channel}'


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec='milliseconds')
