"""The cards beside the plots: what was recorded and what the machine is like, as Markdown."""
from __future__ import annotations

import dataclasses
from datetime import UTC, datetime

import numpy as np

from hpv_twin.model.vibrator import Vibrator, VibratorError
from hpv_twin.viewer import palette
from hpv_twin.viewer.phases import NAMES, SYMBOLS
from hpv_twin.viewer.scene import Panel
from hpv_twin.viewer.signals import Replay

# What a person reads beside SI, by the SI unit of a design's field: factor and unit.
SHOWN = {'m': (1e3, 'mm'), 'Pa': (1e-6, 'MPa'), 'm^3': (1e3, 'L'), 'm^3/s': (6e4, 'L/min'),
         'N/m': (1e-3, 'kN/m'), 'Pa s': (1e3, 'mPa·s'), 'N s/m': (1.0, 'N·s/m'),
         'kg/m^3': (1.0, 'kg/m³'), '1': (1.0, '')}
Rows = list[tuple[str, str]]
GREEK = {'kappa': 'κ', 'rho_e': 'ρ', 'mu_e': 'μ', 'xi_H': 'ξ_H'}


def write_card(replay: Replay, panels: list[Panel]) -> str:
    """Return the card of a recording: who made it, when, and the figures of its machines."""
    figures = [_figures(replay, panel) for panel in panels]
    if len(figures) == 1:  # one table takes less room
        parts = [_table('Recording', replay.path.name, _head(replay) + figures[0])]
    else:
        parts = [_table('Recording', replay.path.name, _head(replay))]
        parts += [_table(panel.name, '', rows)
                  for panel, rows in zip(panels, figures, strict=True)]
    return '\n\n'.join(parts) + '\n'


def write_live_card(replay: Replay, seconds: float, figures: Rows) -> str:
    """Return the card of a recording that still grows and has lasted `seconds`."""
    rows = [row for row in _head(replay) if row[0] not in ('shown', '**missing**')]
    return _table('Live', replay.path.name,
                  [*rows, ('recorded so far', f'{seconds:.0f} s'), *figures]) + '\n'


def design_of(replay: Replay, vibrator: Vibrator | None) -> tuple[Vibrator | None, str]:
    """Return the design to show: `vibrator`, or the recorded one; or why that cannot be shown."""
    if vibrator is not None or replay.design is None:
        return vibrator, ''
    try:
        return Vibrator.load_yaml(replay.design, 'vibrator.yaml in the recording'), ''
    except VibratorError as error:
        return None, str(error)


def write_design(vibrator: Vibrator | None, problem: str) -> str:
    """Return the card of a design; without one, `problem` says why there is none."""
    if vibrator is None:
        return _table('Design', '', [('unreadable', problem)])
    lines = ['| **Design** | | **origin** |', '|:--|:--|:--|']
    lines += [f'| {name} | {value} | {origin} |' for name, value, origin in _design(vibrator)]
    return '\n'.join(lines) + '\n'


def _head(replay: Replay) -> Rows:
    """Say who wrote this file and when, and what is missing in it."""
    began = datetime.fromtimestamp(replay.start * 1e-9, tz=UTC)
    assumed = '' if replay.ambient_is_recorded else ' (not recorded)'
    rows = [('began', f'{began:%Y-%m-%d %H:%M:%S} UTC'),
            ('shown', f'{replay.seconds(replay.first):.3f} to {replay.seconds(replay.last):.3f} s'),
            ('ambient', f'{replay.ambient * 1e-3:.3f} kPa{assumed}')]
    if names := ', '.join(machine.name for machine in replay.machines if machine.name):
        by = f' (hpv_twin {replay.version})' if replay.version else ''
        rows.insert(0, ('node', f'{names}{by}'))
    if replay.missing:
        rows.append(('**missing**', f'**{replay.missing}**'))
    return rows


def _figures(replay: Replay, panel: Panel) -> Rows:
    """Give counts and the figures of one machine's cycles."""
    machine = panel.machine
    signal = machine.waveforms[0]
    steps = np.diff(signal.time)
    rate = f' at {1e9 / np.median(steps):.0f} Hz' if len(steps) else ''
    gaps = signal.gaps()
    longest = f', longest {steps[gaps].max() * 1e-6:g} ms' if len(gaps) else ''
    rows = [('samples', f'{len(signal):,}{rate}'), ('gaps', f'{len(gaps):,}{longest}')]
    for label, values in machine.pressures.items():
        low, high = _range(values.values - replay.ambient)
        rows.append((f'{label}, gauge', f'{palette.PRESSURE.show(low):.2f} to '
                     f'{palette.PRESSURE.text(high)} ({high * 1e-5:.1f} bar)'))
    for name in palette.CYCLE_FIGURES:
        if name in machine.numbers:
            rows.append((name, _spread(palette.NUMBERS[name], machine.numbers[name].values)))
    return rows + _cycle(panel)


def _cycle(panel: Panel) -> Rows:
    """Give the median of what each cycle did, read off the samples."""
    rows = [(f'{mark.entity.rsplit("/")[-1]} pressure',
             palette.PRESSURE.text(np.median(mark.signal.values))) for mark in panel.marks]
    for name, symbol, kind in zip(NAMES, SYMBOLS, range(4), strict=False):
        times = panel.phases.durations(kind) if panel.phases else np.empty(0)
        if len(times):
            rows.append((f'{name}, {symbol}', f'{1e3 * np.median(times):.2f} ms'))
    return [(f'{name} (median)', value) for name, value in rows]


def _spread(quantity: palette.Quantity, values: np.ndarray) -> str:
    """Give the median of what is not zero, and the range if there is one."""
    running = values[values > 0]
    if not len(running):
        return 'no cycle'
    middle = quantity.text(np.median(running))
    low, high = (f'{quantity.show(value):.{quantity.digits}f}' for value in _range(running))
    return middle if low == high else f'{middle} ({low} to {high} {quantity.unit})'


def _range(values: np.ndarray) -> tuple[float, float]:
    return float(np.nanmin(values)), float(np.nanmax(values))


def _design(vibrator: Vibrator) -> list[tuple[str, str, str]]:
    """Give every field of the design in a person's unit, and where the value is from."""
    rows, base = [], Vibrator()
    for field in dataclasses.fields(vibrator):
        symbol = GREEK.get(field.metadata['symbol'], field.metadata['symbol'])
        value = getattr(vibrator, field.name)
        same = value == getattr(base, field.name)
        rows.append((f'{field.name.replace("_", " ")}, {symbol}',
                     _value(value, field.metadata['unit']),
                     field.metadata['origin'].split(':')[0].split(' ')[0] if same else 'user'))
    return rows


def _value(value: float | None, unit: str) -> str:
    """Return a design value with a person's unit."""
    if value is None:
        return 'by (19)'
    factor, shown = SHOWN.get(unit, (1.0, unit))
    return f'{value * factor:.5g} {shown}'.strip()


def _table(title: str, what: str, rows: Rows) -> str:
    """Return a Markdown table of two columns under `title` and `what`."""
    return '\n'.join([f'| **{title}** | {what} |', '|:--|:--|',
                      *(f'| {name} | {value} |' for name, value in rows)])
