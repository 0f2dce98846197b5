"""What a person at the terminal sees: a banner at the start, then one status line a second."""
from __future__ import annotations

import shutil
import sys

from .interface import INPUTS, OUTPUTS, SERVICES
from .units import both, litres_per_minute

CLEAR = '\r\x1b[2K'


class Console:
    """Writes to a terminal; where there is none, it is silent and the log has to do."""

    def __init__(self, stream=None, on=True):
        self._stream = sys.stdout if stream is None else stream
        self.on = on and self._stream.isatty()

    def banner(self, node) -> None:
        """Say what the twin publishes, listens to and records."""
        if self.on:
            self._stream.write('\n'.join(banner(node)) + '\n')
            self._stream.flush()

    def status(self, node) -> None:
        """Rewrite the status line."""
        if self.on:
            width = shutil.get_terminal_size().columns - 1
            self._stream.write(CLEAR + status(node)[:width])
            self._stream.flush()

    def clear(self) -> None:
        """Make room for a line of the log."""
        if self.on:
            self._stream.write(CLEAR)
            self._stream.flush()


def banner(node) -> list[str]:
    """Lines of the banner."""
    settings = node.settings
    design = settings['vibrator'] or 'the base design'
    full_name = node.get_fully_qualified_name()
    lines = [f'{full_name}: real-time twin of a hydropulse vibrator, {design}', '']
    heading = 'publishes'
    for name, output in OUTPUTS.items():
        rate = f', {settings["publish_rate"]:g} Hz' if output.steady else ''
        unit = f' [{output.unit}]' if output.unit else ''
        lines.append(f'  {heading:12}{name.replace("~", full_name)}{unit}{rate}: {output.text}')
        heading = ''
    heading = 'listens to'
    for name, setpoint in INPUTS.items():
        limits = node.limits(name)
        lines.append(f'  {heading:12}{setpoint.topic.replace("~", full_name)} [{setpoint.unit}]: '
                     f'{both(name, limits.low)} to {both(name, limits.high)}')
        heading = ''
    heading = 'serves'
    for name, text in SERVICES.items():
        lines.append(f'  {heading:12}{name.replace("~", full_name)}: {text}')
        heading = ''
    recorder = node.recorder
    recording = recorder is not None and recorder.status.recording
    lines += [f'  {"records":12}{recorder.status.file if recording else "nothing"}', '',
              '  Ctrl-C stops it.', '']
    return lines


def status(node) -> str:
    """The status line."""
    plant = node.loop.plant
    simulation, cycle = plant.simulation, plant.cycle
    motion = plant.regime
    if node.loop.paused:
        motion = 'paused'
    elif cycle is not None:
        motion = (f'{cycle.frequency:.1f} Hz  {cycle.stroke * 1e3:.2f} mm  '
                  f'peak {cycle.peak_pressure * 1e-6:.1f} MPa gauge')
    return (f'{motion}  {litres_per_minute(simulation.pump_flow)}  '
            f'preload {simulation.preload * 1e3:.2f} mm  margin {100.0 * node.health.margin:.0f}%')
