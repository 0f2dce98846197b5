"""One MCAP file while it is written, from its opening records to the check that it reads back."""

import contextlib
import mimetypes
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType

from . import LIBRARY
from .bulk import BulkWriter
from .files import DataFile, sync_directory
from .layout import Rows
from .schemas import Channel
from .summary import unfinished

CHUNK_SIZE = 256 * 1024
COMPRESSION = CompressionType.ZSTD
OPENING_RECORD = 'hpv_twin'
CLOSING_RECORD = 'hpv_twin_closing'
GAPS_RECORD = 'hpv_twin_gaps'
PROFILE = 'ros2'


class Segment:
    """A file being written. Every method raises OSError when the disk refuses.

    After the first error only `abandon` may be called: the MCAP writer keeps stale indexes then,
    and would spoil what is on the disk already.
    """

    def __init__(self, file: DataFile, channels: Sequence[Channel], metadata: Mapping[str, str],
                 attachments: Mapping[str, bytes], fsync: bool = False):
        self.path = file.path
        self.messages = 0
        self.unwritten: Counter[int] = Counter()  # by channel: what the process's death would lose
        self._file = file
        self._fsync = fsync
        self._writer = BulkWriter(file, chunk_size=CHUNK_SIZE, compression=COMPRESSION)
        try:
            self._begin(metadata, attachments)
            self._channels = self._register(channels)
            self._rows = {number: Rows(self._channels[number], channel.layout)
                          for number, channel in enumerate(channels) if channel.layout}
        except BaseException:
            self.abandon()
            self.path.unlink(missing_ok=True)
            raise

    def _begin(self, metadata: Mapping[str, str], attachments: Mapping[str, bytes]) -> None:
        """What explains the file comes first, so that a killed recording has it too."""
        self._writer.start(PROFILE, LIBRARY)
        self._writer.add_metadata(OPENING_RECORD, dict(metadata))
        now = time.time_ns()
        for name, data in attachments.items():
            self._writer.add_attachment(now, now, name, _media_type(name), data)
        if self._fsync:
            self._file.sync()
            sync_directory(self.path.parent)

    def _register(self, channels: Sequence[Channel]) -> list[int]:
        schemas = {}
        for channel in channels:
            if channel.type_name not in schemas:
                schemas[channel.type_name] = self._writer.register_schema(
                    channel.type_name, SchemaEncoding.ROS2, channel.schema.encode())
        return [self._writer.register_channel(
            channel.topic, MessageEncoding.CDR, schemas[channel.type_name],
            {'offered_qos_profiles': channel.qos, 'topic_type_hash': channel.type_hash})
            for channel in channels]

    @property
    def open(self) -> bool:
        """Whether the file was neither finished nor abandoned."""
        return self._file.open

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._file.size

    def append(self, channel: int, stamp: int, payload: bytes, sequence: int) -> None:
        """Add a message; it is safe from the process's death after the next `flush`."""
        before = self._note(channel, 1)
        self._writer.add_message(self._channels[channel], stamp, payload, stamp,
                                 sequence & 0xffffffff)
        self._settle(before)

    def append_rows(self, channel: int, stamps: np.ndarray, values: np.ndarray,
                    sequence: int) -> None:
        """Add messages of a channel with a layout: `stamps` in ns, ascending, and rows of `values`.

        Raises ValueError if the values do not fit the layout.
        """
        rows = self._rows[channel].lay_out(stamps, values, sequence & 0xffffffff)
        before = self._note(channel, len(stamps))
        self._writer.add_rows(self._channels[channel], stamps, rows)
        self._settle(before)

    def _note(self, channel: int, count: int) -> int:
        """Count what is about to be added; the size of the file before."""
        self.unwritten[channel] += count
        self.messages += count
        return self._file.size

    def _settle(self, size_before: int) -> None:
        """A chunk that was full has taken along everything before it."""
        if self._file.size > size_before:
            self.unwritten.clear()

    def tell_gaps(self, gaps: Mapping[str, str]) -> None:
        """Write why the stamps jump: first stamp behind a gap, in ns, and the reason."""
        self._writer.add_metadata(GAPS_RECORD, dict(gaps))

    def flush(self) -> None:
        """Hand everything to the operating system, with `fsync` to the disk.

        Raises FileNotFoundError if the file was removed meanwhile.
        """
        self._writer.flush()
        self.unwritten.clear()
        if self._fsync:
            self._file.sync()
        if self._file.removed():
            raise FileNotFoundError(2, 'the file was removed while it was written',
                                    str(self.path))

    def finish(self, closing: Mapping[str, str]) -> str:
        """Write the closing record and the index, close, read back: '' or what is wrong."""
        self.flush()
        self._writer.add_metadata(CLOSING_RECORD, dict(closing))
        self._writer.finish()
        if self._fsync:
            self._file.sync()
        self._file.close()
        return unfinished(self.path)

    def abandon(self) -> None:
        """Close the file as it is: what was flushed can be read and recovered."""
        with contextlib.suppress(OSError):  # close reports an older error once more
            self._file.close()


def _media_type(name: str) -> str:
    if Path(name).suffix in ('.yaml', '.yml'):
        return 'application/yaml'
    return mimetypes.guess_type(name)[0] or 'application/octet-stream'
