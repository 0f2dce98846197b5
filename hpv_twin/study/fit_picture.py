"""The picture of a calibration: one cycle, measured against model, with residuals."""
from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

from .figures import shown_field
from .fit import OFFSETS

mpl.use('Agg')
import matplotlib.pyplot as plt

MEASURED, PRESSURE, POSITION, NOISE = '#adb5bd', '#c92a2a', '#1971c2', '#868e96'
MOST = 6000  # points drawn
BINS = 200


def draw_fit(result, path: Path) -> None:
    """Draw the first recording of a calibration; OSError where the file cannot be written."""
    fitted = result.fit
    problem, shift = fitted.problem, fitted.x[len(fitted.problem.names)]
    rows = [(problem.pressures[0], fitted.wave.pressure_at, 'pressure_offset', 1e-6,
             'pressure, gauge [MPa]', PRESSURE)]
    if problem.positions[0]:
        rows.append((problem.positions[0], fitted.wave.position_at, 'position_offset', 1e3,
                     'plunger position [mm]', POSITION))
    figure, panels = plt.subplots(2 * len(rows), 1, sharex=True, layout='constrained',
                                  figsize=(11.0, 2.6 + 3.4 * len(rows)),
                                  height_ratios=[2.2, 1.0] * len(rows))
    for k, (samples, model, offset, factor, label, colour) in enumerate(rows):
        draw_sensor(panels[2 * k:2 * k + 2], fitted, samples, model,
                    problem.offset(offset, fitted.x), (shift, factor, label, colour))
    panels[-1].set_xlabel('time since the opening [ms]')
    panels[0].set_title(
        f'{result.sources}: {1.0 / result.folds[0].period:.3f} Hz, '
        f'{sum(one.cycles for one in result.folds)} cycles over one another\n' + ',  '.join(
            in_words(v) for v in result.verdicts if v.identified and v.name not in OFFSETS),
        fontsize=10, wrap=True)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def in_words(verdict) -> str:
    """A parameter with its interval, in a person's unit."""
    scale = shown_field(verdict.name)
    return (f'{verdict.name.replace("_", " ")} {scale.factor * verdict.value:.4g} ± '
            f'{scale.text(verdict.half, 2)}')


def draw_sensor(panels, fitted, samples, model, offset, how) -> None:
    """Draw one sensor over a cycle, and measured minus model below it."""
    shift, factor, label, colour = how
    period = 1e3 * fitted.wave.period
    phase = np.mod(samples.phase + shift, 1.0)
    some = np.random.default_rng(0).permutation(len(phase))[:MOST]
    upper, lower = panels
    upper.plot(period * phase[some], (samples.value[some] - offset) * factor, '.', ms=3,
               color=MEASURED, label='measured')
    fine = np.linspace(0.0, 1.0, 4000, endpoint=False)
    upper.plot(period * fine, model(fine) * factor, color=colour, lw=1.4, label='model')
    upper.set_ylabel(label)
    upper.legend(loc='upper center')
    upper.grid(alpha=0.3)
    left = samples.value - offset - model(samples.phase + shift, samples.clock)
    lower.plot(period * phase[some], left[some] * factor, '.', ms=2, color=MEASURED)
    bins = np.floor(phase * BINS).astype(int)
    count = np.bincount(bins, minlength=BINS)
    mean = np.bincount(bins, left, BINS) / np.where(count, count, 1)
    centre = (np.arange(BINS) + 0.5) / BINS * period
    lower.plot(centre[count > 0], mean[count > 0] * factor, color=colour, lw=1.2,
               label='mean')
    limit = 4.0 * float(np.std(left[some])) * factor
    lower.set_ylim(-limit, limit)
    lower.axhline(0.0, color=NOISE, lw=0.6)
    lower.set_ylabel(f'measured − model\n{label.rpartition("[")[2].rstrip("]")}')
    lower.legend(loc='upper right', fontsize=8)
    lower.grid(alpha=0.3)
