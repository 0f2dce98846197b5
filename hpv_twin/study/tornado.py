"""The tornado of a sensitivity table: one panel per figure, the strongest fields on top."""
from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

from .figures import shown, shown_field

mpl.use('Agg')
import matplotlib.pyplot as plt

MORE, LESS = '#1971c2', '#e8590c'  # the figure grows, falls, with the field
MOST = 14  # fields of a panel
NEGLIGIBLE = 5e-4


def draw_tornado(table, path: Path) -> None:
    """Draw the table; fields at 0, which have no percent, are left out. OSError if it cannot."""
    figure, panels = plt.subplots(1, len(table.figures), squeeze=False, layout='constrained',
                                  figsize=(6.2 * len(table.figures), 6.6))
    proper = np.array([name not in table.per_unit for name in table.fields])
    for axes, name, value, smooth in zip(panels[0], table.figures, table.value.T, table.smooth.T,
                                         strict=True):
        size = np.where(proper & np.isfinite(value), np.abs(value), 0.0)
        places = [i for i in np.argsort(-size)[:MOST] if size[i] > NEGLIGIBLE][::-1]
        draw_bars(axes, [shown_field(table.fields[i]).label for i in places], value[places],
                  smooth[places])
        scale = shown(name)
        axes.set_title(f'{scale.label}: {scale.text(table.at[name])}')
        axes.set_xlabel(f'% of {scale.label} for 1 % of the field')
    figure.suptitle('Sensitivity of the settled motion to the fields of the design')
    figure.savefig(path, dpi=100)
    plt.close(figure)


def draw_bars(axes, labels, values, smooth) -> None:
    """Draw one panel."""
    axes.barh(labels, values, color=[MORE if value > 0.0 else LESS for value in values])
    widest = max(np.abs(values).max(), NEGLIGIBLE) if len(values) else 1.0
    axes.set_xlim(-1.35 * widest, 1.35 * widest)
    axes.axvline(0.0, color='#212529', lw=0.8)
    axes.grid(axis='x', alpha=0.3)
    for place, (value, fine) in enumerate(zip(values, smooth, strict=True)):
        axes.annotate(f'{"" if fine else "~"}{value:+.3f}', (value, place),
                      xytext=(4 if value > 0.0 else -4, 0), textcoords='offset points',
                      va='center', ha='left' if value > 0.0 else 'right', fontsize=8)
