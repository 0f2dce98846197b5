"""The picture of an operating map: regimes shaded and named, contours, the base design, Q_crit."""
from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

from hpv_twin.model.batch import CHATTERS, IMPOSSIBLE
from hpv_twin.model.regimes import (
    HELD_OPEN,
    HOVERING,
    NO_OPENING,
    OFF_SEAT,
    OSCILLATING,
    PARTIAL,
    SEAT_REBOUND,
    SEATED,
    STARTING,
)

from .figures import shown, shown_field

mpl.use('Agg')
import matplotlib.pyplot as plt
from matplotlib import patheffects
from matplotlib.colors import ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

# One colour for each regime, the same in every picture.
COLOURS = {SEATED: '#d3f9d8', SEAT_REBOUND: '#fff3bf', PARTIAL: '#c5f6fa', OFF_SEAT: '#ffe3e3',
           HELD_OPEN: '#dee2e6', HOVERING: '#e5dbff', NO_OPENING: '#f8f9fa', STARTING: '#f8f9fa',
           IMPOSSIBLE: '#868e96', CHATTERS: '#ff8787'}
INK, CRITICAL, WANTED, BASE = '#212529', '#c92a2a', '#7048e8', '#e8590c'
LEVELS = (5, 10, 15, 20, 30, 40, 55, 80, 100, 125, 150, 175, 200, 250, 300, 400)  # Hz
PANELS = ('stroke', 'peak_pressure', 'return_pressure', 'impact_energy', 'impact_power',
          'efficiency')
DRAWN = ('frequency', 'regime', *PANELS)  # the columns of a map that its picture shows
HALO = (patheffects.withStroke(linewidth=2.5, foreground='white'),)


def draw_map(grid, columns: dict, path: Path, found: dict | None = None,
             wanted: float | None = None) -> None:
    """
    Draw the map; `found` are settings that give the frequency `wanted`, Hz.

    Raises OSError where the file cannot be written.
    """
    figure = plt.figure(figsize=(18.0, 9.0), layout='constrained')
    left, right = figure.subfigures(1, 2, width_ratios=(1.0, 1.35))
    scales = [shown_field(axis.name) for axis in (grid.x, grid.y)]
    x, y = (axis.values * scale.factor for axis, scale in zip((grid.x, grid.y), scales,
                                                               strict=True))
    main = left.subplots()
    table = {name: values.reshape(grid.shape) for name, values in columns.items()}
    shade(main, x, y, table['regime'])
    marks = decorate(main, grid, scales)
    frequency_contours(main, x, y, table)
    if found is not None and len(found[grid.x.column]):
        at = (found[axis.column] * scale.factor
              for axis, scale in zip((grid.x, grid.y), scales, strict=True))
        main.plot(*at, '.', color=WANTED, markersize=5)
        marks.append(Line2D([], [], color=WANTED, marker='.', linestyle='', markersize=8,
                            label=f'{wanted:g} Hz'))
    patches = [Patch(facecolor=COLOURS[regime], edgecolor='#adb5bd', label=regime)
               for regime in COLOURS if (table['regime'] == regime).any()]
    left.legend(handles=patches + marks, loc='outside lower center', ncols=4, frameon=False)
    main.set_title('Regimes, and frequency in Hz', fontsize=12)
    for axis, name in zip(right.subplots(2, 3).flat, PANELS, strict=True):
        draw_panel(right, axis, x, y, table, name)
        decorate(axis, grid, scales)
    for axis in figure.axes:
        if axis.get_label() != '<colorbar>':
            axis.set(xlabel=scales[0].title, ylabel=scales[1].title, xlim=(x[0], x[-1]),
                     ylim=(y[0], y[-1]), xscale='log' if grid.x.log else 'linear',
                     yscale='log' if grid.y.log else 'linear')
    figure.savefig(path, dpi=100)
    plt.close(figure)


def shade(axis, x, y, regime) -> None:
    """Shade each design's cell by its regime, and write the names of the larger regions."""
    names = list(COLOURS)
    code = np.zeros(regime.shape, dtype=int)
    for number, name in enumerate(names):
        code[regime == name] = number
    axis.pcolormesh(x, y, code, cmap=ListedColormap(list(COLOURS.values())), vmin=-0.5,
                    vmax=len(names) - 0.5, shading='nearest', rasterized=True, zorder=0)
    for name in names:
        here = regime == name
        if here.mean() > 0.02:
            row, column = inmost(here)
            side = 'right' if column > 0.85 * len(x) else 'center'
            axis.text(x[column], y[row], name, ha=side, va='center', fontsize=11,
                      fontweight='bold', color=INK, path_effects=HALO, zorder=6,
                      rotation=0 if here.mean() > 0.15 else 25)


def inmost(here) -> tuple[int, int]:
    """Row and column of the cell of a region that lies furthest from its edge."""
    from scipy.ndimage import distance_transform_edt
    depth = distance_transform_edt(np.pad(here, 1))[1:-1, 1:-1]
    return np.unravel_index(np.argmax(depth), depth.shape)


def frequency_contours(axis, x, y, table) -> None:
    """Contours of the frequency, apart for motion that visits the seat and motion that does not."""
    seat, off = (np.isin(table['regime'], names) for names in
                 ((SEATED, SEAT_REBOUND, PARTIAL), (OFF_SEAT,)))
    for here, style in ((seat, 'solid'), (off, 'dotted')):
        frequency = np.where(here, table['frequency'], np.nan)
        if here.sum() < 4:
            continue
        levels = [f for f in LEVELS if np.nanmin(frequency) < f < np.nanmax(frequency)]
        if levels:
            lines = axis.contour(x, y, frequency, levels=levels, colors=INK, linewidths=0.9,
                                 linestyles=style)
            for text in axis.clabel(lines, fmt='%g', fontsize=9):
                text.set_path_effects(HALO)


def draw_panel(figure, axis, x, y, table, name) -> None:
    """One figure as colour and contours, where the machine oscillates."""
    quantity = shown(name)
    axis.set_title(quantity.title, fontsize=10)
    axis.set_facecolor('#e9ecef')
    oscillates = np.isin(table['regime'], list(OSCILLATING))
    values = np.where(oscillates, table[name] * quantity.factor, np.nan)
    if not np.isfinite(values).any():
        return
    image = axis.pcolormesh(x, y, values, cmap='viridis', shading='nearest', rasterized=True)
    figure.colorbar(image, ax=axis, pad=0.01, aspect=30)
    seated = np.where(table['regime'] == SEATED, values, np.nan)
    # A constant has no contours (the stroke of seated motion is the full one).
    if np.isfinite(seated).sum() > 4 and np.nanmax(seated) - np.nanmin(seated) > 1e-6 * np.nanmax(
            np.abs(seated)):
        lines = axis.contour(x, y, seated, levels=7, colors='white', linewidths=0.7)
        axis.clabel(lines, fmt='%g', fontsize=7)


def decorate(axis, grid, scales) -> list:
    """Mark the base design and the line of Q_crit; returns what the legend says of them."""
    marks = []
    base = [getattr(grid.base, field.name) for field in (grid.x, grid.y)]
    if grid.x.low <= base[0] <= grid.x.high and grid.y.low <= base[1] <= grid.y.high:
        axis.plot(base[0] * scales[0].factor, base[1] * scales[1].factor, marker='*', color=BASE,
                  markersize=13, markeredgecolor='white', linestyle='', zorder=7)
        marks.append(Line2D([], [], marker='*', color=BASE, linestyle='', markersize=11,
                            label='base design'))
    if grid.x.name == 'pump_flow':
        from hpv_twin.model.designs import Designs
        values = np.linspace(grid.y.low, grid.y.high, 200)
        critical = np.broadcast_to(
            Designs(grid.base, **{grid.y.name: values}).critical_flow, len(values))
        axis.plot(critical * scales[0].factor, values * scales[1].factor, color=CRITICAL,
                  linewidth=1.5, linestyle='--', zorder=5)
        marks.append(Line2D([], [], color=CRITICAL, linestyle='--', label='$Q_{crit}$'))
    return marks
