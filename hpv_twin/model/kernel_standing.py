"""Compiled: the plunger on its seat or at its stop, solved in closed form."""
import math

from .compiling import inner
from .kernel_layout import (
    ACCOUNTED, ANCHOR_P, ANCHOR_TIME, AREA, CLOSED, CURSOR, DRAIN, FLOW, FORCE0, KS, LIFT, NEVER,
    OPEN, ORIFICE, P, PUMP_FLOW, RETURN_HIGH, S0, STAGE, STIFFNESS, STROKE, TIME, Y,
)
from .kernel_ledger import GAUSS_AT, GAUSS_WEIGHT, PUMP_WORK, add_powers, note_rate
from .kernel_switches import anchor, extend_extremes, note_rise, put_sample, settle_force, switch_to


@inner
def account_straight(state, rise, until, par, ledger):
    """Add the pump's work since the last account, up to `until`, while p = p_a + rise*(t - t_a)."""
    middle = 0.5 * (state[ACCOUNTED] + until) - state[ANCHOR_TIME]
    ledger[PUMP_WORK] += ((until - state[ACCOUNTED]) * par[PUMP_FLOW]
                          * (state[ANCHOR_P] + rise * middle))
    note_rate(ledger, rise)
    state[ACCOUNTED] = until


@inner
def account_open(state, root, still, pace, until, table, par, ledger):
    """Add the energies of the dwell since the last account, up to `until`; see `root_after`."""
    since = state[ACCOUNTED] - state[ANCHOR_TIME]
    duration = until - state[ACCOUNTED]
    first = root_after(root, still, since * pace)
    # From here the flow through the slot only nears the pump's: the first rate is the greatest.
    note_rate(ledger, 2.0 * pace * (still - first))
    if still == 0.0:
        # The root falls in a straight line, to zero and no further.
        duration = min(duration, first / pace)
    pieces = 1 if still == 0.0 else min(64, 1 + int(duration * pace / still))
    for piece in range(pieces):
        for i in range(len(GAUSS_AT)):
            part = (piece + GAUSS_AT[i]) / pieces
            weight = GAUSS_WEIGHT[i] * duration / pieces
            then = root_after(first, still, part * duration * pace)
            add_powers(ledger, weight, then * then + par[DRAIN], par[STROKE], 0.0, then, OPEN,
                       table, par)
    state[ACCOUNTED] = until


@inner
def straight_samples(state, until, rise, first, rate, samples, written):
    """Write the samples up to `until` while the plunger stands and p = p_a + rise*(t - t_a)."""
    stage, y = int(state[STAGE]), state[Y]
    start, p = state[ANCHOR_TIME], state[ANCHOR_P]
    while written < samples.shape[1]:
        time = (first + written) / rate
        if time > until:
            break
        put_sample(samples, written, time, p + rise * (time - start), y, 0.0, y, stage)
        written += 1
    return written


@inner
def exact_closed(state, table, par, until, first, rate, samples, written, log, used, ledger):
    """Build-up: the pressure rises in a straight line, (7), until the net force is zero."""
    row = table[CLOSED]
    rise = par[STIFFNESS] * par[PUMP_FLOW]
    limit = -(row[FORCE0] + row[FLOW] * par[PUMP_FLOW]) / row[AREA]
    end = NEVER
    if rise > 0.0:
        end = state[ANCHOR_TIME] + max(limit - state[ANCHOR_P], 0.0) / rise
    written = straight_samples(state, min(end, until), rise, first, rate, samples, written)
    if len(ledger) > 0:
        account_straight(state, rise, min(end, until), par, ledger)
    if end > until:
        state[P] = state[ANCHOR_P] + rise * (until - state[ANCHOR_TIME])
        state[TIME] = until
        note_rise(state, state[P], state[ANCHOR_TIME], state[ANCHOR_P], rise)
        extend_extremes(state)
        return written, used
    state[P], state[TIME] = limit, end
    note_rise(state, limit, state[ANCHOR_TIME], state[ANCHOR_P], rise)
    settle_force(state, CLOSED, table, par, 1.0)
    state[CURSOR] = 0.0
    return written, switch_to(state, LIFT, table, par, False, log, used)


@inner
def root_after(root, still, reduced):
    """
    Square root of the pressure above the drain after a reduced time, with the slot fully open.

    2u du/dt = (kappa/W0)(Q_H - b u) gives u - u0 + r ln((u - r)/(u0 - r)) = -T with u = `root` at
    the start, r = Q_H/b = `still` where it ends, T = t*b*kappa/(2*W0) = `reduced`. With
    u - r = (u0 - r) exp(-x) that is (u0 - r)(1 - exp(-x)) + r x = T, on which Newton's method
    converges from one side.
    """
    if reduced <= 0.0:
        return root
    if still == 0.0:
        return max(root - reduced, 0.0)
    excess = root - still
    x = reduced / still + 1.0
    if excess > 0.0 or reduced < x * root:
        x = reduced / root
    for _ in range(60):
        gone = -math.expm1(-x)
        step = (excess * gone + still * x - reduced) / (excess * (1.0 - gone) + still)
        x -= step
        if abs(step) <= 1e-15 * x:
            break
    return still + excess * math.exp(-x)


@inner
def time_to_root(root, target, still):
    """Reduced time, as in `root_after`, until the root has fallen or risen to `target`."""
    reduced = root - target
    if still > 0.0:
        reduced += still * math.log1p((root - target) / (target - still))
    return reduced


@inner
def leaving_root(row, par, root, still):
    """Root of the pressure above the drain at which the open plunger starts back, or -1."""
    # area u^2 - push u + constant = 0, with the line's dashpot in `push`; see net_force.
    area = row[AREA]
    push = row[FLOW] * par[ORIFICE] * row[S0]
    constant = (area * par[DRAIN] + row[FORCE0] - row[KS] * par[STROKE]
                + row[FLOW] * par[PUMP_FLOW])
    under = push * push - 4.0 * area * constant
    if under < 0.0:
        return -1.0
    upper = (push + math.sqrt(under)) / (2.0 * area)
    lower = constant / (area * upper) if upper > 0.0 else -1.0
    if still < upper <= root:
        return upper
    return lower if root <= lower < still else -1.0


@inner
def exact_refill(state, par, until, first, rate, samples, written, ledger):
    """Open valve, pressure below the drain's: nothing flows out, the pressure rises by (7)."""
    rise = par[STIFFNESS] * par[PUMP_FLOW]
    end = NEVER
    if rise > 0.0:
        end = state[ANCHOR_TIME] + (par[DRAIN] - state[ANCHOR_P]) / rise
    written = straight_samples(state, min(end, until), rise, first, rate, samples, written)
    if len(ledger) > 0:
        account_straight(state, rise, min(end, until), par, ledger)
    if end > until:
        state[P] = state[ANCHOR_P] + rise * (until - state[ANCHOR_TIME])
        state[TIME] = until
        extend_extremes(state)
    else:
        state[P], state[TIME] = par[DRAIN], end
        extend_extremes(state)
        anchor(state)
    return written


@inner
def exact_open(state, table, par, until, first, rate, samples, written, log, used, ledger):
    """Dwell: time is explicit in the pressure; ends where the net force is zero, (3)."""
    if state[ANCHOR_P] < par[DRAIN]:
        return exact_refill(state, par, until, first, rate, samples, written, ledger), used
    row = table[OPEN]
    root = math.sqrt(state[ANCHOR_P] - par[DRAIN])
    slot = par[ORIFICE] * row[S0]
    still = par[PUMP_FLOW] / slot
    pace = 0.5 * par[STIFFNESS] * slot
    target = leaving_root(row, par, root, still)
    end = NEVER
    if target >= 0.0:
        end = state[ANCHOR_TIME] + time_to_root(root, target, still) / pace
    while written < samples.shape[1] and (first + written) / rate <= min(end, until):
        time = (first + written) / rate
        then = root_after(root, still, max(time - state[ANCHOR_TIME], 0.0) * pace)
        put_sample(samples, written, time, then * then + par[DRAIN], state[Y], 0.0, state[Y], OPEN)
        written += 1
    if len(ledger) > 0:
        account_open(state, root, still, pace, min(end, until), table, par, ledger)
    if end > until:
        then = root_after(root, still, (until - state[ANCHOR_TIME]) * pace)
        state[P], state[TIME] = then * then + par[DRAIN], until
        extend_extremes(state)
        return written, used
    state[P], state[TIME] = target * target + par[DRAIN], end
    settle_force(state, OPEN, table, par, 1.0 if target > root else -1.0)
    return written, switch_to(state, RETURN_HIGH, table, par, False, log, used)
