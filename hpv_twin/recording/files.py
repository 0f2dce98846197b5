"""Files on disk: names, a file that only this process writes, room for the next one."""

import contextlib
import errno
import fcntl
import os
import re
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

STAMP = r'\d{8}T\d{6}\.\d{3}Z'
SUFFIX = '.mcap'


class DataFile:
    """A new file; every write is with the operating system when the call returns.

    The MCAP writer hands over whole chunks, so a buffer of one's own would gain nothing and would
    be lost with the process. The file is locked while it is open: other twins that share the
    folder do not take it for an old one. Raises OSError (FileExistsError if `path` exists).
    """

    def __init__(self, path: Path):
        self.path = path
        self.size = 0
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        with contextlib.suppress(OSError):  # a network file system may know no locks
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)

    @property
    def open(self) -> bool:
        """Whether `close` is yet to come."""
        return self._fd >= 0

    def write(self, data: bytes) -> int:
        """Write all of `data`; a short write is continued until the system refuses."""
        view = memoryview(data)
        while view:
            written = os.write(self._fd, view)
            if written == 0:
                raise OSError(errno.EIO, 'nothing was written', str(self.path))
            self.size += written
            view = view[written:]
        return len(data)

    def tell(self) -> int:
        """Bytes written so far."""
        return self.size

    def flush(self) -> None:
        """Nothing is held back."""

    def sync(self) -> None:
        """Wait until the data are on the disk itself."""
        os.fsync(self._fd)

    def removed(self) -> bool:
        """Whether the file has lost its name: what is written now would vanish with it."""
        return os.fstat(self._fd).st_nlink == 0

    def close(self) -> None:
        """Close; a second call does nothing."""
        fd, self._fd = self._fd, -1
        if fd >= 0:
            os.close(fd)


def create(directory: Path, name: str, now: datetime | None = None) -> DataFile:
    """Open `<name>_YYYYmmddTHHMMSS.mmmZ.mcap`, a later one if that exists. Raises OSError."""
    directory.mkdir(parents=True, exist_ok=True)
    now = now or datetime.now(UTC)
    while True:
        stamp = f'{now:%Y%m%dT%H%M%S}.{now.microsecond // 1000:03d}Z'
        try:
            return DataFile(directory.absolute() / f'{name}_{stamp}{SUFFIX}')
        except FileExistsError:
            now += timedelta(milliseconds=1)


def make_directory(directory: Path, fsync: bool = False) -> None:
    """Make a folder and those above it; with `fsync` wait until they are on the disk itself."""
    missing = [folder for folder in (directory, *directory.parents) if not folder.exists()]
    directory.mkdir(parents=True, exist_ok=True)
    for folder in missing if fsync else ():
        sync_directory(folder.parent)


def sync_directory(directory: Path) -> None:
    """Wait until the names in `directory` are on the disk itself. Raises OSError."""
    fd = os.open(directory, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def own_files(directory: Path, name: str) -> list[Path]:
    """The files that a recorder called `name` has made in `directory`, oldest first.

    Those in the folders of its recordings, `<name>_<time>/`, are among them.
    """
    folder = re.compile(re.escape(name) + '_' + STAMP)
    file = re.compile(folder.pattern + re.escape(SUFFIX))
    found = []
    with os.scandir(directory) as entries:
        for entry in entries:
            if file.fullmatch(entry.name) and entry.is_file(follow_symlinks=False):
                found.append(Path(entry.path))
            elif folder.fullmatch(entry.name) and entry.is_dir(follow_symlinks=False):
                found += _files_in(entry.path, file)
    return sorted(found, key=lambda path: path.name)


def _files_in(folder: str, name: re.Pattern) -> list[Path]:
    """The plain files in a folder whose names match; none if it cannot be read."""
    try:
        with os.scandir(folder) as entries:
            return [Path(entry.path) for entry in entries
                    if name.fullmatch(entry.name) and entry.is_file(follow_symlinks=False)]
    except OSError:
        return []


def make_room(directory: Path, name: str, limit: float,
              max_age: float = 0.0) -> Iterator[Path | OSError]:
    """Remove the oldest of one's own files until those left hold at most `limit` bytes.

    With `max_age` also those last written to more than so many seconds ago. Files that a recorder
    is writing are left alone. Yields each path removed, and each error met: a file that cannot be
    removed is passed over.
    """
    files = own_files(directory, name)
    total = sum(size_of(path) for path in files)
    for path in files:
        if total <= limit and not (max_age and _age(path) > max_age):
            continue
        try:
            if _is_being_written(path):
                continue
            size = size_of(path)
            path.unlink()
        except FileNotFoundError:
            continue
        except OSError as error:
            yield error
            continue
        total -= size
        yield path


def _age(path: Path) -> float:
    """Seconds since a file was last written to; 0 if it is not there."""
    try:
        return time.time() - path.stat().st_mtime
    except OSError:
        return 0.0


def size_of(path: Path) -> int:
    """Bytes in a file; 0 if it is not there."""
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _is_being_written(path: Path) -> bool:
    with open(path, 'rb') as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:
            return False
        return False


def readable_size(size: float) -> str:
    """Bytes as a person reads them: `5.2 MB`."""
    for unit in ('B', 'kB', 'MB', 'GB'):
        if abs(size) < 1000:
            return f'{size:.0f} B' if unit == 'B' else f'{size:.1f} {unit}'
        size /= 1000
    return f'{size:.1f} TB'
