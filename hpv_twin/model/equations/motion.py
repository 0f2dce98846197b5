"""
The equations of motion as a driven oscillator: (29)-(33) and their frequencies.

They say the same as (22), (23), and so as the simulation, if the deformation X of the hydraulic
link is counted *before* the displacement of the plunger: X = x0r + sqrt(U)*y with x0r =
(p - p_dp)*A0/k0r the net deformation of (14). The oil's stiffness U*k0r then acts on y, and X is
what drives the plunger. U, the mass m (m1 or m1 + m2) and delta (0 where the twisted spring does
not act on the plunger: from h_s on, and on the whole return stroke) are constant over one stage
of the cycle, in which alone these equations hold.
"""
import numpy as np


def partial_frequency(stiffness, mass):
    """
    Partial circular frequency under (30), sqrt(k/m), rad/s: omega_p of k0r, omega_01 of k1.

    stiffness, N/m; mass m1 or m1 + m2, kg, above 0.
    """
    return np.sqrt(stiffness / mass)


def sleeve_partial_frequency(spring_frequency, stiffness_ratio):
    """
    Under (30), omega_02 = sqrt(k2/m) = omega_01*sqrt(delta), rad/s.

    spring_frequency omega_01, rad/s; stiffness_ratio delta = k2/k1, 1.
    Print: omega_02 = sqrt(delta), which is no frequency.
    """
    return spring_frequency * np.sqrt(stiffness_ratio)


def eigenfrequency(transfer, line_frequency, spring_frequency, stiffness_ratio=0.0):
    """
    Under (30), omega_Sigma = sqrt(U*omega_p² + (1 + delta)*omega_01²), rad/s, of either stroke.

    transfer U, 1; line_frequency omega_p and spring_frequency omega_01, rad/s; stiffness_ratio
    delta = k2/k1, 1, 0 where the twisted spring does not act.

    Valid with the valve shut: an open slot lets the pressure escape and the oil's stiffness goes.
    """
    return np.sqrt(transfer * line_frequency ** 2 + (1.0 + stiffness_ratio) * spring_frequency ** 2)


def damping_coefficient(viscous_friction, line_damping, transfer, mass):
    """
    Under (30), beta = (c1 + c0*U^(1/4))/(2*m), 1/s, of either stroke.

    viscous_friction c1 and line_damping c0, N s/m; transfer U, 1; mass m, kg, above 0.

    Print: c0*sqrt(U)*(x_A/y - 1) in place of c0*U^(1/4): it divides by a displacement that is 0
    on the seat. The part of the dashpot's force with dx_A/dt belongs on the right, see excitation.
    """
    return (viscous_friction + line_damping * transfer ** 0.25) / (2.0 * mass)


def excitation(deformation, deformation_rate, transfer, line_frequency, mass, line_damping=0.0):
    """
    Right side of (29)-(33): omega_p²*sqrt(U)*X + c0*U^(-1/4)*(dX/dt)/m, m/s².

    deformation X = x0r + sqrt(U)*y before displacement, m, and deformation_rate dX/dt, m/s;
    transfer U, 1, above 0; line_frequency omega_p, rad/s; mass m, kg; line_damping c0, N s/m.

    Print: x0r for X, with which A*y counts twice; the second term hides in beta.
    """
    return (line_frequency ** 2 * np.sqrt(transfer) * deformation
            + line_damping * transfer ** -0.25 * deformation_rate / mass)


def forward_free_term(spring_frequency, preload, mass, load=0.0, stiffness_ratio=0.0,
                      twisted_preload=0.0):
    """
    Free term of (29): omega_01²*(y01 - delta*y02) + F_T/m, m/s².

    spring_frequency omega_01, rad/s; preload y01 and twisted_preload y02, m; mass m, kg; load F_T,
    N, signed; stiffness_ratio delta, 1, 0 from h_s on.
    """
    return spring_frequency ** 2 * (preload - stiffness_ratio * twisted_preload) + load / mass


def return_free_term(spring_frequency, preload, stroke, mass, transfer, line_frequency, load=0.0,
                     stiffness_ratio=0.0, twisted_preload=0.0):
    """
    Free term of (30): -omega_01²*(y01 + h_b - delta*(y02 - h_b)) - F_T/m - U*omega_p²*h_b, m/s².

    spring_frequency omega_01 and line_frequency omega_p, rad/s; preload y01, stroke h_b and
    twisted_preload y02, m; mass m, kg; transfer U, 1; load F_T, N, signed; stiffness_ratio delta,
    1, 0 in the simulation: the sleeve rides with the plunger.

    Print: + for both signs and without U*omega_p²*h_b, against (23) divided by m; and y02 for
    y02 - h_b, against y = h_b - y_rev.
    """
    return (-spring_frequency ** 2 * (preload + stroke
                                      - stiffness_ratio * (twisted_preload - stroke))
            - load / mass - transfer * line_frequency ** 2 * stroke)


def forward_acceleration(position, velocity, damping, frequency, free_term, drive):
    """
    (29) y'' = -2*beta*y' - omega_Sigma²*y - free + drive, m/s²: forward stroke.

    position y, m, from the seat; velocity y', m/s; damping beta, 1/s; frequency omega_Sigma,
    rad/s; free_term by forward_free_term and drive by excitation, m/s².

    Print: a minus before the right side; (32) prints the plus.
    """
    return drive - 2.0 * damping * velocity - frequency ** 2 * position - free_term


def return_acceleration(position, velocity, damping, frequency, free_term, drive):
    """
    (30) y_rev'' = -2*beta*y_rev' - omega_Sigma²*y_rev - free - drive, m/s²: return stroke.

    position y_rev = h_b - y, m, counted down from full stroke; velocity y_rev', m/s; damping beta,
    1/s; frequency omega_Sigma, rad/s; free_term by return_free_term and drive by excitation, m/s².
    """
    return -drive - 2.0 * damping * velocity - frequency ** 2 * position - free_term


def dynamic_displacement(position, frequency, free_term):
    """
    (31) z = y + free/omega_Sigma²: displacement from the place of rest without drive, m.

    position y of the forward or y_rev of the return stroke, m; frequency omega_Sigma, rad/s, above
    0; free_term of that stroke, m/s². z' = y' and z'' = y''.

    Print: multiplies by omega_Sigma², and has + for the return stroke's negative free term.
    """
    return position + free_term / frequency ** 2


def forward_free_vibration(displacement, velocity, damping, frequency, drive):
    """
    (32) z'' = -2*beta*z' - omega_Sigma²*z + drive, m/s²: forward stroke.

    displacement z, m, and velocity z', m/s, of (31); damping beta, 1/s; frequency omega_Sigma,
    rad/s; drive by excitation, m/s².
    """
    return drive - 2.0 * damping * velocity - frequency ** 2 * displacement


def return_free_vibration(displacement, velocity, damping, frequency, drive):
    """
    (33) z_rev'' = -2*beta*z_rev' - omega_Sigma²*z_rev - drive, m/s²: return stroke.

    displacement z_rev, m, and velocity z_rev', m/s, of (31); damping beta, 1/s; frequency
    omega_Sigma, rad/s; drive by excitation, m/s². Print: U01(02) for U02(01), a slip of the index.
    """
    return -drive - 2.0 * damping * velocity - frequency ** 2 * displacement
