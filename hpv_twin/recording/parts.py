"""Which files make up a recording: one bare file, or a folder with its parts and metadata.yaml."""

import os
import re
from datetime import UTC, datetime
from pathlib import Path

import yaml

from .files import STAMP, SUFFIX
from .summary import RecordingError

METADATA_FILE = 'metadata.yaml'
INFORMATION = 'rosbag2_bagfile_information'
NAME_STAMP = re.compile(rf'_({STAMP})')
STAMPED = re.compile(rf'.*_{STAMP}')


def folder_of(path: Path) -> Path:
    """The folder into which a recording that began as the bare file `path` moves when it splits."""
    return path.with_suffix('')


def is_recording(folder: Path) -> bool:
    """Whether a folder is one recording, not a place where several lie.

    It holds metadata.yaml as `ros2 bag` writes it, or its name ends in a time and it holds parts.
    """
    return (folder / METADATA_FILE).is_file() or (
        STAMPED.fullmatch(folder.name) is not None and bool(_mcap_files(folder)))


def find_recordings(directory: str | os.PathLike) -> list[Path]:
    """The recordings in a directory, newest first; none if there is no such directory.

    A recording is an MCAP file or a folder with its parts. The time is that in its name, else that
    of its last change.
    """
    directory = Path(directory)
    if not directory.is_dir():
        return []
    found = _mcap_files(directory)
    found += [path for path in directory.iterdir() if path.is_dir() and is_recording(path)]
    return sorted(found, key=lambda path: (_time_of(path), path.name), reverse=True)


def resolve(path: str | os.PathLike) -> Path:
    """The recording meant by `path`, absolute: a file, or the folder of one that was split.

    A folder that holds several recordings stands for its newest; a file that has moved into its
    folder since it was named, for that folder. Raises RecordingError if there is none.
    """
    path = Path(path).absolute()
    if path.is_dir() and not is_recording(path):
        found = find_recordings(path)
        if not found:
            raise RecordingError(f'{path}: there is no recording in this folder')
        return found[0]
    if path.suffix == SUFFIX and not path.exists() and is_recording(folder_of(path)):
        return folder_of(path)
    return path


def find_parts(path: str | os.PathLike) -> list[Path]:
    """The files of the recording meant by `path` (see `resolve`), in order, at least one.

    The part that is being written is among them. Raises RecordingError if there is none.
    """
    path = resolve(path)
    if not path.is_dir():
        return [path]
    listed = _listed(path)
    others = [file for file in _mcap_files(path) if file not in listed]
    parts = listed + sorted(others, key=lambda file: file.name)
    if all(STAMPED.fullmatch(file.stem) for file in parts):
        parts.sort(key=lambda file: file.name)
    if not parts:
        raise RecordingError(f'{path}: there is no MCAP file in this folder')
    return parts


def _listed(folder: Path) -> list[Path]:
    """The files that metadata.yaml names and that are there."""
    try:
        text = (folder / METADATA_FILE).read_text(encoding='utf-8')
        names = yaml.safe_load(text)[INFORMATION]['relative_file_paths']
        paths = [folder / name for name in names]
    except (OSError, UnicodeError, yaml.YAMLError, KeyError, TypeError):
        return []
    return [path for path in paths if path.is_file()]


def _mcap_files(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return [path for path in folder.iterdir() if path.suffix == SUFFIX and path.is_file()]


def _time_of(path: Path) -> float:
    """Seconds since the epoch."""
    stamps = NAME_STAMP.findall(path.name)
    try:
        when = datetime.strptime(stamps[-1], '%Y%m%dT%H%M%S.%fZ')
        return when.replace(tzinfo=UTC).timestamp()
    except (IndexError, ValueError):
        return path.stat().st_mtime
