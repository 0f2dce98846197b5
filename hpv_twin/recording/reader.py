"""Reads recordings: what is in a file, its signals as arrays, its messages one by one.

Files that were never finished, or are damaged, are read as far as they can be understood.
"""

import os
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from . import cdr
from .about import Recording, Topic, attached_design, describe
from .cdr import JointSignal, PressureSignal, ScalarSignal
from .files import size_of
from .parts import find_parts, find_recordings
from .scan import Block, Scan
from .summary import RecordingError

__all__ = ['JointSignal', 'Message', 'PressureSignal', 'Recording', 'RecordingError',
           'ScalarSignal', 'Topic', 'attached_design', 'describe', 'find_parts', 'find_recordings',
           'messages', 'read_signals']

Signal = PressureSignal | JointSignal | ScalarSignal
FIELDS = {'sensor_msgs/msg/FluidPressure': cdr.pressure_fields,
          'sensor_msgs/msg/JointState': cdr.joint_fields,
          'std_msgs/msg/Float64': cdr.scalar_fields}


class Message(NamedTuple):
    """One message as it was recorded; times in ns, `payload` in CDR."""

    topic: str
    type_name: str
    log_time: int
    publish_time: int
    sequence: int
    payload: bytes


def messages(path: str | os.PathLike, topics: Iterable[str] | None = None,
             start: int | None = None, end: int | None = None) -> Iterator[Message]:
    """Every message with `start` <= log time < `end` (ns), in file order, part by part.

    Raises RecordingError.
    """
    wanted = None if topics is None else set(topics)
    for scan, _, _ in _scans(path, start, end):
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
    The parts of a recording are read as one. `progress(done, size)` is told bytes. Raises
    RecordingError, also for a topic that is not there or is of another type.
    """
    wanted = None if topics is None else set(topics)
    pieces, malformed, seen, types = defaultdict(list), defaultdict(int), 0, {}
    for scan, before, total in _scans(path, start, end):
        for block in scan.blocks(start, end):
            for topic, found, bad in _decoded(scan, block, wanted, seen):
                malformed[topic] += bad
                pieces[topic] += found
            seen += block.channel.size
            if progress:
                progress(before + scan.position, total)
        types |= {channel.topic: scan.type_name(number)
                  for number, channel in scan.channels.items()}
    _refuse_unreadable(path, wanted, types)
    return {topic: _signal(types[topic], pieces[topic], malformed[topic])
            for topic in types if types[topic] in FIELDS and (wanted is None or topic in wanted)}


def signals_in(scan: Scan, blocks: Iterable[Block]) -> dict[str, Signal]:
    """The signals of some blocks of one file, by topic; those without a message are left out."""
    pieces, malformed, seen = defaultdict(list), defaultdict(int), 0
    for block in blocks:
        for topic, found, bad in _decoded(scan, block, None, seen):
            malformed[topic] += bad
            pieces[topic] += found
        seen += block.channel.size
    types = {channel.topic: scan.type_name(number) for number, channel in scan.channels.items()}
    return {topic: _signal(types[topic], found, malformed[topic])
            for topic, found in pieces.items() if found}


def _decoded(scan: Scan, block: Block, wanted: set[str] | None,
             seen: int) -> Iterator[tuple[str, list['_Piece'], int]]:
    """Topic by topic what a block holds, and how many messages could not be decoded."""
    for number, fields_of in _readable(scan, wanted).items():
        part = block.only(block.channel == number)
        groups, bad = cdr.decode(fields_of, part.data, part.start, part.stop)
        yield scan.channels[number].topic, [
            _Piece(_times(group, part.log_time), seen + group.rows, group) for group in groups], bad


def _scans(path: str | os.PathLike, start: int | None,
           end: int | None) -> Iterator[tuple[Scan, int, int]]:
    """A scan of each part that may hold something of the span, the bytes before it and in all.

    Of several parts those that are no MCAP files at all are passed over; `describe` tells.
    """
    parts, refusals, before = find_parts(path), [], 0
    total = sum(size_of(part) for part in parts)
    for part in parts:
        try:
            scan = Scan(part)
        except RecordingError as error:
            refusals.append(error)
        else:
            with scan:
                if not (len(parts) > 1 and scan.lies_outside(start, end)):
                    yield scan, before, total
        before += size_of(part)
    if len(refusals) == len(parts):
        raise refusals[0]


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
