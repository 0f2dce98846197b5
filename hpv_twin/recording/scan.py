"""Walks an MCAP file, whole or not, and yields what can be understood, in file order.

Records are framed here (a byte and a length), so that the place where understanding ends is known
exactly; the mcap library parses their contents. Message indexes are passed over.
"""

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import zstandard
from mcap import records
from mcap.opcode import Opcode
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC as MAGIC

from .summary import BROKEN, FRAME, PARSERS, RecordingError, parse, read_summary

CHUNK_HEAD = struct.Struct('<QQQII')  # first and last time, size, checksum, length of a name
MESSAGE_HEAD = np.dtype([('channel', '<u2'), ('sequence', '<u4'), ('log_time', '<u8'),
                         ('publish_time', '<u8')])
BLOCK_SIZE = 4 << 20
END_OF_TIME = 2**63 - 1


class Trouble(NamedTuple):
    """A stretch of a file that was not understood: its first byte, its length, and why."""

    offset: int
    length: int
    reason: str


class Block(NamedTuple):
    """Messages in file order. Message i's payload is `data[start[i]:stop[i]]`.

    `data` is one array of bytes; `channel`, `sequence`, `log_time` and `publish_time` (ns),
    `start` and `stop` hold one value per message.
    """

    data: np.ndarray
    channel: np.ndarray
    sequence: np.ndarray
    log_time: np.ndarray
    publish_time: np.ndarray
    start: np.ndarray
    stop: np.ndarray

    def only(self, keep: np.ndarray) -> 'Block':
        """The messages that a mask or an index array picks."""
        return Block(self.data, *(column[keep] for column in self[1:]))


class Scan:
    """One pass over a file. While `blocks` is consumed the other attributes fill up.

    Attributes: `size` in bytes; `problem`, '' for a finished file with an intact index; `summary`
    or None; `header`; `schemas`, `channels` by id; `metadata`, `attachments` in file order;
    `troubles`; `position` of the next byte; `reached_end`, whether the end of the data was met.
    Raises RecordingError for what is no MCAP file at all.
    """

    def __init__(self, path: str | os.PathLike):
        self.path = Path(path)
        try:
            self._file = self.path.open('rb')
        except OSError as error:
            raise RecordingError(f'{self.path}: {error.strerror}') from None
        try:
            self._begin()
        except BaseException:
            self._file.close()
            raise
        self.position = len(MAGIC)
        self.header = records.Header('', '')
        self.schemas = dict(self.summary.schemas) if self.summary else {}
        self.channels = dict(self.summary.channels) if self.summary else {}
        self.metadata: list[records.Metadata] = []
        self.attachments: list[records.Attachment] = []
        self.troubles: list[Trouble] = []
        self.reached_end = False

    def _begin(self) -> None:
        try:
            self.size = self._file.seek(0, os.SEEK_END)
            self.problem, self.summary = read_summary(self._file)
            self._file.seek(0)
            magic = self._file.read(len(MAGIC))
        except OSError as error:
            raise RecordingError(f'{self.path}: {error.strerror}') from None
        if magic != MAGIC:
            what = 'is not an MCAP file' if self.size else 'is empty: nothing was recorded'
            raise RecordingError(f'{self.path}: {what}')

    def __enter__(self) -> 'Scan':
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def lies_outside(self, start: int | None, end: int | None) -> bool:
        """Whether the index says that no message has `start` <= log time < `end` (ns).

        What such a file names besides is learnt from its index.
        """
        if self.summary is None or not self.summary.names_all or (start is None and end is None):
            return False
        told = self.summary.statistics
        return told.message_count > 0 and (
            (start is not None and told.message_end_time < start)
            or (end is not None and told.message_start_time >= end))

    def type_name(self, channel: int) -> str:
        """The message type of a channel, '' if it has no schema."""
        schema = self.schemas.get(self.channels[channel].schema_id)
        return schema.name if schema else ''

    def learn_indexed(self) -> None:
        """Read header, metadata and attachments from where the index says, and nothing else."""
        for offset in (len(MAGIC), *(self.summary.places if self.summary else ())):
            opcode, content, reason = self._frame(offset)
            if reason:
                self.troubles.append(Trouble(offset, 0, reason))
            elif opcode in PARSERS:
                self._learn(opcode, content, offset)

    def blocks(self, start: int | None = None, end: int | None = None) -> Iterator[Block]:
        """The messages with `start` <= log time < `end` (ns), a few megabytes at a time."""
        start, end = start or 0, END_OF_TIME if end is None else end
        pile = _Pile()
        for offset, opcode, content in self._frames():
            if opcode == Opcode.MESSAGE:
                pile.add(FRAME.pack(opcode, len(content)) + content)
            elif opcode == Opcode.CHUNK:
                pile.add(self._unpack(offset, content, start, end))
            elif opcode in PARSERS:
                self._learn(opcode, content, offset)
            if pile.size >= BLOCK_SIZE:
                yield self._sift(pile, start, end)
                pile = _Pile()
        yield self._sift(pile, start, end)
        if self.troubles and self.troubles[-1].offset + self.troubles[-1].length >= self.size:
            yield self._sift_cut_chunk(start, end)

    def _frames(self) -> Iterator[tuple[int, int, bytes]]:
        """Offset, opcode and content of each record of the data section that is framed well."""
        while self.position < self.size:
            offset = self.position
            try:
                opcode, content, reason = self._frame(offset)
            except (OSError, MemoryError) as error:
                opcode, content, reason = 0, b'', f'cannot be read: {error}'
            if reason:
                self.position = self._next_chunk(offset)
                self.troubles.append(Trouble(offset, self.position - offset, reason))
                continue
            self.position = offset + FRAME.size + len(content)
            if opcode == Opcode.DATA_END:
                self.reached_end = True
                return
            yield offset, opcode, content

    def _frame(self, offset: int) -> tuple[int, bytes, str]:
        """Opcode and content of the record at `offset`, or why there is none."""
        self._file.seek(offset)
        head = self._file.read(FRAME.size)
        if len(head) < FRAME.size:
            return 0, b'', 'the file ends inside a record'
        opcode, length = FRAME.unpack(head)
        if opcode == 0 or opcode in (Opcode.FOOTER, Opcode.STATISTICS):
            return 0, b'', 'there is no record here'
        if offset + FRAME.size + length > self.size:
            what = 'a chunk of messages' if opcode == Opcode.CHUNK else 'a record'
            return 0, b'', f'the file ends inside {what}'
        return opcode, self._file.read(length), ''

    def _next_chunk(self, offset: int) -> int:
        """Where the index says that the next chunk begins; the file's end without an index."""
        chunks = self.summary.chunks if self.summary else []
        return min((chunk.chunk_start_offset for chunk in chunks
                    if offset < chunk.chunk_start_offset < self.size), default=self.size)

    def _unpack(self, offset: int, content: bytes, start: int, end: int) -> bytes:
        """The records inside a chunk; b'' if they lie outside the span or are damaged."""
        try:
            chunk = parse(Opcode.CHUNK, content)
            known = self.summary is not None and self.summary.names_all
            if known and (chunk.message_end_time < start or chunk.message_start_time >= end):
                return b''
            stream, length = get_chunk_data_stream(chunk, validate_crc=True)
            return stream.read(length)
        except Exception as error:  # each decompressor raises a class of its own
            self._lose(offset, content, f'a chunk is damaged: {error}')
            return b''

    def _learn(self, opcode: int, content: bytes, offset: int) -> None:
        try:
            record = parse(opcode, content)
        except BROKEN as error:
            self._lose(offset, content, f'a {Opcode(opcode).name.lower()} record: {error}')
            return
        if opcode == Opcode.SCHEMA:
            self.schemas[record.id] = record
        elif opcode == Opcode.CHANNEL:
            self.channels[record.id] = record
        elif opcode == Opcode.METADATA:
            self.metadata.append(record)
        elif opcode == Opcode.ATTACHMENT:
            self.attachments.append(record)
        elif opcode == Opcode.HEADER:
            self.header = record

    def _lose(self, offset: int, content: bytes, reason: str) -> None:
        self.troubles.append(Trouble(offset, FRAME.size + len(content), reason))

    def _sift(self, pile: '_Pile', start: int, end: int) -> Block:
        """The messages of a pile in the span; what else lies there is learnt."""
        block, others = pile.block()
        for opcode, content in others:
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._learn(opcode, content, self.position)
        known = np.isin(block.channel, list(self.channels))
        if not known.all():
            self.troubles.append(Trouble(self.position, 0, f'{np.sum(~known)} messages of '
                                         'topics that the file does not name'))
        return block.only(known & (block.log_time >= start) & (block.log_time < end))

    def _sift_cut_chunk(self, start: int, end: int) -> Block:
        """The whole messages in a chunk whose end is missing; there is no checksum for them."""
        pile = _Pile()
        try:
            self._file.seek(self.troubles[-1].offset)
            opcode, length = FRAME.unpack(self._file.read(FRAME.size))
            content = self._file.read()
            if opcode != Opcode.CHUNK or length <= len(content):
                return self._sift(pile, start, end)
            first, last, _, _, named = CHUNK_HEAD.unpack_from(content)
            name = content[CHUNK_HEAD.size:][:named]
            data = content[CHUNK_HEAD.size + named + 8:]
            if name == b'zstd':
                data = zstandard.ZstdDecompressor().decompressobj().decompress(data)
            if name in (b'', b'zstd'):
                pile.add(data)
                start, end = max(start, first), min(end, last + 1)
        except (struct.error, zstandard.ZstdError, MemoryError, OSError):
            pass  # too little is left of it
        return self._sift(pile, start, end)


class _Pile:
    """Strings of records, one after the other."""

    def __init__(self):
        self.size = 0
        self._parts = []

    def add(self, part: bytes) -> None:
        self._parts.append(part)
        self.size += len(part)

    def block(self) -> tuple[Block, list[tuple[int, bytes]]]:
        """The messages, and the other records as opcode and content."""
        starts, stops, others, base = [], [], [], 0
        for part in self._parts:
            position, end = 0, len(part)
            while position + 9 <= end:
                opcode, length = FRAME.unpack_from(part, position)
                begin = position + 9
                position = begin + length
                if position > end:
                    break
                if opcode == 5:
                    starts.append(base + begin)
                    stops.append(base + position)
                else:
                    others.append((opcode, part[begin:position]))
            base += end
        data = np.frombuffer(b''.join(self._parts), np.uint8)
        return _block(data, np.array(starts, np.int64), np.array(stops, np.int64)), others


def _block(data: np.ndarray, start: np.ndarray, stop: np.ndarray) -> Block:
    size = MESSAGE_HEAD.itemsize
    whole = stop - start >= size
    start, stop = start[whole], stop[whole]
    head = data[start[:, None] + np.arange(size)].view(MESSAGE_HEAD)[:, 0]
    return Block(data, head['channel'], head['sequence'], head['log_time'].astype(np.int64),
                 head['publish_time'].astype(np.int64), start + size, stop)
