"""diagnostic_msgs/DiagnosticArray from the bytes of a recording."""
from __future__ import annotations

import struct
from dataclasses import dataclass

TYPE = 'diagnostic_msgs/msg/DiagnosticArray'
ENCAPSULATION = 4


@dataclass
class Status:
    """One diagnostic status at `time` (ns); `level` is 0 OK, 1 WARN, 2 ERROR, 3 STALE."""

    time: int
    name: str
    level: int
    message: str


class _Cursor:
    """Takes fields off a CDR payload; IndexError or struct.error where it ends too early."""

    def __init__(self, payload: bytes):
        self._payload = payload[ENCAPSULATION:]
        self._order = '<' if payload[1] & 1 else '>'
        self._at = 0

    def number(self) -> int:
        """Return the next uint32, aligned."""
        self._at += -self._at % 4
        (value,) = struct.unpack_from(f'{self._order}I', self._payload, self._at)
        self._at += 4
        return value

    def byte(self) -> int:
        """Return the next byte."""
        self._at += 1
        return self._payload[self._at - 1]

    def text(self) -> str:
        """Return the next string."""
        size = self.number()
        self._at += size
        return self._payload[self._at - size:self._at].rstrip(b'\0').decode(errors='replace')


def statuses(time: int, payload: bytes) -> list[Status]:
    """Return the statuses in one message recorded at `time` (ns); what is malformed is left out."""
    found = []
    try:
        cursor = _Cursor(payload)
        cursor.number(), cursor.number(), cursor.text()  # stamp and frame
        for _ in range(cursor.number()):
            level, name, message, _hardware = (
                cursor.byte(), cursor.text(), cursor.text(), cursor.text())
            for _ in range(2 * cursor.number()):
                cursor.text()
            found.append(Status(time, name, level, message))
    except (IndexError, struct.error):
        pass
    return found
