"""
Compiled: the default integrator, exact but for rounding.

CLOSED and OPEN are solved in closed form. A moving plunger is followed by Taylor series of the
equations themselves, summed to rounding: where no slot is open these are the series of the
exponentials that solve the linear equations, and cheaper than the exponentials; elsewhere they
are a high-order method. Every series is a polynomial, so samples, extremes and switches are
found on it, and neither a sample nor the end of a slice ends it: however `advance` is sliced,
the same series are evaluated.

An opening fixes p, y and v: while the setpoints stay, every cycle that begins with one runs
through the same states. Its series are kept and used again until a setpoint changes; a cycle
then costs little more than its samples.
"""
import math

from .compiling import entry, inner
from .kernel_expand import expand
from .kernel_layout import (
    ACCOUNTED, ACTIVE, ANCHOR_TIME, CHATTER, CLOSED, CURSOR, DONE, DRAIN, LOG_FULL, OPEN, P,
    REPEATS, RISE_TIME, SLOT, STAGE, STORED, SWITCHES_AT_ONCE, TIME, V, Y,
)
from .kernel_ledger import CLAMP_WORK, GAUSS_AT, GAUSS_WEIGHT, add_powers, note_rate
from .kernel_machine import sleeve_position
from .kernel_series import (
    ABOVE, AT_VACUUM, DIRECTION, DURATION, END_P, END_V, END_Y, FACTS, LEAVES, LEVEL, LINEAR, MODE,
    ORDER, POSITION, RISE, ROOT_LAMINAR, TURBULENT, TURNS, TURN_P, TURN_TIME, VELOCITY,
    horner, place_of, pressure_at, slope_of,
)
from .kernel_standing import exact_closed, exact_open
from .kernel_switches import (
    anchor, extend_extremes, extend_pressure, log_row, neighbour, next_stage, put_sample, switch_to,
    write_sample,
)

RATE_PLACES = 8  # stretches of a series in each of which its rate of pressure turns once at most


@inner
def series_in_use(state, table, par, store):
    """Place in store of the series that holds now, whether in use, kept from before, or new."""
    if state[ACTIVE] < 0.0:
        cursor, last = int(state[CURSOR]), len(store) - 1
        place = cursor if 0 <= cursor < last else last
        if place == last or cursor >= int(state[STORED]):
            expand(store[place], state, table[int(state[STAGE])], par)
        if place < last:
            state[CURSOR] = cursor + 1.0
            state[STORED] = max(state[STORED], state[CURSOR])
        state[ACTIVE], state[ANCHOR_TIME] = place, state[TIME]
    return int(state[ACTIVE])


@inner
def moving_samples(c, until, state, par, first, rate, samples, written):
    """Write the samples that lie on the series up to `until`; returns how many there are now."""
    stage, order = int(state[STAGE]), int(c[FACTS, ORDER])
    while written < samples.shape[1]:
        time = (first + written) / rate
        if time > until:
            break
        at = place_of(c, time - state[ANCHOR_TIME])
        y = horner(c[POSITION], order, at)
        put_sample(samples, written, time, pressure_at(c, par[DRAIN], at), y,
                   horner(c[VELOCITY], order, at), sleeve_position(y, stage, par), stage)
        written += 1
    return written


@inner
def moving_stop(state, c, par, until):
    """Leave the state at `until`, on the series, which stays in use."""
    at = place_of(c, until - state[ANCHOR_TIME])
    order = int(c[FACTS, ORDER])
    state[TIME], state[P] = until, pressure_at(c, par[DRAIN], at)
    state[Y], state[V] = horner(c[POSITION], order, at), horner(c[VELOCITY], order, at)


@inner
def note_rates(c, order, start, end, ledger):
    """Note the rates of pressure from `start` to `end` on a series: there and where they turn."""
    # By the root law dp/dt = 2*above*dw/ds; else it is the slope of the LEVEL row itself.
    factor = 2.0 * c[FACTS, ABOVE] if c[FACTS, MODE] == TURBULENT else 1.0
    low = start
    slope, bend = slope_of(c, order, low)
    note_rate(ledger, factor * slope)
    for k in range(1, RATE_PLACES + 1):
        high = start + (end - start) * k / RATE_PLACES
        slope, bend_after = slope_of(c, order, high)
        if bend * bend_after < 0.0:
            left, right = low, high
            for _ in range(50):
                middle = 0.5 * (left + right)
                turning_slope, turning_bend = slope_of(c, order, middle)
                if turning_bend * bend > 0.0:
                    left = middle
                else:
                    right = middle
            note_rate(ledger, factor * turning_slope)
        low, bend = high, bend_after
    note_rate(ledger, factor * slope)


@inner
def account_moving(c, state, table, par, until, ledger):
    """Add the energies of the motion on this series since the last account, up to `until`."""
    stage, order = int(state[STAGE]), int(c[FACTS, ORDER])
    start = place_of(c, state[ACCOUNTED] - state[ANCHOR_TIME])
    length = place_of(c, until - state[ANCHOR_TIME]) - start
    mode, above = int(c[FACTS, MODE]), c[FACTS, ABOVE]
    for i in range(len(GAUSS_AT)):
        at = start + length * GAUSS_AT[i]
        level = horner(c[LEVEL], order, at)
        duration, root = length * GAUSS_WEIGHT[i], 0.0
        if mode == TURBULENT:
            duration *= level
            root = level * math.sqrt(above)
        elif mode == LINEAR:
            root = level / ROOT_LAMINAR
        p = pressure_at(c, par[DRAIN], at)
        balance = add_powers(ledger, duration, p, horner(c[POSITION], order, at),
                             horner(c[VELOCITY], order, at), root, stage, table, par)
        if mode == AT_VACUUM:
            ledger[CLAMP_WORK] -= duration * p * balance
    note_rates(c, order, start, start + length, ledger)
    state[ACCOUNTED] = until


@inner
def exact_moving(state, table, par, until, store, first, rate, samples, written, log, used,
                 ledger):
    """
    Follow a moving plunger on one series, to its end or to `until`.

    Returns samples written and log rows used (or -1 for chatter).
    """
    # Facts are read one by one: a view of the row would cost more than all the rest.
    i = series_in_use(state, table, par, store)
    stage = int(state[STAGE])
    if stage == SLOT and store[i, FACTS, DIRECTION] < 0.0:
        after = neighbour(stage, state[Y], -1.0, par)
        return written, switch_to(state, after, table, par, False, log, used)
    end = state[ANCHOR_TIME] + store[i, FACTS, DURATION]
    if written < samples.shape[1] and (first + written) / rate <= min(end, until):
        written = moving_samples(store[i], min(end, until), state, par, first, rate, samples,
                                 written)
    if len(ledger) > 0:
        account_moving(store[i], state, table, par, min(end, until), ledger)
    if end > until:
        moving_stop(state, store[i], par, until)
        return written, used
    if store[i, FACTS, TURN_TIME] >= 0.0:
        state[TIME] = state[ANCHOR_TIME] + store[i, FACTS, TURN_TIME]
        state[P] = store[i, FACTS, TURN_P]
        extend_pressure(state)
    if store[i, FACTS, RISE] >= 0.0 and math.isnan(state[RISE_TIME]):
        state[RISE_TIME] = state[ANCHOR_TIME] + store[i, FACTS, RISE]
    state[TIME], state[P] = end, store[i, FACTS, END_P]
    state[Y], state[V] = store[i, FACTS, END_Y], store[i, FACTS, END_V]
    turns, direction = store[i, FACTS, TURNS] != 0.0, store[i, FACTS, DIRECTION]
    if store[i, FACTS, LEAVES] != 0.0 or (turns and stage == SLOT):
        after = neighbour(stage, state[Y], -1.0 if turns else direction, par)
        return written, switch_to(state, after, table, par, False, log, used)
    if turns and direction > 0.0:
        used = log_row(state, stage, log, used)
    extend_extremes(state)
    anchor(state)
    return written, used


@inner
def exact_start(state, table, par, log):
    """Begin with new setpoints: where they send the state. Returns log rows used, -1: chatter."""
    state[REPEATS], state[CURSOR], state[STORED] = 0.0, -1.0, 0.0
    anchor(state)
    return switch_to(state, next_stage(state, table, par, True), table, par, True, log, 0)


@inner
def exact_step(state, table, par, until, store, first, rate, samples, written, log, used, ledger):
    """Go on to the next switch, to the end of a series or to `until`, whichever comes first."""
    stage = int(state[STAGE])
    if stage == CLOSED:
        return exact_closed(state, table, par, until, first, rate, samples, written, log, used,
                            ledger)
    if stage == OPEN:
        return exact_open(state, table, par, until, first, rate, samples, written, log, used,
                          ledger)
    return exact_moving(state, table, par, until, store, first, rate, samples, written, log, used,
                        ledger)


@entry
def advance_exact(state, table, par, changed, until, store, first, rate, samples, written, log,
                  ledger):
    """
    Integrate to the time `until`: closed forms and Taylor series, switches located on them.

    Samples, return values and the log are those of `advance_euler`.
    """
    used = 0
    if changed:
        used = exact_start(state, table, par, log)
        if used < 0:
            return CHATTER, written, 0
    while state[TIME] < until:
        if used > len(log) - 2 * SWITCHES_AT_ONCE:
            return LOG_FULL, written, used
        written, used = exact_step(state, table, par, until, store, first, rate, samples, written,
                                   log, used, ledger)
        if used < 0:
            return CHATTER, written, 0
    while written < samples.shape[1]:
        # The last sample may lie past the end by rounding.
        write_sample(state, par, samples, written)
        written += 1
    return DONE, written, used
