"""Reads recordings: what is in a file, its signals as arrays, its messages one by one.

Files that were never finished, or are damaged, are read as far as they can be understood.
"""

import os
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from . import cdr
from .cdr import JointSignal, PressureSignal, ScalarSignal
from .files import STAMP, SUFFIX
from .scan import Scan
from .segment import CLOSING_RECORD, OPENING_RECORD
from .summary import RecordingError

__all__ = ['JointSignal', 'Message', 'PressureSignal', 'Recording', 'RecordingError',
           'ScalarSignal', 'Topic', 'describe', 'find_recordings', 'messages', 'read_signals']

Signal = PressureSignal | JointSignal | ScalarSignal
FIELDS = {'sensor_msgs/msg/FluidPressure': cdr.pressure_fields,
          'sensor_msgs/msg/JointState': cdr.joint_fields,
          'std_msgs/msg/Float64': cdr.scalar_fields}
NAME_STAMP = re.compile(rf'_({STAMP})')


class Topic(NamedTuple):
    """The message type of a topic and how many messages a file holds."""

    type_name: str
    count: int


class Message(NamedTuple):
    """One message as it was recorded; times in ns, `payload` in CDR."""

    topic: str
    type_name: str
    log_time: int
    publish_time: int
    sequence: int
    payload: bytes


@dataclass(frozen=True)
class Recording:
    """What a file says of itself.

    `complete`: it was finished and its index is intact; otherwise `problem` says in one line what
    is wrong. `metadata` is what the recorder was given, with what it noted at the end; `records`
    holds all metadata records by name. `start`, `end`: first and last log time in ns, None
    without messages. `size` in bytes.
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

    @property
    def messages(self) -> int:
        """How many messages there are in all."""
        return sum(topic.count for topic in self.topics.values())


def describe(path: str | os.PathLike) -> Recording:
    """What is in a recording; a file with an index is not read through. Raises RecordingError."""
    with Scan(path) as scan:
        counts, start, end = _indexed(scan) or _counted(scan)
        topics, every = _topics(scan, counts), {}
        for record in scan.metadata:
            every[record.name] = every.get(record.name, {}) | record.metadata
        problem = scan.problem or (scan.troubles[0].reason if scan.troubles else '')
        return Recording(
            Path(path).absolute(), not problem, problem, scan.size, scan.header.library,
            every.get(OPENING_RECORD, {}) | every.get(CLOSING_RECORD, {}), every,
            {record.name: record.data for record in scan.attachments}, topics, start, end)


def messages(path: str | os.PathLike, topics: Iterable[str] | None = None,
             start: int | None = None, end: int | None = None) -> Iterator[Message]:
    """Every message with `start` <= log time < `end` (ns), in file order. Raises RecordingError."""
    wanted = None if topics is None else set(topics)
    with Scan(path) as scan:
        for block in scan.blocks(start, end):
            names = {number: (channel.topic, scan.type_name(number))
                     for number, channel in scan.channels.items()
                     if wanted is None or channel.topic in wanted}
            data = block.data.tobytes()
            for channel, sequence, log_time, publish_time, first, last in zip(
                    *(column.tolist() for column in block[1:]), strict=True):
                if channel in names:
                    yield Message(*names[channel], log_time, publish_time, sequence,
                                  data[first:last])


def read_signals(path: str | os.PathLike, topics: Iterable[str] | None = None,
                 start: int | None = None, end: int | None = None,
                 progress: Callable[[int, int], None] | None = None) -> dict[str, Signal]:
    """The signals of a recording as arrays, by topic, each in ascending time.

    Without `topics`: all of FluidPressure, JointState and Float64. `start` <= log time < `end`, in
    ns. `time` is the stamp in the header; the log time where there is none, or where it is 0.
    `progress(done, size)` is told bytes. Raises RecordingError, also for a topic that is not there
    or is of another type.
    """
    wanted = None if topics is None else set(topics)
    pieces, malformed, seen = defaultdict(list), defaultdict(int), 0
    with Scan(path) as scan:
        for block in scan.blocks(start, end):
            for number, fields_of in _readable(scan, wanted).items():
                topic = scan.channels[number].topic
                part = block.only(block.channel == number)
                groups, bad = cdr.decode(fields_of, part.data, part.start, part.stop)
                malformed[topic] += bad
                pieces[topic] += [_Piece(_times(group, part.log_time), seen + group.rows, group)
                                  for group in groups]
                seen += part.channel.size
            if progress:
                progress(scan.position, scan.size)
        types = {channel.topic: scan.type_name(number)
                 for number, channel in scan.channels.items()}
    _refuse_unreadable(path, wanted, types)
    return {topic: _signal(types[topic], pieces[topic], malformed[topic])
            for topic in types if types[topic] in FIELDS and (wanted is None or topic in wanted)}


def find_recordings(directory: str | os.PathLike) -> list[Path]:
    """The MCAP files in a directory, newest first; none if there is no such directory.

    The time is that in the file's name, else that of its last change.
    """
    directory = Path(directory)
    if not directory.is_dir():
        return []
    files = (path for path in directory.iterdir() if path.suffix == SUFFIX and path.is_file())
    return sorted(files, key=lambda path: (_time_of(path), path.name), reverse=True)


def _time_of(path: Path) -> float:
    """Seconds since the epoch."""
    stamps = NAME_STAMP.findall(path.name)
    try:
        when = datetime.strptime(stamps[-1], '%Y%m%dT%H%M%S.%fZ')
        return when.replace(tzinfo=UTC).timestamp()
    except (IndexError, ValueError):
        return path.stat().st_mtime


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


def _readable(scan: Scan, wanted: set[str] | None) -> dict[int, Callable]:
    """How to decode the channels that are wanted, by number."""
    return {number: FIELDS[scan.type_name(number)]
            for number, channel in scan.channels.items()
            if channel.message_encoding == 'cdr' and scan.type_name(number) in FIELDS
            and (wanted is None or channel.topic in wanted)}


def _refuse_unreadable(path: str | os.PathLike, wanted: set[str] | None,
                       types: dict[str, str]) -> None:
    for topic in sorted(wanted or ()):
        if topic not in types:
            there = ', '.join(sorted(types)) or 'none'
            raise RecordingError(f'{path}: there is no topic {topic}; the topics are: {there}')
        if types[topic] not in FIELDS:
            raise RecordingError(f'{path}: {topic} is of type {types[topic]}; readable as signals '
                                 f'are {", ".join(FIELDS)}')


class _Piece(NamedTuple):
    """Messages laid out alike, with their times and their places in the order of the file."""

    time: np.ndarray
    place: np.ndarray
    group: cdr.Group


def _times(group: cdr.Group, log_time: np.ndarray) -> np.ndarray:
    if group.stamp is None:
        return log_time[group.rows]
    return np.where(group.stamp == 0, log_time[group.rows], group.stamp)


def _signal(type_name: str, pieces: list[_Piece], malformed: int) -> Signal:
    """One topic's pieces, joined, in ascending time and, where that is equal, in file order."""
    groups = [piece.group for piece in pieces]
    time = np.concatenate([np.empty(0, np.int64), *(piece.time for piece in pieces)])
    place = np.concatenate([np.empty(0, np.int64), *(piece.place for piece in pieces)])
    in_order = np.all(time[1:] >= time[:-1]) and np.all(place[1:] > place[:-1])
    order = slice(None) if in_order else np.lexsort((place, time))

    def column(field: int) -> np.ndarray:
        return np.concatenate([np.empty(0), *(g.fields[field][:, 0] for g in groups)])[order]

    if type_name == 'std_msgs/msg/Float64':
        return ScalarSignal(time[order], column(0), malformed)
    if type_name == 'sensor_msgs/msg/FluidPressure':
        return PressureSignal(time[order], column(0), column(1), malformed)
    names = tuple(dict.fromkeys(name for group in groups for name in group.names))
    return JointSignal(time[order], names,
                       *(_joined(groups, field, names)[order] for field in range(3)), malformed)


def _joined(groups: list[cdr.Group], field: int, names: tuple[str, ...]) -> np.ndarray:
    """One column per name, NaN where a message says nothing of a joint."""
    joined = np.full((sum(group.rows.size for group in groups), len(names)), np.nan)
    begin = 0
    for group in groups:
        end = begin + group.rows.size
        values = group.fields[field]
        if values.shape[1]:
            joined[begin:end, [names.index(name) for name in group.names]] = values
        begin = end
    return joined
