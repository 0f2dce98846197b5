"""Named faults: what in the estimates points to them, how surely, and since when it grows."""
from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from .estimator import ESTIMATES, Estimate

OK, WARN, ERROR = 0, 1, 2
SURE = 4.5  # standard deviations of the estimate beyond which a deviation is no chance
CONFIRM, CLEAR = 0.7, 1.5  # s for which it must stand, and be gone
FIRST = 2.0  # s of trusted estimates before anything is said
KEEP_TREND, TREND_EVERY = 240, 60.0  # points, and s between them: hours of history
TREND_SURE = 4.0


@dataclass(frozen=True)
class Sign:
    """
    What a fault does to an estimate: `direction` of its deviation, and how far is much.

    In the coordinates of Deviation: logarithms of ratios, shares, MPa. Below `warn` nothing is said
    however sure it is: no design is its machine to a hair. `shared` names what looks the same.
    """

    fault: str
    text: str
    estimate: str
    direction: int
    warn: float
    error: float
    shared: str


SIGNS = (
    Sign('air_in_oil', 'air in the oil', 'cavity_stiffness', -1, 0.06, 0.2,
         'a softer hose or a larger cavity looks the same'),
    Sign('pump_leakage', 'the pump is worn or leaks', 'pump_flow', -1, 0.05, 0.15,
         'a pump that does not obey its setpoint looks the same'),
    Sign('preload_loss', 'the spring has set, or the cap nut is loose', 'opening_force', -1, 0.04,
         0.15, 'a pull on the tool looks the same'),
    Sign('worn_slot', 'seat or slot are worn', 'flow_coefficient', 1, 0.07, 0.2,
         'seat and slot cannot be told apart'),
    Sign('blocked_drain', 'the drain is blocked', 'base_pressure', 1, 0.15, 0.6,
         'a sensor whose zero has moved looks the same'),
    Sign('sticking_plunger', 'the plunger sticks', 'viscous_friction', 1, 1.5, 6.0,
         'friction of plunger and sleeve cannot be told apart'),
)
NAMES = list(ESTIMATES)
PAIR = ('air_in_oil', 'pump_leakage')  # both slow the build-up: apart only by the discharge


@dataclass(frozen=True)
class Finding:
    """A fault found: `level` WARN or ERROR, evidence in words and numbers."""

    fault: str
    level: int
    text: str


class Condition:
    """Judges estimates as they come; `findings` are the faults that stand confirmed."""

    def __init__(self):
        self.findings: dict[str, Finding] = {}
        self._since: dict[str, float] = {}
        self._gone: dict[str, float] = {}
        self._began = math.nan
        self._sum, self._count, self._minute = np.zeros(len(NAMES)), 0, math.nan
        self._trend = deque(maxlen=KEEP_TREND)

    def forget(self) -> None:
        """The machine is not followed any more: nothing is known of it. The trend stays."""
        self.findings.clear()
        self._since.clear()
        self._gone.clear()
        self._began = math.nan

    def feed(self, estimate: Estimate, trusted: bool, undecided: bool) -> None:
        """Take an estimate; while it is `undecided` which parameter changed, nothing is judged."""
        if not trusted:
            self.forget()
            return
        if math.isnan(self._began):
            self._began = estimate.time
        if undecided or estimate.time - self._began < FIRST:
            return
        self._note(estimate)
        seen = self._seen(estimate)
        for fault, text in seen.items():
            self._gone.pop(fault, None)
            since = self._since.setdefault(fault, estimate.time)
            if estimate.time - since >= CONFIRM:
                self.findings[fault] = text
        for fault in [fault for fault in self._since if fault not in seen]:
            gone = self._gone.setdefault(fault, estimate.time)
            if fault not in self.findings or estimate.time - gone >= CLEAR:
                for kept in (self._since, self._gone, self.findings):
                    kept.pop(fault, None)

    def _seen(self, estimate):
        """Return findings for what this estimate alone points to."""
        found = {}
        for sign in SIGNS:
            k = NAMES.index(sign.estimate)
            away = sign.direction * estimate.deviation[k]
            sigma = math.sqrt(estimate.covariance[k, k])
            if away > max(sign.warn, SURE * sigma):
                found[sign.fault] = Finding(sign.fault, ERROR if away > sign.error else WARN,
                                            evidence(sign, estimate, sigma))
        if not set(PAIR) & set(found):
            found |= either(estimate)
        return found

    # Hours ------------------------------------------------------------------------------------

    def _note(self, estimate):
        if math.isnan(self._minute):
            self._minute = estimate.time
        self._sum += estimate.deviation
        self._count += 1
        if estimate.time - self._minute >= TREND_EVERY:
            self._trend.append((estimate.time, *(self._sum / self._count)))
            self._sum, self._count, self._minute = np.zeros(len(NAMES)), 0, estimate.time

    def trends(self) -> dict[str, str]:
        """Estimates that drift towards a fault, in words: how fast, and when they will warn."""
        if len(self._trend) < 10:
            return {}
        rows = np.array(self._trend)
        hours = (rows[:, 0] - rows[:, 0].mean()) / 3600.0
        told = {}
        for sign in SIGNS:
            values = sign.direction * rows[:, 1 + NAMES.index(sign.estimate)]
            slope = float(hours @ values / (hours @ hours))
            left = values - values.mean() - slope * hours
            sigma = math.sqrt(float(left @ left) / (len(hours) - 2) / float(hours @ hours))
            if slope > TREND_SURE * sigma and slope > 0.01 * sign.warn:
                to_go = (sign.warn - values[-1]) / slope
                when = f'; warns in about {to_go:.1f} h' if to_go > 0.0 else ''
                told[sign.fault] = f'{sign.text}: {change_of(sign, slope)} per hour{when}'
        return told


def change_of(sign: Sign, amount: float) -> str:
    """Put a deviation in the direction of a sign into words."""
    amount *= sign.direction
    if sign.estimate == 'base_pressure':
        return f'{amount:+.2f} MPa'
    if sign.estimate in ('opening_force', 'viscous_friction'):
        return f'{100.0 * amount:+.1f} %'
    return f'{100.0 * math.expm1(amount):+.1f} %'


def evidence(sign: Sign, estimate: Estimate, sigma: float) -> str:
    """Say what points to a fault, with numbers."""
    k = NAMES.index(sign.estimate)
    unit = ESTIMATES[sign.estimate][0]
    away = sign.direction * estimate.deviation[k]
    return (f'{sign.text}: {sign.estimate} {estimate.values[k]:.4g} {unit}, '
            f'{change_of(sign, away)} from the design ({away / sigma:.0f} standard deviations); '
            f'{sign.shared}')


def either(estimate: Estimate) -> dict[str, Finding]:
    """The build-up is slow, but whether by soft oil or by lack of flow is not sure."""
    pair = np.zeros(len(NAMES))
    pair[[NAMES.index('cavity_stiffness'), NAMES.index('pump_flow')]] = 1.0
    away = -float(pair @ estimate.deviation)
    sigma = math.sqrt(float(pair @ estimate.covariance @ pair))
    if away <= max(SIGNS[0].warn, SURE * sigma):
        return {}
    k = NAMES.index('pump_flow')
    return {'slow_build_up': Finding('slow_build_up', WARN, (
        f'the pressure builds up {-100.0 * math.expm1(-away):.1f} % more slowly than by the '
        f'design ({away / sigma:.0f} standard deviations): air in the oil or a leaking pump; '
        f'flow alone is known to {100.0 * math.sqrt(estimate.covariance[k, k]):.1f} %, which '
        'does not tell them apart'))}
