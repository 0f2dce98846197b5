"""`hpv-twin machine --to-file`: a recording of a machine's sensors, made without ROS."""
from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from tqdm import tqdm

from hpv_twin import __version__
from hpv_twin.designs import HELP, METAVAR, load_design
from hpv_twin.model import VibratorError
from hpv_twin.model.faults import FAULTS
from hpv_twin.model.machine import Machine
from hpv_twin.model.sensors import Dropouts, Sensor
from hpv_twin.recording.measurements import SECOND, MeasurementFile

SLICE = 1.0  # s of model time between two looks at the faults to come
SETTLED = 0.5  # s before the recording begins
FARTHEST = 0.45  # a stamp is never more of a sample's time from its place

EXAMPLES = """\
examples:
  hpv-twin machine --to-file m.mcap --duration 60 --rate 5000
  hpv-twin machine --to-file m.mcap --vibrator other.yaml --jitter 5e-5 --dropouts 0.02
  hpv-twin machine --to-file m.mcap --no-position --pressure-quantum 6e3 --pressure-offset -3e4
  hpv-twin machine --to-file m.mcap --fault air_in_oil=0.4@20 --fault worn_slot=0.2

faults, each with a severity from 0 to 1, and from which second on:
"""


def main(argv: list[str] | None = None) -> int:
    """Write the file; 0 when it is whole, 2 for what cannot be."""
    arguments = parser().parse_args(argv)
    try:
        write(arguments)
    except (VibratorError, OSError) as error:
        text = f'{error.filename}: {error.strerror}' if getattr(error, 'filename', 0) else error
        print(f'hpv-twin machine: {text}', file=sys.stderr)
        return 2
    print(f'written: {arguments.to_file}')
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the parser of the options."""
    faults = '\n'.join(f'  {fault.name:18}{fault.text}; 1: {fault.at_full}'
                       for fault in FAULTS.values())
    options = argparse.ArgumentParser(
        prog='hpv-twin machine', epilog=EXAMPLES + faults,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Write what the sensors of a machine show into an MCAP file. SI units.')
    options.add_argument('--to-file', type=Path, required=True, metavar='OUT.mcap')
    options.add_argument('--vibrator', metavar=METAVAR, help=f'{HELP}; default: the built-in one')
    for name, unit in (('pump-flow', 'm³/s'), ('preload', 'm'), ('load', 'N')):
        options.add_argument(f'--{name}', type=float, metavar=unit, help="default: the design's")
    for name, default, text in (
            ('duration', 10.0, 's'), ('rate', 1000.0, 'samples per second'),
            ('pressure-noise', 8e4, 'Pa, standard deviation'), ('pressure-offset', 0.0, 'Pa'),
            ('pressure-quantum', 0.0, 'Pa, step of the converter'),
            ('position-noise', 1e-5, 'm, standard deviation'), ('position-offset', 0.0, 'm'),
            ('position-quantum', 0.0, 'm, step of the converter'),
            ('dropouts', 0.0, 'share of the samples that go missing, in gaps'),
            ('jitter', 0.0, 's, standard deviation of the stamps'),
            ('ambient-pressure', 101_325.0, 'Pa, added to the gauge pressure; 0 writes gauge')):
        options.add_argument(f'--{name}', type=float, default=default, metavar='X',
                             help=f'{text} [%(default)g]')
    options.add_argument('--no-position', action='store_true', help='no displacement sensor')
    options.add_argument('--fault', type=fault_at, action='append', default=[],
                         metavar='NAME=SEVERITY[@SECOND]')
    options.add_argument('--seed', type=int, default=0, help='of noise, jitter and dropouts')
    return options


def fault_at(text: str) -> tuple[float, str, float]:
    """Read NAME=SEVERITY or NAME=SEVERITY@SECOND into (second, name, severity)."""
    name, _, rest = text.partition('=')
    severity, _, second = rest.partition('@')
    if name not in FAULTS:
        raise argparse.ArgumentTypeError(f'no fault "{name}"; there are: {", ".join(FAULTS)}')
    try:
        return float(second or 0.0), name, float(severity)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f'"{text}" is not NAME=SEVERITY or NAME=SEVERITY@SECOND') from None


def write(arguments) -> None:
    """Run the machine and write its sensors."""
    for name in ('duration', 'rate'):
        if not getattr(arguments, name) > 0.0:
            raise VibratorError(f'--{name} must be above 0')
    told = {name: getattr(arguments, name) for name in ('pump_flow', 'preload', 'load')
            if getattr(arguments, name) is not None}
    design = load_design(arguments.vibrator).replace(**told)
    pressure = Sensor(1.0, arguments.pressure_offset + arguments.ambient_pressure,
                      arguments.pressure_noise, arguments.pressure_quantum)
    position = Sensor(1.0, arguments.position_offset, arguments.position_noise,
                      arguments.position_quantum)
    random = np.random.default_rng(arguments.seed)
    dropouts = Dropouts(random)
    metadata = {'package_version': __version__, 'made_by': 'hpv-twin machine --to-file',
                'ambient_pressure': repr(arguments.ambient_pressure),
                'faults': ' '.join(f'{name}={severity:g}@{second:g}'
                                   for second, name, severity in sorted(arguments.fault))}
    attachments = {'machine.yaml': design.to_yaml().encode()}
    start = time.time_ns()
    with MeasurementFile(arguments.to_file, metadata=metadata, attachments=attachments) as file, \
            tqdm(total=arguments.duration, unit=' s', file=sys.stderr, disable=None) as bar:
        for trace in run(design, arguments):
            jitter = np.clip(arguments.jitter * random.standard_normal(trace.time.shape),
                             -FARTHEST / arguments.rate, FARTHEST / arguments.rate)
            kept = np.array([not dropouts.lost(arguments.dropouts) for _ in trace.time], bool)
            stamps = start + np.round((trace.time + jitter) * SECOND).astype(np.int64)
            moved = None if arguments.no_position else position.read(
                trace.plunger_position, random)[kept]
            file.write(stamps[kept], pressure.read(trace.pressure, random)[kept], moved)
            bar.update(len(trace.time) / arguments.rate)


def run(design, arguments):
    """Yield slices of the machine's motion, its faults switched when they are due."""
    faults = sorted(arguments.fault)
    machine = Machine(design, {name: severity for second, name, severity in faults
                               if second <= 0.0})
    later = [fault for fault in faults if fault[0] > 0.0]
    machine.tick(SETTLED)
    ends = np.arange(SLICE, arguments.duration + SLICE, SLICE).clip(max=arguments.duration)
    for end in np.unique(np.append(ends, [fault[0] for fault in later])):
        if end > arguments.duration:
            return
        trace = machine.simulation.advance(SETTLED + end - machine.simulation.time,
                                           arguments.rate)
        yield trace
        for second, name, severity in later:
            if second == end:
                machine.set_fault(name, severity)
