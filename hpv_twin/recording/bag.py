"""metadata.yaml as `ros2 bag` writes it: what makes a folder of MCAP files one bag."""

import contextlib
import os
from pathlib import Path

import yaml

from . import LIBRARY
from .files import SUFFIX
from .parts import INFORMATION, METADATA_FILE, STAMPED
from .summary import RecordingError, Summary, read_summary

VERSION = 9  # of the metadata, as ROS 2 Jazzy writes it: QoS policies by name
RECORDER = 'recorder'  # key of custom_data by which our own metadata.yaml is known


def write_metadata(folder: Path) -> None:
    """Write metadata.yaml of the finished parts in `folder`, in whole or not at all.

    Without any such part it is removed. A metadata.yaml of somebody else is left alone.
    Raises OSError.
    """
    path = folder / METADATA_FILE
    if path.exists() and not _is_own(path):
        return
    parts = {file: summary for file in sorted(folder.iterdir())
             if STAMPED.fullmatch(file.stem) and file.suffix == SUFFIX
             and (summary := _summary(file)) is not None}
    if not parts:
        path.unlink(missing_ok=True)
        return
    text = yaml.safe_dump({INFORMATION: _information(parts)}, sort_keys=False, allow_unicode=True)
    draft = folder / f'.{METADATA_FILE}.part{os.getpid()}'
    try:
        draft.write_text(text, encoding='utf-8')
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def tidy(folder: Path) -> None:
    """After parts were removed: metadata.yaml of those left, or no folder. Raises OSError."""
    write_metadata(folder)
    with contextlib.suppress(OSError):  # others keep something there
        folder.rmdir()


def _is_own(path: Path) -> bool:
    """Whether a metadata.yaml was written by this package."""
    try:
        custom = yaml.safe_load(path.read_text(encoding='utf-8'))[INFORMATION]['custom_data']
        return RECORDER in custom
    except (OSError, UnicodeError, yaml.YAMLError, KeyError, TypeError):
        return False


def _summary(path: Path) -> Summary | None:
    """The index of a finished file; None for others."""
    try:
        with open(path, 'rb') as file:
            return read_summary(file, chunks=False)[1]
    except (OSError, RecordingError):
        return None


def _information(parts: dict[Path, Summary]) -> dict:
    """The content of metadata.yaml."""
    files = [_file(path, summary) for path, summary in parts.items()]
    filled = [file for file in files if file['message_count']]
    start = min((_start(file) for file in filled), default=0)
    end = max((_start(file) + file['duration']['nanoseconds'] for file in filled), default=0)
    return {
        'version': VERSION, 'storage_identifier': 'mcap',
        'duration': {'nanoseconds': end - start},
        'starting_time': {'nanoseconds_since_epoch': start},
        'message_count': sum(file['message_count'] for file in files),
        'topics_with_message_count': _topics(list(parts.values())),
        'compression_format': '', 'compression_mode': '',
        'relative_file_paths': [path.name for path in parts], 'files': files,
        'custom_data': {RECORDER: LIBRARY}, 'ros_distro': os.environ.get('ROS_DISTRO', '')}


def _file(path: Path, summary: Summary) -> dict:
    told = summary.statistics
    return {'path': path.name,
            'starting_time': {'nanoseconds_since_epoch': told.message_start_time},
            'duration': {'nanoseconds': told.message_end_time - told.message_start_time},
            'message_count': told.message_count}


def _start(file: dict) -> int:
    return file['starting_time']['nanoseconds_since_epoch']


def _topics(summaries: list[Summary]) -> list[dict]:
    topics: dict[str, dict] = {}
    for summary in summaries:
        for number, channel in summary.channels.items():
            topic = topics.setdefault(channel.topic, {'topic_metadata': {
                'name': channel.topic, 'type': summary.schemas[channel.schema_id].name,
                'serialization_format': channel.message_encoding,
                'offered_qos_profiles': yaml.safe_load(
                    channel.metadata.get('offered_qos_profiles', '')) or [],
                'type_description_hash': channel.metadata.get('topic_type_hash', '')},
                'message_count': 0})
            topic['message_count'] += summary.statistics.channel_message_counts.get(number, 0)
    return list(topics.values())
