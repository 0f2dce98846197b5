"""Follows a recording while it grows, from file to file."""

import os
from collections.abc import Iterator
from pathlib import Path

from .parts import find_parts, resolve
from .reader import Message, Signal, signals_in
from .scan import Block, Scan
from .summary import FRAME, RecordingError

DATA_END = 15  # the opcode behind the last message of a finished file


class Follower:
    """
    What is new in the recording at `path`, each time it is asked.

    Nothing is locked, nothing is written: who records does not notice. `scan` is the file at hand,
    `finished` whether its end has been met and there is no further part. Raises RecordingError.
    """

    def __init__(self, path: str | os.PathLike, from_end: bool = False):
        self._named = resolve(path)
        parts = find_parts(self._named)
        self._seen = {part.name for part in parts}
        self.scan = _Growing(parts[-1])
        self.finished = False
        if from_end:
            for _ in self.scan.grown():
                pass

    def read(self) -> tuple[dict[str, Signal], list[Message]]:
        """The signals by topic that were recorded since the last call, and all other messages."""
        blocks = list(self.scan.grown())
        signals = signals_in(self.scan, blocks)
        others = [message for block in blocks for message in self._messages(block, signals)]
        self.finished = self.scan.reached_end and not self._go_on()
        return signals, others

    def close(self) -> None:
        """Let go of the file."""
        self.scan.__exit__()

    def _messages(self, block: Block, but: dict) -> Iterator[Message]:
        """The messages of the topics that are no signals."""
        for channel, sequence, log_time, publish_time, first, last in zip(
                *(column.tolist() for column in block[1:]), strict=True):
            topic = self.scan.channels[channel].topic
            if topic not in but:
                yield Message(topic, self.scan.type_name(channel), log_time, publish_time,
                              sequence, block.data[first:last].tobytes())

    def _go_on(self) -> bool:
        """Turn to the next file of the recording; False if there is none yet."""
        for part in find_parts(self._named):
            if part.name not in self._seen:
                try:
                    scan = _Growing(part)
                except RecordingError:
                    return False  # it has only just been made
                self.close()
                self._seen.add(part.name)
                self.scan = scan
                return True
        return False


class _Growing(Scan):
    """A scan that takes up again where the file ended; half a record waits for its other half."""

    def __init__(self, path: Path):
        super().__init__(path)
        self.summary = None  # what an index says is not needed, and there is none at first

    def grown(self) -> Iterator[Block]:
        """The messages behind those of the last call."""
        if self.reached_end:
            return
        self.size = self._whole()
        if self.size > self.position:
            yield from self.blocks()

    def _whole(self) -> int:
        """Where the last whole record ends."""
        size, at = os.fstat(self._file.fileno()).st_size, self.position
        while at + FRAME.size <= size:
            self._file.seek(at)
            opcode, length = FRAME.unpack(self._file.read(FRAME.size))
            if opcode == 0 or at + FRAME.size + length > size:
                break
            at += FRAME.size + length
            if opcode == DATA_END:
                break
        return at
