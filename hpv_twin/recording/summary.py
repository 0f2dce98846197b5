"""The index at the end of a finished MCAP file, and the check that a file has one."""

import io
import os
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC as MAGIC

FRAME = struct.Struct('<BQ')
FOOTER = struct.Struct('<BQQQI')
TAIL = FOOTER.size + len(MAGIC)
PARSERS = {Opcode.HEADER: records.Header, Opcode.SCHEMA: records.Schema,
           Opcode.CHANNEL: records.Channel, Opcode.CHUNK: records.Chunk,
           Opcode.METADATA: records.Metadata, Opcode.ATTACHMENT: records.Attachment,
           Opcode.CHUNK_INDEX: records.ChunkIndex, Opcode.STATISTICS: records.Statistics,
           Opcode.METADATA_INDEX: records.MetadataIndex,
           Opcode.ATTACHMENT_INDEX: records.AttachmentIndex}
BROKEN = (McapError, struct.error, ValueError, OverflowError, MemoryError)


class RecordingError(Exception):
    """A recording that cannot be used; the text is one line and names the file."""


class Summary(NamedTuple):
    """What a finished file says of itself at its end."""

    schemas: dict[int, records.Schema]
    channels: dict[int, records.Channel]
    chunks: list[records.ChunkIndex]
    statistics: records.Statistics
    places: list[int]  # offsets of the metadata and attachment records

    @property
    def names_all(self) -> bool:
        """Whether every channel that has messages is described here, not only among the data."""
        return self.statistics.channel_message_counts.keys() <= self.channels.keys()


def unfinished(path: Path) -> str:
    """'' if the file at `path` was finished and its index is intact, else what is wrong."""
    try:
        with open(path, 'rb') as file:
            return _index_bytes(file)[0]
    except OSError as error:
        return f'cannot be read back: {error.strerror}'


def read_summary(file: BinaryIO, chunks: bool = True) -> tuple[str, Summary | None]:
    """What is wrong ('' if nothing), and the index: None also in a whole file without one.

    Without `chunks` the places of the chunks, the most of it, are passed over.
    """
    problem, data = _index_bytes(file)
    if problem or not data:
        return problem, None
    found = {opcode: [] for opcode in PARSERS}
    try:
        for opcode, content in _frames(data):
            if opcode in found and (chunks or opcode != Opcode.CHUNK_INDEX):
                found[opcode].append(parse(opcode, content))
    except BROKEN:
        return 'its index makes no sense', None
    if not found[Opcode.STATISTICS]:
        return '', None
    indexes = found[Opcode.METADATA_INDEX] + found[Opcode.ATTACHMENT_INDEX]
    return '', Summary({schema.id: schema for schema in found[Opcode.SCHEMA]},
                       {channel.id: channel for channel in found[Opcode.CHANNEL]},
                       found[Opcode.CHUNK_INDEX], found[Opcode.STATISTICS][-1],
                       sorted(index.offset for index in indexes))


def parse(opcode: int, content: bytes) -> records.McapRecord:
    """The record of this opcode; raises one of BROKEN. An attachment's checksum is tested."""
    if opcode == Opcode.ATTACHMENT:
        stored = int.from_bytes(content[-4:], 'little')
        if stored and stored != zlib.crc32(content[:-4]):
            raise ValueError('the checksum of an attachment is wrong')
    return PARSERS[opcode].read(ReadDataStream(io.BytesIO(content)))


def _index_bytes(file: BinaryIO) -> tuple[str, bytes]:
    """What is wrong ('' if nothing), and the bytes of the index."""
    size = file.seek(0, os.SEEK_END)
    if size < len(MAGIC) + TAIL:
        return 'it was not finished: its index is missing', b''
    file.seek(size - TAIL)
    tail = file.read(TAIL)
    opcode, length, start, _, checksum = FOOTER.unpack_from(tail)
    if (opcode, length, tail[-len(MAGIC):]) != (Opcode.FOOTER, FOOTER.size - FRAME.size, MAGIC):
        return 'it was not finished: its index is missing', b''
    if start == 0:
        return '', b''
    if not len(MAGIC) <= start <= size - TAIL:
        return 'its index makes no sense', b''
    file.seek(start)
    data = file.read(size - TAIL - start)
    if checksum and checksum != zlib.crc32(tail[:FOOTER.size - 4], zlib.crc32(data)):
        return 'its index is damaged: the checksum is wrong', b''
    return '', data


def _frames(data: bytes) -> Iterator[tuple[int, bytes]]:
    position = 0
    while position < len(data):
        opcode, length = FRAME.unpack_from(data, position)
        position += FRAME.size
        yield opcode, data[position:position + length]
        position += length
