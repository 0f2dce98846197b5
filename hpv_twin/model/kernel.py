"""
Everything compiled: stages, rates, switches and the two integrators, as scalar code for numba.

One cycle passes through seven *stages*: the rows of the phase table. In a stage every term of
(22)-(25) is linear in the pressure p and the plunger's position y and velocity v, but for the root
in the slot's flow; all that changes from stage to stage is a handful of constants. `fill_stages`
is therefore the one place where the machine is written down, and `flow_balance` with `net_force`
are the equations.

This is one file on purpose: numba's on-disk cache is keyed on the file of the compiled function
alone, so that a callee changed in another file would leave stale machine code behind.
"""
import math
import warnings

import numba
import numpy as np

# Stages, and the paper's phase of each.
CLOSED, LIFT, CATCH_UP, SLOT, OPEN, RETURN_HIGH, RETURN_LOW = range(7)
STAGE_NAMES = ('closed', 'lift', 'catch-up', 'slot', 'open', 'return high', 'return low')
PHASE_NAMES = ('closed', 'forward', 'open', 'return')
PHASE_CLOSED, PHASE_FORWARD, PHASE_OPEN, PHASE_RETURN = range(4)
PHASE_OF_STAGE = np.array([0, 1, 1, 1, 2, 3, 3], dtype=np.int8)

# Columns of the stage table: area A, mass m, displaced area A_v, slot s = S0 + S1*y, net force
# A*p + FLOW*(flow balance) + F0 - KS*y - c1*v, and the stretch of y on which the stage holds.
AREA, MASS, DISPLACED, S0, S1, FORCE0, KS, FLOW, LOW, HIGH = range(10)
# Entries of the parameter vector.
STIFFNESS, PUMP_FLOW, DRAIN, FRICTION, ORIFICE, STROKE, PICK_UP, GAP, SLEEVE_RATIO = range(9)
# Entries of the state: time, gauge pressure, position, velocity, stage, the number of switches at
# the instant of the last one and that instant, and the extremes since the last row of the log.
TIME, P, Y, V, STAGE, REPEATS, LAST_SWITCH = range(7)
P_MAX, T_P_MAX, P_MIN, T_P_MIN, Y_MAX, T_Y_MAX, Y_MIN = range(7, 14)
STATE_SIZE = 14
# Columns of the log of located switches.
ROW_TIME, ROW_BEFORE, ROW_AFTER, ROW_P, ROW_Y, ROW_V = range(6)
ROW_P_MAX, ROW_T_P_MAX, ROW_P_MIN, ROW_T_P_MIN, ROW_Y_MAX, ROW_T_Y_MAX, ROW_Y_MIN = range(6, 13)
ROW_SIZE = 13
# Columns of the samples.
SAMPLE_TIME, SAMPLE_P, SAMPLE_Y, SAMPLE_V, SAMPLE_SLEEVE, SAMPLE_PHASE = range(6)
SAMPLE_SIZE = 6
# What an integrator returns.
DONE, LOG_FULL, CHATTER = range(3)

VACUUM = -101_325.0  # Pa gauge: the oil cavitates, pressure falls no further
SWITCHES_AT_ONCE = 4
NEVER = np.inf

inner = numba.njit(error_model='numpy')


def entry(function):
    """
    Compile a function that Python calls, keeping the machine code on disk.

    Without a writable place for it the model is compiled in memory at each start, and says so.
    """
    try:
        return numba.njit(cache=True, error_model='numpy')(function)
    except RuntimeError:
        warnings.warn('no writable place for the compiled model: compiling it anew takes some '
                      'seconds at each start; NUMBA_CACHE_DIR can name one', stacklevel=2)
        return inner(function)


def parameters(vibrator) -> np.ndarray:
    """Constants of a design that no stage changes; the pump flow is a setpoint."""
    vector = np.empty(9)
    vector[STIFFNESS] = vibrator.bulk_modulus / vibrator.cavity_volume
    vector[PUMP_FLOW] = vibrator.pump_flow
    vector[DRAIN] = vibrator.drain_pressure
    vector[FRICTION] = vibrator.viscous_friction
    vector[ORIFICE] = (vibrator.flow_coefficient * math.pi * vibrator.sleeve_seat_diameter
                       * math.sqrt(2.0 / vibrator.density))
    vector[STROKE] = vibrator.stroke
    vector[PICK_UP] = 0.1 * vibrator.stroke
    vector[GAP] = vibrator.gap
    vector[SLEEVE_RATIO] = vibrator.gap / (vibrator.gap - 0.1 * vibrator.stroke)
    return vector


def stage_table(vibrator, preload: float, load: float) -> np.ndarray:
    """Constants of the seven stages, shape (7, 10), for a design with these setpoints in force."""
    area_1, area_2 = vibrator.plunger_seat_area, vibrator.sleeve_seat_area
    stroke, gap = vibrator.stroke, vibrator.gap
    pick_up = 0.1 * stroke
    catching_up = area_1 + (area_2 - area_1) * gap / (gap - pick_up)
    back = stroke - gap
    mass_1 = vibrator.plunger_mass
    mass_2 = mass_1 + vibrator.sleeve_mass
    #        area    mass    displaced    slot S0 and S1   valid from and to      k2 acts
    rows = ((area_1, mass_1, 0.0,         0.0,    0.0,     0.0,      0.0,         True),
            (area_1, mass_1, area_1,      0.0,    0.0,     0.0,      pick_up,     True),
            (area_1, mass_1, catching_up, 0.0,    0.0,     pick_up,  gap,         True),
            (area_2, mass_2, area_2,      -gap,   1.0,     -NEVER,   stroke,      False),
            (area_2, mass_2, 0.0,         stroke, 0.0,     stroke,   stroke,      False),
            (area_2, mass_2, area_2,      0.0,    1.0,     back,     stroke,      False),
            (area_1, mass_1, area_2,      0.0,    1.0,     0.0,      back,        False))
    k1, k2 = vibrator.slotted_spring_stiffness, vibrator.twisted_spring_stiffness
    table = np.zeros((7, 10))
    for line, (area, mass, displaced, s0, s1, low, high, sleeve_spring) in zip(
            table, rows, strict=True):
        line[:] = (area, mass, displaced, s0, s1, 0.0, k1, 0.0, low, high)
        line[FORCE0] = -area * vibrator.drain_pressure - k1 * preload - load
        line[FLOW] = (math.sqrt(area / vibrator.line_area)
                      * vibrator.line_damping_in_force / area)
        if sleeve_spring:
            line[FORCE0] += k2 * vibrator.twisted_spring_preload
            line[KS] += k2
    return table


@inner
def flow_balance(p, y, v, displaced, s0, s1, pump_flow, drain, orifice):
    """Q_H - Q_slot - A_v*v, m³/s: what compresses the oil; (24)-(27) with the present pressure."""
    balance = pump_flow - displaced * v
    if p > drain:
        balance -= orifice * (s0 + s1 * y) * math.sqrt(p - drain)
    return balance


@inner
def net_force(p, y, v, balance, area, force0, ks, flow, friction):
    """Sum of the forces on the plunger, N, as in (22): the last term is the line's dashpot."""
    return area * p + force0 - ks * y - friction * v + flow * balance


@entry
def force_at(p, y, v, stage, table, par):
    """Net force, N, at this state in this stage."""
    row = table[stage]
    balance = flow_balance(p, y, v, row[DISPLACED], row[S0], row[S1],
                           par[PUMP_FLOW], par[DRAIN], par[ORIFICE])
    return net_force(p, y, v, balance, row[AREA], row[FORCE0], row[KS], row[FLOW], par[FRICTION])


@entry
def sleeve_position(y, stage, par):
    """y2, m: the sleeve waits until 0.1*h_b, then closes up to meet the plunger at h_s."""
    if stage == CATCH_UP:
        return max(0.0, y - par[PICK_UP]) * par[SLEEVE_RATIO]
    return y if stage > CATCH_UP else 0.0


@entry
def sleeve_velocity(v, stage, par):
    """dy2/dt, m/s, by the same law."""
    if stage == CATCH_UP:
        return v * par[SLEEVE_RATIO]
    return v if stage > CATCH_UP else 0.0


# Switches ---------------------------------------------------------------------------------------


@inner
def extend_extremes(state):
    """Let the extremes since the last logged row take in the present state."""
    if state[P] > state[P_MAX]:
        state[P_MAX], state[T_P_MAX] = state[P], state[TIME]
    if state[P] < state[P_MIN]:
        state[P_MIN], state[T_P_MIN] = state[P], state[TIME]
    if state[Y] > state[Y_MAX]:
        state[Y_MAX], state[T_Y_MAX] = state[Y], state[TIME]
    state[Y_MIN] = min(state[Y_MIN], state[Y])


@inner
def restart_extremes(state):
    """Begin new extremes at the present state."""
    state[P_MAX] = state[P_MIN] = state[P]
    state[Y_MAX] = state[Y_MIN] = state[Y]
    state[T_P_MAX] = state[T_P_MIN] = state[T_Y_MAX] = state[TIME]


@inner
def log_row(state, stage_after, log, used):
    """Write a located switch (or a turning point, with one stage twice) with its extremes."""
    extend_extremes(state)
    row = log[used]
    row[ROW_TIME], row[ROW_BEFORE], row[ROW_AFTER] = state[TIME], state[STAGE], stage_after
    row[ROW_P], row[ROW_Y], row[ROW_V] = state[P], state[Y], state[V]
    for k in range(7):
        row[ROW_P_MAX + k] = state[P_MAX + k]
    restart_extremes(state)
    return used + 1


@inner
def next_stage(state, table, par, changed):
    """
    Level tests: the stage in which this state belongs, the present one where it may stay.

    Stop and seat come first, then force, then velocity. A state that lies on a boundary because a
    switch has just been located there stays put; only when the setpoints have `changed` can it be
    pushed back over the boundary it came from, and is tested for that.
    """
    stage = int(state[STAGE])
    p, y, v = state[P], state[Y], state[V]
    if stage == CLOSED:
        return LIFT if force_at(p, 0.0, 0.0, CLOSED, table, par) > 0.0 else CLOSED
    if stage == OPEN:
        return RETURN_HIGH if force_at(p, y, 0.0, OPEN, table, par) < 0.0 else OPEN
    # How the plunger would leave this spot: by its velocity, or at rest by the force on it.
    drift = v
    if changed and v == 0.0:
        drift = force_at(p, y, v, stage, table, par)
    if (stage == SLOT or stage == RETURN_HIGH) and y >= par[STROKE] and drift > 0.0:
        return OPEN
    if (stage == LIFT or stage == RETURN_LOW) and y <= 0.0 and drift < 0.0:
        return CLOSED
    if stage == SLOT and v < 0.0:
        return RETURN_HIGH if y >= par[STROKE] - par[GAP] else RETURN_LOW
    return stage


@inner
def enter(state, stage, par):
    """Put the state into a stage. Stop and seat are plastic."""
    state[STAGE] = stage
    if stage == CLOSED:
        state[Y] = state[V] = 0.0
    elif stage == OPEN:
        state[Y], state[V] = par[STROKE], 0.0


@inner
def neighbour(stage, y, v, par):
    """Stage behind the boundary that a moving plunger has just reached."""
    if v >= 0.0:
        if stage == LIFT:
            return CATCH_UP
        if stage == CATCH_UP:
            return SLOT
        return RETURN_HIGH if stage == RETURN_LOW else OPEN
    if stage == CATCH_UP:
        return LIFT
    if stage == SLOT:
        return RETURN_HIGH if y >= par[STROKE] - par[GAP] else RETURN_LOW
    return RETURN_LOW if stage == RETURN_HIGH else CLOSED


@inner
def switch_to(state, stage, table, par, changed, log, used):
    """
    Go to `stage`, then wherever the level tests send the state at this same instant.

    Returns the number of log rows used, or -1 when more than four switches of phase happen
    without time advancing.
    """
    while stage != int(state[STAGE]):
        if PHASE_OF_STAGE[stage] != PHASE_OF_STAGE[int(state[STAGE])]:
            state[REPEATS] = state[REPEATS] + 1.0 if state[TIME] == state[LAST_SWITCH] else 1.0
            state[LAST_SWITCH] = state[TIME]
            if state[REPEATS] > SWITCHES_AT_ONCE:
                return -1
        used = log_row(state, stage, log, used)
        enter(state, stage, par)
        restart_extremes(state)
        stage = next_stage(state, table, par, changed)
    return used


@inner
def write_sample(state, par, samples, index):
    """Write the present state as one line of the samples."""
    stage = int(state[STAGE])
    line = samples[index]
    line[SAMPLE_TIME], line[SAMPLE_P] = state[TIME], state[P]
    line[SAMPLE_Y], line[SAMPLE_V] = state[Y], state[V]
    line[SAMPLE_SLEEVE] = sleeve_position(state[Y], stage, par)
    line[SAMPLE_PHASE] = PHASE_OF_STAGE[stage]


# The paper's integrator -------------------------------------------------------------------------


@inner
def euler_closed(p, rate, limit, step, count):
    """Step the build-up until p passes `limit`: returns p before and after, whole steps done."""
    for done in range(count):
        after = max(p + step * rate, VACUUM)
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
    done, p_after, y_after, v_after = 0, p, y, v
    while done < count:
        balance = flow_balance(p, y, v, displaced, s0, s1, pump_flow, drain, orifice)
        force = net_force(p, y, v, balance, area, force0, ks, flow, friction)
        p_after = max(p + to_pressure * balance, VACUUM)
        y_after = y + step * v
        v_after = v + to_velocity * force
        if y_after > high or y_after < low or (v_after <= 0.0 and v > 0.0):
            break
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
    return p, y, v, p_after, y_after, v_after, done


@inner
def settle_force(state, stage, table, par, sign):
    """
    Nudge the pressure by rounding errors until the net force of the stage just left has `sign`.

    The force is zero where this switch is located; were it a hair on the wrong side, the plunger
    would be found to move back through the seat or the stop that it is leaving.
    """
    ulp = sign * 2.3e-16 * max(abs(state[P]), 1.0)
    for _ in range(100):
        if sign * force_at(state[P], state[Y], 0.0, stage, table, par) >= 0.0:
            return
        state[P] += ulp
        ulp *= 2.0


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
    state[P] = p + share * (after - p)
    state[TIME] = start + (done + share) * step
    if done == count:
        extend_extremes(state)
        return used, float(count)
    settle_force(state, stage, table, par, 1.0 if stage == CLOSED else -1.0)
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
def euler_steps(state, table, par, stop, step, log, used):
    """
    Go on towards `stop` by whole steps on the grid n*step, or by the part of one up to the grid.

    Returns the log rows used, or -1 for chatter.
    """
    now = state[TIME]
    slack = 1e-6 + 4e-16 * now / step
    grid = math.floor(now / step + slack)
    count = int(math.floor(stop / step + slack) - grid)
    if abs(now - grid * step) <= slack * step and count >= 1:
        used, reached = euler_stretch(state, table, par, step, count, log, used)
        if reached == count:
            state[TIME] = min((grid + count) * step, stop)
        return used
    end = min((grid + 1.0) * step, stop) if count >= 1 else stop
    used, reached = euler_stretch(state, table, par, end - now, 1, log, used)
    if reached == 1.0:
        state[TIME] = end
    return used


@entry
def advance_euler(state, table, par, changed, until, step, first, rate, samples, log):
    """
    Integrate by the paper's explicit Euler method to the time `until`.

    Steps lie on the grid n*step of model time; a sample or the end of the slice off that grid
    shortens a step. Samples are taken at (first + k)/rate. Returns (code, samples written, log
    rows used); with LOG_FULL the caller empties the log and calls again.
    """
    used = 0
    written = 0
    if changed:
        state[REPEATS] = 0.0
        used = switch_to(state, next_stage(state, table, par, True), table, par, True, log, used)
        if used < 0:
            return CHATTER, written, 0
    while True:
        stop = until
        if written < len(samples):
            stop = min(until, (first + written) / rate)
        while state[TIME] < stop:
            if used > len(log) - 2 * SWITCHES_AT_ONCE:
                return LOG_FULL, written, used
            used = euler_steps(state, table, par, stop, step, log, used)
            if used < 0:
                return CHATTER, written, 0
        if written < len(samples):
            write_sample(state, par, samples, written)
            written += 1
        else:
            return DONE, written, used
