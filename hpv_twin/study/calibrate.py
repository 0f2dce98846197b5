"""`hpv-twin calibrate`: a design fitted to the recorded sensors of a machine, honestly."""
from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from tqdm import tqdm

from hpv_twin import __version__
from hpv_twin.designs import HELP, METAVAR, load_design
from hpv_twin.model import Vibrator, VibratorError

from .fit import CHOICES, FREE, OFFSETS, Fit, Problem, fit
from .folding import Fold, fold, refuse_other_stroke, same_machine
from .guesses import first_guesses
from .measured import AMBIENT, CalibrationError, Measured, RecordingError, read_measured
from .samples import first_samples
from .verdicts import Verdict, judge, quantities
from .weighing import left_of

STRANGE = 0.03  # of the range: what a model of the right machine does not leave unexplained
PERIOD_MISSED = 1e-3  # relative
ORDERED = 3.0  # the same for plain noise is 1
EXAMPLES = f"""\
examples:
  hpv-twin calibrate machine.mcap -o machine.yaml --plot fit.png
  hpv-twin calibrate machine.mcap --free bulk_modulus,pump_flow,preload,plunger_mass
  hpv-twin calibrate monday.mcap tuesday.mcap --gauge --vibrator drawing.yaml
  hpv-twin calibrate bags/run.mcap --from 10 --to 40 --pressure-topic /plant/p
  hpv-twin twin --ros-args -p vibrator:=machine.yaml        and the twin is that machine

free parameters: any of {', '.join(CHOICES)};
by default {', '.join(FREE)}.
Everything else is taken from the starting design, so let that be the machine's drawing.

Each value has its 95 % interval. What the data do not tell is said to be NOT identifiable, with the
reason, and keeps its starting value. docs/calibration.md tells how it is done. Exit status 0; 1
where the recording is refused, with the reason; 2 for arguments that make no calibration."""


def main(argv: list[str] | None = None) -> int:
    """Calibrate, print what was found, write what was asked for."""
    parser = argparse.ArgumentParser(
        prog='hpv-twin calibrate', epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Fit the model to pressure, and position where there is a sensor of it, that a '
                    'machine with steady settings has shown: 1000 samples per second or more.')
    parser.add_argument('files', metavar='FILE', nargs='+', type=Path,
                        help='recording (.mcap, or the folder of a split one)')
    parser.add_argument('--vibrator', metavar=METAVAR,
                        help=f'where to start from: {HELP}; default: the built-in one')
    parser.add_argument('--free', metavar='NAMES', default=','.join(FREE),
                        help='parameters to be found, with commas between them')
    parser.add_argument('--gauge', action='store_true', help='the pressure recorded is gauge')
    parser.add_argument('--ambient', metavar='PA', type=float,
                        help=f'default: what the recording tells, else {AMBIENT:.0f}')
    parser.add_argument('--pressure-topic', metavar='TOPIC', help='of type FluidPressure')
    parser.add_argument('--position-topic', metavar='TOPIC', help='of type JointState')
    parser.add_argument('--no-position', action='store_true', help='leave a position out')
    parser.add_argument('--from', dest='start', metavar='S', type=float,
                        help='s from the beginning')
    parser.add_argument('--to', dest='end', metavar='S', type=float)
    parser.add_argument('-o', '--output', metavar='YAML', type=Path,
                        help='write the design, with what each value comes from')
    parser.add_argument('--json', action='store_true', help='print JSON instead of a table')
    parser.add_argument('--plot', metavar='PNG', type=Path,
                        help='draw measured against model, with residuals')
    arguments = parser.parse_args(argv)
    try:
        return run(arguments)
    except VibratorError as error:
        print(f'hpv-twin calibrate: {error}', file=sys.stderr)
        return 2
    except (CalibrationError, RecordingError) as error:
        print(f'hpv-twin calibrate: refused: {error}', file=sys.stderr)
        return 1
    except OSError as error:
        print(f'hpv-twin calibrate: {error.filename}: {error.strerror}', file=sys.stderr)
        return 2


def run(arguments) -> int:
    """Do what the arguments say."""
    free = tuple(name.strip() for name in arguments.free.split(',') if name.strip())
    for name in free:
        if name not in CHOICES:
            raise VibratorError(f'no free parameter "{name}"; there are {", ".join(CHOICES)}')
    start = load_design(arguments.vibrator)
    recordings = [read(path, arguments) for path in arguments.files]
    result = calibrate(recordings, start, free)
    if arguments.json:
        print(json.dumps(result.as_json(), indent=2))
    else:
        print(result.as_text())
    if arguments.output:
        arguments.output.write_text(result.to_yaml(), encoding='utf-8')
        print(f'written: {arguments.output}', file=sys.stderr)
    if arguments.plot:
        from .fit_picture import draw_fit
        draw_fit(result, arguments.plot)
        print(f'drawn: {arguments.plot}', file=sys.stderr)
    return 0


def read(path: Path, arguments) -> Measured:
    """Read one recording, with a bar for a long one."""
    with tqdm(desc=f'reading {path.name}', unit='B', unit_scale=True, file=sys.stderr,
              disable=None, delay=0.5) as bar:
        def progress(done, total):
            bar.total = total
            bar.update(done - bar.n)
        measured = read_measured(path, arguments.gauge, arguments.ambient,
                                 arguments.pressure_topic, arguments.position_topic,
                                 (arguments.start, arguments.end), progress)
    if arguments.no_position:
        return Measured(measured.name, measured.time, measured.pressure, np.empty(0), np.empty(0))
    return measured


class Calibration:
    """The outcome: the `fit`, a Verdict for every free parameter, and what shows most directly."""

    def __init__(self, recordings: list[Measured], folds: list[Fold], fitted: Fit,
                 verdicts: list[Verdict]):
        self.recordings, self.folds, self.fit, self.verdicts = recordings, folds, fitted, verdicts
        self.quantities = quantities(fitted)

    @property
    def design(self) -> Vibrator:
        """The design: calibrated values, starting values for all else."""
        return self.fit.design

    @property
    def sources(self) -> str:
        """Names of the recordings."""
        return ', '.join(measured.name for measured in self.recordings)

    def to_yaml(self) -> str:
        """The design, each value with what it comes from."""
        origins = {}
        for verdict in self.verdicts:
            if verdict.name in OFFSETS:
                continue
            origins[verdict.name] = (
                f'calibrated from {self.sources}: ± {verdict.half:.2g} (95 %)'
                if verdict.identified else
                f'NOT identifiable from {self.sources}: as it was before; {verdict.why}')
        return self.design.to_yaml(origins)

    def as_json(self) -> dict:
        """Everything, for machines."""
        names = self.fit.problem.names
        return {
            'version': __version__, 'recordings': [measured.name for measured in self.recordings],
            'frequency': 1.0 / self.folds[0].period,
            'cycles': sum(fold_.cycles for fold_ in self.folds),
            'parameters': {v.name: told(v) for v in self.verdicts},
            'quantities': {v.name: told(v) for v in self.quantities},
            'correlations': {one: {other: self.fit.correlation(one, other) for other in names
                                   if other != one} for one in names},
            'residual': {'chi2_per_sample': self.fit.cost, 'more_than_noise': self.fit.order,
                         'pressure_rms': self.pressure_rms()}}

    def as_text(self) -> str:
        """Everything, for a person."""
        fold_ = self.folds[0]
        lines = [f'{self.sources}: {1.0 / fold_.period:.4f} Hz, '
                 f'{sum(f.cycles for f in self.folds)} cycles, pressure '
                 + ('and position' if self.fit.problem.positions[0] else 'alone')
                 + f'; residual {self.pressure_rms() * 1e-6:.4f} MPa', '']
        for verdict in self.verdicts:
            if verdict.identified:
                share = (f'  ({100.0 * verdict.half / abs(verdict.value):.2f} %)'
                         if verdict.value and verdict.name not in OFFSETS else '')
                lines.append(f'{verdict.name:26}{verdict.value:.6g} ± {verdict.half:.2g} '
                             f'{verdict.unit}{share}')
            else:
                lines.append(f'{verdict.name:26}NOT identifiable, kept at {verdict.kept:.6g} '
                             f'{verdict.unit}')
            if verdict.why:
                lines.append(f'{"":26}  {verdict.why}')
        lines.append('')
        for verdict in self.quantities:
            lines.append(f'{verdict.why:26}{verdict.value:.6g} ± {verdict.half:.2g} '
                         f'{verdict.unit}  ({100.0 * verdict.half / abs(verdict.value):.2f} %)')
        strong = self.strong_correlations()
        if strong:
            lines += ['', 'correlations: ' + ', '.join(strong)]
        lines.append('± is half of the 95 % interval, scaled by the residuals')
        if self.fit.order > ORDERED:
            lines.append('CAUTION: what is left is not noise: it stands in the same places of '
                         f'every cycle, {self.fit.order:.0f} times what noise would. Something '
                         'that was not free is not as in the starting design; the intervals are '
                         'widened, and may yet be too narrow.')
        return '\n'.join(lines)

    def strong_correlations(self) -> list[str]:
        """Pairs that lean on one another, in words."""
        names = self.fit.problem.names
        return [f'{one} and {other} {self.fit.correlation(one, other):+.2f}'
                for k, one in enumerate(names) for other in names[k + 1:]
                if abs(self.fit.correlation(one, other)) > 0.7]

    def pressure_rms(self) -> float:
        """RMS of measured minus model, Pa."""
        return float(np.sqrt(np.mean(np.concatenate(
            [residual_of(self.fit, k) for k in range(len(self.recordings))]) ** 2)))


def told(verdict: Verdict) -> dict:
    """A verdict as JSON."""
    row = {'unit': verdict.unit, 'identifiable': verdict.identified}
    if verdict.identified:
        row |= {'value': verdict.value, 'low': verdict.value - verdict.half,
                'high': verdict.value + verdict.half}
    else:
        row['kept'] = verdict.kept
    return row | ({'note': verdict.why} if verdict.why else {})


def residual_of(fitted: Fit, k: int) -> np.ndarray:
    """Measured minus model of one recording's pressure, Pa."""
    return left_of(fitted.problem, fitted.x, k, fitted.wave)[0]


def calibrate(recordings: list[Measured], start: Vibrator,
              free: tuple[str, ...] = FREE) -> Calibration:
    """Calibrate from recordings of one machine; CalibrationError says why they are refused."""
    folds = [fold(measured) for measured in recordings]
    same_machine(recordings, folds)
    for measured in recordings:
        refuse_other_stroke(measured, start.stroke)
    laid = [first_samples(measured, one) for measured, one in zip(recordings, folds, strict=True)]
    pressures, positions = ([pair[k] for pair in laid] for k in range(2))
    if not any(positions):
        free = tuple(name for name in free if name != 'position_offset')
    problem = Problem(start, free, pressures, positions, folds)
    guesses = first_guesses(start, free, recordings[0], folds[0])
    # Every recording begins at a fall of its own: the phase is the same.
    starts = [np.append(guess, [guess[-1]] * (len(recordings) - 1)) for guess in guesses]
    with tqdm(desc='fitting', total=len(starts) + 4, file=sys.stderr, disable=None,
              delay=0.5) as bar:
        fitted = fit(problem, starts, bar.update)
        if fitted is None:
            raise CalibrationError(f'{recordings[0].name}: the starting design does not oscillate '
                                   'anywhere near these data; --vibrator names a nearer one')
        refuse_strange(recordings, folds, fitted)
        fitted, verdicts = judge(fitted, refit)
        bar.update(bar.total - bar.n)
    return Calibration(recordings, folds, fitted, verdicts)


def refit(fitted: Fit, names: tuple[str, ...]) -> Fit | None:
    """Fit fewer parameters, the others as they were at the start, from where a fit ended."""
    before = fitted.problem
    kept = [before.names.index(name) for name in names]
    x = np.concatenate([fitted.x[kept], fitted.x[len(before.names):]])
    problem = Problem(before.start, names, before.pressures, before.positions, before.folds,
                      before.period)
    return fit(problem, [x], rounds=1)


def refuse_strange(recordings: list[Measured], folds: list[Fold], fitted: Fit) -> None:
    """Raise CalibrationError where the best fit is none."""
    name = recordings[0].name
    missed = fitted.wave.period / fitted.problem.period - 1.0
    if abs(missed) > PERIOD_MISSED:
        raise CalibrationError(
            f'{name}: with these free parameters the model cannot have {1.0 / folds[0].period:.2f} '
            f'Hz (the nearest is {1.0 / fitted.wave.period:.2f} Hz): free others, or start from '
            'another design')
    for k, (measured, one) in enumerate(zip(recordings, folds, strict=True)):
        left = residual_of(fitted, k)
        bins = np.floor(np.mod(fitted.problem.pressures[k].phase, 1.0) * 100).astype(int)
        count = np.bincount(bins, minlength=100)
        mean = np.bincount(bins, left, 100)[count > 0] / count[count > 0]
        share = float(np.sqrt(np.mean(mean ** 2))) / one.span
        if share > STRANGE:
            raise CalibrationError(
                f'{measured.name}: this is not this machine: the best fit leaves '
                f"{100.0 * share:.1f} % of the pressure's range unexplained, in the same places "
                'of every cycle; another design to start from, or other free parameters?')


if __name__ == '__main__':
    sys.exit(main())
