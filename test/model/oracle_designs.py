"""Designs to hold the package against the oracle, and the package's run of them."""
from __future__ import annotations

import numpy as np

from hpv_twin.model import Simulation, Trace, Vibrator, find_cycles

# How far a random design may be from the base design, as a share of it, field by field.
SPREAD = {
    'plunger_seat_diameter': 0.2, 'sleeve_seat_diameter': 0.15, 'stroke': 0.4,
    'plunger_mass': 0.5, 'sleeve_mass': 0.5, 'slotted_spring_stiffness': 0.5, 'preload': 0.4,
    'twisted_spring_stiffness': 0.5, 'twisted_spring_preload': 0.5, 'cavity_volume': 0.5,
    'line_length': 0.5, 'bulk_modulus': 0.5, 'density': 0.1, 'dynamic_viscosity': 0.5,
    'flow_coefficient': 0.2,
}
# Every term of the equations is worth something in this design.
EVERY_TERM = Vibrator(
    gap_ratio=0.3, sleeve_mass=0.2, twisted_spring_stiffness=3e4, cavity_volume=0.7e-3,
    viscous_friction=200.0, line_damping=10.0, drain_pressure=4e5, load=250.0, pump_flow=1.1e-3)


def random_design(rng: np.random.Generator) -> Vibrator:
    """Vary every physical field; the pump flow lies between 3 and 60 % of the critical flow."""
    base = Vibrator()
    fields = {name: getattr(base, name) * rng.uniform(1.0 - share, 1.0 + share)
              for name, share in SPREAD.items()}
    design = Vibrator(
        gap_ratio=rng.uniform(0.2, 0.5), viscous_friction=10.0 ** rng.uniform(0.0, 3.0),
        line_damping=rng.choice([None, 10.0 ** rng.uniform(-2.0, 1.0)]),
        drain_pressure=rng.uniform(-5e4, 1e6), load=rng.uniform(-300.0, 1000.0), **fields)
    return design.replace(pump_flow=rng.uniform(0.03, 0.6) * design.critical_flow)


def steady_cycles(design, duration=2.0, **how):
    """Return the cycles of a design from rest, the first of them left out."""
    cycles = find_cycles(Simulation(design, **how).advance(duration, sample_rate=10.0))
    return {name: getattr(cycles, name)[1:] for name in vars(cycles)}


def seated_designs(seed: int, count: int):
    """Yield `count` random designs in seated oscillation, each with the start of its 4th cycle."""
    rng = np.random.default_rng(seed)
    for _ in range(4 * count):
        design = random_design(rng)
        cycles = steady_cycles(design)
        if len(cycles['start']) > 3 and set(cycles['regime']) == {'seated oscillation'}:
            yield design, cycles['start'][2]
            count -= 1
            if count == 0:
                return
    raise AssertionError('too few random designs oscillate on the seat')


def simulate(design, duration, changes=(), sample_rate=1000.0, **how) -> Trace:
    """Run the package with setpoint changes at their instants, as Oracle.run takes them."""
    simulation = Simulation(design, **how)
    traces = []
    for instant, setpoints in [*changes, (duration, {})]:
        traces.append(simulation.advance(instant - simulation.time, sample_rate))
        fields = dict(setpoints)
        for name in {'pump_flow', 'preload', 'load'} & fields.keys():
            setattr(simulation, name, fields.pop(name))
        simulation.redesign(**fields)
    return Trace.join(traces)


def phase_switches(trace) -> np.ndarray:
    """Rows of the trace at which the phase changes."""
    return trace.switches[trace.switches['before'] != trace.switches['after']]
