"""Messages built once: a template per topic, in which a tick patches stamp and values."""
from __future__ import annotations

import struct

from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Header

from hpv_twin.recording.layout import Layout

from .interface import JOINTS, PRESSURE_FRAME

STAMP = struct.Struct('<iI')
SECOND = 1_000_000_000
# A header of four bytes and the number; the second byte tells version and byte order of the CDR.
FLOAT64_SIZE = 12
BYTE_ORDERS = {0: '>d', 1: '<d', 6: '>d', 7: '<d'}
# Values that occur nowhere else in a message: where their bytes stand, the fields stand.
MARK_SECONDS, MARK_NANOSECONDS = 0x5A17_C0DE, 0x2B1D_FACE
MARKS = tuple(-1.2345678901234567e+100 * (k + 1) for k in range(6))


class Template:
    """
    The bytes of a message with a stamp and a few float64 fields that change.

    `build(seconds, nanoseconds, values)` makes the message; it is called at construction only, to
    find the fields and to check that patched bytes read as the message that they stand for.
    """

    def __init__(self, build, values: int):
        self._build = build
        marks = MARKS[:values]
        data = serialize_message(build(MARK_SECONDS, MARK_NANOSECONDS, marks))
        self._bytes = bytearray(data)
        self._stamp = data.index(STAMP.pack(MARK_SECONDS, MARK_NANOSECONDS))
        slots = [data.index(struct.pack('<d', mark)) for mark in marks]
        self._runs = runs_of(slots)
        self.layout = Layout(data, self._stamp, tuple(slots))
        self._values = values
        self.exact = self._check()

    def _check(self):
        """See that patched bytes read as the message they stand for; else they are never used."""
        for seconds, nanoseconds in ((1, 2), (2_000_000_000, 999_999_999)):
            values = [0.1 * seconds + k for k in range(self._values)]
            message = self._build(seconds, nanoseconds, values)
            # Not byte by byte: the serializer leaves what is in its padding to chance.
            patched = self.patched(seconds * SECOND + nanoseconds, *values)
            if (len(patched) != len(serialize_message(message))
                    or deserialize_message(patched, type(message)) != message):
                return False
        return True

    def patched(self, stamp: int, *values: float) -> bytes:
        """The message with this stamp, ns, and these values, by patching."""
        STAMP.pack_into(self._bytes, self._stamp, stamp // SECOND, stamp % SECOND)
        first = 0
        for offset, layout, count in self._runs:
            layout.pack_into(self._bytes, offset, *values[first:first + count])
            first += count
        return bytes(self._bytes)

    def serialized(self, stamp: int, *values: float) -> bytes:
        """The message with this stamp, ns, and these values, by the serializer."""
        return serialize_message(self._build(stamp // SECOND, stamp % SECOND, values))

    def message(self, stamp: int, *values: float) -> bytes:
        """The message, by patching where the self-check has allowed it."""
        return (self.patched if self.exact else self.serialized)(stamp, *values)


def float_value(payload: bytes) -> float | None:
    """
    The value of a serialized std_msgs/Float64; None for bytes that are none.

    The middleware drops a message that it cannot read without a word. Taken as it came, it can be
    counted and told of.
    """
    if len(payload) != FLOAT64_SIZE or payload[0] or payload[1] not in BYTE_ORDERS:
        return None
    return struct.unpack_from(BYTE_ORDERS[payload[1]], payload, 4)[0]


def runs_of(slots: list[int]) -> list[tuple[int, struct.Struct, int]]:
    """Offsets of float64 fields, joined where they lie side by side: (offset, layout, fields)."""
    runs = []
    for slot in slots:
        if runs and slot == runs[-1][0] + 8 * runs[-1][1]:
            runs[-1][1] += 1
        else:
            runs.append([slot, 1])
    return [(offset, struct.Struct(f'<{count}d'), count) for offset, count in runs]


def pressure_template() -> Template:
    """FluidPressure; value: absolute pressure in Pa."""
    def build(seconds, nanoseconds, values):
        header = Header(stamp=Time(sec=seconds, nanosec=nanoseconds), frame_id=PRESSURE_FRAME)
        return FluidPressure(header=header, fluid_pressure=values[0], variance=0.0)
    return Template(build, 1)


def position_template() -> Template:
    """JointState; values: both positions m, both velocities m/s, both efforts N."""
    def build(seconds, nanoseconds, values):
        header = Header(stamp=Time(sec=seconds, nanosec=nanoseconds))
        values = list(values)
        return JointState(header=header, name=list(JOINTS), position=values[0:2],
                          velocity=values[2:4], effort=values[4:6])
    return Template(build, 6)


def fine_position_template() -> Template:
    """JointState; values: both positions m, both velocities m/s; no efforts."""
    def build(seconds, nanoseconds, values):
        header = Header(stamp=Time(sec=seconds, nanosec=nanoseconds))
        values = list(values)
        return JointState(header=header, name=list(JOINTS), position=values[0:2],
                          velocity=values[2:4])
    return Template(build, 4)
