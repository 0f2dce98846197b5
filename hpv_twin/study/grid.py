"""The designs of a map: two fields of a base design, each over a range."""
from __future__ import annotations

import argparse
from typing import NamedTuple

import numpy as np

from hpv_twin.model import Vibrator, VibratorError
from hpv_twin.model.batch import FIGURES
from hpv_twin.model.designs import FIELDS, Designs, check_values

MOST = 10**9  # values of one axis; memory of a map is that of a chunk, not of this
DEFAULT_COUNT = 100
RANGE_HELP = 'LO:HI:N, or LO:HI:N:log for equal ratios'


class Axis(NamedTuple):
    """One field over a range: N values from `low` to `high`, SI."""

    name: str
    low: float
    high: float
    count: int
    log: bool = False

    @property
    def values(self) -> np.ndarray:
        """The values, SI, shape (count,)."""
        spaced = np.geomspace if self.log else np.linspace
        return spaced(self.low, self.high, self.count)

    @property
    def column(self) -> str:
        """Name among the columns of a map: a stroke is a field and, measured, a figure too."""
        return f'design_{self.name}' if self.name in FIGURES else self.name

    def __str__(self):
        return f'{self.low!r}:{self.high!r}:{self.count}{":log" if self.log else ""}'


def read_setting(name: str, text: str) -> Axis | float:
    """Read LO:HI:N[:log], or a single value; VibratorError names what is wrong."""
    parts = text.split(':')
    try:
        if len(parts) == 1:
            value = float(text)
            check_values(name, np.array([value]))
            return value
        log = parts[-1] == 'log'
        low, high, count = parts[:-1] if log else parts
        axis = Axis(name, float(low), float(high), int(count), log)
    except VibratorError:
        raise
    except ValueError:
        raise VibratorError(f'{name} = {text}: expected a number, or {RANGE_HELP}') from None
    if not axis.low < axis.high or not 2 <= axis.count <= MOST or (log and axis.low <= 0.0):
        raise VibratorError(f'{name} = {text}: LO must be below HI{" and above 0" if log else ""}, '
                            f'and N at least 2')
    check_values(name, np.array([axis.low, axis.high]))
    return axis


def add_field_options(parser: argparse.ArgumentParser, first=('pump_flow', 'preload')) -> None:
    """Give the parser an option for every field; those named `first` stand with the main ones."""
    others = parser.add_argument_group(
        'any other field', f'SI units; {RANGE_HELP}; or one value, which changes the base design')
    for name, field in FIELDS.items():
        meta = field.metadata
        group = parser if name in first else others
        text = f'{meta["symbol"]}, {meta["unit"]}: {meta["text"]}'.replace('%', '%%')
        group.add_argument(f'--{name.replace("_", "-")}', metavar='LO:HI:N', dest=f'field_{name}',
                           help=text)


def read_settings(arguments) -> dict[str, Axis | float]:
    """Return what the options of the fields say, in the order of the fields."""
    return {name: read_setting(name, getattr(arguments, f'field_{name}'))
            for name in FIELDS if getattr(arguments, f'field_{name}') is not None}


def default_axis(name: str, base: Vibrator) -> Axis:
    """Range of a map where none is given: flow up to Q_crit, preload up to twice the design's."""
    whole = base.critical_flow if name == 'pump_flow' else 2.0 * base.preload
    low, high = (float(f'{share * whole:.3g}') for share in (0.01, 1.0))
    if not high > 0.0:
        raise VibratorError(f'{name}: this design suggests no range, give one')
    return Axis(name, low, high, DEFAULT_COUNT)


class Grid:
    """All pairs of two axes on a base design; the first axis runs fastest."""

    def __init__(self, base: Vibrator, settings: dict[str, Axis | float]):
        fixed = {name: value for name, value in settings.items() if not isinstance(value, Axis)}
        axes = [value for value in settings.values() if isinstance(value, Axis)]
        self.base = base.replace(**fixed)
        if len(axes) > 2:
            names = ', '.join(axis.name for axis in axes)
            raise VibratorError(f'a map has two ranges, these are {len(axes)}: {names}')
        for name in ('pump_flow', 'preload'):
            if len(axes) < 2 and name not in settings:
                axes.append(default_axis(name, self.base))
        if len(axes) < 2:
            raise VibratorError('a map needs two ranges: pump_flow and preload, or any two fields')
        # The pump's flow along x wherever it is varied, as the map is usually drawn.
        self.x, self.y = sorted(axes, key=lambda axis: axis.name != 'pump_flow')
        self.shape = (self.y.count, self.x.count)

    def __len__(self):
        return self.shape[0] * self.shape[1]

    def designs(self, start: int, stop: int) -> Designs:
        """Return designs number `start` to `stop`, without making the others."""
        row, column = np.unravel_index(np.arange(start, stop), self.shape)
        return Designs(self.base, **{self.x.name: self.x.values[column],
                                     self.y.name: self.y.values[row]})
