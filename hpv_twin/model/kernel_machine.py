"""
Compiled: the machine itself, as a table of stages, and its equations.

One cycle passes through seven *stages*: the rows of the phase table. In a stage every term of
(22)-(25) is linear in the pressure p and the plunger's position y and velocity v, but for the root
in the slot's flow; all that changes from stage to stage is a handful of constants. `fill_stages`
is therefore the one place where the machine is written down, and `flow_balance` with `net_force`
are the equations.
"""
import math

import numpy as np

from .compiling import entry, inner
from .kernel_layout import (
    AREA, CATCH_UP, CLOSED, DISPLACED, DRAIN, FLOW, FORCE0, FRICTION, GAP, HIGH, KS, LIFT, LOW,
    MASS, NEVER, OPEN, ORIFICE, PARAMETERS, PICK_UP, PUMP_FLOW, RETURN_HIGH, RETURN_LOW, S0, S1,
    SLEEVE_RATIO, SLEEVE_SPRING, SLEEVE_SPRING_FORCE, SLOT, STIFFNESS, STROKE, TABLE,
)


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
