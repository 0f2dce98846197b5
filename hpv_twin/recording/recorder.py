"""Records messages into MCAP files while a real-time loop goes on.

`Recorder.write` only appends to a queue; a thread of its own (`Session`) does all the work.
"""

import math
import os
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from .schemas import Channel
from .series import Settings
from .session import Handful, Session, Source

MIN_TOTAL_SIZE = 2_000_000  # bytes
MIN_SPLIT_SIZE, MAX_SPLIT_SIZE = 1_000_000, 1_000_000_000  # bytes
MIN_SPLIT_TIME = 1.0  # s
RESERVE = 100e6  # bytes of the disk left to others


@dataclass(frozen=True)
class RecorderStatus:
    """How a recording stands.

    `file`, `bytes` (written) and `messages` are those of the file in work, or of the last one;
    `dropped` counts messages lost since `start`, because the queue was full or the disk failed;
    `free_space` in bytes as last seen; `last_flush` in seconds of `time.monotonic`; `error` is ''
    or why nothing is being recorded, and when the disk is tried again.
    """

    recording: bool
    file: Path | None
    bytes: int
    messages: int
    dropped: int
    free_space: int
    last_flush: float | None
    error: str


class Recorder:
    """Writes what `write` is given into `directory`, in files called `<name>_<UTC time>.mcap`.

    All of its files together keep within `max_total_size` bytes, the oldest go first; with
    `max_age` (s) also those that ended longer ago. Nothing else is ever removed. A file is
    followed by the next at `split_size` bytes (0: a tenth of the total, 1 MB to 1 GB) or after
    `split_time` (s; 0: never); the parts of a recording then lie in a folder of its name.
    `metadata` (a mapping, or a function that gives one) and `attachments` are written at the start
    of every file. `flush_interval` (s) is what a killed process loses at most; with `fsync` so
    does a power cut. When fewer than `reserve` bytes of the disk are free, or it fails, recording
    waits, and goes on in a new file when it can. `log(level, text)` is called with 'info',
    'warning' or 'error', also from the recorder's thread; what it raises is printed only.
    Raises ValueError for settings out of bounds.
    """

    def __init__(self, directory: str | os.PathLike, channels: Sequence[Channel], *, name: str,
                 max_total_size: float = 1e9, max_age: float = 0.0, split_size: float = 0.0,
                 split_time: float = 0.0, fsync: bool = False, flush_interval: float = 0.25,
                 queue_length: int = 20_000,
                 metadata: Mapping[str, str] | Callable[[], Mapping[str, str]] | None = None,
                 attachments: Mapping[str, bytes] | None = None,
                 log: Callable[[str, str], None], reserve: float = RESERVE):
        if not name or '/' in name:
            raise ValueError(f'name {name!r} cannot begin the name of a file')
        if not max_total_size >= MIN_TOTAL_SIZE:
            raise ValueError(f'max_total_size {max_total_size:g} is below {MIN_TOTAL_SIZE} bytes')
        if split_size and not MIN_SPLIT_SIZE <= split_size <= max_total_size / 2:
            raise ValueError(f'split_size {split_size:g} bytes is outside [{MIN_SPLIT_SIZE:g}, '
                             f'{max_total_size / 2:g}], half of what is kept in all')
        if split_time and not split_time >= MIN_SPLIT_TIME:
            raise ValueError(f'split_time {split_time:g} s is below {MIN_SPLIT_TIME:g} s')
        split_size = split_size or min(max(max_total_size / 10, MIN_SPLIT_SIZE), MAX_SPLIT_SIZE)
        given = dict(metadata or {}) if not callable(metadata) else None
        self._settings = Settings(
            Path(directory).absolute(), tuple(channels), name, max_total_size, max_age, split_size,
            split_time, fsync, flush_interval, metadata if given is None else lambda: given,
            dict(attachments or {}), reserve, _shielded(log))
        self._queue_length = queue_length
        self._lock = threading.RLock()  # for start, stop and close; write takes no lock
        self._session: Session | None = None
        self._closed = False

    def start(self, opening: Sequence[tuple[int, int, bytes]] = ()) -> Path | None:
        """Open a new file and record into it; a recording under way is finished first.

        `opening`: channel index, stamp (ns) and payload of messages that come first.
        Returns the absolute path; None, with a line in the log, if nothing can be written now:
        then recording begins when the disk lets it.
        """
        with self._lock:
            self.stop()
            if self._closed:
                return None
            self._session = session = Session(self._settings, opening)
            path = session.series.segment.path if session.recording else None
            if path is None:
                self._settings.log('error', f'not recording: {session.error}; it begins when the '
                                   'disk lets it')
            session.start()
            return path

    def write(self, channel: int, stamp: int, payload: bytes) -> bool:
        """Queue a message for the channel of this index; `stamp` in ns. Never waits, never raises.

        False if nothing is being recorded, or if the queue is full and the message is lost.
        """
        session = self._session
        if session is None or session.stopping:
            return False
        if len(session.queue) >= self._queue_length:
            session.overflow.append((channel, 1))
            return False
        session.queue.append((channel, stamp, payload))
        return session.recording

    def write_rows(self, source: Source, item: object, count: int) -> bool:
        """Queue what `source` makes `count` messages of each of its channels of, as `write` does.

        The channels have a layout. The messages are made in the recorder's thread, many at once.
        """
        session = self._session
        if session is None or session.stopping:
            return False
        if len(session.queue) >= self._queue_length:
            session.overflow.extend((channel, count) for channel in source.channels)
            return False
        session.queue.append(Handful(source, item, count))
        return session.recording

    def note_gap(self, stamp: int, reason: str) -> None:
        """Have the file say why the stamps jump, and which is the first (ns) behind the jump."""
        if self._session is not None and not self._session.stopping:
            self._session.series.gaps.append((stamp, reason))

    def stop(self, timeout: float = 10.0) -> Path | None:
        """Write what is queued, finish the file, see that it reads back.

        Returns the absolute path of the recording, that of its folder if it was split. None if
        nothing was being recorded, if the file is damaged, or if the disk takes longer than
        `timeout` (s); the log says so.
        """
        with self._lock:
            session = self._session
            if session is None or not session.is_alive():
                return None
            return session.finish(timeout)

    def close(self) -> None:
        """Stop for good; a second call does nothing."""
        with self._lock:
            self.stop()
            self._closed = True

    @property
    def status(self) -> RecorderStatus:
        """How the recording stands; cheap, from any thread."""
        session = self._session
        if session is None:
            return RecorderStatus(False, None, 0, 0, 0, 0, None, '')
        segment, error = session.series.segment, session.error
        if error and session.is_alive():
            wait = max(0.0, session.next_try - time.monotonic())
            error = f'{error}; next try within {math.ceil(wait)} s'
        path, size, messages = ((segment.path, segment.size, segment.messages) if segment
                                else (None, 0, 0))
        return RecorderStatus(session.recording, path, size, messages, session.dropped,
                              session.free_space, session.last_flush, error)


def _shielded(log: Callable[[str, str], None]) -> Callable[[str, str], None]:
    """The same, but a log that raises ends no recording."""
    def say(level: str, text: str) -> None:
        try:
            log(level, text)
        except Exception:
            traceback.print_exc()

    return say
