"""A scene on its way to a file: in whole or not at all, without being in memory in whole."""
from __future__ import annotations

import contextlib
import os
import tempfile
import threading
from pathlib import Path

import rerun as rr

BLOCK = 1 << 20  # bytes


class SceneFile:
    """
    Writes what `stream` is sent to `path`, which is there at the end of the `with` or not at all.

    rerun's own file writer waits for ever when the disk is full; so it writes into a pipe here,
    and a thread carries the bytes to the disk. Raises OSError at the end of the `with`.
    """

    def __init__(self, stream: rr.RecordingStream, path: Path):
        self._stream, self._path = stream, path
        self._draft = path.with_name(f'.{path.name}')
        self._error: OSError | None = None

    def __enter__(self) -> SceneFile:
        """Open the draft and let the stream flow into it."""
        try:
            self._file = open(self._draft, 'wb')
        except OSError as error:
            raise self._named(error) from None
        if not hasattr(os, 'mkfifo'):  # Windows: what it can do
            self._thread = None
            self._stream.save(self._draft)
            return self
        self._folder = tempfile.TemporaryDirectory(prefix='hpv_twin_')
        pipe = Path(self._folder.name) / 'scene'
        os.mkfifo(pipe)
        self._thread = threading.Thread(target=self._carry, args=(pipe,), daemon=True)
        self._thread.start()
        self._stream.save(pipe)
        return self

    def __exit__(self, kind, *_) -> None:
        """End the stream; the draft becomes the file if all went well."""
        self._stream.disconnect()
        try:
            if self._thread:
                self._thread.join()
                self._folder.cleanup()
            self._finish()
            if self._error and kind is None:
                raise self._named(self._error) from None
            if kind is None:
                self._draft.replace(self._path)
        finally:
            with contextlib.suppress(OSError):
                self._draft.unlink()

    def _carry(self, pipe: Path) -> None:
        """Carry bytes until the stream ends; after an error they are only taken off the pipe."""
        with open(pipe, 'rb', buffering=0) as source:
            while block := source.read(BLOCK):
                if self._error is None:
                    try:
                        self._file.write(block)
                    except OSError as error:
                        self._error = error

    def _finish(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            self._error = self._error or error

    def _named(self, error: OSError) -> OSError:
        return OSError(error.errno, error.strerror, str(self._path))
