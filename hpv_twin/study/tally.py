"""What a map shows, gathered block by block: its memory does not grow with the map."""
from __future__ import annotations

import numpy as np

from hpv_twin.model.regimes import OSCILLATING, SEATED

from .figures import shown, shown_field
from .grid import Grid

SAFE_PRESSURE = 40e6  # Pa gauge; above it the twin warns
BEST = ('peak_pressure', 'impact_energy', 'impact_power', 'efficiency')


class Tally:
    """
    Designs and frequencies by regime, the seated bests, what needs a warning.

    `keep` names columns that are wanted whole, for a picture or a search along the map.
    """

    def __init__(self, grid: Grid, keep: tuple[str, ...] = ()):
        self.grid, self.keep = grid, keep
        self.counts: dict[str, int] = {}
        self.frequencies: dict[str, tuple[float, float]] = {}
        self.best: dict[str, tuple[float, float, float]] = {}  # the figure, and x and y there
        self.over = self.unsettled = 0
        self._kept: list[dict] = []

    def take_in(self, block: dict) -> None:
        """Take in some rows of the map: columns of arrays of one length."""
        for regime in np.unique(block['regime']):
            self._count(str(regime), block['frequency'][block['regime'] == regime])
        seated = np.flatnonzero(block['regime'] == SEATED)
        for name in BEST if len(seated) else ():
            i = seated[np.argmax(block[name][seated])]
            if name not in self.best or block[name][i] > self.best[name][0]:
                self.best[name] = tuple(block[key][i] for key in (
                    name, self.grid.x.column, self.grid.y.column))
        self.over += int(np.count_nonzero(block['peak_pressure'] > SAFE_PRESSURE))
        self.unsettled += int(np.count_nonzero(block['settled'] == 0.0))
        if self.keep:
            self._kept.append({name: block[name] for name in self.keep})

    def _count(self, regime, frequency):
        self.counts[regime] = self.counts.get(regime, 0) + len(frequency)
        low, high = self.frequencies.get(regime, (np.inf, -np.inf))
        self.frequencies[regime] = min(low, frequency.min()), max(high, frequency.max())

    def columns(self) -> dict:
        """Return the columns kept, each of shape (designs,)."""
        return {name: np.concatenate([block[name] for block in self._kept]) for name in self.keep}

    def text(self) -> str:
        """What the map shows, in some lines."""
        grid, total = self.grid, sum(self.counts.values())
        x, y = shown_field(grid.x.name), shown_field(grid.y.name)
        lines = [f'{total} designs: {grid.x.count} of {x.label}, {x.text(grid.x.low)} to '
                 f'{x.text(grid.x.high)}; {grid.y.count} of {y.label}, {y.text(grid.y.low)} to '
                 f'{y.text(grid.y.high)}', '']
        for regime, count in sorted(self.counts.items(), key=lambda pair: -pair[1]):
            line = f'{regime:22}{count:8d}  {100.0 * count / total:5.1f} %'
            if regime in OSCILLATING:
                low, high = self.frequencies[regime]
                line += f'   {low:.4g} to {high:.4g} Hz'
            lines.append(line)
        for name, (value, at_x, at_y) in self.best.items():
            lines.append(f'highest {shown(name).label}, seated: {shown(name).text(value)} at '
                         f'{x.text(at_x)}, {y.text(at_y)}')
        if self.over:
            lines.append(f'{self.over} designs go above {SAFE_PRESSURE * 1e-6:g} MPa gauge: the '
                         'model has no relief valve')
        if self.unsettled:
            lines.append(f'{self.unsettled} designs had not settled when they were measured')
        return '\n'.join(lines)
