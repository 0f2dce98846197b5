"""Pictures of studies, with matplotlib; the colours are those of the replay."""
from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import numpy as np

from hpv_twin.model import Simulation, Vibrator, find_cycles

mpl.use('Agg')
import matplotlib.pyplot as plt

PRESSURE, PLUNGER, SLEEVE = '#e8590c', '#1c7ed6', '#d6336c'
PHASES = ('closed', 'forward', 'open', 'return')
SHADES = ('#f1f3f5', '#d3f9d8', '#fff3bf', '#ffe3e3')
START_UP = 0.12  # s shown of the triple
RATE = 100_000.0  # Hz


def draw_validation(vibrator: Vibrator, path: Path) -> None:
    """
    Draw the paper's Figure 6 triple (sleeve, plunger, pressure) and the cyclogram of Figure 2.

    Raises OSError where the file cannot be written.
    """
    simulation = Simulation(vibrator)
    start = simulation.advance(START_UP, RATE)
    simulation.advance(0.5, 100.0)
    trace = simulation.advance(1.0, RATE)
    figure = plt.figure(figsize=(12.0, 8.0), layout='constrained')
    left, right = figure.subfigures(1, 2, width_ratios=(1.0, 1.15))
    draw_triple(left, start)
    draw_cyclogram(right, trace)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def draw_triple(figure, trace) -> None:
    """Sleeve, plunger and pressure from rest on."""
    figure.suptitle('From rest: sleeve, plunger, pressure (paper: Figure 6)')
    milliseconds = trace.time * 1e3
    curves = ((trace.sleeve_position * 1e3, 'valve sleeve $y_2$ [mm]', SLEEVE),
              (trace.plunger_position * 1e3, 'plunger $y_1$ [mm]', PLUNGER),
              (trace.pressure * 1e-6, 'pressure, gauge [MPa]', PRESSURE))
    axes = figure.subplots(3, 1, sharex=True)
    for axis, (values, label, colour) in zip(axes, curves, strict=True):
        axis.plot(milliseconds, values, color=colour, linewidth=1.2)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel('time [ms]')


def draw_cyclogram(figure, trace) -> None:
    """Two steady cycles with their phases shaded and the times of (6)."""
    cycles = find_cycles(trace)
    axes = figure.subplots(2, 1, sharex=True)
    if len(cycles) < 3:
        figure.suptitle('No steady cycle')
        return
    figure.suptitle(f'Two steady cycles at {cycles.frequency[-1]:.2f} Hz: cyclogram '
                    '(paper: Figure 2)')
    start, period = cycles.start[-2], cycles.period[-2]
    shown = (trace.time >= start - 0.15 * period) & (trace.time <= start + 1.85 * period)
    time = (trace.time[shown] - start) * 1e3
    axes[0].plot(time, trace.pressure[shown] * 1e-6, color=PRESSURE)
    axes[0].set_ylabel('pressure, gauge [MPa]')
    for value, text in ((cycles.opening_pressure[-2], 'opening'), (cycles.return_pressure[-2],
                                                                   'return')):
        axes[0].axhline(value * 1e-6, color='#868e96', linewidth=0.8, linestyle='--')
        axes[0].annotate(f'{text} {value * 1e-6:.2f}', (time[-1], value * 1e-6), ha='right',
                         va='bottom', fontsize=8, color='#495057')
    axes[1].plot(time, trace.plunger_position[shown] * 1e3, color=PLUNGER, label='plunger $y_1$')
    axes[1].plot(time, trace.sleeve_position[shown] * 1e3, color=SLEEVE, linestyle='--',
                 label='valve sleeve $y_2$')
    axes[1].set_ylabel('position [mm]')
    axes[1].set_xlabel('time after the opening [ms]')
    shade_phases(axes, time, trace.phase[shown])
    axes[1].legend(loc='upper center')
    write_times(axes[0], cycles, -2)


def shade_phases(axes, time, phase) -> None:
    """Shade the background by phase; the legend names the shades."""
    edges = np.concatenate([[0], np.nonzero(np.diff(phase))[0] + 1, [len(phase) - 1]])
    for axis in axes:
        for first, last in pairwise(edges):
            axis.axvspan(time[first], time[last], color=SHADES[phase[first]], zorder=0)
        axis.margins(x=0)
    for number, name in enumerate(PHASES):
        axes[1].plot([], [], color=SHADES[number], linewidth=8, label=name)


def write_times(axis, cycles, index) -> None:
    """Write the plunger's row of (6) above the pressure."""
    names = (('$t_{kn}$', cycles.forward), ('$t_{kb}$', cycles.dwell),
             ('$t_{RS}$', cycles.return_stroke), ('$t_{kh}$', cycles.build_up))
    text = '   '.join(f'{name} {values[index] * 1e3:.3f} ms' for name, values in names)
    axis.set_title(f'{text}   period {cycles.period[index] * 1e3:.3f} ms', fontsize=9)
