"""The card beside the plots: what was recorded and what the machine is like, as Markdown."""
from __future__ import annotations

import dataclasses
from datetime import UTC, datetime

import numpy as np

from hpv_twin.model.vibrator import Vibrator
from hpv_twin.viewer import palette
from hpv_twin.viewer.signals import Machine, Replay

# What a person reads beside SI, by the SI unit of a design's field: factor and unit.
SHOWN = {'m': (1e3, 'mm'), 'Pa': (1e-6, 'MPa'), 'm^3': (1e3, 'L'), 'm^3/s': (6e4, 'L/min'),
         'N/m': (1e-3, 'kN/m'), 'Pa s': (1e3, 'mPa·s'), 'N s/m': (1.0, 'N·s/m'),
         'kg/m^3': (1.0, 'kg/m³'), '1': (1.0, '')}
Rows = list[tuple[str, str]]
SYMBOLS = {'kappa': 'κ', 'rho_e': 'ρ', 'mu_e': 'μ', 'xi_H': 'ξ_H'}


def write_card(replay: Replay, vibrator: Vibrator | None, problem: str) -> str:
    """Return the card; `problem` says why there is no design although there should be one."""
    figures = [_figures(replay, machine) for machine in replay.machines]
    if len(figures) == 1:  # one table takes less room
        parts = [_table('Recording', replay.path.name, _head(replay) + figures[0])]
    else:
        parts = [_table('Recording', replay.path.name, _head(replay))]
        parts += [_table(machine.name or 'sensors', '', rows)
                  for machine, rows in zip(replay.machines, figures, strict=True)]
    if vibrator is not None:
        parts.append(_table('Design', '', _design(vibrator)))
    elif problem:
        parts.append(_table('Design', '', [('unreadable', problem)]))
    return '\n\n'.join(parts) + '\n'


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


def _figures(replay: Replay, machine: Machine) -> Rows:
    """Give counts and a few figures of one machine."""
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
    return rows


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


def _design(vibrator: Vibrator) -> Rows:
    """Give every field of the design in a person's unit."""
    rows = []
    for field in dataclasses.fields(vibrator):
        symbol = SYMBOLS.get(field.metadata['symbol'], field.metadata['symbol'])
        rows.append((f'{field.name.replace("_", " ")}, {symbol}',
                     _value(getattr(vibrator, field.name), field.metadata['unit'])))
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
