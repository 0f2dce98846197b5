"""`hpv-twin recover`: a readable copy of a recording that was not finished, or is damaged."""

import argparse
import contextlib
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.writer import Writer

from . import LIBRARY
from .bag import write_metadata
from .files import readable_size
from .parts import find_parts, is_recording
from .scan import Block, Scan, Trouble
from .segment import CHUNK_SIZE, COMPRESSION
from .summary import RecordingError

Progress = Callable[[int, int], None]
WHOLE, NOTHING, LOST = 0, 1, 3
MAX_TROUBLES = 10  # told one by one
RECOVERED_RECORD = 'hpv_twin_recovered'
DESCRIPTION = """\
Make a readable copy of a recording that was not finished (the process was killed, the power
failed, the disk was full) or is damaged. Everything that can be understood is copied: messages
with their times, metadata, attachments. The file itself is never changed."""
EPILOG = """\
exit status: 0 the recording was whole; 3 something is lost; 1 nothing could be copied.
A recording that was not finished counts as 3 even if every byte of it is understood: the messages
of its last quarter of a second never reached the disk.

examples:
  hpv-twin recover bags/hpv_twin_20250131T120000.000Z.mcap
  hpv-twin recover bags/hpv_twin_20250131T120000.000Z        the folder of a split recording"""


@dataclass
class Recovery:
    """What was copied and what was not.

    `counts` messages by topic; `spans` their first and last log times (ns), piece by piece;
    `problem` what is wrong with the index; `finished_data`, whether the data reach their end.
    """

    source: Path
    output: Path
    size: int
    problem: str = ''
    finished_data: bool = True
    troubles: list[Trouble] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    spans: list[int] = field(default_factory=list)

    @property
    def lost(self) -> int:
        """Bytes that were not understood."""
        return sum(trouble.length for trouble in self.troubles)

    @property
    def whole(self) -> bool:
        """Whether the file held everything that was written to it, its end included."""
        return self.finished_data and not self.troubles


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; the exit status is 0, 3 or 1 as `--help` says."""
    parser = argparse.ArgumentParser('hpv-twin recover', description=DESCRIPTION, epilog=EPILOG,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('file', metavar='FILE', type=Path,
                        help='the recording: a file (.mcap), or the folder of one that was split')
    parser.add_argument('-o', '--output', metavar='OUT', type=Path,
                        help='the copy; default: FILE_recovered.mcap beside FILE, or '
                             'FOLDER_recovered. What exists is never overwritten')
    options = parser.parse_args(argv)
    source = options.file
    beside = (f'{source.name}_recovered' if source.is_dir() else f'{source.stem}_recovered.mcap')
    output = options.output or source.parent / beside
    try:
        if source.is_dir():
            return recover_folder(source, output)
        return recover_file(source, output)
    except RecordingError as error:
        return _refuse(str(error))
    except OSError as error:
        return _refuse(f'{error.filename or output}: {error.strerror}')
    except KeyboardInterrupt:
        return _refuse('interrupted; parts that were done are kept' if source.is_dir()
                       else 'interrupted, nothing was written')


def recover_file(source: Path, output: Path) -> int:
    """Recover one file and say what became of it; the exit status."""
    progress = _Progress()
    try:
        recovery = recover(source, output, progress)
    finally:
        progress.end()
    print('\n'.join(_report(recovery)))
    return WHOLE if recovery.whole else LOST


def recover_folder(folder: Path, output: Path) -> int:
    """Recover the parts of a split recording into a folder with metadata.yaml; the exit status."""
    if not is_recording(folder):
        raise RecordingError(f'{folder}: this folder is not one recording; name a recording in it')
    parts = find_parts(folder)
    if output.exists():
        raise FileExistsError(17, 'not overwritten, it exists', str(output))
    output.mkdir(parents=True)
    outcomes = []
    for part in parts:
        print(f'{part.name}:')
        try:
            outcomes.append(recover_file(part, output / part.name))
        except RecordingError as error:
            print(error)
            outcomes.append(NOTHING)
    write_metadata(output)
    if set(outcomes) == {NOTHING}:
        output.rmdir()
        return NOTHING
    return WHOLE if set(outcomes) == {WHOLE} else LOST


def _refuse(text: str) -> int:
    print(f'hpv-twin recover: {text}', file=sys.stderr)
    return NOTHING


def recover(source: Path, output: Path, progress: Progress | None = None) -> Recovery:
    """Copy what can be understood of `source` into a new file `output`.

    `progress(done, size)` is told bytes. Raises RecordingError if there is nothing to copy, and
    OSError (FileExistsError if `output` exists); nothing is left behind then.
    """
    with Scan(source) as scan:
        if output.exists():
            raise FileExistsError(17, 'not overwritten, it exists', str(output))
        recovery = Recovery(source, output, scan.size, scan.problem)
        draft = output.with_name(f'.{output.name}.part{os.getpid()}')
        try:
            with open(draft, 'xb') as file:
                _Copier(scan, file, recovery).run(progress)
                recovery.troubles, recovery.finished_data = scan.troubles, scan.reached_end
                os.fsync(file.fileno())
            if not recovery.counts:
                raise RecordingError(f'{source}: not a single message can be recovered')
            if output.exists():
                raise FileExistsError(17, 'not overwritten, it exists', str(output))
            draft.rename(output)
        finally:
            with contextlib.suppress(FileNotFoundError):
                draft.unlink()
    return recovery


class _Copier:
    """Writes what a scan yields into `file`, with an index at its end."""

    def __init__(self, scan: Scan, file: BinaryIO, recovery: Recovery):
        self._scan = scan
        self._recovery = recovery
        self._writer = Writer(file, chunk_size=CHUNK_SIZE, compression=COMPRESSION)
        self._schemas = {0: 0}
        self._channels: dict[int, int] = {}
        self._metadata = self._attachments = 0

    def run(self, progress: Progress | None) -> None:
        """Copy everything; raises OSError."""
        for number, block in enumerate(self._scan.blocks()):
            if number == 0:
                header = self._scan.header
                self._writer.start(header.profile, f'{LIBRARY}; recovered, {header.library}')
            self._extras()
            self._register()
            self._messages(block)
            if progress:
                progress(self._scan.position, self._scan.size)
        self._writer.add_metadata(RECOVERED_RECORD, {
            'source': self._recovery.source.name, 'problem': self._scan.problem,
            'recovered': datetime.now(UTC).isoformat(timespec='seconds'),
            'messages': str(self._recovery.counts.total()),
            'bytes_not_understood': str(sum(t.length for t in self._scan.troubles))})
        self._writer.finish()

    def _extras(self) -> None:
        """Metadata and attachments that were met since the last time."""
        for record in self._scan.metadata[self._metadata:]:
            self._writer.add_metadata(record.name, record.metadata)
        for record in self._scan.attachments[self._attachments:]:
            self._writer.add_attachment(record.create_time, record.log_time, record.name,
                                        record.media_type, record.data)
        self._metadata = len(self._scan.metadata)
        self._attachments = len(self._scan.attachments)

    def _register(self) -> None:
        """Schemas and channels that were met since the last time."""
        for number, schema in self._scan.schemas.items():
            if number not in self._schemas:
                self._schemas[number] = self._writer.register_schema(
                    schema.name, schema.encoding, schema.data)
        for number, channel in self._scan.channels.items():
            if number not in self._channels:
                self._channels[number] = self._writer.register_channel(
                    channel.topic, channel.message_encoding,
                    self._schemas.get(channel.schema_id, 0), channel.metadata)

    def _messages(self, block: Block) -> None:
        data, add = block.data.tobytes(), self._writer.add_message
        for channel, sequence, log_time, publish_time, first, last in zip(
                *(column.tolist() for column in block[1:]), strict=True):
            add(self._channels[channel], log_time, data[first:last], publish_time, sequence)
        numbers, counts = np.unique(block.channel, return_counts=True)
        for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
            self._recovery.counts[self._scan.channels[number].topic] += count
        if numbers.size:
            self._recovery.spans += [int(block.log_time.min()), int(block.log_time.max())]


class _Progress:
    """A line on the terminal that tells how far a big file is read."""

    def __init__(self):
        self._next = time.monotonic() + 0.5
        self._shown = False

    def __call__(self, done: int, size: int) -> None:
        if sys.stderr.isatty() and time.monotonic() >= self._next:
            self._next, self._shown = time.monotonic() + 0.2, True
            print(f'\r{100 * done // size:3d} % of {readable_size(size)} read', end='',
                  file=sys.stderr, flush=True)

    def end(self) -> None:
        """Clear the line."""
        if self._shown:
            print('\r\033[K', end='', file=sys.stderr, flush=True)


def _report(recovery: Recovery) -> Iterator[str]:
    """What was kept and what was lost, line by line."""
    first, last = min(recovery.spans), max(recovery.spans)
    yield (f'kept {recovery.counts.total()} messages over {(last - first) / 1e9:.3f} s, '
           f'{_utc(first)} to {_utc(last)}')
    width = len(str(max(recovery.counts.values())))
    for topic, count in sorted(recovery.counts.items()):
        yield f'  {count:{width}d}  {topic}'
    if recovery.whole:
        index = f'; only {recovery.problem}' if recovery.problem else ''
        yield f'nothing is lost{index}'
    for trouble in recovery.troubles[:MAX_TROUBLES]:
        yield f'lost {trouble.length} bytes from byte {trouble.offset}: {trouble.reason}'
    if len(recovery.troubles) > MAX_TROUBLES:
        yield f'and {len(recovery.troubles) - MAX_TROUBLES} more such places'
    if recovery.troubles:
        yield f'not understood: {recovery.lost} of {recovery.size} bytes'
    if not recovery.finished_data:
        yield ('the recording was not finished: messages of its last moments, a quarter of a '
               'second as a rule, never reached the disk')
    yield f'written: {recovery.output} ({readable_size(recovery.output.stat().st_size)})'


def _utc(stamp: int) -> str:
    when = datetime.fromtimestamp(stamp / 1e9, UTC)
    return f'{when:%Y-%m-%d %H:%M:%S}.{stamp // 1_000_000 % 1000:03d} UTC'
