"""`hpv-twin sweep`: the operating map of a machine over flow and preload, or any two fields."""
from __future__ import annotations

import argparse
import contextlib
import dataclasses
import sys
from pathlib import Path

from tqdm import tqdm

from hpv_twin import __version__
from hpv_twin.designs import HELP, METAVAR, load_design
from hpv_twin.model import VibratorError
from hpv_twin.model.batch import CYCLES, FIGURES

from .farm import Farm
from .grid import RANGE_HELP, Grid, add_field_options, read_settings
from .results import Results, StudyFileError
from .tally import Tally

EXAMPLES = """\
examples:
  hpv-twin sweep --plot map.png                                the map, flow up to Q_crit
  hpv-twin sweep --pump-flow 2e-4:2e-3:200 --preload 2e-3:8e-3:100 -o map.csv --plot map.png
  hpv-twin sweep --want-frequency 80                           flows and preloads that give 80 Hz
  hpv-twin sweep --stroke 1e-3:3e-3:50 --slotted-spring-stiffness 1e5:4e5:50 --plot k1.png
  hpv-twin sweep --load 300 -o loaded.parquet                  the base design under 300 N
  hpv-twin sweep -o map.csv --dask tcp://127.0.0.1:8786        on the workers of a dask cluster

Ctrl-C keeps the rows that are done: the same command goes on from there. docs/studies.md tells what
each figure is. Exit status 0, 2 for arguments that make no study, 130 when interrupted."""

USAGE = """hpv-twin sweep [--pump-flow LO:HI:N] [--preload LO:HI:N] [--FIELD LO:HI:N]
       [-o CSV] [--plot PNG] [--want-frequency HZ] [--vibrator DESIGN] [--cycles N]
       [--threads N] [--dask ADDRESS]"""


def add_common_options(parser: argparse.ArgumentParser) -> None:
    """Give a study the options that all of them have."""
    parser.add_argument('--vibrator', metavar=METAVAR, help=f'{HELP}; default: the built-in one')
    parser.add_argument('--threads', type=int, metavar='N', help='threads; default: all cores')
    parser.add_argument('--dask', metavar='ADDRESS', help='scheduler of a dask cluster that does '
                        'the work, e.g. tcp://127.0.0.1:8786')


def main(argv: list[str] | None = None) -> int:
    """Make the map, print what it shows; 2 where the arguments make no study."""
    parser = argparse.ArgumentParser(
        prog='hpv-twin sweep', epilog=EXAMPLES, usage=USAGE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Map what a machine does over pump flow and preload, or any two of its '
                    f'fields. Ranges are {RANGE_HELP}, SI units, pressures gauge.')
    add_field_options(parser)
    parser.add_argument('-o', '--output', metavar='CSV', type=Path,
                        help='one row per design; .parquet is written where pyarrow is installed')
    parser.add_argument('--plot', metavar='PNG', type=Path, help='draw the map')
    parser.add_argument('--want-frequency', metavar='HZ', type=float,
                        help='print the settings along the map that give this frequency')
    parser.add_argument('--cycles', type=int, default=CYCLES, metavar='N',
                        help='settled cycles measured of each design (default %(default)s)')
    add_common_options(parser)
    arguments = parser.parse_args(argv)
    try:
        return sweep(arguments)
    except (VibratorError, StudyFileError) as error:
        print(f'hpv-twin sweep: {error}', file=sys.stderr)
        return 2


def sweep(arguments) -> int:
    """Do what the arguments say."""
    if arguments.cycles < 1 or (arguments.threads or 1) < 1:
        raise VibratorError('--cycles and --threads are at least 1')
    if arguments.want_frequency is not None and not arguments.want_frequency > 0.0:
        raise VibratorError('--want-frequency must be above 0 Hz')
    grid = Grid(load_design(arguments.vibrator), read_settings(arguments))
    keep = ()
    if arguments.want_frequency is not None:
        keep = (grid.x.column, grid.y.column, 'frequency', 'regime')
    if arguments.plot:
        from . import map_picture  # what is missing is missed now, not after the work
        keep = tuple(dict.fromkeys((*keep, *map_picture.DRAWN)))
    with Farm(arguments.threads, arguments.dask, arguments.cycles) as farm:
        tally = work_through(grid, farm, arguments.output, keep)
        if tally is None:
            return 130
        print(tally.text())
        columns, found = tally.columns(), None
        if arguments.want_frequency is not None:
            from .want import report, settings_for
            found = settings_for(grid, columns, arguments.want_frequency, farm)
            print(report(grid, found, arguments.want_frequency))
    if arguments.plot:
        map_picture.draw_map(grid, columns, arguments.plot, found, arguments.want_frequency)
        print(f'drawn: {arguments.plot}', file=sys.stderr)
    return 0


def study_of(grid: Grid, cycles: int) -> dict:
    """What makes two maps the same study."""
    return {'study': 'sweep', 'version': __version__, 'x': f'{grid.x.name} {grid.x}',
            'y': f'{grid.y.name} {grid.y}', 'cycles': cycles,
            'design': dataclasses.asdict(grid.base)}


def work_through(grid: Grid, farm: Farm, output: Path | None,
                 keep: tuple[str, ...] = ()) -> Tally | None:
    """Return what the whole map shows, with the columns to keep; None when it was interrupted."""
    names = [grid.x.column, grid.y.column, *FIGURES, 'regime']
    results = Results(output, study_of(grid, farm.cycles), names) if output else None
    tally = Tally(grid, keep)
    start = results.rows if results else 0
    if start:
        print(f'{output}: {start} of {len(grid)} designs are there', file=sys.stderr)
        for block in results.blocks():
            tally.take_in(block)
    try:
        with tqdm(total=len(grid), initial=start, unit=' designs', smoothing=0.1, file=sys.stderr,
                  disable=None) as bar:
            for done, figures in farm.work_off(len(grid), grid.designs, start):
                block = with_fields(grid, start, done, figures)
                if results:
                    results.append(block)
                tally.take_in(block)
                bar.update(done - start)
                start = done
    except KeyboardInterrupt:
        # The file knows what it has: the signal may have come between its writing and our counting.
        start = results.count() if results else start
        kept = f'kept in {output}, the same command goes on from there' if output else \
            'lost: with -o FILE they are kept'
        print(f'\nstopped: {start} of {len(grid)} designs {kept}', file=sys.stderr)
        return None
    if results:
        results.finish()
        print(f'written: {output}, {len(grid)} designs', file=sys.stderr)
    return tally


def with_fields(grid: Grid, start: int, stop: int, figures: dict) -> dict:
    """Put the two fields of the map beside the figures."""
    designs = grid.designs(start, stop)
    return {axis.column: getattr(designs, axis.name) for axis in (grid.x, grid.y)} | figures


if __name__ == '__main__':
    with contextlib.suppress(KeyboardInterrupt):
        sys.exit(main())
