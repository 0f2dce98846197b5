"""Writes a machine's measurements, made or taken elsewhere, into a recording; without ROS."""
from __future__ import annotations

import os
import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from .files import DataFile
from .schemas import RULE, Channel, qos_text
from .segment import Segment

PRESSURE_TYPE, JOINT_TYPE = 'sensor_msgs/msg/FluidPressure', 'sensor_msgs/msg/JointState'
SECOND = 1_000_000_000
# The definitions without their comments, and the hashes that the ROS 2 packages ship.
HEADER = (f'\n{RULE}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n'
          f'\n{RULE}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n')
SCHEMAS = {
    PRESSURE_TYPE: 'std_msgs/Header header\nfloat64 fluid_pressure\nfloat64 variance\n' + HEADER,
    JOINT_TYPE: 'std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n'
                'float64[] effort\n' + HEADER,
}
HASHES = {
    PRESSURE_TYPE: 'RIHS01_22dfb2b145a0bd5a31a1ac3882a1b32148b51d9b2f3bab250290d66f3595bc32',
    JOINT_TYPE: 'RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e',
}
# CDR, little-endian: encapsulation, stamp, then what the message is made of. Padding is spelt out.
PRESSURE_LAYOUT = struct.Struct('<4s iI I9s3x dd')
JOINT_LAYOUT = struct.Struct('<4s iI I1s3x I I8s I4x d II')
LITTLE_ENDIAN = b'\0\1\0\0'


class MeasurementFile:
    """
    A recording of sensors alone, in work: FluidPressure and, where there is one, JointState.

    `topics` are those of pressure and of plunger position (one joint, `plunger`). Raises OSError
    (FileExistsError if `path` exists). Use it with `with`: the file is finished at the end.
    """

    def __init__(self, path: str | os.PathLike,
                 topics: tuple[str, str] = ('/machine/pressure', '/machine/plunger_position'),
                 metadata: Mapping[str, str] | None = None,
                 attachments: Mapping[str, bytes] | None = None):
        channels = [Channel(topic, kind, SCHEMAS[kind], HASHES[kind], qos_text())
                    for topic, kind in zip(topics, (PRESSURE_TYPE, JOINT_TYPE), strict=True)]
        self._segment = Segment(DataFile(Path(path)), channels, metadata or {}, attachments or {})
        self._sequence = 0

    def write(self, time: np.ndarray, pressure: np.ndarray,
              position: np.ndarray | None = None) -> None:
        """Append samples: `time` in ns, absolute `pressure` in Pa, plunger `position` in m."""
        positions = [None] * len(time) if position is None else position.tolist()
        append, sequence = self._segment.append, self._sequence
        for stamp, pressed, moved in zip(time.tolist(), pressure.tolist(), positions,
                                         strict=True):
            append(0, stamp, pressure_payload(stamp, pressed), sequence)
            if moved is not None:
                append(1, stamp, joint_payload(stamp, moved), sequence)
            sequence += 1
        self._sequence = sequence

    def __enter__(self) -> MeasurementFile:
        """Return the file itself."""
        return self

    def __exit__(self, kind, *_) -> None:
        """Finish the file, or leave it as it is where writing failed."""
        if kind is not None and issubclass(kind, OSError):
            self._segment.abandon()
        elif trouble := self._segment.finish({}):
            raise OSError(f'{self._segment.path}: {trouble}')


def pressure_payload(stamp: int, pressure: float) -> bytes:
    """Return a serialized FluidPressure; `stamp` in ns, absolute pressure in Pa."""
    return PRESSURE_LAYOUT.pack(LITTLE_ENDIAN, stamp // SECOND, stamp % SECOND, 9, b'cavity_a\0',
                                pressure, 0.0)


def joint_payload(stamp: int, position: float) -> bytes:
    """Return a serialized JointState of the joint `plunger`; `stamp` in ns, position in m."""
    return JOINT_LAYOUT.pack(LITTLE_ENDIAN, stamp // SECOND, stamp % SECOND, 1, b'\0', 1, 8,
                             b'plunger\0', 1, position, 0, 0)
