"""rerun's viewer as a child process that listens on this machine only and never outlives us."""
from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import rerun_cli

PATIENCE = 5.0  # s
ENDING = tuple(getattr(signal, name) for name in ('SIGTERM', 'SIGHUP') if hasattr(signal, name))


class ViewerError(RuntimeError):
    """The viewer cannot be shown; the message says why and what to do."""


def check_display() -> None:
    """Raise ViewerError where a window cannot be opened."""
    if sys.platform.startswith('linux') and not (
            os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY')):
        raise ViewerError('no display (neither DISPLAY nor WAYLAND_DISPLAY is set); '
                          'write the scene with --save OUT.rrd and open that elsewhere')


def executable() -> str:
    """
    Return the viewer itself.

    The `rerun` command is a Python wrapper around it: to stop that would orphan the viewer.
    RERUN_CLI_PATH overrides it, as it does for the wrapper.
    """
    if path := os.environ.get('RERUN_CLI_PATH'):
        return path
    folder = Path(rerun_cli.__file__).parent
    bundled = folder / 'Rerun.app' / 'Contents' / 'MacOS' / 'Rerun'
    if bundled.exists():
        return str(bundled)
    return str(folder / ('rerun.exe' if sys.platform == 'win32' else 'rerun'))


def show(path: Path) -> None:
    """
    Open `path` in a viewer and wait until it is closed.

    Ctrl-C, SIGTERM and a closed terminal end the viewer too. Raises OSError if it cannot start,
    ViewerError if it fails.
    """
    command = [executable(), '--bind', '127.0.0.1', '--port', 'auto', '--hide-welcome-screen',
               str(path)]
    with _signals(ENDING, _interrupt):
        child = subprocess.Popen(command, env={'RUST_LOG': 'error', **os.environ})
        try:
            status = child.wait()
        except KeyboardInterrupt:
            status = 0
        finally:
            # Whoever presses Ctrl-C twice shall not leave a viewer behind.
            with _signals((signal.SIGINT, *ENDING), signal.SIG_IGN):
                _end(child)
    if status:
        raise ViewerError(f'the viewer ended with status {status}; with --save OUT.rrd the scene '
                          'can be opened elsewhere')


@contextlib.contextmanager
def _signals(numbers, handler):
    """Answer signals with `handler` for a while."""
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


def _interrupt(*_) -> None:
    raise KeyboardInterrupt


def _end(child: subprocess.Popen) -> None:
    """End the viewer if it still runs; kill it if it does not listen."""
    if child.poll() is not None:
        return
    child.terminate()
    try:
        child.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
