"""
Tracking: a step of each parameter, the phase, and what it costs.

    python bench/tracking.py [--runs 3] [--noise 8e4]

The pure room: a model is measured at 1 kHz with noise, as `hpv-twin machine` does, and followed.
After 12 s one parameter steps by 10 %; the error is that of its step, 1 s later. The phase is that
of the tracker's openings against the located ones.
"""
import argparse
import time

import numpy as np

from hpv_twin.model import Simulation, Vibrator
from hpv_twin.tracking.estimator import ESTIMATES
from hpv_twin.tracking.phase import phase_error
from hpv_twin.tracking.tracker import Tracker

RATE, SLICE = 1000.0, 0.02
BEFORE, AFTER = 12.0, 1.0  # s
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

    def __init__(self, noise, seed):
        self.random = np.random.default_rng(seed)
        self.noise = noise
        self.simulation = Simulation(Vibrator())
        self.simulation.tick(0.3 + 0.02 * self.random.random())
        self.tracker = Tracker(Vibrator())
        self.estimates, self.openings, self.busy, self.worst = [], [], 0.0, 0.0

    def go(self, duration):
        """Let `duration` s of model time pass."""
        for _ in range(round(duration / SLICE)):
            trace = self.simulation.advance(SLICE, RATE)
            opened = trace.switches[(trace.switches['before'] == 0)
                                    & (trace.switches['after'] == 1)]
            self.openings += list(opened['time'])
            shown = trace.pressure + self.noise * self.random.standard_normal(len(trace.time))
            began = time.process_time()
            self.estimates += self.tracker.feed(trace.time, shown)
            took = time.process_time() - began
            self.busy += took
            self.worst = max(self.worst, took)

    def phase_errors(self, since):
        """Phase errors of the estimates after an instant, shares of a cycle."""
        openings = np.array(self.openings)
        return np.array([phase_error(e.opening, openings[np.argmin(abs(openings - e.opening))],
                                     e.period) for e in self.estimates if e.time > since])


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=3)
    parser.add_argument('--noise', type=float, default=8e4, help='Pa, standard deviation')
    arguments = parser.parse_args()
    print(f'noise {arguments.noise:.3g} Pa, {arguments.runs} runs each; errors in % of the value: '
          'worst of the runs')
    print(f'{"step of 10 %":20}{"level before":>13}{"step, 1 s after":>16}{"level after":>12}'
          f'{"others moved":>13}{"phase, max %":>13}{"% of a core":>12}{"slice ms":>9}')
    for name in STEPS:
        rows = []
        for seed in range(arguments.runs):
            run = Run(arguments.noise, seed)
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
            # For half a second after a step it may not be known yet.
            phase = np.concatenate([run.phase_errors(started + 0.5),
                                    run.phase_errors(2.0)[:-20]])
            rows.append([before.value(shown) / old - 1, step / new,
                         after.value(shown) / new - 1, max(others), abs(phase).max(),
                         run.busy / (BEFORE + AFTER), run.worst])
        worst = np.abs(rows).max(axis=0)
        print(f'{name:20}{100 * worst[0]:13.2f}{100 * worst[1]:16.2f}{100 * worst[2]:12.2f}'
              f'{100 * worst[3]:13.2f}{100 * worst[4]:13.2f}'
              f'{100 * np.mean([r[5] for r in rows]):12.1f}{1e3 * worst[6]:9.1f}')


if __name__ == '__main__':
    main()
