"""What a recording says of itself: topics, counts, times, metadata, attachments, its design."""

import os
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .files import size_of
from .parts import find_parts, resolve
from .scan import Scan
from .segment import CLOSING_RECORD, OPENING_RECORD
from .summary import RecordingError

DESIGN = 'vibrator.yaml'
# Noted at the end of each part for that part alone.
COUNTERS = ('recording.messages', 'recording.dropped', 'recording.rejected', 'recording.gaps')
OPENING = ('recording.opened', 'recording.part', 'recording.continues')


class Topic(NamedTuple):
    """The message type of a topic and how many messages a recording holds."""

    type_name: str
    count: int


@dataclass(frozen=True)
class Recording:
    """What a recording says of itself.

    `path`: the file, or the folder of a recording in several `parts`. `complete`: it was finished
    and its index is intact; otherwise `problem` says in one line what is wrong. `metadata` is what
    the recorder was given, with what it noted at the end; `records` holds all metadata records by
    name. `start`, `end`: first and last log time in ns, None without messages. `size` in bytes.
    """

    path: Path
    complete: bool
    problem: str
    size: int
    library: str
    metadata: dict[str, str]
    records: dict[str, dict[str, str]]
    attachments: dict[str, bytes]
    topics: dict[str, Topic]
    start: int | None
    end: int | None
    parts: tuple[Path, ...] = ()

    @property
    def messages(self) -> int:
        """How many messages there are in all."""
        return sum(topic.count for topic in self.topics.values())


def describe(path: str | os.PathLike) -> Recording:
    """What is in a recording; a file with an index is not read through. Raises RecordingError.

    Of several parts those that are no MCAP files at all are passed over, and `problem` says so.
    """
    files, told, refusals = find_parts(path), [], []
    for file in files:
        try:
            told.append(describe_part(file))
        except RecordingError as error:
            refusals.append(error)
    if not told:
        raise refusals[0]
    where = resolve(path)
    return told[0] if where == files[0] else _joined(where, files, told, refusals)


def describe_part(path: Path) -> Recording:
    """What is in one file. Raises RecordingError."""
    with Scan(path) as scan:
        counts, start, end = _indexed(scan) or _counted(scan)
        topics, every = _topics(scan, counts), {}
        for record in scan.metadata:
            every[record.name] = every.get(record.name, {}) | record.metadata
        problem = scan.problem or (scan.troubles[0].reason if scan.troubles else '')
        return Recording(
            Path(path).absolute(), not problem, problem, scan.size, scan.header.library,
            every.get(OPENING_RECORD, {}) | every.get(CLOSING_RECORD, {}), every,
            {record.name: record.data for record in scan.attachments}, topics, start, end,
            (Path(path).absolute(),))


def attached_design(path: str | os.PathLike) -> str:
    """The design (YAML text) that a recording carries. Raises RecordingError if it has none."""
    about = describe(path)
    if DESIGN not in about.attachments:
        there = ', '.join(sorted(about.attachments)) or 'none'
        raise RecordingError(f'{about.path}: no design is attached to it ({DESIGN}); the '
                             f'attachments are: {there}')
    try:
        return about.attachments[DESIGN].decode()
    except UnicodeError:
        raise RecordingError(f'{about.path}: the design attached to it is no text') from None


def _joined(folder: Path, files: Sequence[Path], told: list[Recording],
            refusals: list[RecordingError]) -> Recording:
    """The parts of a recording as one."""
    problems = [f'{part.path.name}: {part.problem}' for part in told if part.problem]
    problem = '; '.join(problems + [str(error) for error in refusals])
    times = [time for part in told for time in (part.start, part.end) if time is not None]
    records: dict[str, dict[str, str]] = {}
    for part in told:
        for name, record in part.records.items():
            records[name] = records.get(name, {}) | record
    return Recording(
        folder, not problem, problem, sum(size_of(file) for file in files), told[0].library,
        _joined_metadata(told), records, reduce(dict.__or__, (p.attachments for p in told)),
        _joined_topics(told), min(times, default=None), max(times, default=None), tuple(files))


def _joined_metadata(told: list[Recording]) -> dict[str, str]:
    """The last word of each part, the first part's opening, and counts in all."""
    joined = reduce(dict.__or__, (part.metadata for part in told))
    joined |= {key: told[0].metadata[key] for key in OPENING if key in told[0].metadata}
    counts = defaultdict(int)
    for part in told:
        for key, text in part.metadata.items():
            if key.startswith(COUNTERS) and text.isdecimal():
                counts[key] += int(text)
    return joined | {key: str(count) for key, count in counts.items()}


def _joined_topics(told: list[Recording]) -> dict[str, Topic]:
    topics: dict[str, Topic] = {}
    for part in told:
        for name, topic in part.topics.items():
            before = topics.get(name, topic._replace(count=0))
            topics[name] = before._replace(count=before.count + topic.count)
    return topics


def _indexed(scan: Scan) -> tuple[dict[int, int], int | None, int | None] | None:
    """Messages per channel, first and last log time, as the index says; None if it does not."""
    if scan.summary is None or not scan.summary.names_all:
        return None
    scan.learn_indexed()
    statistics = scan.summary.statistics
    if not statistics.message_count:
        return {}, None, None
    return (dict(statistics.channel_message_counts), statistics.message_start_time,
            statistics.message_end_time)


def _counted(scan: Scan) -> tuple[dict[int, int], int | None, int | None]:
    """Messages per channel, first and last log time, by reading through the file."""
    counts, spans = defaultdict(int), []
    for block in scan.blocks():
        for number, count in zip(*np.unique(block.channel, return_counts=True), strict=True):
            counts[int(number)] += int(count)
        if block.channel.size:
            spans += [int(block.log_time.min()), int(block.log_time.max())]
    return counts, min(spans, default=None), max(spans, default=None)


def _topics(scan: Scan, counts: dict[int, int]) -> dict[str, Topic]:
    topics: dict[str, Topic] = {}
    for number, channel in scan.channels.items():
        before = topics.get(channel.topic, Topic(scan.type_name(number), 0))
        topics[channel.topic] = before._replace(count=before.count + counts.get(number, 0))
    return topics
