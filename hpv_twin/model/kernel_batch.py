"""
Compiled: one design after another, from rest to its settled motion, and the figures of that.

The integrator, the search for cycles and the names of regimes are those of a single simulation.
"""
from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from .compiling import entry, inner
from .kernel import (
    A1,
    A2,
    ACCOUNT_SIZE,
    ACCOUNTED,
    F_T,
    LAST_SWITCH,
    M1,
    M2,
    PARAMETERS,
    PUMP_FLOW,
    PUMP_WORK,
    RETURN_P,
    RISE_TIME,
    ROW_AFTER,
    ROW_BEFORE,
    ROW_SIZE,
    ROW_TIME,
    SAMPLE_SIZE,
    STATE_SIZE,
    STEEPEST_FALL,
    STEEPEST_RISE,
    STROKE,
    SWITCHES_AT_ONCE,
    TABLE,
    TIME,
    WORKSPACE,
    Y01,
    exact_start,
    exact_step,
    fill_parameters,
    fill_stages,
)
from .kernel_cycles import (
    ANCHOR,
    BUILD_UP,
    CYCLE_STROKE,
    DWELL,
    FIGURES,
    FORWARD,
    HELD_OPEN,
    LOWEST,
    NO_OPENING,
    NONE,
    OFF_SEAT,
    OPENING,
    PEAK,
    PERIOD,
    PHASE_LAG,
    REGIME,
    RETURN_STROKE,
    RETURNING,
    ROOM,
    ROWS,
    SEAT_SPEED,
    SEATED,
    START,
    STARTING,
    STOP_SPEED,
    judge,
    take_row,
)

# Beside the regimes of a simulation: no such machine, and one with which the model cannot go on.
IMPOSSIBLE, CHATTERS = 8, 9
# Figures of a design, in the order of batch.COMPILED. The first are means over the cycles
# measured, of these figures of a cycle.
MEANS = np.array([PERIOD, CYCLE_STROKE, OPENING, RETURNING, BUILD_UP, FORWARD, DWELL,
                  RETURN_STROKE, PHASE_LAG])
(D_IMPACT, D_SEAT, D_PEAK, D_LOWEST, D_SPREAD, D_INPUT, D_RATE, D_SETTLED,
 D_REGIME) = range(len(MEANS), len(MEANS) + 9)
DESIGN_FIGURES = len(MEANS) + 9
# Successive cycles are alike when their periods and strokes differ by no more than this share.
ALIKE = 1e-9
LONGEST_SETTLING = 300  # cycles; what has not settled by then is measured as it is
MOST_STEPS = 100_000  # switches and series on the way to a whole cycle; far more than any needs
FAR = 1e9  # s of model time: nothing goes on so long
# Three cycles in hand: the last one, the one before it, one that may be none.
LAST, BEFORE, PERHAPS = range(3)
# What is known of the motion: end of the last whole cycle, s, how many there were, instant of the
# last switch, s, and whether the valve has ever opened.
CYCLE_END, FOUND, SWITCHED, OPENED = range(4)


class Lanes(NamedTuple):
    """Room in which designs are worked off one after the other, of each kind one per lane."""

    state: np.ndarray
    table: np.ndarray
    par: np.ndarray
    store: np.ndarray
    log: np.ndarray
    rows: np.ndarray
    hand: np.ndarray
    cycle: np.ndarray
    known: np.ndarray
    account: np.ndarray
    no_account: np.ndarray
    no_samples: np.ndarray

    @classmethod
    def make(cls, count: int) -> Lanes:
        """Return room for `count` lanes, 130 kB each."""
        shapes = ((STATE_SIZE,), TABLE, (PARAMETERS,), WORKSPACE, (4 * SWITCHES_AT_ONCE, ROW_SIZE),
                  (ROOM, ROW_SIZE), (2,), (3, FIGURES), (4,), (ACCOUNT_SIZE,), (0,),
                  (SAMPLE_SIZE, 0))
        return cls(*(np.zeros((count, *shape)) for shape in shapes))


@inner
def copy_into(values, into):
    """Copy a row, element by element: slices would need what is compiled out."""
    for k in range(len(values)):
        into[k] = values[k]


@inner
def start_design(con, state, table, par, log, hand, known):
    """Put a machine to rest and let it begin. Returns rows of the log used, -1 for chatter."""
    fill_parameters(con, par)
    fill_stages(con, con[Y01], con[F_T], table)
    state[:] = 0.0
    state[LAST_SWITCH] = -1.0
    state[RETURN_P] = state[RISE_TIME] = math.nan
    hand[ROWS], hand[ANCHOR] = 0.0, NONE
    known[:] = 0.0
    return exact_start(state, table, par, log)


@inner
def take_log(log, used, rows, hand, stroke, cycle, known):
    """Take in the rows of a step; returns whether they complete a cycle (no step completes two)."""
    found = False
    for i in range(used):
        known[OPENED] = 1.0
        if log[i, ROW_BEFORE] != log[i, ROW_AFTER]:
            known[SWITCHED] = log[i, ROW_TIME]
        if take_row(log[i], rows, hand, stroke, cycle[PERHAPS]):
            found = True
            copy_into(cycle[LAST], cycle[BEFORE])
            copy_into(cycle[PERHAPS], cycle[LAST])
            known[FOUND] += 1.0
            known[CYCLE_END] = cycle[LAST, START] + cycle[LAST, PERIOD]
    return found


@inner
def regime_now(state, table, par, cycle, known):
    """What the machine is doing, as `judge` has it, from what is known of the motion."""
    period, regime = 0.0, STARTING
    if known[FOUND] > 0.0:
        period, regime = cycle[LAST, PERIOD], int(cycle[LAST, REGIME])
    return judge(state, table, par, known[CYCLE_END], period, regime, known[SWITCHED],
                 known[OPENED] > 0.0)


@inner
def next_cycle(state, table, par, store, log, used, rows, hand, cycle, known, account, samples):
    """
    Go on to the end of the next whole cycle, the first `used` rows of the log to be taken in first.

    Returns -1 with the cycle in hand, or the regime of a machine that makes none.
    """
    regime = STARTING
    for _ in range(MOST_STEPS):
        if take_log(log, used, rows, hand, par[STROKE], cycle, known):
            return -1
        regime = regime_now(state, table, par, cycle, known)
        still = regime >= HELD_OPEN or (regime == NO_OPENING and par[PUMP_FLOW] == 0.0)
        if still or state[TIME] >= FAR:
            return regime
        _, used = exact_step(state, table, par, FAR, store, 0, 1.0, samples, 0, log, 0, account)
        if used < 0:
            return CHATTERS
    return regime


@inner
def alike(cycle):
    """Whether the last two cycles are the same."""
    return (cycle[LAST, REGIME] == cycle[BEFORE, REGIME]
            and abs(cycle[LAST, PERIOD] - cycle[BEFORE, PERIOD]) <= ALIKE * cycle[LAST, PERIOD]
            and (abs(cycle[LAST, CYCLE_STROKE] - cycle[BEFORE, CYCLE_STROKE])
                 <= ALIKE * cycle[LAST, CYCLE_STROKE]))


@inner
def blow(mass, speed):
    """Kinetic energy of a blow, J; none where there was none."""
    return 0.5 * mass * speed * speed if speed > 0.0 else 0.0


@inner
def add_cycle(cycle, con, figures):
    """Let the figures of a design take in one more cycle."""
    for k in range(len(MEANS)):
        figures[k] += cycle[MEANS[k]]
    figures[D_IMPACT] += blow(con[M1] + con[M2], cycle[STOP_SPEED])
    figures[D_SEAT] += blow(con[M1], cycle[SEAT_SPEED])
    figures[D_PEAK] = max(figures[D_PEAK], cycle[PEAK])
    figures[D_LOWEST] = min(figures[D_LOWEST], cycle[LOWEST])


@inner
def measure_design(con, cycles, figures, state, table, par, store, log, rows, hand, cycle, known,
                   account, no_account, samples):
    """
    Run one design from rest until it has settled and then for `cycles` cycles.

    Returns its regime; the figures are to be used where that is an oscillation. Energy put in and
    rate of pressure are those of the first of the cycles, or of all when they are not alike.
    """
    if not con[A2] > con[A1]:
        return IMPOSSIBLE
    used = start_design(con, state, table, par, log, hand, known)
    if used < 0:
        return CHATTERS
    settled = False
    while not settled and known[FOUND] < LONGEST_SETTLING:
        regime = next_cycle(state, table, par, store, log, used, rows, hand, cycle, known,
                            no_account, samples)
        if regime >= 0:
            return regime
        used = 0
        settled = known[FOUND] > 1.0 and alike(cycle)
    figures[:] = 0.0
    figures[D_PEAK], figures[D_LOWEST] = -math.inf, math.inf
    shortest, longest = math.inf, 0.0
    account[:] = 0.0
    state[ACCOUNTED] = state[TIME]
    for n in range(cycles):
        ledger = account if n == 0 or not settled else no_account
        regime = next_cycle(state, table, par, store, log, 0, rows, hand, cycle, known, ledger,
                            samples)
        if regime >= 0:
            return regime
        add_cycle(cycle[LAST], con, figures)
        shortest, longest = min(shortest, cycle[LAST, PERIOD]), max(longest, cycle[LAST, PERIOD])
    for k in range(len(MEANS) + 2):
        figures[k] /= cycles
    figures[D_SPREAD] = (longest - shortest) / figures[0]
    figures[D_INPUT] = account[PUMP_WORK] / (1 if settled else cycles)
    figures[D_RATE] = max(account[STEEPEST_RISE], -account[STEEPEST_FALL])
    figures[D_SETTLED] = settled
    return int(cycle[LAST, REGIME])


@inner
def work_off(con, cycles, figures, lane, lanes, state, table, par, store, log, rows, hand, cycle,
             known, account, no_account, samples):
    """Measure every design of one lane: each `lanes`-th, so that hard ones are shared out."""
    for i in range(lane, len(con), lanes):
        regime = measure_design(con[i], cycles, figures[i], state[lane], table[lane], par[lane],
                                store[lane], log[lane], rows[lane], hand[lane], cycle[lane],
                                known[lane], account[lane], no_account[lane], samples[lane])
        if regime < SEATED or regime > OFF_SEAT:
            figures[i, :] = math.nan
        figures[i, D_REGIME] = regime


@entry(nogil=True)
def run_serial(con, cycles, figures, room):
    """Measure designs on this thread; needs no threading layer, and may run in several threads."""
    for lane in range(len(room[0])):
        work_off(con, cycles, figures, lane, len(room[0]), *room)


@entry(nogil=True, parallel=True)
def run_parallel(con, cycles, figures, room):
    """Measure designs on numba's threads, a lane each; not from two threads at once."""
    lanes = len(room[0])
    for lane in numba.prange(lanes):
        work_off(con, cycles, figures, lane, lanes, *room)
