"""
Compiled: the Taylor series of a moving plunger, made from the equations and the laws of flow.

In the root law sqrt(p - p_dp) a series in time converges no further than the pressure stays away
from the drain's. In the parameter s of dt = w ds, with w = sqrt((p - p_dp)/d) and d the value of
p - p_dp at the start of the series, everything is polynomial:
    dw/ds = kappa/(2 W0 d)*balance,  dy/ds = w v,  dv/ds = w F/m,  dt/ds = w,
and the discharge, an exponential in s, takes a few steps instead of dozens.
"""
import math

import numpy as np

from .compiling import inner
from .kernel_layout import (
    AREA, DISPLACED, DRAIN, FLOW, FORCE0, FRICTION, HIGH, KS, LOW, MASS, NEVER, ORIFICE, P,
    PUMP_FLOW, RETURN_P, S0, S1, STIFFNESS, STROKE, V, VACUUM, Y,
)
from .kernel_series import (
    ABOVE, AT_VACUUM, CLOCK, DIRECTION, DRY, DURATION, END, END_P, END_SLOPE, END_V, END_Y, FACTS,
    FORCE, LAMINAR, LEAVES, LEVEL, LINEAR, MODE, ORDER, ORDER_FREE, ORDER_SLOT, POSITION, RISE,
    ROOT_LAMINAR, TURBULENT, TURNS, TURN_P, TURN_TIME, VELOCITY, crossing, direction_of, horner,
    level_end, monotone_end, pressure_at, reach,
)

PRESSURE_SCALE = 1e6  # Pa
MARGIN = 1e-6  # Pa by which the laws of flow overlap
RELEASE = 1e-15  # m³/s: the vacuum lets go when this much oil is to spare
INVERSE = 1.0 / np.arange(1.0, ORDER_SLOT + 1.0)


@inner
def flow_mode(p, v, row, par):
    """Which law of flow holds at this gauge pressure, Pa, and velocity."""
    if p <= VACUUM and par[PUMP_FLOW] - row[DISPLACED] * v < 0.0:
        return AT_VACUUM
    if (row[S0] == 0.0 and row[S1] == 0.0) or p < par[DRAIN]:
        return DRY
    return LINEAR if p - par[DRAIN] < LAMINAR else TURBULENT


@inner
def level_limits(mode, slotted, above, drain):
    """
    Bounds of the LEVEL row within which a law of flow holds.

    They overlap by MARGIN, so that a pressure that has crossed one of them is well inside the next.
    """
    if mode == TURBULENT:
        return math.sqrt((LAMINAR - MARGIN) / above), NEVER
    if mode == LINEAR:
        return -MARGIN, LAMINAR + MARGIN
    if mode == DRY:
        return VACUUM - drain - MARGIN, MARGIN if slotted else NEVER
    return -NEVER, NEVER


@inner
def free_series(c, above, y, v, row, par, mode):
    """Series in time of the motion while no oil passes the slot; `above` is p - p_dp."""
    stiffness = 0.0 if mode == AT_VACUUM else par[STIFFNESS]
    displaced, area, ks, flow = row[DISPLACED], row[AREA], row[KS], row[FLOW]
    friction, to_velocity = par[FRICTION], 1.0 / row[MASS]
    c[LEVEL, 0], c[POSITION, 0], c[VELOCITY, 0] = above, y, v
    balance = par[PUMP_FLOW] - displaced * v
    force = area * (above + par[DRAIN]) + row[FORCE0] - ks * y - friction * v + flow * balance
    for k in range(ORDER_FREE):
        level, position = stiffness * balance * INVERSE[k], v * INVERSE[k]
        v = force * to_velocity * INVERSE[k]
        c[LEVEL, k + 1], c[POSITION, k + 1], c[VELOCITY, k + 1] = level, position, v
        balance = -displaced * v
        force = area * level - ks * position - friction * v + flow * balance
    return ORDER_FREE


@inner
def linear_series(c, above, y, v, row, par):
    """Series in time with the slot s = S0 + y open and its flow linear in the pressure."""
    orifice = par[ORIFICE] / ROOT_LAMINAR
    displaced, to_velocity = row[DISPLACED], 1.0 / row[MASS]
    c[LEVEL, 0], c[POSITION, 0], c[VELOCITY, 0] = above, y, v
    pump, constant = par[PUMP_FLOW], row[AREA] * par[DRAIN] + row[FORCE0]
    for k in range(ORDER_SLOT):
        through = row[S0] * c[LEVEL, k]
        for j in range(k + 1):
            through += c[POSITION, j] * c[LEVEL, k - j]
        balance = pump - orifice * through - displaced * c[VELOCITY, k]
        force = (constant + row[AREA] * c[LEVEL, k] - row[KS] * c[POSITION, k]
                 - par[FRICTION] * c[VELOCITY, k] + row[FLOW] * balance)
        pump = constant = 0.0
        c[LEVEL, k + 1] = par[STIFFNESS] * balance * INVERSE[k]
        c[POSITION, k + 1] = c[VELOCITY, k] * INVERSE[k]
        c[VELOCITY, k + 1] = force * to_velocity * INVERSE[k]
    return ORDER_SLOT


@inner
def root_series(c, above, y, v, row, par, order):
    """Series in the parameter s of dt = w ds with the slot S0 + y open under the root law."""
    half = 0.5 * par[STIFFNESS] / above
    orifice = par[ORIFICE] * math.sqrt(above)
    pressing = row[AREA] * above
    displaced, ks, flow, s0 = row[DISPLACED], row[KS], row[FLOW], row[S0]
    friction, to_velocity = par[FRICTION], 1.0 / row[MASS]
    c[LEVEL, 0], c[POSITION, 0], c[VELOCITY, 0], c[CLOCK, 0] = 1.0, y, v, 0.0
    pump, constant = par[PUMP_FLOW], row[AREA] * par[DRAIN] + row[FORCE0]
    for k in range(order):
        # The products with w that the k-th coefficients need: y*w, v*w, w*w, and F*w but for its
        # newest term.
        position = velocity = square = force = 0.0
        for j in range(k):
            w = c[LEVEL, k - j]
            position += c[POSITION, j] * w
            velocity += c[VELOCITY, j] * w
            square += c[LEVEL, j] * w
            force += c[FORCE, j] * w
        position += c[POSITION, k]
        velocity += c[VELOCITY, k]
        square += c[LEVEL, k]
        balance = pump - orifice * (s0 * c[LEVEL, k] + position) - displaced * c[VELOCITY, k]
        newest = (constant + pressing * square - ks * c[POSITION, k]
                  - friction * c[VELOCITY, k] + flow * balance)
        pump = constant = 0.0
        c[FORCE, k] = newest
        c[LEVEL, k + 1] = half * balance * INVERSE[k]
        c[POSITION, k + 1] = velocity * INVERSE[k]
        c[VELOCITY, k + 1] = (force + newest) * to_velocity * INVERSE[k]
        c[CLOCK, k + 1] = c[LEVEL, k] * INVERSE[k]
    return order


@inner
def moving_end(c, order, mode, above, row, par):
    """
    How far the series goes: to its reach or to an event, whichever comes first.

    Returns (end, whether the plunger turns there, whether it leaves the stage there, in which
    direction it goes, where the pressure turns on the way, or `end` if it does not).
    """
    unit = PRESSURE_SCALE
    if mode == TURBULENT:
        unit = max(1.0, math.sqrt(PRESSURE_SCALE / above))
    end = reach(c, order, par[STROKE], unit)
    direction = direction_of(c, order)
    end, turns = monotone_end(c, order, direction, end)
    bound = row[HIGH] if direction > 0.0 else row[LOW]
    leaves = direction * (horner(c[POSITION], order, end) - bound) > 0.0
    if leaves:
        end, turns = crossing(c[POSITION], order, bound, -direction, end, end), False
    low, high = level_limits(mode, row[S1] != 0.0, above, par[DRAIN])
    reached, turn = level_end(c, order, low, high, end)
    if mode == AT_VACUUM:
        released = (par[PUMP_FLOW] - RELEASE) / row[DISPLACED]
        if horner(c[VELOCITY], order, reached) < released:
            reached = crossing(c[VELOCITY], order, released, 1.0, reached, reached)
    if reached < end:
        end, turns, leaves = reached, False, False
    return end, turns, leaves, direction, min(turn, end)


@inner
def expand(c, state, row, par):
    """Fill `c` with the series of the motion from the present state, and with its facts."""
    mode = flow_mode(state[P], state[V], row, par)
    above, y, v = state[P] - par[DRAIN], state[Y], state[V]
    if mode == TURBULENT:
        order = root_series(c, above, y, v, row, par, ORDER_SLOT)
    elif mode == LINEAR:
        order = linear_series(c, above, y, v, row, par)
    else:
        order = free_series(c, above, y, v, row, par, mode)
    end, turns, leaves, direction, turn = moving_end(c, order, mode, above, row, par)
    facts = c[FACTS]
    facts[MODE], facts[ORDER], facts[ABOVE], facts[END] = mode, order, above, end
    facts[TURNS], facts[LEAVES], facts[DIRECTION] = turns, leaves, direction
    facts[DURATION] = horner(c[CLOCK], order, end) if mode == TURBULENT else end
    facts[END_SLOPE] = 1.0 / horner(c[LEVEL], order, end) if mode == TURBULENT else 1.0
    facts[TURN_TIME] = -1.0
    if turn < end:
        facts[TURN_TIME] = horner(c[CLOCK], order, turn) if mode == TURBULENT else turn
        facts[TURN_P] = pressure_at(c, par[DRAIN], turn)
    facts[END_P] = max(pressure_at(c, par[DRAIN], end), VACUUM)
    facts[END_Y] = horner(c[POSITION], order, end)
    if leaves:
        facts[END_Y] = row[HIGH] if direction > 0.0 else row[LOW]
    facts[END_V] = 0.0 if turns else horner(c[VELOCITY], order, end)
    facts[RISE] = -1.0
    if state[P] < state[RETURN_P] <= facts[END_P]:
        level = state[RETURN_P] - par[DRAIN]
        if mode == TURBULENT:
            level = math.sqrt(level / above)
        rise = crossing(c[LEVEL], order, level, -1.0, end, end) if level > 0.0 else 0.0
        facts[RISE] = horner(c[CLOCK], order, rise) if mode == TURBULENT else rise
