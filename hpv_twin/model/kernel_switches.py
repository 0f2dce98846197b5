"""Compiled: from stage to stage, the log of switches with the extremes between them, samples."""
import math

from .compiling import inner
from .kernel_layout import (
    ACTIVE, ANCHOR_P, ANCHOR_TIME, AREA, CATCH_UP, CLOSED, CURSOR, FORCE0, GAP, LAST_SWITCH, LIFT,
    OPEN, P, PHASE_OF_STAGE, P_MAX, P_MIN, REPEATS, RETURN_HIGH, RETURN_LOW, RETURN_P, RISE_TIME,
    ROW_AFTER, ROW_BEFORE, ROW_P, ROW_P_MAX, ROW_RISE_TIME, ROW_TIME, ROW_V, ROW_Y, SAMPLE_P,
    SAMPLE_PHASE, SAMPLE_SLEEVE, SAMPLE_TIME, SAMPLE_V, SAMPLE_Y, SLOT, STAGE, STROKE,
    SWITCHES_AT_ONCE, TIME, T_P_MAX, T_P_MIN, T_Y_MAX, V, Y, Y_MAX, Y_MIN,
)
from .kernel_machine import force_at, sleeve_position


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
