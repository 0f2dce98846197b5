"""Times of the cycle: (6), (7)."""
import numpy as np


def cycle_period(pressure_times, plunger_times, sleeve_times, tolerance=1e-6):
    """
    (6) T = t_H + t_BT + t_rT + t_HT = t_kn + t_kb + t_RS + t_kh = the same of the sleeve, s.

    Each argument holds the four times of one row, s, in the paper's order: shape (4,), or
    (4, cycles) for several cycles at once. Returns the period, shape () or (cycles,). Raises
    ValueError where a time is negative, or the rows differ by more than `tolerance` of the period.

    pressure_times: t_H from p2 rising to the maximum, t_BT maximum to p2, t_rT p2 to the minimum,
    t_HT minimum to p2. plunger_times: forward t_kn, dwell t_kb, return t_RS, seat t_kh.
    sleeve_times: t'_kn from y = 0.1*h_b to the stop, dwell, return, rest on the seat t'_kh.

    Valid for one steady cycle. Print: says t_knp = h_b - h_s, a length; the time by which the
    sleeve starts after the plunger runs until y = 0.1*h_b, by intervals 1)-4) under (25).
    """
    rows = np.array([pressure_times, plunger_times, sleeve_times], dtype=float)
    if (rows < 0.0).any():
        raise ValueError(f'a time of the cycle is negative: {rows.min():g} s')
    sums = rows.sum(axis=1)
    spread = np.max(np.ptp(sums, axis=0) / np.min(sums, axis=0))
    if not spread <= tolerance:
        raise ValueError(f'the rows of (6) differ by {spread:.3g} of the period, allowed are '
                         f'{tolerance:.3g}: sums of pressure, plunger, sleeve {sums.tolist()} s')
    return sums[1]


def sleeve_rest_time(seat_time, forward_time, sleeve_forward_time):
    """
    (6) t'_kh = t_kh + t_kn - t'_kn: time the valve sleeve rests on its seat in a cycle, s.

    seat_time t_kh, forward_time t_kn and sleeve_forward_time t'_kn, s. The sleeve lands with the
    plunger and leaves later, when the plunger is at 0.1*h_b.
    """
    return seat_time + forward_time - sleeve_forward_time


def build_up_time(volume, pressure_rise, bulk_modulus, pump_flow):
    """
    (7) t_H = W0*dp/(kappa*Q_H): time in which the pump raises the pressure of the cavity, s.

    volume W0, m³; pressure_rise dp, Pa; bulk_modulus kappa, Pa; pump_flow Q_H, m³/s, above 0.

    Valid while plunger and valve are shut, W0 and kappa constant, no leak: exact then for the dp
    really swept. The paper's dp = p1 - p2 falls short of it, because the pressure goes on falling
    on the return stroke, far below p2: the build-up of the base design takes 19 % longer.
    """
    return volume * pressure_rise / (bulk_modulus * pump_flow)
