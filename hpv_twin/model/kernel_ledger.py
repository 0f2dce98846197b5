"""
Compiled: the integrals of the energy ledger, J, each by itself.

The power is integrated along the motion, by Gauss's rule on a series and by Euler's own steps in
`euler`. No term is found as the rest.
"""
import numpy as np

from .compiling import inner
from .kernel_layout import (
    AREA, CATCH_UP, DISPLACED, DRAIN, FLOW, FRICTION, ORIFICE, PUMP_FLOW, S0, S1, SLEEVE_SPRING,
    SLEEVE_SPRING_FORCE,
)

(PUMP_WORK, SLOT_LOSS, DISPLACED_WORK, CLAMP_WORK, PRESSURE_WORK, DASHPOT_WORK, SLEEVE_SPRING_WORK,
 FRICTION_LOSS) = range(8)
LEDGER_SIZE = 8
# Beside them, the greatest rates of pressure met, Pa/s: rising, and (a negative one) falling.
STEEPEST_RISE, STEEPEST_FALL = 8, 9
ACCOUNT_SIZE = 10
GAUSS_AT, GAUSS_WEIGHT = (np.polynomial.legendre.leggauss(16)[0] * 0.5 + 0.5,
                          np.polynomial.legendre.leggauss(16)[1] * 0.5)


@inner
def add_powers(ledger, duration, p, y, v, root, stage, table, par):
    """Add each power times `duration`; `root` stands for sqrt(p - p_dp) in the slot's flow."""
    slot = par[ORIFICE] * (table[stage, S0] + table[stage, S1] * y) * root
    displaced = table[stage, DISPLACED] * v
    balance = par[PUMP_FLOW] - slot - displaced
    ledger[PUMP_WORK] += duration * p * par[PUMP_FLOW]
    ledger[SLOT_LOSS] += duration * p * slot
    ledger[DISPLACED_WORK] += duration * p * displaced
    ledger[PRESSURE_WORK] += duration * table[stage, AREA] * (p - par[DRAIN]) * v
    ledger[DASHPOT_WORK] += duration * table[stage, FLOW] * balance * v
    ledger[FRICTION_LOSS] += duration * par[FRICTION] * v * v
    if stage <= CATCH_UP:
        spring = par[SLEEVE_SPRING_FORCE] - par[SLEEVE_SPRING] * y
        ledger[SLEEVE_SPRING_WORK] += duration * spring * v
    return balance


@inner
def note_rate(ledger, rate):
    """Let the greatest rates of pressure take in this one, Pa/s."""
    ledger[STEEPEST_RISE] = max(ledger[STEEPEST_RISE], rate)
    ledger[STEEPEST_FALL] = min(ledger[STEEPEST_FALL], rate)
