"""One run of the replay: from the recording to a scene that is saved or shown."""
from __future__ import annotations

import argparse
import contextlib
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
    _tell(replay)
    if options.save:
        _write(replay, vibrator, options.save)
        print(f'{options.save} ({options.save.stat().st_size / 1e6:.1f} MB); '
              f'open it with: rerun {options.save}')
        return 0
    with tempfile.TemporaryDirectory(prefix='hpv_twin_') as folder:
        file = Path(folder) / f'{path.stem}.rrd'
        _write(replay, vibrator, file)
        viewer_process.show(file)
    return 0


def _load(path: Path, options: argparse.Namespace) -> Replay:
    """Read what is to be shown, with a line that tells how far it is."""
    progress = Progress(path)
    try:
        return reading.load(path, options.since, options.until, ambient=options.ambient,
                            progress=progress)
    finally:
        progress.end()


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
    """
    Write the scene with its layout to `path`, in whole or not at all. Raises OSError.

    The scene is made in memory: rerun's own file writer waits for ever when the disk is full.
    """
    design, problem = _design(replay, vibrator)
    panels = scene.build_panels(replay, design)
    stream = rr.RecordingStream('hpv_twin', recording_id=replay.path.stem)
    memory = stream.memory_recording()
    stream.send_blueprint(layout.build_blueprint(panels, bool(design or problem)))
    cards = {scene.CARD: card.write_card(replay, panels)}
    if design or problem:
        cards[scene.DESIGN] = card.write_design(design, problem)
    scene.write_scene(stream, replay, panels, cards)
    draft = path.with_name(f'.{path.name}')
    try:
        draft.write_bytes(memory.drain_as_bytes())
        draft.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        with contextlib.suppress(OSError):
            draft.unlink()


def _design(replay: Replay, vibrator: Vibrator | None) -> tuple[Vibrator | None, str]:
    """Return the design to show, or why it cannot be shown."""
    if vibrator is not None or replay.design is None:
        return vibrator, ''
    try:
        return Vibrator.load_yaml(replay.design, 'vibrator.yaml in the recording'), ''
    except VibratorError as error:
        return None, str(error)


class Progress:
    """A line on the terminal while a long file is read; short ones pass in silence."""

    def __init__(self, path: Path):
        self._name = path.name
        self._next = time.monotonic() + 0.5
        self._shown = False

    def __call__(self, done: int, size: int) -> None:
        """Show that `done` of `size` bytes are read."""
        if sys.stderr.isatty() and time.monotonic() >= self._next:
            self._next, self._shown = time.monotonic() + 0.2, True
            print(f'\rreading {self._name}: {100 * done // max(size, 1):3d} %', end='',
                  file=sys.stderr, flush=True)

    def end(self) -> None:
        """Clear the line."""
        if self._shown:
            print('\r\033[K', end='', file=sys.stderr, flush=True)
