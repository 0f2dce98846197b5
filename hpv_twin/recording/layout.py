"""Lays out many messages of one topic at once, from arrays: the way back of `cdr.decode`."""

import struct
from dataclasses import dataclass

import numpy as np
from mcap.opcode import Opcode

HEAD = struct.Struct('<BQHIQQ')  # of a message record: opcode, length, channel, sequence, times
HEAD_FIELDS = (('sequence', '<u4', 11), ('log_time', '<u8', 15), ('publish_time', '<u8', 23))
SECOND = 1_000_000_000


@dataclass(frozen=True)
class Layout:
    """Where the values lie in the messages of a topic, which are equal in all else.

    `template`: the bytes of one message; `stamp`: offset of the header's stamp in them; `fields`:
    offsets of its float64 values, little-endian, in the order of the columns that `Rows` is given.
    """

    template: bytes
    stamp: int
    fields: tuple[int, ...]


class Rows:
    """Makes the message records of one channel of a file."""

    def __init__(self, channel_id: int, layout: Layout):
        length = HEAD.size - 9 + len(layout.template)
        head = HEAD.pack(Opcode.MESSAGE, length, channel_id, 0, 0, 0)
        self._pattern = np.frombuffer(head + layout.template, np.uint8)
        self._fields = [f'value{i}' for i in range(len(layout.fields))]
        names, formats, offsets = (list(column) for column in zip(*HEAD_FIELDS, strict=True))
        places = [layout.stamp, layout.stamp + 4, *layout.fields]
        self._type = np.dtype({
            'names': [*names, 'seconds', 'nanoseconds', *self._fields],
            'formats': [*formats, '<i4', '<u4', *['<f8'] * len(self._fields)],
            'offsets': offsets + [HEAD.size + place for place in places],
            'itemsize': self._pattern.size})

    def lay_out(self, stamps: np.ndarray, values: np.ndarray, sequence: int) -> np.ndarray:
        """Message records, one a row of bytes, numbered from `sequence`.

        `stamps` in ns, shape (n,); `values` of shape (n, fields). Raises ValueError for others.
        """
        if values.shape != (len(stamps), len(self._fields)):
            raise ValueError(f'values of shape {values.shape} for {len(stamps)} messages with '
                             f'{len(self._fields)} fields')
        table = np.tile(self._pattern, (len(stamps), 1))
        rows = table.view(self._type)[:, 0]
        rows['sequence'] = np.arange(sequence, sequence + len(stamps))
        rows['log_time'] = rows['publish_time'] = stamps
        rows['seconds'], rows['nanoseconds'] = stamps // SECOND, stamps % SECOND
        for name, column in zip(self._fields, values.T, strict=True):
            rows[name] = column
        return table
