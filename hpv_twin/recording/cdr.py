"""Decodes many messages of one topic at once, from the bytes of a recording into arrays.

A message is laid out by what its lengths say (frame_id, joint names, array sizes); the first one
is taken apart field by field, and all that are laid out alike follow in one step of NumPy.
"""

import struct
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

ENCAPSULATION = 4
MAX_JOINTS = 10_000


class PressureSignal(NamedTuple):
    """sensor_msgs/FluidPressure: `time` (ns), absolute `pressure` (Pa), `variance` (Pa²).

    `malformed` messages could not be decoded and are left out.
    """

    time: np.ndarray
    pressure: np.ndarray
    variance: np.ndarray
    malformed: int = 0


class JointSignal(NamedTuple):
    """sensor_msgs/JointState: `time` (ns, shape n) and one column per name (shape n × names).

    `position` (m or rad), `velocity` (per second), `effort` (N or N·m); NaN where a message says
    nothing of a joint. `malformed` messages could not be decoded and are left out.
    """

    time: np.ndarray
    names: tuple[str, ...]
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    malformed: int = 0


class ScalarSignal(NamedTuple):
    """std_msgs/Float64: `time` (ns, when it was recorded: the message has no stamp) and `value`.

    `malformed` messages could not be decoded and are left out.
    """

    time: np.ndarray
    value: np.ndarray
    malformed: int = 0


class _Layout:
    """Takes one message apart and notes which of its bytes decide where the values lie."""

    def __init__(self, payload: bytes):
        if len(payload) < ENCAPSULATION or payload[0] != 0 or payload[1] > 1:
            raise ValueError('not plain CDR')
        self.size = len(payload)
        self.order = '<' if payload[1] else '>'
        self.names: tuple[str, ...] = ()
        self._payload = payload
        self._position = 0
        self._deciding = [np.arange(ENCAPSULATION)]

    @property
    def deciding(self) -> np.ndarray:
        """Offsets of the bytes that must be equal for another message to be laid out alike."""
        return np.concatenate(self._deciding)

    def take(self, size: int, alignment: int) -> int:
        """Offset of the next field of `size` bytes."""
        self._position += -self._position % alignment
        offset = ENCAPSULATION + self._position
        self._position += size
        if offset + size > self.size:
            raise ValueError('a field lies beyond the end')
        return offset

    def count(self) -> int:
        """The next length, of a string or a sequence."""
        offset = self.take(4, 4)
        self._deciding.append(np.arange(offset, offset + 4))
        return struct.unpack_from(self.order + 'I', self._payload, offset)[0]

    def stamp(self) -> int:
        """Offset of a header's stamp; the header is passed."""
        offset = self.take(8, 4)
        self.take(self.count(), 1)
        return offset

    def texts(self) -> tuple[str, ...]:
        """A sequence of strings, which are part of the layout."""
        number, texts = self.count(), []
        if number > MAX_JOINTS:
            raise ValueError('too many names')
        for _ in range(number):
            size = self.count()
            offset = self.take(size, 1)
            self._deciding.append(np.arange(offset, offset + size))
            texts.append(self._payload[offset:offset + size].rstrip(b'\0').decode())
        return tuple(texts)

    def doubles(self, number: int | None = None) -> tuple[int, int]:
        """Offset and number of float64 values; without `number` a sequence, its length first."""
        number = self.count() if number is None else number
        if number > self.size:
            raise ValueError('too many values')
        return self.take(8 * number, 8 if number else 1), number


class Group(NamedTuple):
    """Messages laid out alike: which they are, and their fields."""

    rows: np.ndarray
    names: tuple[str, ...]
    stamp: np.ndarray | None
    fields: list[np.ndarray]


def pressure_fields(layout: _Layout) -> tuple[int | None, list[tuple[int, int]]]:
    """Where FluidPressure's stamp and values lie."""
    return layout.stamp(), [layout.doubles(1), layout.doubles(1)]


def joint_fields(layout: _Layout) -> tuple[int | None, list[tuple[int, int]]]:
    """Where JointState's stamp and values lie: position, velocity and effort."""
    stamp = layout.stamp()
    layout.names = layout.texts()
    fields = [layout.doubles() for _ in range(3)]
    if any(number not in (0, len(layout.names)) for _, number in fields):
        raise ValueError('as many values as names, or none')
    return stamp, fields


def scalar_fields(layout: _Layout) -> tuple[int | None, list[tuple[int, int]]]:
    """Where Float64's value lies."""
    return None, [layout.doubles(1)]


def decode(fields_of: Callable, data: np.ndarray, start: np.ndarray,
           stop: np.ndarray) -> tuple[list[Group], int]:
    """Groups of messages laid out alike, and how many could not be decoded.

    `data` holds the bytes, message i at `start[i]:stop[i]`; `fields_of` is one of the three above.
    """
    groups, malformed = [], 0
    left = np.arange(len(start))
    while left.size:
        first = left[0]
        try:
            layout = _Layout(data[start[first]:stop[first]].tobytes())
            stamp, fields = fields_of(layout)
        except ValueError:
            malformed += 1
            left = left[1:]
            continue
        alike = _alike(layout.deciding, layout.size, data, start[left], stop[left])
        rows = left[alike]
        groups.append(Group(rows, layout.names, _stamps(data, start[rows], stamp, layout.order),
                            [_doubles(data, start[rows], *field, layout.order)
                             for field in fields]))
        left = left[~alike]
    return groups, malformed


def _alike(deciding: np.ndarray, size: int, data: np.ndarray, start: np.ndarray,
           stop: np.ndarray) -> np.ndarray:
    """Which messages are laid out as the first one."""
    alike = stop - start == size
    patterns = data[start[alike][:, None] + deciding]
    alike[alike] = (patterns == patterns[0]).all(axis=1)
    return alike


def _stamps(data: np.ndarray, start: np.ndarray, offset: int | None,
            order: str) -> np.ndarray | None:
    """Header stamps, ns."""
    if offset is None:
        return None
    words = data[start[:, None] + np.arange(offset, offset + 8)]
    return (words[:, :4].copy().view(order + 'i4')[:, 0].astype(np.int64) * 1_000_000_000
            + words[:, 4:].copy().view(order + 'u4')[:, 0])


def _doubles(data: np.ndarray, start: np.ndarray, offset: int, number: int,
             order: str) -> np.ndarray:
    """Values, one row per message."""
    if number == 0:
        return np.empty((len(start), 0))
    words = data[start[:, None] + np.arange(offset, offset + 8 * number)]
    return words.view(order + 'f8').astype(np.float64)
