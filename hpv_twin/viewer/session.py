"""One run of the replay: from the recording to a scene that is saved or shown."""
from __future__ import annotations

import argparse
import contextlib
import ctypes
import sys
import tempfile
import time
from pathlib import Path

import rerun as rr

from hpv_twin.designs import load_design
from hpv_twin.model.vibrator import Vibrator, VibratorError
from hpv_twin.recording.parts import find_recordings, resolve
from hpv_twin.recording.summary import RecordingError
from hpv_twin.viewer import card, layout, reading, scene, viewer_process
from hpv_twin.viewer.saving import SceneFile
from hpv_twin.viewer.signals import Replay

FOLDER = Path('bags')
Refusal = (RecordingError, VibratorError, viewer_process.ViewerError)


def run(options: argparse.Namespace) -> int:
    """Read the recording, build the scene, then save or show it. Raises OSError or a Refusal."""
    path = resolve(options.file) if options.file else _newest()
    vibrator = load_design(options.vibrator) if options.vibrator else None
    if not options.save:
        viewer_process.check_display()
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
        viewer_process.show(file)
    return 0


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
    design, problem = _design(replay, vibrator)
    panels = scene.build_panels(replay, design)
    cards = {scene.CARD: card.write_card(replay, panels)}
    if design or problem:
        cards[scene.DESIGN] = card.write_design(design, problem)
    stream = rr.RecordingStream('hpv_twin', recording_id=replay.path.stem)
    progress = Progress(f'drawing {replay.path.name}')
    with SceneFile(stream, path), contextlib.closing(progress):
        stream.send_blueprint(layout.build_blueprint(panels, scene.DESIGN in cards))
        scene.write_scene(stream, replay, panels, cards, progress)


def _design(replay: Replay, vibrator: Vibrator | None) -> tuple[Vibrator | None, str]:
    """Return the design to show, or why it cannot be shown."""
    if vibrator is not None or replay.design is None:
        return vibrator, ''
    try:
        return Vibrator.load_yaml(replay.design, 'vibrator.yaml in the recording'), ''
    except VibratorError as error:
        return None, str(error)


class Progress:
    """A bar on the terminal while long work goes on; what is short passes in silence."""

    WIDTH = 30  # characters

    def __init__(self, what: str):
        self._what = what
        self._next = time.monotonic() + 0.5
        self._shown = False

    def __call__(self, done: float, whole: float) -> None:
        """Show that `done` of `whole` is done."""
        if sys.stderr.isatty() and time.monotonic() >= self._next:
            self._next, self._shown = time.monotonic() + 0.2, True
            share = min(done / max(whole, 1), 1.0)
            bar = '#' * round(share * self.WIDTH)
            print(f'\r{self._what}  [{bar:.<{self.WIDTH}}] {100 * share:3.0f} %\033[K', end='',
                  file=sys.stderr, flush=True)

    def close(self) -> None:
        """Clear the line."""
        if self._shown:
            print('\r\033[K', end='', file=sys.stderr, flush=True)
