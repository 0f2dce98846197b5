"""`hpv-twin sensitivity`: by how many percent the figures change for a percent of each field."""
from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from hpv_twin import __version__
from hpv_twin.designs import load_design
from hpv_twin.model import Vibrator, VibratorError
from hpv_twin.model.designs import FIELDS, Designs
from hpv_twin.model.quantity import check_quantity
from hpv_twin.model.regimes import OSCILLATING

from .farm import Farm
from .figures import FIGURES_SHOWN, shown, shown_field
from .sweep import add_common_options

FIGURES = ('frequency', 'peak_pressure', 'impact_energy')
STEP = 1e-3  # relative; halved once
SMOOTH = 0.02  # of the largest: two steps that differ by more have met a corner
EXAMPLES = f"""\
examples:
  hpv-twin sensitivity --plot tornado.png
  hpv-twin sensitivity --vibrator best.yaml --figures efficiency,pressure_rate --json
  hpv-twin sensitivity --vibrator bags/run.mcap          the design of a recording

figures: {', '.join(FIGURES_SHOWN)}

Central differences with {STEP:g} and half of it, freed of their leading error; `~` marks where the
two do not agree: the figure has a corner there. A field at 0 has no percent: its row tells by how
many percent the figure changes per unit of the field (the CSV and JSON: the share, per SI unit)."""


def main(argv: list[str] | None = None) -> int:
    """Print the table; 1 where the machine does not oscillate, 2 for arguments that make none."""
    parser = argparse.ArgumentParser(
        prog='hpv-twin sensitivity', epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Normalised derivatives (x/f)(df/dx) of the figures of a machine with respect '
                    'to every field of its design.')
    parser.add_argument('--figures', default=','.join(FIGURES), metavar='NAMES',
                        help='with commas between them (default %(default)s)')
    parser.add_argument('--json', action='store_true', help='print JSON instead of a table')
    parser.add_argument('-o', '--output', metavar='CSV', type=Path, help='write the table')
    parser.add_argument('--plot', metavar='PNG', type=Path, help='draw the tornado')
    add_common_options(parser)
    arguments = parser.parse_args(argv)
    figures = tuple(name.strip() for name in arguments.figures.split(',') if name.strip())
    try:
        for name in figures:
            if name not in FIGURES_SHOWN or name == 'band_miss':
                raise VibratorError(f'no figure "{name}"; there are {", ".join(FIGURES_SHOWN)}')
        base = load_design(arguments.vibrator)
        with Farm(arguments.threads, arguments.dask) as farm:
            table = sensitivities(base, figures, farm)
        if table is None:
            print('hpv-twin sensitivity: the machine does not oscillate: it has no figures',
                  file=sys.stderr)
            return 1
        if arguments.output:
            arguments.output.write_text(as_csv(table), encoding='utf-8')
        print(json.dumps(as_json(table, base), indent=2) if arguments.json else as_text(table))
        if arguments.plot:
            from .tornado import draw_tornado
            draw_tornado(table, arguments.plot)
    except VibratorError as error:
        print(f'hpv-twin sensitivity: {error}', file=sys.stderr)
        return 2
    except OSError as error:
        print(f'hpv-twin sensitivity: {error.filename}: {error.strerror}', file=sys.stderr)
        return 2
    return 0


class Table:
    """
    Derivatives of `figures` (their values in `at`) by field: `value`, shape (fields, figures).

    Normalised, (x/f)(df/dx), 1; for the fields in `per_unit`, which are 0, (df/dx)/f, per SI unit.
    `smooth` tells where the two steps agree, of the same shape.
    """

    def __init__(self, fields, figures, at, value, smooth, per_unit):
        self.fields, self.figures, self.at = fields, figures, at
        self.value, self.smooth, self.per_unit = value, smooth, per_unit


def sensitivities(base: Vibrator, figures: tuple[str, ...], farm: Farm,
                  step: float = STEP) -> Table | None:
    """
    Return the derivatives at a design; None where it does not oscillate.

    A step that would leave the bounds of a field is taken on one side only, with a second-order
    formula.
    """
    values = {name: getattr(base, name) for name in FIELDS}
    if values['line_damping'] is None:
        values['line_damping'] = base.line_damping_in_force
    sizes = {name: step * (abs(value) if value else natural_size(name, base))
             for name, value in values.items()}
    places = {name: stencil(name, values[name], sizes[name]) for name in FIELDS}
    rows = [(name, at) for name, ats in places.items() for at in ats]
    columns = {name: np.array([at if name == moved else values[name] for moved, at in rows])
               for name in FIELDS if name != 'line_damping'}
    # Left to (19) where it is not what is moved: the line's other fields act through it.
    kept = np.nan if base.line_damping is None else base.line_damping
    columns['line_damping'] = np.array([at if moved == 'line_damping' else kept
                                        for moved, at in rows])
    found = farm.run(Designs(base, **columns))
    centre = farm.run(Designs(base, pump_flow=np.array([base.pump_flow])))
    if centre['regime'][0] not in OSCILLATING:
        return None
    at = {name: float(centre[name][0]) for name in figures}
    value, smooth = np.empty((len(FIELDS), len(figures))), np.empty((len(FIELDS), len(figures)))
    for j, figure in enumerate(figures):
        per_row = found[figure].reshape(len(FIELDS), 4)
        for i, name in enumerate(FIELDS):
            coarse, fine = slopes(places[name], values[name], per_row[i], at[figure])
            slope = (4.0 * fine - coarse) / 3.0
            scale = (values[name] if values[name] else 1.0) / at[figure]
            value[i, j], smooth[i, j] = slope * scale, abs(fine - coarse) * abs(scale)
    with np.errstate(invalid='ignore'):
        smooth = smooth <= SMOOTH * np.maximum(np.abs(value), 0.05)
    return Table(tuple(FIELDS), figures, at, value, smooth,
                 {name for name in FIELDS if not values[name]})


def natural_size(name: str, base: Vibrator) -> float:
    """Size of a change that matters, for a field that is 0."""
    sizes = {'load': base.plunger_seat_area * base.opening_pressure,
             'drain_pressure': 0.1 * base.return_pressure, 'viscous_friction': 10.0,
             'line_damping': 0.01}
    return sizes.get(name, 1e-3 * FIELDS[name].metadata['high'])


def stencil(name: str, value: float, size: float) -> tuple[float, ...]:
    """Four places about a value: at a step and at half of it, both on one side at a bound."""
    for places in ((value - size, value + size, value - size / 2, value + size / 2),
                   (value + 2 * size, value + size, value + size, value + size / 2),
                   (value - 2 * size, value - size, value - size, value - size / 2)):
        try:
            for place in places:
                check_quantity(FIELDS[name], place)
        except VibratorError:
            continue
        return places
    raise VibratorError(f'{name} = {value:g} has no room for a step of {size:g} within its bounds')


def slopes(places, value, found, centre) -> tuple[float, float]:
    """Second-order slopes with the step and with half of it, from the figures at a stencil."""
    result = []
    for (a, b), (f_a, f_b) in zip((places[:2], places[2:]), (found[:2], found[2:]), strict=True):
        if (a - value) * (b - value) < 0.0:
            result.append((f_b - f_a) / (b - a))
        else:  # a lies twice as far as b
            result.append((4.0 * f_b - f_a - 3.0 * centre) / (2.0 * (b - value)))
    return tuple(result)


def as_text(table: Table) -> str:
    """The table for a person, the greatest first by the first figure."""
    shown_figures = [shown(name) for name in table.figures]
    head = 'percent for a percent of'
    lines = [f'{head:48}' + ''.join(f'{name.replace("_", " "):>18}' for name in table.figures)]
    lines.append(f'{"at this design":48}' + ''.join(
        f'{scale.text(table.at[name]):>18}'
        for name, scale in zip(table.figures, shown_figures, strict=True)))
    for i in order(table):
        name = table.fields[i]
        field = shown_field(name)
        label = field.label + (f', per {field.unit}' if name in table.per_unit else '')
        scale = 100.0 / field.factor if name in table.per_unit else 1.0
        lines.append(f'  {label:46}' + ''.join(
            f'{text_of(scale * value, smooth):>18}'
            for value, smooth in zip(table.value[i], table.smooth[i], strict=True)))
    return '\n'.join(lines)


def text_of(value: float, smooth: bool) -> str:
    """One derivative."""
    if not np.isfinite(value):
        return '-'
    # Neither -0.0000 nor more digits than mean anything.
    number = f'{round(value, 4) + 0.0:.4f}' if abs(value) < 100.0 else f'{value:.3g}'
    return number if smooth else f'~{number}'


def order(table: Table) -> np.ndarray:
    """Places of the fields, those with most effect on any figure first, those at 0 last."""
    weight = np.nan_to_num(np.abs(table.value)).max(axis=1)
    last = np.array([name in table.per_unit for name in table.fields])
    return np.lexsort((-weight, last))


def as_csv(table: Table) -> str:
    """A row per field, with the unit of the derivative."""
    lines = ['field,unit,' + ','.join(f'{name},{name}_smooth' for name in table.figures)]
    for i, name in enumerate(table.fields):
        unit = f'1/({FIELDS[name].metadata["unit"]})' if name in table.per_unit else '1'
        cells = [f'{value!r},{int(smooth)}' for value, smooth in zip(
            table.value[i].tolist(), table.smooth[i], strict=True)]
        lines.append(','.join([name, unit, *cells]))
    return '\n'.join(lines) + '\n'


def as_json(table: Table, base: Vibrator) -> dict:
    """The table with what it was made of."""
    return {'version': __version__, 'figures': table.at,
            'fields': {name: {'value': getattr(base, name), 'per_unit': name in table.per_unit,
                              **{figure: {'derivative': table.value[i, j],
                                          'smooth': bool(table.smooth[i, j])}
                                 for j, figure in enumerate(table.figures)}}
                       for i, name in enumerate(table.fields)}}


if __name__ == '__main__':
    sys.exit(main())
