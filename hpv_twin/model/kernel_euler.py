"""Compiled: the paper's integrator, explicit Euler."""
import math

from .compiling import entry, inner
from .kernel_layout import (
    AREA, CHATTER, CLOSED, DISPLACED, DONE, DRAIN, FLOW, FORCE0, FRICTION, HIGH, KS, LIFT, LOG_FULL,
    LOW, MASS, OPEN, ORIFICE, P, PUMP_FLOW, P_MAX, P_MIN, REPEATS, RETURN_HIGH, RETURN_P, RISE_TIME,
    S0, S1, SLOT, STAGE, STIFFNESS, STROKE, SWITCHES_AT_ONCE, TIME, T_P_MAX, T_P_MIN, V, VACUUM, Y,
)
from .kernel_ledger import CLAMP_WORK, add_powers, note_rate
from .kernel_machine import flow_balance, force_at, net_force
from .kernel_switches import (
    extend_extremes, log_row, neighbour, next_stage, note_rise, settle_force, switch_to,
    write_sample,
)


@inner
def euler_closed(p, rate, limit, step, count):
    """Step the build-up until p passes `limit`: returns p before and after, whole steps done."""
    for done in range(count):
        after = p + step * rate  # never falls: no vacuum to mind
        if after > limit:
            return p, after, done
        p = after
    return p, p, count


@inner
def euler_open(p, force, row, par, step, count):
    """
    Step the dwell until the net force turns negative.

    Returns pressure and force before the last step, the same after it, and the whole steps done.
    """
    y = par[STROKE]
    for done in range(count):
        balance = flow_balance(p, y, 0.0, 0.0, row[S0], row[S1],
                               par[PUMP_FLOW], par[DRAIN], par[ORIFICE])
        p_after = max(p + step * par[STIFFNESS] * balance, VACUUM)
        balance = flow_balance(p_after, y, 0.0, 0.0, row[S0], row[S1],
                               par[PUMP_FLOW], par[DRAIN], par[ORIFICE])
        force_after = net_force(p_after, y, 0.0, balance, row[AREA], row[FORCE0], row[KS],
                                row[FLOW], par[FRICTION])
        if force_after < 0.0:
            return p, force, p_after, force_after, done
        p, force = p_after, force_after
    return p, force, p, force, count


@inner
def euler_moving(state, row, par, step, count):
    """
    Step a moving plunger until it leaves the stage or its velocity passes from + to -.

    All rates are taken from the old state. Returns (p, y, v) before the last step, the same after
    it, and the whole steps done; extremes of whole steps go into `state`.
    """
    p, y, v = state[P], state[Y], state[V]
    area, displaced, s0, s1 = row[AREA], row[DISPLACED], row[S0], row[S1]
    force0, ks, flow, low, high = row[FORCE0], row[KS], row[FLOW], row[LOW], row[HIGH]
    pump_flow, drain, friction, orifice = par[PUMP_FLOW], par[DRAIN], par[FRICTION], par[ORIFICE]
    to_pressure, to_velocity = step * par[STIFFNESS], step / row[MASS]
    p_max, p_min, i_max, i_min = state[P_MAX], state[P_MIN], -1, -1
    return_p, i_rise = state[RETURN_P], -1.0
    done, p_after, y_after, v_after = 0, p, y, v
    slotted = s1 != 0.0
    while done < count:
        if slotted:
            balance = flow_balance(p, y, v, displaced, s0, s1, pump_flow, drain, orifice)
        else:
            balance = pump_flow - displaced * v
        force = net_force(p, y, v, balance, area, force0, ks, flow, friction)
        p_after = max(p + to_pressure * balance, VACUUM)
        y_after = y + step * v
        v_after = v + to_velocity * force
        if y_after > high or y_after < low or (v_after <= 0.0 and v > 0.0):
            break
        if p < return_p <= p_after:
            i_rise = done + (return_p - p) / (p_after - p)
        p, y, v = p_after, y_after, v_after
        done += 1
        if p > p_max:
            p_max, i_max = p, done
        if p < p_min:
            p_min, i_min = p, done
    if i_max > 0:
        state[P_MAX], state[T_P_MAX] = p_max, state[TIME] + i_max * step
    if i_min > 0:
        state[P_MIN], state[T_P_MIN] = p_min, state[TIME] + i_min * step
    if i_rise >= 0.0 and math.isnan(state[RISE_TIME]):
        state[RISE_TIME] = state[TIME] + i_rise * step
    return p, y, v, p_after, y_after, v_after, done


@inner
def euler_standing(state, table, par, step, count, log, used):
    """`euler_stretch` for CLOSED and OPEN."""
    stage = int(state[STAGE])
    row = table[stage]
    start, p = state[TIME], state[P]
    if stage == CLOSED:
        limit = -(row[FORCE0] + row[FLOW] * par[PUMP_FLOW]) / row[AREA]
        p, after, done = euler_closed(p, par[STIFFNESS] * par[PUMP_FLOW], limit, step, count)
        share = (limit - p) / (after - p) if done < count else 0.0
    else:
        force = force_at(p, state[Y], 0.0, OPEN, table, par)
        p, force, after, force_after, done = euler_open(p, force, row, par, step, count)
        share = force / (force - force_after) if done < count else 0.0
    p_start = state[P]
    state[P] = p + share * (after - p)
    state[TIME] = start + (done + share) * step
    if stage == CLOSED:
        note_rise(state, state[P], start, p_start, par[STIFFNESS] * par[PUMP_FLOW])
    if done == count:
        extend_extremes(state)
        return used, float(count)
    settle_force(state, stage, table, par, 1.0 if after > p else -1.0)
    after_stage = LIFT if stage == CLOSED else RETURN_HIGH
    return switch_to(state, after_stage, table, par, False, log, used), done + share


@inner
def euler_stretch(state, table, par, step, count, log, used):
    """
    Take up to `count` Euler steps within the present stage, and the switch that ends it.

    A switch inside a step is located by linear interpolation in it, and the state is left there.
    Returns the log rows used (or -1 for chatter) and the time reached, in steps from the start.
    """
    stage = int(state[STAGE])
    if stage == CLOSED or stage == OPEN:
        return euler_standing(state, table, par, step, count, log, used)
    row = table[stage]
    start = state[TIME]
    p, y, v, p_2, y_2, v_2, done = euler_moving(state, row, par, step, count)
    state[P], state[Y], state[V] = p, y, v
    state[TIME] = start + done * step
    if done == count:
        extend_extremes(state)
        return used, float(count)
    share = 2.0
    bound = y
    if y_2 > row[HIGH] or y_2 < row[LOW]:
        bound = row[HIGH] if y_2 > row[HIGH] else row[LOW]
        share = (bound - y) / (y_2 - y)
    turns = v > 0.0 and v_2 <= 0.0 and v / (v - v_2) < share
    if turns:
        share = v / (v - v_2)
        bound = y + share * (y_2 - y)
    state[P], state[Y] = p + share * (p_2 - p), bound
    state[V] = 0.0 if turns else v + share * (v_2 - v)
    state[TIME] = start + (done + share) * step
    if turns and stage != SLOT:
        return log_row(state, stage, log, used), done + share
    after_stage = neighbour(stage, bound, -1.0 if turns else v, par)
    return switch_to(state, after_stage, table, par, False, log, used), done + share


@inner
def euler_accounted(state, table, par, step, log, used, ledger):
    """One `euler_stretch` of at most one step, with the powers of the state it starts from."""
    start, p, y, v, stage = state[TIME], state[P], state[Y], state[V], int(state[STAGE])
    used, reached = euler_stretch(state, table, par, step, 1, log, used)
    duration = state[TIME] - start
    root = math.sqrt(max(p - par[DRAIN], 0.0))
    balance = add_powers(ledger, duration, p, y, v, root, stage, table, par)
    note_rate(ledger, par[STIFFNESS] * balance)
    missing = VACUUM - (p + duration * par[STIFFNESS] * balance)
    if missing > 0.0:
        ledger[CLAMP_WORK] += p * missing / par[STIFFNESS]
    return used, reached


@inner
def euler_steps(state, table, par, stop, step, log, used, ledger):
    """
    Go on towards `stop` by whole steps on the grid n*step, or by the part of one up to the grid.

    Returns the log rows used, or -1 for chatter.
    """
    now = state[TIME]
    slack = 1e-6 + 4e-16 * now / step
    grid = math.floor(now / step + slack)
    count = int(math.floor(stop / step + slack) - grid)
    whole = abs(now - grid * step) <= slack * step and count >= 1
    if whole and len(ledger) == 0:
        used, reached = euler_stretch(state, table, par, step, count, log, used)
        if reached == count:
            state[TIME] = min((grid + count) * step, stop)
        return used
    end = min((grid + 1.0) * step, stop) if count >= 1 else stop
    part = step if whole else end - now
    if len(ledger) == 0:
        used, reached = euler_stretch(state, table, par, part, 1, log, used)
    else:
        used, reached = euler_accounted(state, table, par, part, log, used, ledger)
    if reached == 1.0:
        state[TIME] = end
    return used


@entry
def advance_euler(state, table, par, changed, until, step, first, rate, samples, written, log,
                  ledger):
    """
    Integrate by the paper's explicit Euler method to the time `until`.

    Steps lie on the grid n*step of model time; a sample or the end of the slice off that grid
    shortens a step. Sample k is taken at (first + k)/rate; `written` of them are there already.
    Returns (code, samples written, log rows used); with LOG_FULL the caller empties the log and
    calls again.
    """
    used = 0
    if changed:
        state[REPEATS] = 0.0
        used = switch_to(state, next_stage(state, table, par, True), table, par, True, log, used)
        if used < 0:
            return CHATTER, written, 0
    while True:
        stop = until
        if written < samples.shape[1]:
            stop = min(until, (first + written) / rate)
        while state[TIME] < stop:
            if used > len(log) - 2 * SWITCHES_AT_ONCE:
                return LOG_FULL, written, used
            used = euler_steps(state, table, par, stop, step, log, used, ledger)
            if used < 0:
                return CHATTER, written, 0
        if written < samples.shape[1]:
            write_sample(state, par, samples, written)
            written += 1
        else:
            return DONE, written, used
