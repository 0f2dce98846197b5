"""What a fit may claim: intervals, what the data cannot tell and why, quantities that they can."""
from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hpv_twin.model import Vibrator
from hpv_twin.model.designs import FIELDS

from .fit import LINEAR, OFFSETS, STEP, Fit, field_value

INTERVAL = 1.96  # standard deviations of a 95 % interval
LOOSE = 0.2  # half an interval beyond this share of the value is no knowledge of it
TOGETHER = 0.9  # correlation above which two parameters show only together
TOLD = 0.01  # a force known to this share of the opening force is told, however small it is
PAIRS = {
    frozenset(('preload', 'slotted_spring_stiffness')):
        'almost only the product k1*y01 shows; a displacement sensor tells the two apart',
    frozenset(('preload', 'load')): 'only the force k1*y01 + F_T on the seat shows',
    frozenset(('slotted_spring_stiffness', 'load')):
        'only the force k1*y01 + F_T on the seat shows; a displacement sensor tells them apart',
    frozenset(('bulk_modulus', 'pump_flow')):
        'the build-up shows only kappa*Q_H/W0, and the discharge, which would tell them apart, is '
        'not seen well enough',
    frozenset(('flow_coefficient', 'sleeve_seat_diameter')):
        'the slot shows only their product in its flow',
}
HARDLY = {
    'line_damping': 'a c0 below about 3e-3 N·s/m moves the pressure by less than the noise',
    'viscous_friction': 'so little friction moves the waveform by less than the noise',
    'plunger_mass': 'the masses show in some tenths of a millisecond of each cycle alone',
}
PRODUCT, ALMOST = frozenset(('preload', 'slotted_spring_stiffness')), 0.95
NOTES = {'bulk_modulus': 'only the ratio kappa/W0 shows: this kappa goes with the W0 given'}


@dataclass(frozen=True)
class Verdict:
    """
    One parameter: `value` and half of its 95 % interval, SI, in `unit`.

    `identified` False: the value is not to be used, `why` says what the data lack; it was kept at
    `kept`, and the others hold for that.
    """

    name: str
    unit: str
    value: float
    half: float
    identified: bool
    why: str = ''
    kept: float = math.nan


def judge(fit: Fit, refit: Callable[[Fit, tuple[str, ...]], Fit | None]) -> tuple[Fit, list]:
    """
    Take out, one by one, what the data do not tell, and fit the rest again.

    Returns the last fit and a Verdict for every parameter of the first one, in its order.
    `refit(fit, names)` fits the parameters `names` alone, from where `fit` ended.
    """
    names, lost = fit.problem.names, {}
    while True:
        doubtful = {name: doubt(fit, name) for name in fit.problem.names}
        doubtful = {name: how for name, how in doubtful.items() if how > 1.0}
        if not doubtful:
            break
        worst = max(doubtful, key=doubtful.get)
        lost[worst] = Verdict(worst, unit_of(worst), fit.value(worst),
                              INTERVAL * fit.sigma(worst), False, reason(fit, worst),
                              start_of(fit, worst))
        rest = tuple(name for name in fit.problem.names if name != worst)
        again = refit(fit, rest) if rest else None
        if again is None:
            break
        fit = again
    verdicts = []
    for name in names:
        if name in lost:
            verdicts.append(lost[name])
            continue
        verdicts.append(Verdict(name, unit_of(name), fit.value(name), INTERVAL * fit.sigma(name),
                                True, note(fit, name, lost)))
    return fit, verdicts


def doubt(fit: Fit, name: str) -> float:
    """Half the interval over the widest that still is knowledge; above 1 it is none."""
    half = INTERVAL * fit.sigma(name)
    if name in OFFSETS:
        return half / (100.0 * OFFSETS[name])
    if name == 'load':
        return half / max(LOOSE * abs(fit.value(name)), TOLD * opening_force(fit.design))
    if name in LINEAR:
        # An interval that reaches 0 tells a bound, not a value.
        return half / max(0.5 * fit.value(name), 1e-12)
    return half / (LOOSE * fit.value(name))


def reason(fit: Fit, name: str) -> str:
    """Why the data do not tell a parameter."""
    others = {other: fit.correlation(name, other) for other in fit.problem.names if other != name}
    partner = max(others, key=lambda other: abs(others[other]), default=None)
    if partner and abs(others[partner]) > TOGETHER:
        words = PAIRS.get(frozenset((name, partner)),
                          f'it cannot be told apart from {partner}')
        return f'{words} (correlation {others[partner]:+.3f})'
    words = HARDLY.get(name, 'it hardly shows in these data')
    if name in LINEAR and name != 'load':
        most = fit.value(name) + INTERVAL * fit.sigma(name)
        return f'{words}; anything up to {most:.2g} {unit_of(name)} fits'
    return words


def note(fit: Fit, name: str, lost: dict) -> str:
    """What a value goes with."""
    words = [NOTES[name]] if name in NOTES else []
    if name in PRODUCT and set(fit.problem.names) >= PRODUCT and abs(
            fit.correlation(*sorted(PRODUCT))) > ALMOST:
        words.append('almost only the product k1*y01 shows, each of the two far less')
    words += [f'holds for {other} as given' for other in lost if frozenset((name, other)) in PAIRS]
    return '; '.join(words)


def unit_of(name: str) -> str:
    """SI unit of a parameter."""
    if name in OFFSETS:
        return {'pressure_offset': 'Pa', 'position_offset': 'm'}[name]
    return FIELDS[name].metadata['unit']


def start_of(fit: Fit, name: str) -> float:
    """Where a parameter began."""
    return 0.0 if name in OFFSETS else field_value(fit.problem.start, name)


def opening_force(design: Vibrator) -> float:
    """k1*y01 - k2*y02 + F_T, N: what the pressure on the seat overcomes, (22)."""
    return design.plunger_seat_area * (design.opening_pressure - design.drain_pressure)


# What the waveform shows more directly than any single field.
QUANTITIES = {
    'cavity_stiffness': ('Pa/m^3', 'kappa/W0', lambda d: d.bulk_modulus / d.cavity_volume),
    'opening_force': ('N', 'k1*y01 - k2*y02 + F_T', opening_force),
    'spring_force': ('N', 'k1*y01', lambda d: d.slotted_spring_stiffness * d.preload),
}


def quantities(fit: Fit) -> list[Verdict]:
    """Return what the waveform shows most directly, with 95 % intervals, from all correlations."""
    told = []
    for name, (unit, formula, of) in QUANTITIES.items():
        slope = np.zeros(len(fit.x))
        for k in range(len(fit.problem.names)):
            away = np.zeros(len(fit.x))
            away[k] = STEP
            slope[k] = (of(fit.problem.design(fit.x + away))
                        - of(fit.problem.design(fit.x - away))) / (2.0 * STEP)
        sigma = math.sqrt(max(0.0, float(slope @ fit.covariance @ slope)))
        told.append(Verdict(name, unit, of(fit.design), INTERVAL * sigma, True, formula))
    return told
