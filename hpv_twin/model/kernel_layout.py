"""What stands where in the arrays of the compiled code: stages, parameters, state, log, samples."""
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
