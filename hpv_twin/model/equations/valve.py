"""Pressures of the two sealing stages, moving masses and the slotted spring: (1)-(5), (21)."""
import math


def opening_pressure(spring_stiffness, preload, load, seat_area, twisted_stiffness=0.0,
                     twisted_preload=0.0, drain_pressure=0.0):
    """
    (1) p1 = p_dp + (k1*y01 + F_T - k2*y02)/A1: pressure at which the plunger lifts, Pa gauge.

    spring_stiffness k1 and twisted_stiffness k2, N/m; preload y01 and twisted_preload y02, m;
    load F_T, N, a pull is negative; seat_area A1, m², above 0; drain_pressure p_dp, Pa gauge.

    Valid for a plunger at rest on its seat and slow enough a rise: the line's dashpot lowers it by
    c0*Q_H*(A1/A0)^(1/2)/A1², 0.3 Pa in the base design.
    Print: without k2*y02, the default here. The sign of (23) and (29)-(31) makes the twisted
    spring help the plunger; in the base design that is 0.42 MPa of 13.3 MPa.
    """
    spring = spring_stiffness * preload - twisted_stiffness * twisted_preload
    return drain_pressure + (spring + load) / seat_area


def seat_contact_pressure(twisted_stiffness, twisted_preload, sleeve_seat_diameter):
    """
    (2) p_c = 4*k2*y02/(pi*d2²): pressure with which the valve sleeve seals at rest, Pa.

    twisted_stiffness k2, N/m; twisted_preload y02, m; sleeve_seat_diameter d2, m, above 0.

    Valid at rest: the force of the spring spread over the circle d2, not over the chamfer's ring.
    Print: the approximation 1.274*k2*y02 has lost the division by d2²; and 4/pi is 1.273.
    """
    return 4.0 * twisted_stiffness * twisted_preload / (math.pi * sleeve_seat_diameter ** 2)


def return_pressure(spring_stiffness, preload, stroke, load, sleeve_seat_area,
                    drain_pressure=0.0):
    """
    (3) p2 = p_dp + (k1*(y01 + h_b) + F_T)/A2: where the return stroke starts, Pa gauge.

    spring_stiffness k1, N/m; preload y01 and stroke h_b, m; load F_T, N, signed;
    sleeve_seat_area A2, m², above 0; drain_pressure p_dp, Pa gauge.

    Valid for a plunger at rest at full stroke, F_T the load at that moment; the line's dashpot is
    neglected. With (1): p2 = p1*(d1/d2)² + k1*h_b/A2 for a constant load and k2 = 0.
    Print: adds F_Tmax to an F_T0 that p1 already holds, and k2*(y02 + h_s), which the text under
    (23) neglects above h_s: 0.08 MPa too much in the base design.
    """
    return drain_pressure + (spring_stiffness * (preload + stroke) + load) / sleeve_seat_area


def slotted_spring_mass(jumper_edge, rings, mean_radius, density):
    """
    (4) m13 = rho*(2*pi*R*n*a² + 2*a³*(n + 1) + 6*pi*R*a²): mass of the slotted spring, kg.

    jumper_edge a and mean_radius R, m; rings n, 1; density rho of its material, kg/m³.
    The terms: n rings of section a*a, two jumpers a*a*a in each of n + 1 slots, and two end rings
    together 3a high.

    Valid for a well below R.
    Print: the last term has a for a²: no volume. n is called the number of jumpers; by this
    equation and (21) it counts the rings between the slots.
    """
    edge_squared = jumper_edge ** 2
    circumference = 2.0 * math.pi * mean_radius
    volume = (circumference * rings * edge_squared + 2.0 * jumper_edge ** 3 * (rings + 1)
              + 3.0 * circumference * edge_squared)
    return density * volume


def plunger_mass(mass_without_spring, spring_mass):
    """
    (4) m1 = m8 + m13: moving mass of the plunger, kg.

    mass_without_spring m8 and spring_mass m13, kg.

    Valid as the paper's simplification: the spring's whole mass is counted. A spring held at one
    end moves with a third of it (Rayleigh), so m1 is on the heavy side.
    """
    return mass_without_spring + spring_mass


def sleeve_mass(*parts):
    """
    (5) m2 = m9 + m10 + m11 + m12: moving mass of the valve sleeve, kg.

    parts: masses of sleeve, twisted spring, stepped sleeve and spring ring, kg, each a scalar or
    arrays of one shape.
    """
    return sum(parts)


def slotted_spring_stiffness(jumper_edge, rings, mean_radius, youngs_modulus=2.15e11):
    """
    (21) k1 = 1.035*E*a⁴/(n*R³): stiffness of the slotted spring, N/m.

    jumper_edge a and mean_radius R, m, above 0; rings n, 1, at least 1; youngs_modulus E, Pa (the
    paper's steel by default).

    Valid for a well below R: thin rings of section a*a on stiff jumpers of no width. Theory of
    curved bars then gives 1.026 for a Poisson ratio of 0.3 and 1.034 for 0.25: docs/model.md.
    """
    return 1.035 * youngs_modulus * jumper_edge ** 4 / (rings * mean_radius ** 3)
