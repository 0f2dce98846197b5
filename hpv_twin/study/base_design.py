"""
Find the base design: the values the paper leaves open, such that the model reports what it reports.

    python -m hpv_twin.study.base_design [--method euler] [-o config/vibrator.yaml]

Four fields are solved for against four results of the paper; the others are its own numbers or
choices, as their origins in hpv_twin/model/vibrator.py say.
"""
from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import root

from hpv_twin.model import Simulation, Vibrator, find_cycles

# Result of the paper, and the field that mostly decides it.
TARGETS = {'frequency': 55.0, 'peak_pressure': 16e6, 'return_pressure': 3e6, 'dwell_ratio': 0.15}
FREE = ('cavity_volume', 'preload', 'sleeve_seat_diameter', 'plunger_mass')
# Round numbers from which the search starts.
START = {'cavity_volume': 1e-3, 'preload': 5e-3, 'sleeve_seat_diameter': 0.028,
         'plunger_mass': 0.5}


def results(vibrator: Vibrator, method: str = 'default') -> dict[str, float]:
    """Return the results named in TARGETS: Hz, Pa gauge, Pa gauge, 1; of the tenth cycle."""
    trace = Simulation(vibrator, method=method).advance(0.25, sample_rate=1000)
    cycles = find_cycles(trace)
    if len(cycles) == 0:
        raise ValueError('the design does not oscillate')
    return {'frequency': cycles.frequency[-1], 'peak_pressure': cycles.peak_pressure[-1],
            'return_pressure': cycles.return_pressure[-1],
            'dwell_ratio': cycles.dwell[-1] / cycles.forward[-1]}


def find_base_design(method: str = 'default') -> Vibrator:
    """Solve for the FREE fields; raises RuntimeError where the search does not converge."""
    start = np.array([START[name] for name in FREE])
    fixed = Vibrator()

    def design(factors):
        fields = zip(FREE, (factors * start).tolist(), strict=True)
        return fixed.replace(**dict(fields))

    def mismatch(factors):
        found = results(design(factors), method)
        return [found[name] / target - 1.0 for name, target in TARGETS.items()]

    solution = root(mismatch, np.ones(len(FREE)), method='hybr', options={'eps': 1e-5})
    if np.max(np.abs(solution.fun)) > 1e-6:
        raise RuntimeError(f'no base design found: {solution.message}')
    return design(solution.x)


def main(argv=None) -> int:
    """Print the design that meets the targets beside the built-in one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--method', choices=('default', 'euler'), default='default')
    parser.add_argument('-o', '--output', type=Path, help='also write the design as YAML')
    arguments = parser.parse_args(argv)
    found = find_base_design(arguments.method)
    built_in = Vibrator()
    print(f'{"field":24}{"found":>16}{"built in":>16}')
    for name in FREE:
        print(f'{name:24}{getattr(found, name):16.8g}{getattr(built_in, name):16.8g}')
    print(f'\n{"result":24}{"found":>16}{"built in":>16}{"paper":>16}')
    here, there = results(found, arguments.method), results(built_in, arguments.method)
    for name, target in TARGETS.items():
        print(f'{name:24}{here[name]:16.8g}{there[name]:16.8g}{target:16.8g}')
    if arguments.output:
        arguments.output.write_text(found.to_yaml(), encoding='utf-8')
        print(f'\nwritten to {arguments.output}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
