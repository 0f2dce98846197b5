"""Compiled: cycles found in the kernel's rows, their figures, and what a machine is doing."""
import math

import numpy as np

from .compiling import entry, inner
from .kernel import (
    AREA,
    CATCH_UP,
    CLOSED,
    DRAIN,
    FORCE0,
    KS,
    LIFT,
    OPEN,
    ORIFICE,
    PHASE_OF_STAGE,
    PUMP_FLOW,
    RETURN_HIGH,
    ROW_AFTER,
    ROW_BEFORE,
    ROW_P,
    ROW_P_MAX,
    ROW_P_MIN,
    ROW_RISE_TIME,
    ROW_SIZE,
    ROW_T_P_MAX,
    ROW_T_P_MIN,
    ROW_T_Y_MAX,
    ROW_TIME,
    ROW_V,
    ROW_Y_MAX,
    ROW_Y_MIN,
    STAGE,
    STROKE,
    TIME,
    V,
)

# Regimes, in the order of regimes.REGIMES.
(NO_OPENING, STARTING, SEATED, SEAT_REBOUND, PARTIAL, OFF_SEAT, HELD_OPEN, HOVERING) = range(8)
# Figures of a cycle, in the order of the fields of cycles.Cycle.
(START, PERIOD, CYCLE_STROKE, PEAK, LOWEST, OPENING, RETURNING, BUILD_UP, FORWARD, DWELL,
 RETURN_STROKE, PHASE_LAG, PRESSURE_RISE, PRESSURE_FALL, UNDERSHOOT, RECOVERY, SLEEVE_FORWARD,
 SLEEVE_SEATED, STOP_SPEED, SEAT_SPEED, REGIME) = range(21)
FIGURES = 21
# What a search for cycles has in hand: how many rows, and what the present cycle is counted from.
ROWS, ANCHOR = range(2)
ROOM = 512  # rows kept while a cycle is not complete
# What a cycle can be counted from, the stronger first: opening (CLOSED), start of the return
# stroke (OPEN), and, written as RETURN_HIGH, a highest position.
NONE = -1
# Below this share of the full stroke the plunger is not oscillating, it is coming to rest.
LEAST_STROKE = 1e-3
# Without a whole cycle for so many periods of the last one, and for so long, it may be at rest,
PATIENCE = 3.0
SHORTEST_PATIENCE = 0.05  # s
# which it is if it would need longer than that for so much of its stroke.
AT_REST = 0.01


def new_search():
    """Return (rows, hand), what a search for cycles starts with."""
    return np.empty((ROOM, ROW_SIZE)), np.array([0.0, NONE])


@inner
def cycle_kind(row):
    """What a row can begin a cycle with: an opening, a return stroke, a highest position."""
    before, after = int(row[ROW_BEFORE]), int(row[ROW_AFTER])
    if before == CLOSED and after == LIFT:
        return CLOSED
    if before == OPEN and after == RETURN_HIGH:
        return OPEN
    return RETURN_HIGH if before == after else NONE


@inner
def rank(kind):
    """How strong a beginning is."""
    if kind == CLOSED:
        return 3
    if kind == OPEN:
        return 2
    return 1 if kind == RETURN_HIGH else 0


@inner
def copy_row(row, into):
    """Copy a row, element by element: slices would need what is compiled out."""
    for k in range(ROW_SIZE):
        into[k] = row[k]


@inner
def take_row(row, rows, hand, stroke, figures):
    """
    Take in the next row of the log.

    Returns whether it completes a cycle, whose figures then stand in `figures`.
    """
    used = int(hand[ROWS])
    if used == len(rows):  # so many switches are no cycle: begin again
        used, hand[ANCHOR] = 0, NONE
    copy_row(row, rows[used])
    hand[ROWS] = used + 1
    kind, anchor = cycle_kind(row), int(hand[ANCHOR])
    if kind == NONE:
        return False
    latest, count = -1, 0
    for i in range(used):
        if cycle_kind(rows[i]) == kind:
            latest = i
            count += 1
    # A seated cycle may well turn back on its way; only a third time is it off the seat.
    ends_one = count >= (2 if kind == RETURN_HIGH and anchor != RETURN_HIGH else 1)
    if not ends_one and rank(kind) < rank(anchor):
        return False
    whole = ends_one and measure(rows[latest:used + 1], kind, stroke, figures)
    copy_row(row, rows[0])
    hand[ROWS], hand[ANCHOR] = 1, kind
    return whole


@inner
def measure(rows, kind, stroke, figures):
    """
    Put the figures of the cycle from the first to the last of `rows` into `figures`.

    Returns whether it is one: a plunger coming to rest makes none.
    """
    figures[:] = math.nan
    figures[BUILD_UP] = figures[FORWARD] = figures[DWELL] = figures[RETURN_STROKE] = 0.0
    highest = peak = lowest = 1
    least = rows[1, ROW_Y_MIN]
    for i in range(1, len(rows)):
        # The four times stand in the order of the phases.
        column = BUILD_UP + PHASE_OF_STAGE[int(rows[i, ROW_BEFORE])]
        figures[column] += rows[i, ROW_TIME] - rows[i - 1, ROW_TIME]
        if rows[i, ROW_Y_MAX] > rows[highest, ROW_Y_MAX]:
            highest = i
        if rows[i, ROW_P_MAX] > rows[peak, ROW_P_MAX]:
            peak = i
        if rows[i, ROW_P_MIN] < rows[lowest, ROW_P_MIN]:
            lowest = i
        least = min(least, rows[i, ROW_Y_MIN])
        note_impact(rows[i], figures)
    figures[START] = rows[0, ROW_TIME]
    figures[PERIOD] = rows[-1, ROW_TIME] - rows[0, ROW_TIME]
    figures[CYCLE_STROKE] = rows[highest, ROW_Y_MAX] - least
    if figures[CYCLE_STROKE] < LEAST_STROKE * stroke or figures[PERIOD] <= 0.0:
        return False
    figures[PEAK], figures[LOWEST] = rows[peak, ROW_P_MAX], rows[lowest, ROW_P_MIN]
    figures[PHASE_LAG] = rows[highest, ROW_T_Y_MAX] - rows[peak, ROW_T_P_MAX]
    turned = first_return(rows)
    if turned >= 0:
        figures[RETURNING] = rows[turned, ROW_P]
    if kind == CLOSED:
        figures[OPENING] = rows[0, ROW_P]
        if turned > 0:
            finer_times(rows, peak, turned, figures)
    figures[REGIME] = regime_of_cycle(kind, figures[BUILD_UP], rows[highest, ROW_Y_MAX], stroke)
    return True


@inner
def note_impact(row, figures):
    """Note with what speed the plunger strikes stop and seat, the hardest blow of the cycle."""
    column = STOP_SPEED
    if row[ROW_AFTER] == CLOSED:
        column = SEAT_SPEED
    elif row[ROW_AFTER] != OPEN:
        return
    # Not `>`: the first blow replaces what is not a number.
    if row[ROW_BEFORE] != row[ROW_AFTER] and not abs(row[ROW_V]) <= figures[column]:
        figures[column] = abs(row[ROW_V])


@inner
def first_return(rows):
    """Row at which the first return stroke of the cycle starts; 0 if only at its start; or -1."""
    for i in range(1, len(rows)):
        if cycle_kind(rows[i]) == OPEN:
            return i
    return 0 if cycle_kind(rows[0]) == OPEN else -1


@inner
def regime_of_cycle(kind, build_up, highest, stroke):
    """Regime of one cycle, by what happened in it."""
    if kind != CLOSED:
        return OFF_SEAT
    if highest < stroke:
        return PARTIAL
    return SEATED if build_up > 0.0 else SEAT_REBOUND


@inner
def first_into(rows, stage):
    """Instant of the first switch into a stage, s."""
    for i in range(1, len(rows)):
        if rows[i, ROW_AFTER] == stage:
            return rows[i, ROW_TIME]
    return math.nan


@inner
def finer_times(rows, peak, turned, figures):
    """Rows of (6) for pressure and sleeve of a cycle between two openings; see Cycle."""
    start, end, then = rows[0, ROW_TIME], rows[-1, ROW_TIME], rows[turned, ROW_TIME]
    highest = rows[peak, ROW_T_P_MAX]
    least, lowest, risen = math.inf, math.nan, math.nan
    for i in range(turned, len(rows)):
        if rows[i, ROW_TIME] > then and rows[i, ROW_P_MIN] < least:
            least, lowest = rows[i, ROW_P_MIN], rows[i, ROW_T_P_MIN]
    for i in range(len(rows) - 1, turned, -1):
        if rows[i, ROW_TIME] > then and rows[i, ROW_RISE_TIME] >= lowest:
            risen = rows[i, ROW_RISE_TIME]
    sleeve_forward = first_into(rows, OPEN) - first_into(rows, CATCH_UP)
    figures[PRESSURE_RISE] = (end - risen) + (highest - start)
    figures[PRESSURE_FALL] = then - highest
    figures[UNDERSHOOT] = lowest - then
    figures[RECOVERY] = risen - lowest
    figures[SLEEVE_FORWARD] = sleeve_forward
    figures[SLEEVE_SEATED] = figures[BUILD_UP] + figures[FORWARD] - sleeve_forward


@entry
def take_rows(log, rows, hand, stroke, found):
    """
    Take in rows of the log in order of time.

    Figures of the cycles they complete go into `found`, shape (at least len(log), FIGURES);
    returns how many there are.
    """
    count = 0
    for i in range(len(log)):
        if take_row(log[i], rows, hand, stroke, found[count]):
            count += 1
    return count


@entry
def judge(state, table, par, cycle_end, cycle_period, cycle_regime, last_switch, opened):
    """
    What a machine is doing, as a regime.

    Given the end, s, the period, s, and the regime of its last whole cycle (period 0: none yet),
    the instant of the last switch, s, and whether it has ever opened. On the seat with the pump
    running the last regime goes on, however slow the build-up is.
    """
    stage = int(state[STAGE])
    if stage == CLOSED and par[PUMP_FLOW] == 0.0:
        return NO_OPENING
    before = STARTING if opened else NO_OPENING
    if cycle_period > 0.0:
        before = cycle_regime
    if stage == CLOSED or moves_on(state, par, cycle_end, cycle_period, last_switch):
        return before
    return HELD_OPEN if held_by_flow(state, table, par) else HOVERING


@inner
def moves_on(state, par, cycle_end, cycle_period, last_switch):
    """Whether a plunger off its seat is still on its way, or was until a moment ago."""
    if state[STAGE] < CATCH_UP + 1 and par[PUMP_FLOW] > 0.0:
        return True  # no slot is open: what the pump delivers must move it
    patience = max(PATIENCE * cycle_period, SHORTEST_PATIENCE)
    if state[TIME] - max(cycle_end, last_switch) <= patience:
        return True
    return cycle_period == 0.0 and abs(state[V]) > AT_REST * par[STROKE] / SHORTEST_PATIENCE


@inner
def held_by_flow(state, table, par):
    """Whether it is the pump's flow that keeps a resting plunger off its seat."""
    row = table[OPEN]
    springs = row[KS] * par[STROKE] - row[FORCE0] - row[AREA] * par[DRAIN]
    if par[PUMP_FLOW] <= 0.0 or springs <= 0.0:
        return False
    critical = par[ORIFICE] * par[STROKE] * math.sqrt(springs / row[AREA])
    return state[STAGE] == OPEN or par[PUMP_FLOW] >= critical
