"""One run of the replay: from the recording to a scene that is saved or shown."""
from __future__ import annotations

import argparse
import contextlib
import ctypes
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import rerun as rr

from hpv_twin.designs import load_design
from hpv_twin.model.vibrator import Vibrator, VibratorError
from hpv_twin.recording.parts import find_recordings, resolve
from hpv_twin.recording.reader import describe
from hpv_twin.recording.summary import RecordingError
from hpv_twin.viewer import card, layout, reading, scene, viewer_process
from hpv_twin.viewer.live import Live
from hpv_twin.viewer.progress import Progress, Status
from hpv_twin.viewer.saving import SceneFile
from hpv_twin.viewer.signals import Replay

FOLDER = Path('bags')
POLL = 0.1  # s
LIVE_MEMORY = '1GB'  # of the viewer, which drops the oldest then
Refusal = (RecordingError, VibratorError, viewer_process.ViewerError)


def run(options: argparse.Namespace) -> int:
    """Read the recording, build the scene, then save or show it. Raises OSError or a Refusal."""
    vibrator = load_design(options.vibrator) if options.vibrator else None
    if not (options.save or options.web):
        viewer_process.check_display()
    if options.live:
        return _follow(options, vibrator)
    path = resolve(options.file) if options.file else _newest()
    replay = _load(path, options)
    _give_back()
    _tell(replay)
    if options.save:
        _write(replay, vibrator, options.save)
        print(f'{options.save} ({options.save.stat().st_size / 1e6:.1f} MB); '
              f'open it with: rerun {options.save}')
        return 0
    with tempfile.TemporaryDirectory(prefix='hpv_twin_') as folder:
        file = Path(folder) / f'{path.stem}.rrd'
        _write(replay, vibrator, file)
        del replay
        _give_back()
        if options.web:
            _serve(file)
        else:
            viewer_process.show(file)
    return 0


def _serve(file: Path) -> None:
    """Serve a scene to browsers on this machine until Ctrl-C."""
    port, web_port = viewer_process.free_port(), viewer_process.free_port()
    with viewer_process.running(*viewer_process.serve_web(file, web_port, port)) as child:
        viewer_process.wait_for(web_port, child)
        print(f'open {viewer_process.web_address(web_port, port)} in a browser on this machine; '
              'Ctrl-C ends', flush=True)
        child.wait()


def _follow(options: argparse.Namespace, vibrator: Vibrator | None) -> int:
    """Show a recording while it grows, and the next one when it has ended, until Ctrl-C."""
    port, web_port = viewer_process.free_port(), viewer_process.free_port()
    arguments = (viewer_process.serve_web(None, web_port, port) if options.web else
                 ['--port', str(port), '--hide-welcome-screen', '--memory-limit', LIVE_MEMORY])
    with viewer_process.running(*arguments) as child:
        viewer_process.wait_for(port, child)
        if options.web:
            viewer_process.wait_for(web_port, child)
            print(f'open {viewer_process.web_address(web_port, port)} in a browser on this '
                  'machine; Ctrl-C ends', flush=True)
        shown = None
        while child.poll() is None and (path := _growing(options.file, shown, child)):
            _show_live(options, vibrator, path, port, child)
            shown = path
            if options.file:
                break
        child.wait()
    return 0


def _growing(file: Path | None, shown: Path | None,
             child: subprocess.Popen) -> Path | None:
    """Return the recording to follow, as soon as there is one; None when the viewer is closed."""
    told = False
    while child.poll() is None:
        if file and file.exists():
            return resolve(file)
        newest = next(iter(find_recordings(FOLDER)), None) if file is None else None
        if newest and newest != shown and describe(newest).problem:  # not finished
            return newest
        if not told:
            print(f'waiting for {file or f"a recording in {FOLDER.absolute()}"}', flush=True)
            told = True
        time.sleep(POLL)
    return None


def _show_live(options: argparse.Namespace, vibrator: Vibrator | None, path: Path, port: int,
               child: subprocess.Popen) -> None:
    """Follow one recording to its end, or until the viewer is closed."""
    stream = rr.RecordingStream('hpv_twin', recording_id=path.stem)
    stream.connect_grpc(f'rerun+http://{viewer_process.HOST}:{port}/proxy')
    live = None
    while child.poll() is None and live is None:
        try:
            live = Live(stream, path, vibrator, options.ambient)
        except RecordingError:
            time.sleep(POLL)  # nothing is in it yet
    if live is None:
        return
    print(f'{path}: {live.names}, live', flush=True)
    behind = []  # s, at each update that brought something
    try:
        with contextlib.closing(live), contextlib.closing(Status()) as status:
            while child.poll() is None and not live.finished:
                if live.update():
                    behind.append((time.time_ns() - live.last) * 1e-9)
                    status(f'{path.name}: {behind[-1]:.2f} s behind')
                time.sleep(POLL)
    finally:
        ended = '; the recording has ended' if live.finished else ''
        late = (f'{statistics.median(behind):.2f} s behind (median; most {max(behind):.2f} s)'
                if behind else 'nothing new')
        print(f'{path}: {late}{ended}', flush=True)


def _load(path: Path, options: argparse.Namespace) -> Replay:
    """Read what is to be shown, with a line that tells how far it is."""
    with contextlib.closing(Progress(f'reading {path.name}')) as progress:
        return reading.load(path, options.since, options.until, ambient=options.ambient,
                            progress=progress)


def _give_back() -> None:
    """
    Return freed memory to the system; the viewer needs it.

    Of a long recording the C library keeps hundreds of MB in small pieces otherwise.
    """
    with contextlib.suppress(OSError, AttributeError):  # not glibc
        ctypes.CDLL('libc.so.6').malloc_trim(0)


def _newest() -> Path:
    """Return the newest recording in ./bags. Raises RecordingError if there is none."""
    found = find_recordings(FOLDER)
    if not found:
        raise RecordingError(f'no FILE was given, and there is no recording in {FOLDER.absolute()}')
    return found[0]


def _tell(replay: Replay) -> None:
    """Say what is shown, and what is not."""
    names = ', '.join(machine.name or 'sensors' for machine in replay.machines)
    print(f'{replay.path}: {names}, {replay.seconds(replay.first):.3f} to '
          f'{replay.seconds(replay.last):.3f} s', flush=True)
    if not replay.ambient_is_recorded and any(m.pressures for m in replay.machines):
        print(f'gauge pressures with {replay.ambient:g} Pa ambient, which the recording does not '
              'tell', flush=True)
    if replay.missing:
        print(f'{replay.path}: {replay.missing}; shown as far as it goes', file=sys.stderr)


def _write(replay: Replay, vibrator: Vibrator | None, path: Path) -> None:
    """Write the scene with its layout to `path`, in whole or not at all. Raises OSError."""
    design, problem = card.design_of(replay, vibrator)
    panels = scene.build_panels(replay, design)
    cards = {scene.CARD: card.write_card(replay, panels)}
    if design or problem:
        cards[scene.DESIGN] = card.write_design(design, problem)
    stream = rr.RecordingStream('hpv_twin', recording_id=replay.path.stem)
    progress = Progress(f'drawing {replay.path.name}')
    with SceneFile(stream, path), contextlib.closing(progress):
        stream.send_blueprint(layout.build_blueprint(panels, scene.DESIGN in cards))
        scene.write_scene(stream, replay, panels, cards, progress)
