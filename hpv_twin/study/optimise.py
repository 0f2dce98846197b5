"""`hpv-twin optimise`: the best designs for several objectives at once, and one of them as YAML."""
from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from pathlib import Path

from hpv_twin import __version__
from hpv_twin.designs import load_design
from hpv_twin.model import Vibrator, VibratorError
from hpv_twin.model.batch import run_designs
from hpv_twin.model.designs import Designs

from .farm import Farm
from .figures import shown, shown_field
from .front import choose, minimised
from .goals import CONSTRAINTS, DEFAULT_OBJECTIVES, FREE, OBJECTIVES, read_goals
from .problem import band_miss
from .results import StudyFileError, read_columns, read_study, write_whole
from .search import search
from .sweep import add_common_options

EVALUATIONS, POPULATION = 20_000, 200
EXAMPLES = f"""\
examples:
  hpv-twin optimise --plot front.png -o front.csv            the paper's five fields
  hpv-twin optimise --free slotted_spring_stiffness,gap_ratio,preload --design best.yaml
  hpv-twin optimise config/optimise.yaml --objectives efficiency,frequency_band,peak_pressure
  hpv-twin optimise --from front.csv --choose 17 --design p17.yaml   a point of a front made before
  hpv-twin twin --ros-args -p vibrator:=best.yaml             and it runs

objectives:  {', '.join(OBJECTIVES)}
constraints: {', '.join(CONSTRAINTS)}
fields without bounds in STUDY go from half to twice the base design; by default free are
{', '.join(FREE)}.

The same seed gives the same front, whatever the threads. Ctrl-C keeps the front so far.
docs/studies.md tells what each objective and constraint is. Exit status 0; 1 if no design keeps
all constraints, 2 for arguments that make no study, 130 when interrupted."""


def main(argv: list[str] | None = None) -> int:
    """Search, print what was found, write what was asked for."""
    parser = argparse.ArgumentParser(
        prog='hpv-twin optimise', epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Search the designs that are best for several objectives at once (NSGA-II), '
                    'within limits on motion, spring, seat and flow: the Pareto front.')
    parser.add_argument('study', nargs='?', metavar='STUDY', type=Path,
                        help='YAML with bounds and limits; see config/optimise.yaml')
    parser.add_argument('--free', type=names_of, metavar='FIELDS',
                        help='fields that may change, with commas between them')
    parser.add_argument('--objectives', type=names_of, default=DEFAULT_OBJECTIVES, metavar='NAMES',
                        help=f'default {",".join(DEFAULT_OBJECTIVES)}')
    parser.add_argument('--without', type=names_of, default=(), metavar='CONSTRAINTS',
                        help='constraints that are not to be kept')
    parser.add_argument('--evaluations', type=int, default=EVALUATIONS, metavar='N',
                        help='designs tried (default %(default)s)')
    parser.add_argument('--population', type=int, default=POPULATION, metavar='N',
                        help='designs of a generation (default %(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='default %(default)s')
    parser.add_argument('-o', '--output', metavar='CSV', type=Path, help='the front, a row a point')
    parser.add_argument('--plot', metavar='PNG', type=Path, help='draw the front')
    parser.add_argument('--from', dest='front', metavar='CSV', type=Path,
                        help='take the front of an earlier run instead of a search')
    parser.add_argument('--choose', default='knee', metavar='POINT',
                        help='a number of the front, "knee" or "best:OBJECTIVE" '
                             '(default %(default)s)')
    parser.add_argument('--design', metavar='YAML', type=Path,
                        help='write the chosen point as a design')
    add_common_options(parser)
    arguments = parser.parse_args(argv)
    try:
        return optimise(arguments)
    except (VibratorError, StudyFileError) as error:
        print(f'hpv-twin optimise: {error}', file=sys.stderr)
        return 2
    except OSError as error:
        print(f'hpv-twin optimise: {error.filename}: {error.strerror}', file=sys.stderr)
        return 2


def names_of(text: str) -> tuple[str, ...]:
    """Split names with commas between them."""
    return tuple(name.strip() for name in text.split(',') if name.strip())


def optimise(arguments) -> int:
    """Do what the arguments say."""
    if arguments.plot:
        from . import front_picture  # what is missing is missed now, not after the work
    interrupted = False
    if arguments.front:
        study, columns = read_front(arguments.front)
    else:
        study, columns, interrupted = new_front(arguments)
    names = tuple(study['objectives'])
    count = len(columns['frequency']) if columns else 0
    if not count:
        print('no design met that keeps all constraints; --without leaves one out',
              file=sys.stderr)
        return 130 if interrupted else 1
    chosen = choose(minimised(columns, names), names, arguments.choose)
    base = base_figures(study)
    print(summary(study, columns, chosen, base))
    if arguments.design:
        arguments.design.write_text(design_of(study, columns, chosen), encoding='utf-8')
        print(f'written: {arguments.design}, point {chosen + 1}; '
              f'hpv-twin twin --ros-args -p vibrator:={arguments.design}', file=sys.stderr)
    if arguments.plot:
        front_picture.draw_front(study, columns, chosen, base, arguments.plot)
        print(f'drawn: {arguments.plot}', file=sys.stderr)
    return 130 if interrupted else 0


def new_front(arguments) -> tuple[dict, dict, bool]:
    """Search; return the study, the front's columns, and whether it was interrupted."""
    if arguments.population < 4 or arguments.evaluations < arguments.population:
        raise VibratorError('--population is at least 4, --evaluations at least the population')
    base = load_design(arguments.vibrator)
    goals = read_goals(base, arguments.study, arguments.free, arguments.objectives,
                       arguments.without)
    study = {'study': 'optimise', 'version': __version__, 'objectives': list(goals.objectives),
             'constraints': list(goals.constraints),
             'free': {name: list(pair) for name, pair in goals.bounds.items()},
             'frequency_band': list(goals.band), 'spring': dataclasses.asdict(goals.spring),
             'limits': dataclasses.asdict(goals.limits), 'seed': arguments.seed,
             'population': arguments.population, 'evaluations': arguments.evaluations,
             'design': dataclasses.asdict(base)}
    if arguments.output and arguments.output.exists():
        raise StudyFileError(f'{arguments.output} exists: name another file with -o, or read it '
                             'with --from')

    def keep(front, done):
        columns = {name: of for name, of in front.columns.items() if name != 'regime_code'}
        write_whole(arguments.output, study | {'tried': done}, columns)
    with Farm(arguments.threads, arguments.dask) as farm:
        front, done = search(base, goals, farm, arguments.population, arguments.evaluations,
                             arguments.seed, keep if arguments.output else None)
    if len(front) and arguments.output:
        keep(front, done)
        print(f'written: {arguments.output}, {len(front)} points after {done} designs',
              file=sys.stderr)
    return study, front.columns, done < arguments.evaluations


def read_front(path: Path) -> tuple[dict, dict]:
    """Read the study and the columns of a front written before."""
    study = read_study(path)
    if study.get('study') != 'optimise':
        raise StudyFileError(f'{path} is no front: its study is {study.get("study")!r}')
    return study, read_columns(path)


def base_figures(study: dict) -> dict:
    """Return the figures of the design that the search began from, each a float."""
    base = Vibrator(**study['design'])
    figures = run_designs(Designs(base, pump_flow=[base.pump_flow]), threads=1)
    figures['band_miss'] = band_miss(figures['frequency'], study['frequency_band'])
    return {name: values[0] for name, values in figures.items()}


def summary(study: dict, columns: dict, chosen: int, base: dict) -> str:
    """What the front spans and what the chosen point is, in some lines."""
    fields = study['design']
    lines = [f'{len(columns["frequency"])} points on the front', '',
             f'{"":30}{"lowest":>14}{"highest":>14}{"point " + str(chosen + 1):>14}{"base":>14}']
    for name in study['objectives']:
        figure, more = OBJECTIVES[name]
        scale, values = shown(figure), columns[figure]
        lines.append(f'{scale.label + (", more" if more else ", less"):30}' + ''.join(
            f'{scale.text(value):>14}'
            for value in (values.min(), values.max(), values[chosen], base[figure])))
    lines += ['', f'point {chosen + 1}:']
    for name in study['free']:
        scale = shown_field(name)
        lines.append(f'  {scale.label:46}{scale.text(columns[name][chosen]):>14}   base '
                     f'{scale.text(fields[name]) if fields[name] is not None else "by (19)"}')
    for figure in ('frequency', 'stroke', 'peak_pressure', 'return_pressure'):
        scale = shown(figure)
        lines.append(f'  {scale.label:46}{scale.text(columns[figure][chosen]):>14}   base '
                     f'{scale.text(base[figure])}')
    return '\n'.join(lines)


def design_of(study: dict, columns: dict, chosen: int) -> str:
    """Return a point of the front as the YAML of a design."""
    changed = [name for name in study['design'] if name in columns and (
        name in study['free'] or name == 'plunger_mass')]
    design = Vibrator(**study['design']).replace(
        **{name: float(columns[name][chosen]) for name in changed})
    told = json.dumps(study['objectives']).strip('[]').replace('"', '')
    origin = f'optimised for {told}; seed {study["seed"]}, point {chosen + 1}'
    return design.to_yaml({name: origin for name in changed})


if __name__ == '__main__':
    sys.exit(main())
