"""
Calibration against machines whose values are known: errors, coverage of the intervals, times.

    python bench/calibration.py
    python bench/calibration.py --machines 10

Each machine is a design drawn at random about the base design, in every field, and its motion is
integrated by an integrator other than the twin's own: Euler's method in C, steps of 0.1 µs. Noise
is 0.5 % of the range, rates are 2 to 10 kHz, and the start is the machine's own design with the
free parameters off by up to 20 %. Each recording is calibrated twice: with position, and by
pressure alone.
"""
import argparse
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
from rivals import CEuler
from tqdm import tqdm

from hpv_twin.model import Simulation, Vibrator
from hpv_twin.model.batch import run_designs
from hpv_twin.model.designs import Designs
from hpv_twin.recording.measurements import MeasurementFile
from hpv_twin.study.calibrate import calibrate
from hpv_twin.study.fit import FREE
from hpv_twin.study.measured import CalibrationError, Measured, read_measured
from hpv_twin.study.verdicts import opening_force

NOISE = 0.005  # of the range
OFF = 0.2  # by so much the starting values may be off
AMBIENT = 101_325.0
SETTLED = 0.3  # s
TARGETS = {'kappa/W0': 0.5, 'pump_flow': 0.5, 'opening force': 0.3, 'flow_coefficient': 1.0}  # %
TOLD = ('bulk_modulus', 'pump_flow', 'preload', 'flow_coefficient', 'viscous_friction')
FIXED = ('plunger_seat_diameter', 'sleeve_seat_diameter', 'stroke', 'gap_ratio', 'plunger_mass',
         'sleeve_mass', 'slotted_spring_stiffness', 'twisted_spring_stiffness', 'cavity_volume')


class FineEuler(CEuler):
    """Euler's method in C with a step so fine that it is off by some 1e-5."""

    step = 1e-7


def machines(count, random):
    """Designs drawn about the base design that oscillate seated, period-1, below 40 MPa."""
    base, found = Vibrator(), []
    while len(found) < count:
        fields = {name: getattr(base, name) * random.uniform(0.9, 1.1, 8 * count)
                  for name in FIXED}
        fields |= {name: getattr(base, name) * random.uniform(0.8, 1.25, 8 * count)
                   for name in TOLD}
        designs = Designs(base, **fields)
        figures = run_designs(designs)
        good = ((figures['regime'] == 'seated oscillation') & (figures['period_spread'] < 1e-9)
                & (figures['peak_pressure'] < 40e6))
        found += [designs.vibrator(i) for i in np.flatnonzero(good)]
    return found[:count]


def record(design, seconds, rate, random, path):
    """Write what the sensors of a machine show, its motion by the other integrator."""
    samples = FineEuler(design, SETTLED + seconds, rate).run()[0][round(SETTLED * rate):]
    pressure = samples[:, 0] + NOISE * np.ptp(samples[:, 0]) * random.standard_normal(len(samples))
    position = samples[:, 1] + NOISE * np.ptp(samples[:, 1]) * random.standard_normal(len(samples))
    stamps = np.round(1e9 * np.arange(len(samples)) / rate).astype(np.int64) + 10 ** 18
    with MeasurementFile(path, metadata={'ambient_pressure': repr(AMBIENT)}) as file:
        file.write(stamps, pressure + AMBIENT, position)


def off(design, random):
    """Return the same drawing with wrong ideas of what is to be found."""
    return design.replace(**{name: getattr(design, name) * random.uniform(1.0 - OFF, 1.0 + OFF)
                             for name in TOLD})


def truths(design):
    """What is to be found, by the names of the outcome."""
    return {name: getattr(design, name) for name in TOLD} | {
        'pressure_offset': 0.0, 'position_offset': 0.0}


def judge(result, design):
    """Errors (%) of what has a target, halves of their intervals (%), which intervals hold."""
    verdicts = {verdict.name: verdict for verdict in result.verdicts}
    by_name = {verdict.name: verdict for verdict in result.quantities}
    pairs = {'kappa/W0': (by_name['cavity_stiffness'], design.bulk_modulus / design.cavity_volume),
             'pump_flow': (verdicts['pump_flow'], design.pump_flow),
             'opening force': (by_name['opening_force'], opening_force(design)),
             'flow_coefficient': (verdicts['flow_coefficient'], design.flow_coefficient)}
    errors = {name: 100.0 * (verdict.value / truth - 1.0)
              for name, (verdict, truth) in pairs.items() if verdict.identified}
    halves = {name: 100.0 * verdict.half / truth
              for name, (verdict, truth) in pairs.items() if verdict.identified}
    held = {name: abs(verdicts[name].value - truth) <= verdicts[name].half
            for name, truth in truths(design).items()
            if name in verdicts and verdicts[name].identified}
    return errors, halves, held


def table(title, rows):
    """Print errors, intervals and coverage of all machines."""
    print(f'{title}: {len(rows)} machines')
    print(f'  {"":20}{"median error":>14}{"largest":>10}{"target":>9}{"missed":>8}'
          f'{"median ±":>11}{"told":>6}')
    for name, target in TARGETS.items():
        errors = [abs(row[0][name]) for row in rows if name in row[0]]
        halves = [row[1][name] for row in rows if name in row[1]]
        print(f'  {name:20}{statistics.median(errors):>12.3f} %{max(errors):>8.3f} %{target:>7} %'
              f'{sum(error > target for error in errors):>8}{statistics.median(halves):>9.3f} %'
              f'{len(errors):>6}')
    every = [held for row in rows for held in row[2].values()]
    print(f'  95 % intervals that hold the truth: {100.0 * sum(every) / len(every):.1f} % of '
          f'{len(every)}: ' + ', '.join(
              f'{name} {sum(r[2][name] for r in rows if name in r[2])}/'
              f'{sum(name in r[2] for r in rows)}' for name in truths(Vibrator())
              if any(name in row[2] for row in rows)))


def wrong_starts(design, path, random):
    """Calibrate one recording from five wrong starting designs."""
    found = []
    for _ in range(5):
        result = calibrate([read_measured(path)], off(design, random), FREE)
        found.append({v.name: (v.value, v.half) for v in result.verdicts})
    print('five starting designs, each free parameter off by up to 20 %')
    for name in TOLD:
        values = [row[name][0] for row in found]
        print(f'  {name:20}{min(values):.7g} to {max(values):.7g}, apart by '
              f'{(max(values) - min(values)) / found[0][name][1]:.1e} of half an interval')


def timing(folder):
    """Time a minute at 5 kHz."""
    random, design = np.random.default_rng(1), Vibrator()
    trace = Simulation(design).advance(60.0, 5000.0)
    path = Path(folder) / 'minute.mcap'
    with MeasurementFile(path, metadata={'ambient_pressure': repr(AMBIENT)}) as file:
        file.write(np.round(1e9 * trace.time).astype(np.int64) + 10 ** 18,
                   trace.pressure + AMBIENT + 8e4 * random.standard_normal(len(trace.time)),
                   trace.plunger_position + 1e-5 * random.standard_normal(len(trace.time)))
    times = []
    for _ in range(3):
        began = time.perf_counter()
        calibrate([read_measured(path)], off(design, random), FREE)
        times.append(time.perf_counter() - began)
    print(f'a minute at 5 kHz, pressure and position: {statistics.median(times):.1f} s '
          f'({min(times):.1f} to {max(times):.1f})')


def refusals():
    """Print what is said of recordings that are not of this machine."""
    random, design = np.random.default_rng(2), Vibrator()

    def shown(design, seconds=2.0, rate=5000.0):
        trace = Simulation(design).advance(0.3 + seconds, rate)
        kept = trace.time > 0.3
        noise = 8e4 * random.standard_normal(np.count_nonzero(kept))
        return trace.time[kept] - 0.3, trace.pressure[kept] + noise

    time_, pressure = shown(design)
    other = shown(design.replace(pump_flow=6e-4))[1]
    none = np.empty(0)
    cases = {
        'no flow': [(time_, shown(design.replace(pump_flow=0.0))[1])],
        'bar': [(time_, pressure * 1e-5)], 'MPa': [(time_, pressure * 1e-6)],
        'gauge taken for absolute': [(time_, pressure - 4e5)],
        'sensor reversed': [(time_, -pressure)],
        'two machines in two files': [(time_, pressure), (time_, other)],
        'settings that change': [(np.concatenate([time_, time_[-1] + 2e-4 + time_]),
                                  np.concatenate([pressure, other]))],
        'a sine of the same frequency': [(time_, 8e6 + 7e6 * np.sin(345.6 * time_))],
        'a sleeve of half the seat': [shown(design.replace(sleeve_seat_diameter=0.018))],
    }
    print('refusals')
    for name, recordings in cases.items():
        try:
            result = calibrate([Measured(f'{k}.mcap', *pair, none, none)
                                for k, pair in enumerate(recordings)], design, FREE)
            print(f'  {name}: NOT refused; what is left is {result.fit.order:.0f} times noise')
        except CalibrationError as error:
            print(f'  {name}: {error}')


def main():
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--machines', type=int, default=50)
    parser.add_argument('--seconds', type=float, default=20.0, help='of each recording')
    arguments = parser.parse_args()
    random = np.random.default_rng(11)
    both, alone, refused, design, path = [], [], 0, None, None
    with tempfile.TemporaryDirectory() as folder:
        for k, design in enumerate(tqdm(machines(arguments.machines, random), disable=None)):
            rate = (2000.0, 5000.0, 10_000.0)[k % 3]
            path = Path(folder) / f'{k}.mcap'
            record(design, arguments.seconds, rate, random, path)
            measured, start = read_measured(path), off(design, random)
            pressure_alone = Measured(measured.name, measured.time, measured.pressure,
                                      np.empty(0), np.empty(0))
            for rows, given in ((both, measured), (alone, pressure_alone)):
                try:
                    rows.append(judge(calibrate([given], start, FREE), design))
                except CalibrationError as error:
                    refused += 1
                    print(f'refused: {error}')
        table(f'pressure and position, {arguments.seconds:g} s', both)
        table(f'pressure alone, {arguments.seconds:g} s', alone)
        print(f'refused: {refused} of {2 * arguments.machines}')
        wrong_starts(design, path, random)
        timing(folder)
    refusals()


if __name__ == '__main__':
    main()
