"""Records messages into MCAP files while a real-time loop goes on.

`Recorder.write` only appends to a queue; a thread of its own (`Session`) does all the work.
"""

import os
import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from .schemas import Channel
from .session import RESERVE, Session, Settings

MIN_TOTAL_SIZE = 2_000_000  # bytes
MIN_SPLIT_SIZE, MAX_SPLIT_SIZE = 1_000_000, 1_000_000_000  # bytes


@dataclass(frozen=True)
class RecorderStatus:
    """How a recording stands.

    `file`, `bytes` (written) and `messages` are those of the file in work, or of the last one;
    `dropped` counts messages lost since `start` because the queue was full; `free_space` in bytes
    as last seen; `last_flush` in seconds of `time.monotonic`; `error` is '' or why nothing is
    being recorded.
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

    All of its files together keep within `max_total_size` bytes: a file is followed by the next
    at a tenth of that (1 MB to 1 GB), and the oldest go first. Nothing else is ever removed.
    `metadata` and `attachments` are written at the start of every file. `flush_interval` (s) is
    what a killed process loses at most; with `fsync` so does a power cut. Recording stops when
    fewer than `reserve` bytes of the disk are free. `log(level, text)` is called with 'info',
    'warning' or 'error', also from the recorder's thread; what it raises is printed only.
    Raises ValueError for settings out of bounds.
    """

    def __init__(self, directory: str | os.PathLike, channels: Sequence[Channel], *, name: str,
                 max_total_size: float = 1e9, fsync: bool = False, flush_interval: float = 0.25,
                 queue_length: int = 20_000, metadata: Mapping[str, str] | None = None,
                 attachments: Mapping[str, bytes] | None = None,
                 log: Callable[[str, str], None], reserve: float = RESERVE):
        if not name or '/' in name:
            raise ValueError(f'name {name!r} cannot begin the name of a file')
        if not max_total_size >= MIN_TOTAL_SIZE:
            raise ValueError(f'max_total_size {max_total_size:g} is below {MIN_TOTAL_SIZE} bytes')
        split_size = min(max(max_total_size / 10, MIN_SPLIT_SIZE), MAX_SPLIT_SIZE)
        self._settings = Settings(
            Path(directory).absolute(), tuple(channels), name, max_total_size, split_size, fsync,
            flush_interval, dict(metadata or {}), dict(attachments or {}), reserve, _shielded(log))
        self._queue_length = queue_length
        self._lock = threading.RLock()  # for start, stop and close; write takes no lock
        self._session: Session | None = None
        self._error = ''
        self._closed = False

    def start(self, opening: Sequence[tuple[int, int, bytes]] = ()) -> Path | None:
        """Open a new file and record into it; a recording under way is finished first.

        `opening`: channel index, stamp (ns) and payload of messages that come first.
        Returns the absolute path; None, with a line in the log, if nothing can be written.
        """
        with self._lock:
            self.stop()
            if self._closed:
                return None
            try:
                session = Session(self._settings, opening)
            except OSError as error:
                where = error.filename or self._settings.directory
                self._error = f'{error.strerror or error} ({where})'
                self._settings.log('error', f'not recording: {self._error}')
                return None
            self._session, self._error = session, ''
            session.start()
            return session.segment.path

    def write(self, channel: int, stamp: int, payload: bytes) -> bool:
        """Queue a message for the channel of this index; `stamp` in ns. Never waits, never raises.

        False if nothing is being recorded, or if the queue is full and the message is lost.
        """
        session = self._session
        if session is None or not session.accepting:
            return False
        if len(session.queue) >= self._queue_length:
            session.overflow.append(channel)
            return False
        session.queue.append((channel, stamp, payload))
        return True

    def stop(self, timeout: float = 10.0) -> Path | None:
        """Write what is queued, finish the file, see that it reads back; its absolute path.

        None if nothing was being recorded, if the file is damaged, or if the disk takes longer
        than `timeout` (s); the log says so.
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
            return RecorderStatus(False, None, 0, 0, 0, 0, None, self._error)
        segment = session.segment
        return RecorderStatus(session.accepting, segment.path, segment.size, segment.messages,
                              session.dropped, session.free_space, session.last_flush,
                              self._error or session.error)


def _shielded(log: Callable[[str, str], None]) -> Callable[[str, str], None]:
    """The same, but a log that raises ends no recording."""
    def say(level: str, text: str) -> None:
        try:
            log(level, text)
        except Exception:
            traceback.print_exc()

    return say
