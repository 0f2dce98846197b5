"""
Tracking: a step of each parameter, the phase, and what it costs.

    python bench/tracking.py [--runs 6] [--noise 8e4] [--rate 1000]

The pure room: a model is measured with noise, as `hpv-twin machine` does, and followed. After 12 s
one parameter steps by 10 %; the error is that of its level 1 s later, and of the step. The phase is
that of the tracker's openings against the located ones, but for half a second from the step.
"""
import argparse
import time

import numpy as np

from hpv_twin.model import Simulation, Vibrator
from hpv_twin.tracking.estimator import ESTIMATES
from hpv_twin.tracking.phase import phase_error
from hpv_twin.tracking.tracker import Tracker

SLICE = 0.02  # s
BEFORE, AFTER = 12.0, 1.0  # s
UNKNOWN = 0.5  # s after a step in which it may not be known yet
STEPS = ('none', 'cavity_stiffness', 'pump_flow', 'opening_force', 'flow_coefficient')


def change(simulation, name, share):
    """Let a parameter step by `share`."""
    design = simulation.design
    if name == 'cavity_stiffness':
        simulation.redesign(bulk_modulus=(1 + share) * design.bulk_modulus)
    elif name == 'pump_flow':
        simulation.pump_flow *= 1 + share
    elif name == 'opening_force':
        simulation.load += share * design.plunger_seat_area * design.opening_pressure
    elif name == 'flow_coefficient':
        simulation.redesign(flow_coefficient=(1 + share) * design.flow_coefficient)


def truth(simulation, name):
    """Return what a parameter is in the model, SI."""
    design = simulation.design
    return {'cavity_stiffness': design.bulk_modulus / design.cavity_volume,
            'pump_flow': design.pump_flow, 'flow_coefficient': design.flow_coefficient,
            'opening_force': design.plunger_seat_area * design.opening_pressure}[name]


class Run:
    """A machine and its tracker."""

    def __init__(self, noise, seed, rate):
        self.random = np.random.default_rng(seed)
        self.noise, self.rate = noise, rate
        self.simulation = Simulation(Vibrator())
        self.simulation.tick(0.3 + 0.02 * self.random.random())
        self.tracker = Tracker(Vibrator())
        self.estimates, self.openings, self.busy, self.worst = [], [], 0.0, 0.0

    def go(self, duration):
        """Let `duration` s of model time pass."""
        for _ in range(round(duration / SLICE)):
            trace = self.simulation.advance(SLICE, self.rate)
            opened = trace.switches[(trace.switches['before'] == 0)
                                    & (trace.switches['after'] == 1)]
            self.openings += list(opened['time'])
            shown = trace.pressure + self.noise * self.random.standard_normal(len(trace.time))
            began = time.process_time()
            self.estimates += self.tracker.feed(trace.time, shown)
            took = time.process_time() - began
            self.busy += took
            self.worst = max(self.worst, took)

    def phase_errors(self, since, but):
        """Phase errors, shares of a cycle, of estimates after an instant but for half a second."""
        openings = np.array(self.openings)
        return np.array([phase_error(e.opening, openings[np.argmin(abs(openings - e.opening))],
                                     e.period) for e in self.estimates
                         if e.time > since and not but <= e.time < but + UNKNOWN])


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=6)
    parser.add_argument('--noise', type=float, default=8e4, help='Pa, standard deviation')
    parser.add_argument('--rate', type=float, default=1000.0, help='samples per second')
    arguments = parser.parse_args()
    print(f'noise {arguments.noise:.3g} Pa, {arguments.rate:g} samples/s, {arguments.runs} runs '
          'each; errors in % of the value: median and worst of the runs')
    print(f'{"step of 10 %":18}{"level before":>14}{"1 s after":>14}{"its own sigma":>15}'
          f'{"step":>14}{"others moved":>14}{"phase":>14}{"% of a core":>12}{"slice ms":>9}')
    for name in STEPS:
        rows = []
        for seed in range(arguments.runs):
            run = Run(arguments.noise, seed, arguments.rate)
            run.go(BEFORE)
            started, before = run.simulation.time, run.estimates[-1]
            shown = 'cavity_stiffness' if name == 'none' else name
            old = truth(run.simulation, shown)
            change(run.simulation, name, 0.1)
            run.go(AFTER)
            new, after = truth(run.simulation, shown), run.estimates[-1]
            step = (after.value(shown) - before.value(shown)) - (new - old)
            others = [abs(after.value(o) / before.value(o) - 1) for o in list(ESTIMATES)[:4]
                      if o != name]
            rows.append([before.value(shown) / old - 1, after.value(shown) / new - 1,
                         after.uncertainty(shown) / new, step / new, max(others),
                         max(abs(run.phase_errors(2.0, started))),
                         run.busy / (BEFORE + AFTER), run.worst])
        rows = np.abs(rows)
        middle, worst = np.median(rows, axis=0), rows.max(axis=0)
        pairs = [f'{100 * middle[i]:.2f}, {100 * worst[i]:.2f}' for i in range(6)]
        print(f'{name:18}{pairs[0]:>14}{pairs[1]:>14}{pairs[2]:>15}{pairs[3]:>14}{pairs[4]:>14}'
              f'{pairs[5]:>14}{100 * middle[6]:12.1f}{1e3 * worst[7]:9.1f}')


if __name__ == '__main__':
    main()
