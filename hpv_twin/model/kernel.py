"""
Everything compiled: stages, rates, switches and the two integrators, as scalar code for numba.

One cycle passes through seven *stages*: the rows of the phase table. In a stage every term of
(22)-(25) is linear in the pressure p and the plunger's position y and velocity v, but for the root
in the slot's flow; all that changes from stage to stage is a handful of constants. `fill_stages`
is therefore the one place where the machine is written down, and `flow_balance` with `net_force`
are the equations.
"""
import math

import numpy as np

from .compiling import entry, inner

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
SLEEVE_SPRING_FORCE, SLEEVE_SPRING = 9, 10
PARAMETERS, TABLE = 11, (7, 10)
# Entries of the state: time, gauge pressure, position, velocity, stage, the number of switches at
# the instant of the last one and that instant, the extremes since the last row of the log.
TIME, P, Y, V, STAGE, REPEATS, LAST_SWITCH = range(7)
P_MAX, T_P_MAX, P_MIN, T_P_MIN, Y_MAX, T_Y_MAX, Y_MIN = range(7, 14)
# Where the present stage, or the present series in it, began; which series is in use (-1: none),
# the place in the cycle since its opening (-1: it did not begin with one), the series in store.
ANCHOR_TIME, ANCHOR_P, ACTIVE, CURSOR, STORED = range(14, 19)
# Pressure at which the last return stroke began, and the instant since the last row of the log at
# which the pressure rose through it (NaN: it did not); until when energies are accounted for.
RETURN_P, RISE_TIME, ACCOUNTED = range(19, 22)
STATE_SIZE = 22
# Columns of the log of located switches.
ROW_TIME, ROW_BEFORE, ROW_AFTER, ROW_P, ROW_Y, ROW_V = range(6)
ROW_P_MAX, ROW_T_P_MAX, ROW_P_MIN, ROW_T_P_MIN, ROW_Y_MAX, ROW_T_Y_MAX, ROW_Y_MIN = range(6, 13)
ROW_RISE_TIME = 13
ROW_SIZE = 14
# Rows of the samples.
SAMPLE_TIME, SAMPLE_P, SAMPLE_Y, SAMPLE_V, SAMPLE_SLEEVE, SAMPLE_PHASE = range(6)
SAMPLE_SIZE = 6
# What an integrator returns.
DONE, LOG_FULL, CHATTER = range(3)

VACUUM = -101_325.0  # Pa gauge: the oil cavitates, pressure falls no further
SWITCHES_AT_ONCE = 4
NEVER = np.inf

# What a design gives to the model, in this order: names of attributes of a Vibrator.
CONSTANTS = (
    'plunger_seat_area', 'sleeve_seat_area', 'line_area', 'line_damping_in_force', 'stroke', 'gap',
    'plunger_mass', 'sleeve_mass', 'slotted_spring_stiffness', 'twisted_spring_stiffness',
    'twisted_spring_preload', 'cavity_volume', 'bulk_modulus', 'sleeve_seat_diameter', 'density',
    'flow_coefficient', 'viscous_friction', 'drain_pressure', 'pump_flow', 'preload', 'load')
(A1, A2, A0, C0, H_B, H_S, M1, M2, K1, K2, Y02, W0, KAPPA, D2, RHO, XI, C1, P_DP, Q_H, Y01,
 F_T) = range(21)


def constants(design) -> np.ndarray:
    """
    What a design gives to the model, SI, shape (21,); see CONSTANTS.

    Of many designs at once (`Designs`), whose attributes are arrays: shape (n, 21).
    """
    columns = [getattr(design, name) for name in CONSTANTS]
    return np.stack(np.broadcast_arrays(*columns), axis=-1, dtype=float)


@entry
def fill_parameters(con, par):
    """Put into `par` the constants of a design that no stage changes; Q_H is a setpoint."""
    par[STIFFNESS] = con[KAPPA] / con[W0]
    par[PUMP_FLOW] = con[Q_H]
    par[DRAIN] = con[P_DP]
    par[FRICTION] = con[C1]
    par[ORIFICE] = con[XI] * math.pi * con[D2] * math.sqrt(2.0 / con[RHO])
    par[STROKE] = con[H_B]
    par[PICK_UP] = 0.1 * con[H_B]
    par[GAP] = con[H_S]
    par[SLEEVE_RATIO] = con[H_S] / (con[H_S] - 0.1 * con[H_B])
    par[SLEEVE_SPRING] = con[K2]
    par[SLEEVE_SPRING_FORCE] = con[K2] * con[Y02]


@inner
def fill_row(row, area, mass, displaced, s0, s1, low, high):
    """Put into a row of the stage table what stands in the phase table."""
    row[AREA], row[MASS], row[DISPLACED], row[S0], row[S1] = area, mass, displaced, s0, s1
    row[LOW], row[HIGH] = low, high


@entry
def fill_stages(con, preload, load, table):
    """Put into `table` the constants of the seven stages with these setpoints in force."""
    area_1, area_2, mass_1, mass_2 = con[A1], con[A2], con[M1], con[M1] + con[M2]
    stroke, gap = con[H_B], con[H_S]
    pick_up, back = 0.1 * stroke, stroke - gap
    catching_up = area_1 + (area_2 - area_1) * gap / (gap - pick_up)
    #                            area    mass    displaced    slot S0, S1    valid from and to
    fill_row(table[CLOSED],      area_1, mass_1, 0.0,         0.0,    0.0,   0.0,     0.0)
    fill_row(table[LIFT],        area_1, mass_1, area_1,      0.0,    0.0,   0.0,     pick_up)
    fill_row(table[CATCH_UP],    area_1, mass_1, catching_up, 0.0,    0.0,   pick_up, gap)
    fill_row(table[SLOT],        area_2, mass_2, area_2,      -gap,   1.0,   -NEVER,  stroke)
    fill_row(table[OPEN],        area_2, mass_2, 0.0,         stroke, 0.0,   stroke,  stroke)
    fill_row(table[RETURN_HIGH], area_2, mass_2, area_2,      0.0,    1.0,   back,    stroke)
    fill_row(table[RETURN_LOW],  area_1, mass_1, area_2,      0.0,    1.0,   0.0,     back)
    for stage in range(7):
        area = table[stage, AREA]
        table[stage, FLOW] = math.sqrt(area / con[A0]) * con[C0] / area
        table[stage, FORCE0] = -area * con[P_DP] - con[K1] * preload - load
        table[stage, KS] = con[K1]
        if stage <= CATCH_UP:
            table[stage, FORCE0] += con[K2] * con[Y02]
            table[stage, KS] += con[K2]


def parameters(vibrator) -> np.ndarray:
    """Constants of a design that no stage changes, as a new vector."""
    par = np.empty(PARAMETERS)
    fill_parameters(constants(vibrator), par)
    return par


def stage_table(vibrator, preload: float, load: float) -> np.ndarray:
    """Constants of the seven stages, shape (7, 10), for a design with these setpoints in force."""
    table = np.empty(TABLE)
    fill_stages(constants(vibrator), float(preload), float(load), table)
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
    balance = flow_balance(p, y, v, table[stage, DISPLACED], table[stage, S0], table[stage, S1],
                           par[PUMP_FLOW], par[DRAIN], par[ORIFICE])
    return net_force(p, y, v, balance, table[stage, AREA], table[stage, FORCE0],
                     table[stage, KS], table[stage, FLOW], par[FRICTION])


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
def extend_pressure(state):
    """Let the extremes of pressure since the last logged row take in the present one."""
    if state[P] > state[P_MAX]:
        state[P_MAX], state[T_P_MAX] = state[P], state[TIME]
    if state[P] < state[P_MIN]:
        state[P_MIN], state[T_P_MIN] = state[P], state[TIME]


@inner
def extend_extremes(state):
    """Let the extremes since the last logged row take in the present state."""
    extend_pressure(state)
    if state[Y] > state[Y_MAX]:
        state[Y_MAX], state[T_Y_MAX] = state[Y], state[TIME]
    state[Y_MIN] = min(state[Y_MIN], state[Y])


@inner
def restart_extremes(state):
    """Begin new extremes at the present state."""
    state[P_MAX] = state[P_MIN] = state[P]
    state[Y_MAX] = state[Y_MIN] = state[Y]
    state[T_P_MAX] = state[T_P_MIN] = state[T_Y_MAX] = state[TIME]
    state[RISE_TIME] = math.nan


@inner
def log_row(state, stage_after, log, used):
    """Write a located switch (or a turning point, with one stage twice) with its extremes."""
    extend_extremes(state)
    log[used, ROW_TIME], log[used, ROW_BEFORE] = state[TIME], state[STAGE]
    log[used, ROW_AFTER] = stage_after
    log[used, ROW_P], log[used, ROW_Y], log[used, ROW_V] = state[P], state[Y], state[V]
    for k in range(7):
        log[used, ROW_P_MAX + k] = state[P_MAX + k]
    log[used, ROW_RISE_TIME] = state[RISE_TIME]
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
        state[CURSOR] = -1.0
    elif stage == OPEN:
        state[Y], state[V] = par[STROKE], 0.0
    elif stage == RETURN_HIGH and state[Y] >= par[STROKE]:
        state[RETURN_P] = state[P]
    anchor(state)


@inner
def note_rise(state, p, start, p_start, slope):
    """Note when the pressure, on a straight line from p_start to p, rose through RETURN_P."""
    if math.isnan(state[RISE_TIME]) and p_start < state[RETURN_P] <= p:
        state[RISE_TIME] = start + (state[RETURN_P] - p_start) / slope


@inner
def anchor(state):
    """Count from here: the stage, or the setpoints, are new."""
    state[ANCHOR_TIME], state[ANCHOR_P], state[ACTIVE] = state[TIME], state[P], -1.0


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
def put_sample(samples, k, time, p, y, v, sleeve, stage):
    """Write column `k` of the samples."""
    samples[SAMPLE_TIME, k], samples[SAMPLE_P, k] = time, p
    samples[SAMPLE_Y, k], samples[SAMPLE_V, k] = y, v
    samples[SAMPLE_SLEEVE, k], samples[SAMPLE_PHASE, k] = sleeve, PHASE_OF_STAGE[stage]


@inner
def write_sample(state, par, samples, k):
    """Write the present state as column `k` of the samples."""
    stage = int(state[STAGE])
    put_sample(samples, k, state[TIME], state[P], state[Y], state[V],
               sleeve_position(state[Y], stage, par), stage)


# Energies ---------------------------------------------------------------------------------------
#
# The integrals of the energy ledger, J, each by itself: the power is integrated along the motion,
# by Gauss's rule on a series and by Euler's own steps in `euler`. No term is found as the rest.

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


# The paper's integrator -------------------------------------------------------------------------


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
def settle_force(state, stage, table, par, way):
    """
    Nudge the pressure on its `way` by rounding errors until the net force frees the plunger.

    The force is zero where this switch is located; were it a hair on the wrong side, the plunger
    would be found to move back through the seat or the stop that it is leaving. `way` is the sign
    of dp/dt: with a strong dashpot a plunger leaves its stop on a rising pressure too.
    """
    sign = 1.0 if stage == CLOSED else -1.0
    hair = 1e-14 * abs(table[stage, FORCE0])
    nudge = way * max(hair / table[stage, AREA], 2.3e-16 * abs(state[P]))
    for _ in range(100):
        state[P] += nudge
        if sign * force_at(state[P], state[Y], 0.0, stage, table, par) >= 0.0:
            return
        nudge *= 2.0


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


# The default integrator --------------------------------------------------------------------------
#
# CLOSED and OPEN are solved in closed form. A moving plunger is followed by Taylor series of the
# equations themselves, summed to rounding: where no slot is open these are the series of the
# exponentials that solve the linear equations, and cheaper than the exponentials; elsewhere they
# are a high-order method. Every series is a polynomial, so samples, extremes and switches are
# found on it, and neither a sample nor the end of a slice ends it: however `advance` is sliced,
# the same series are evaluated.
#
# In the root law sqrt(p - p_dp) a series in time converges no further than the pressure stays away
# from the drain's. In the parameter s of dt = w ds, with w = sqrt((p - p_dp)/d) and d the value of
# p - p_dp at the start of the series, everything is polynomial:
#     dw/ds = kappa/(2 W0 d)*balance,  dy/ds = w v,  dv/ds = w F/m,  dt/ds = w,
# and the discharge, an exponential in s, takes a few steps instead of dozens.
#
# An opening fixes p, y and v: while the setpoints stay, every cycle that begins with one runs
# through the same states. Its series are kept and used again until a setpoint changes; a cycle
# then costs little more than its samples.

ORDER_FREE = 20  # no slot open: the coefficients cost next to nothing
ORDER_SLOT = 24
TOLERANCE = 1e-12  # last terms of a series, relative to the stroke and to the pressure's scale
PRESSURE_SCALE = 1e6  # Pa
# Below this the slot's flow is linear in the pressure: the root has no slope at zero.
LAMINAR = 1.0  # Pa above the drain
ROOT_LAMINAR = math.sqrt(LAMINAR)
MARGIN = 1e-6  # Pa by which the laws of flow overlap
RELEASE = 1e-15  # m³/s: the vacuum lets go when this much oil is to spare
INVERSE = 1.0 / np.arange(1.0, ORDER_SLOT + 1.0)
# Rows of the workspace, coefficients in the parameter of the series: w (root law) or p - p_dp
# (else), y, v, net force, time; a row to spare; and a row of facts about the series.
LEVEL, POSITION, VELOCITY, FORCE, CLOCK, SPARE, FACTS = range(7)
# Facts: law of flow, order, p - p_dp at the start, where it ends and how long that takes, what
# happens there, where the pressure turns on the way (and its value), and the state at the end.
MODE, ORDER, ABOVE, END, DURATION, TURNS, LEAVES, DIRECTION = range(8)
TURN_TIME, TURN_P, END_P, END_Y, END_V, RISE, END_SLOPE = range(8, 15)
ORBIT = 48  # series kept from an opening on; what comes after uses the last place again and again
WORKSPACE = (ORBIT + 1, 7, ORDER_SLOT + 1)
RATE_PLACES = 8  # stretches of a series in each of which its rate of pressure turns once at most
LONGEST = 1.0  # s: a plunger at rest has a series without end
# How oil leaves: not at all at the vacuum limit, not while below the drain, by the linear or by
# the root law.
AT_VACUUM, DRY, LINEAR, TURBULENT = range(4)


@inner
def horner(c, order, at):
    """Value of the polynomial c[0] + c[1]*at + ...; its even and odd terms are summed abreast."""
    square = at * at
    first = order - (order & 1)
    even, odd = c[first], 0.0
    if order & 1:
        odd = c[order]
    for k in range(first - 2, -1, -2):
        even = even * square + c[k]
        odd = odd * square + c[k + 1]
    return even + at * odd


@inner
def crossing(c, order, level, side, end, guess):
    """
    First place in (0, end] at which side*(c - level) falls below zero; it is below at `end`.

    Newton's method from a guess, kept inside a bracket; the polynomial is taken to be above at 0
    even where rounding, or a start on the level itself, hides it.
    """
    low, high = 0.0, end
    at = guess
    for _ in range(100):
        # Value and slope, even and odd terms apart.
        square = at * at
        first = order - (order & 1)
        even, odd, even_slope, odd_slope = c[first], 0.0, 0.0, 0.0
        if order & 1:
            odd = c[order]
        for k in range(first - 2, -1, -2):
            even_slope = even_slope * square + even
            odd_slope = odd_slope * square + odd
            even = even * square + c[k]
            odd = odd * square + c[k + 1]
        value = side * (even + at * odd - level)
        steep = side * (2.0 * at * even_slope + odd + 2.0 * square * odd_slope)
        if value < 0.0:
            high = at
        else:
            low = at
        following = at - value / steep if steep != 0.0 else low
        if not low < following < high:
            following = 0.5 * (low + high)
            if following == low or following == high:
                return at
        elif abs(following - at) <= 1e-8 * end:
            # The next step would be the square of this one.
            return following
        at = following
    return at


@inner
def turning(c, row, order, end):
    """Place in (0, end) at which row `row` turns; its slope has opposite signs at the ends."""
    for k in range(order):
        c[SPARE, k] = (k + 1.0) * c[row, k + 1]
    side = 1.0 if c[row, 1] > 0.0 else -1.0
    return crossing(c[SPARE], order - 1, 0.0, side, end, 0.5 * end)


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
def reach(c, order, stroke, unit):
    """Length over which the series holds to the tolerance, from its last two terms."""
    last = max(abs(c[LEVEL, order]) / unit, abs(c[POSITION, order]) / stroke)
    before = max(abs(c[LEVEL, order - 1]) / unit, abs(c[POSITION, order - 1]) / stroke)
    length = NEVER
    if last > 0.0:
        length = math.log(TOLERANCE / last) / order
    if before > 0.0:
        length = min(length, math.log(TOLERANCE / before) / (order - 1))
    return min(math.exp(length), LONGEST)


@inner
def direction_of(c, order):
    """Sign of the velocity just after the start of the series; 0 at rest for good."""
    for k in range(order + 1):
        if c[VELOCITY, k] != 0.0:
            return 1.0 if c[VELOCITY, k] > 0.0 else -1.0
    return 0.0


@inner
def monotone_end(c, order, direction, end):
    """Up to `end` or, before it, the first place at which the plunger turns round."""
    velocity = c[VELOCITY]
    if direction * horner(velocity, order, end) < 0.0:
        return crossing(velocity, order, 0.0, direction, end, end), True
    if direction * velocity[1] < 0.0:
        slope = order * velocity[order]
        for k in range(order - 1, 0, -1):
            slope = slope * end + k * velocity[k]
        if direction * slope > 0.0:
            # Slower, then faster: it may have turned twice.
            slowest = turning(c, VELOCITY, order, end)
            if direction * horner(velocity, order, slowest) < 0.0:
                return crossing(velocity, order, 0.0, direction, slowest, slowest), True
    return end, False


@inner
def level_end(c, order, low, high, end):
    """
    Up to `end` or, before it, the first place at which the LEVEL row leaves [low, high].

    Returns that place, and where the row turns on the way, or `end` if it does not.
    """
    level = c[LEVEL]
    slope = order * level[order]
    for k in range(order - 1, 0, -1):
        slope = slope * end + k * level[k]
    turn = end
    if level[1] * slope < 0.0:
        turn = turning(c, LEVEL, order, end)
        value = horner(level, order, turn)
        if value > high:
            return crossing(level, order, high, -1.0, turn, turn), end
        if value < low:
            return crossing(level, order, low, 1.0, turn, turn), end
    value = horner(level, order, end)
    if value > high:
        end = crossing(level, order, high, -1.0, end, end)
    elif value < low:
        end = crossing(level, order, low, 1.0, end, end)
    return end, turn


@inner
def pressure_at(c, drain, at):
    """Gauge pressure, Pa, on the series."""
    level = horner(c[LEVEL], int(c[FACTS, ORDER]), at)
    return (c[FACTS, ABOVE] * level * level if c[FACTS, MODE] == TURBULENT else level) + drain


@inner
def place_of(c, time):
    """Parameter of the series at `time` s after its start."""
    if c[FACTS, MODE] != TURBULENT or time <= 0.0:
        return max(time, 0.0)
    if time >= c[FACTS, DURATION]:
        return c[FACTS, END]
    # A cubic through both ends, with the slopes 1/w there, is a guess near enough.
    end, duration = c[FACTS, END], c[FACTS, DURATION]
    part = time / duration
    rest = 1.0 - part
    guess = (duration * part * rest * (rest - part * c[FACTS, END_SLOPE])
             + end * part * part * (3.0 - 2.0 * part))
    guess = min(max(guess, 0.0), end)
    return crossing(c[CLOCK], int(c[FACTS, ORDER]), time, -1.0, end, guess)


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


@inner
def series_in_use(state, table, par, store):
    """Place in store of the series that holds now, whether in use, kept from before, or new."""
    if state[ACTIVE] < 0.0:
        cursor = int(state[CURSOR])
        place = cursor if 0 <= cursor < ORBIT else ORBIT
        if place == ORBIT or cursor >= int(state[STORED]):
            expand(store[place], state, table[int(state[STAGE])], par)
        if place < ORBIT:
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
def slope_of(c, order, at):
    """First and second derivative of the LEVEL row of a series."""
    first = second = 0.0
    for k in range(order, 0, -1):
        second = second * at + first
        first = first * at + k * c[LEVEL, k]
    return first, second


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
