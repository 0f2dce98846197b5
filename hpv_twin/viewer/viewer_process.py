"""rerun's viewer as a child process that listens on this machine only and never outlives us."""
from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import rerun_cli

HOST = '127.0.0.1'
PATIENCE, START_PATIENCE = 5.0, 30.0  # s
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
    with running('--port', 'auto', '--hide-welcome-screen', str(path)) as child:
        child.wait()


def serve_web(path: Path | None, web_port: int, port: int) -> list[str]:
    """Return the arguments with which the viewer serves a browser on this machine."""
    return ['--serve-web', '--web-viewer-port', str(web_port), '--port', str(port),
            *([str(path)] if path else [])]


def web_address(web_port: int, port: int) -> str:
    """Return what to open in a browser."""
    url = quote(f'rerun+http://{HOST}:{port}/proxy', safe='')
    return f'http://{HOST}:{web_port}/?url={url}'


@contextlib.contextmanager
def running(*arguments: str) -> Iterator[subprocess.Popen]:
    """
    Run the viewer, bound to this machine, within the `with`; then it is ended.

    Ctrl-C, SIGTERM and a closed terminal end the `with` in silence. Raises OSError if the viewer
    cannot start, ViewerError if it fails.
    """
    with _signals(ENDING, _interrupt):
        child = subprocess.Popen([executable(), '--bind', HOST, *arguments],
                                 env={'RUST_LOG': 'error', **os.environ})
        try:
            yield child
            status = child.poll()
        except KeyboardInterrupt:
            status = 0
        finally:
            # Whoever presses Ctrl-C twice shall not leave a viewer behind.
            with _signals((signal.SIGINT, *ENDING), signal.SIG_IGN):
                _end(child)
    if status:
        raise ViewerError(f'the viewer ended with status {status}; with --save OUT.rrd the scene '
                          'can be opened elsewhere')


def free_port() -> int:
    """Return a port of this machine that nobody listens on."""
    with socket.create_server((HOST, 0)) as server:
        return server.getsockname()[1]


def wait_for(port: int, child: subprocess.Popen) -> None:
    """Wait until the viewer listens on `port`. Raises ViewerError if it does not."""
    end = time.monotonic() + START_PATIENCE
    while child.poll() is None and time.monotonic() < end:
        with contextlib.suppress(OSError), socket.create_connection((HOST, port), 1.0):
            return
        time.sleep(0.05)
    raise ViewerError(f'the viewer does not answer on {HOST}:{port}')


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
