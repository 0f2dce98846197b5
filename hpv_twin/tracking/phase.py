"""The twin's cycle kept in step with the machine's, by the rate at which model time runs."""
from __future__ import annotations

import math

PULL = 0.15  # of the phase error, made good in each cycle
MOST_PULL = 0.02  # of the rate, for the phase
MOST = 0.25  # of the rate, in all: a machine further away is another machine


def phase_error(own: float, other: float, period: float) -> float:
    """Return by how much of a period `own` opening comes after the `other`, from -0.5 to 0.5."""
    return math.remainder(own - other, period) / period


def rate(own_opening: float, own_period: float, opening: float, period: float) -> float:
    """
    Return model seconds per second with which the twin follows a machine.

    `own_opening` and `opening` are instants, s of the same clock, at which the valves opened;
    `own_period` is the twin's in model time, `period` the machine's, s. Model time never jumps: it
    runs a little faster while the twin is late.
    """
    follow = min(1.0 + MOST, max(1.0 - MOST, own_period / period))
    late = PULL * phase_error(own_opening, opening, period)
    return follow * (1.0 + min(MOST_PULL, max(-MOST_PULL, late)))
