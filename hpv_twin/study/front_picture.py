"""The picture of a Pareto front: objectives pairwise, free fields along it, one point marked."""
from __future__ import annotations

from itertools import combinations
from pathlib import Path

import matplotlib as mpl

from .figures import shown, shown_field
from .goals import OBJECTIVES

mpl.use('Agg')
import matplotlib.pyplot as plt
from matplotlib import patheffects
from matplotlib.lines import Line2D

CHOSEN, BASE, BOUND = '#c92a2a', '#e8590c', '#adb5bd'
MOST_PAIRS = 6


def draw_front(study: dict, columns: dict, chosen: int, base: dict, path: Path) -> None:
    """
    Draw the front of a study.

    `chosen` is the place of the point to be marked, `base` has the figures of the base design.
    Above, each pair of objectives, coloured by the first one not in it (by the first free field
    where there are two only); below, each free field against the first objective, with its bounds.
    Raises OSError where the file cannot be written.
    """
    names = [OBJECTIVES[name][0] for name in study['objectives']]
    pairs = list(combinations(names, 2))[:MOST_PAIRS] or [(names[0], 'frequency')]
    free = list(study['free'])
    figure = plt.figure(figsize=(max(4.6 * len(pairs), 3.1 * len(free), 11.0), 8.6),
                        layout='constrained')
    above, below = figure.subfigures(2, 1, height_ratios=(1.25, 1.0))
    for axes, pair in zip(above.subplots(1, len(pairs), squeeze=False)[0], pairs, strict=True):
        third = next((name for name in names if name not in pair), None)
        draw_pair(axes, columns, pair, third or free[0], chosen)
        x, y = (base[name] * shown(name).factor for name in pair)
        axes.plot(x, y, 'o', ms=9, color=BASE, mec='white')
    above.legend(handles=legend(chosen), loc='outside upper center', ncols=4, frameon=False)
    first = shown(names[0])
    for axes, name in zip(below.subplots(1, len(free), sharey=True, squeeze=False)[0], free,
                          strict=True):
        draw_field(axes, study, columns, (name, names[0]), chosen)
    below.axes[0].set_ylabel(first.title)
    better = ', '.join(f'{shown(OBJECTIVES[name][0]).label} '
                       f'{"up" if OBJECTIVES[name][1] else "down"}'
                       for name in study['objectives'])
    figure.suptitle(f'Pareto front, {len(columns[names[0]])} designs: {better}', fontsize=13)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def legend(chosen) -> list:
    """What the marks and lines are."""
    return [Line2D([], [], marker='*', ms=13, color=CHOSEN, ls='', label=f'point {chosen + 1}'),
            Line2D([], [], marker='o', ms=8, color=BASE, ls='', label='base design'),
            Line2D([], [], color=BASE, label='its value of a field'),
            Line2D([], [], color=BOUND, ls=':', label='bounds of a field')]


def draw_pair(axes, columns, pair, third, chosen) -> None:
    """Draw two objectives of the front against one another, coloured by a third quantity."""
    x, y = (shown(name) for name in pair)
    colour = shown_any(third)
    points = axes.scatter(columns[pair[0]] * x.factor, columns[pair[1]] * y.factor, s=9,
                          c=columns[third] * colour.factor, cmap='viridis')
    mark(axes, columns[pair[0]][chosen] * x.factor, columns[pair[1]][chosen] * y.factor, chosen)
    axes.set_xlabel(x.title)
    axes.set_ylabel(y.title)
    axes.grid(alpha=0.3)
    axes.figure.colorbar(points, ax=axes, label=colour.title)


def draw_field(axes, study, columns, pair, chosen) -> None:
    """Draw the first objective against a free field, with bounds and the base design's value."""
    name, figure = pair
    x, y = shown_field(name), shown(figure)
    axes.scatter(columns[name] * x.factor, columns[figure] * y.factor, s=7, c='#1971c2')
    mark(axes, columns[name][chosen] * x.factor, columns[figure][chosen] * y.factor, chosen)
    for bound in study['free'][name]:
        axes.axvline(bound * x.factor, color=BOUND, lw=1.0, ls=':')
    if study['design'][name] is not None:
        axes.axvline(study['design'][name] * x.factor, color=BASE, lw=1.4)
    axes.set_xlabel(x.title.replace(' (', '\n('))
    axes.grid(alpha=0.3)


def mark(axes, x, y, chosen) -> None:
    """Mark the chosen point and write its number."""
    axes.plot(x, y, marker='*', ms=15, color=CHOSEN, mec='white', ls='none')
    axes.annotate(f'{chosen + 1}', (x, y), xytext=(8, 6), textcoords='offset points',
                  color=CHOSEN, fontsize=10, weight='bold',
                  path_effects=[patheffects.withStroke(linewidth=2.5, foreground='white')])


def shown_any(name: str):
    """How a figure or a field is shown."""
    try:
        return shown(name)
    except KeyError:
        return shown_field(name)

