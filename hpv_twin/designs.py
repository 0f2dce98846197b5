"""Where a command's `--vibrator` takes its design from: a YAML file, or a recording of the twin."""
from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hpv_twin.model import Vibrator

METAVAR = 'DESIGN'
HELP = 'YAML file, or a recording (.mcap or its folder) that carries its design'


def load_design(path: str | os.PathLike | None) -> Vibrator:
    """Read the design that `path` names; without one it is the built-in base design.

    `path` is a YAML file, an MCAP file of the twin or the folder of a recording. The design of a
    recording is the one it began with: its pump flow, preload and load are the initial setpoints.
    Raises VibratorError, whose text names the file.
    """
    # Imported here, so that a command's --help does not wait for the model.
    from hpv_twin.model import Vibrator, VibratorError
    from hpv_twin.recording.about import DESIGN, RecordingError, attached_design
    if not path:
        return Vibrator()
    if Path(path).suffix != '.mcap' and not Path(path).is_dir():
        return Vibrator.load(path)
    try:
        text = attached_design(path)
    except RecordingError as error:
        raise VibratorError(str(error)) from None
    return Vibrator.load_yaml(text, f'{DESIGN} in {path}')
