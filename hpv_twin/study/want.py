"""Which settings give a frequency: roots along the rows of a map, all of them at once."""
from __future__ import annotations

import numpy as np

from hpv_twin.model.batch import FIGURES
from hpv_twin.model.designs import Designs
from hpv_twin.model.regimes import SEATED

from .figures import shown, shown_field
from .steady import steady_cycle

STEPS = 60  # bisection takes about 40, what is used a third of that
CLOSE = 1e-10  # relative miss of the frequency at which a root is good
SHOWN = 15  # settings printed


def settings_for(grid, columns: dict, frequency: float, farm) -> dict:
    """
    Return the settings of the map's rows at which seated motion has this frequency, Hz.

    Between neighbours in a row (in x) that are both seated and between which the frequency is
    passed, the root is found by regula falsi (Illinois), for all rows at once by the batch. Returns
    columns like those of the map, of shape (settings,).
    """
    x, y = (columns[axis.column].reshape(grid.shape) for axis in (grid.x, grid.y))
    miss = columns['frequency'].reshape(grid.shape) - frequency
    seated = (columns['regime'] == SEATED).reshape(grid.shape)
    bracket = (seated[:, :-1] & seated[:, 1:]) & (miss[:, :-1] * miss[:, 1:] <= 0.0)
    row, column = np.nonzero(bracket)
    low, high = x[row, column], x[row, column + 1]
    f_low, f_high = miss[row, column], miss[row, column + 1]
    at, figures = low.copy(), None
    for _ in range(STEPS):
        if not len(row):
            break
        at = high - f_high * (high - low) / np.where(f_high == f_low, 1.0, f_high - f_low)
        figures = farm.run(Designs(grid.base, **{grid.x.name: at, grid.y.name: y[row, column]}))
        f_at = figures['frequency'] - frequency
        if np.all(np.abs(f_at) <= CLOSE * frequency):
            break
        # The new end replaces the one of its sign; the other, if it stayed twice, counts half.
        same = f_at * f_high > 0.0
        f_low = np.where(same, 0.5 * f_low, f_high)
        low = np.where(same, low, high)
        high, f_high = at, f_at
    found = {name: np.empty(0) for name in (grid.x.column, grid.y.column, *FIGURES, 'regime')}
    if figures is not None:
        good = ((np.abs(figures['frequency'] - frequency) <= 1e-6 * frequency)
                & (figures['regime'] == SEATED))
        found = {grid.x.column: at[good], grid.y.column: y[row, column][good]} | {
            name: values[good] for name, values in figures.items()}
    return found


def report(grid, found: dict, frequency: float) -> str:
    """Print the settings, and how near single simulations of them come to the frequency."""
    x, y = grid.x.column, grid.y.column
    count = len(found[x])
    if not count:
        return f'\nNo setting of this map gives {frequency:g} Hz in seated motion.'
    names = ('opening_pressure', 'peak_pressure', 'return_pressure', 'impact_energy',
             'impact_power', 'hydraulic_power', 'efficiency')
    chosen = np.unique(np.linspace(0, count - 1, min(SHOWN, count)).round().astype(int))
    scales = [shown_field(grid.x.name), shown_field(grid.y.name), *map(shown, names)]
    heads = [scale.title.replace(', gauge', '').replace(' per cycle', '') for scale in scales]
    lines = [f'\n{frequency:g} Hz, seated: {count} settings on the map, {len(chosen)} of them '
             '(pressures gauge):', '', '  '.join(heads)]
    misses = []
    for i in chosen:
        cells = [f'{found[name][i] * scale.factor:.5g}'
                 for name, scale in zip((x, y, *names), scales, strict=True)]
        lines.append('  '.join(cell.rjust(len(head))
                               for cell, head in zip(cells, heads, strict=True)))
        fields = {grid.x.name: float(found[x][i]), grid.y.name: float(found[y][i])}
        cycle = steady_cycle(grid.base.replace(**fields))
        misses.append(abs(cycle.frequency / frequency - 1.0))
    first = chosen[len(chosen) // 2]
    lines += ['', f'single simulations of these settings miss {frequency:g} Hz by '
              f'{max(misses):.0e} at most']
    if {x, y} == {'pump_flow', 'preload'}:
        flow, preload = found['pump_flow'][first], found['preload'][first]
        lines.append(f'try one: hpv-twin twin --ros-args -p pump_flow:={flow:.6g} '
                     f'-p preload:={preload:.6g}')
    return '\n'.join(lines)
