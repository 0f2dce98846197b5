"""Total stiffness of plunger and hydraulic link: (34)-(39)."""


def stiffness_ratio(twisted_stiffness, spring_stiffness):
    """Under (30), delta = k2/k1, 1; twisted_stiffness k2, N/m; spring_stiffness k1, N/m, not 0."""
    return twisted_stiffness / spring_stiffness


def total_stiffness(transfer, line_stiffness, spring_stiffness, stiffness_ratio=0.0):
    """
    (34) k_Sigma = m*omega_Sigma² = U*k0r + (1 + delta)*k1, N/m; (35) is this for delta = 0.

    transfer U, 1; line_stiffness k0r and spring_stiffness k1, N/m; stiffness_ratio delta, 1.

    Valid with the valve shut, see eigenfrequency; (35) for delta well below 1 (0.04 in the base
    design).
    """
    return transfer * line_stiffness + (1.0 + stiffness_ratio) * spring_stiffness


def least_total_stiffness(seat_diameter, hydraulic_diameter, line_stiffness, spring_stiffness):
    """
    (36) k_Sigma,min = (d1/d0)⁴*k0r + k1, N/m: the oil acts on the first sealing stage.

    seat_diameter d1 and hydraulic_diameter d0, m, above 0; line_stiffness k0r and
    spring_stiffness k1, N/m. Valid as (35).
    """
    return (seat_diameter / hydraulic_diameter) ** 4 * line_stiffness + spring_stiffness


def greatest_total_stiffness(sleeve_seat_diameter, hydraulic_diameter, line_stiffness,
                             spring_stiffness):
    """
    (37) k_Sigma,max = (d2/d0)⁴*k0r + k1, N/m: the oil acts on the second sealing stage.

    sleeve_seat_diameter d2 and hydraulic_diameter d0, m, above 0; line_stiffness k0r and
    spring_stiffness k1, N/m. Valid as (35).

    Print: U02*k0r + k2 = (d1/d0)⁴*k0r + k1, with k2 for k1 and d1 for d2: equal to (36), while
    (38) needs their difference.
    """
    return least_total_stiffness(sleeve_seat_diameter, hydraulic_diameter, line_stiffness,
                                 spring_stiffness)


def stiffness_span(bulk_modulus, seat_area, sleeve_seat_area, volume):
    """
    (38) k_Sigma,max - k_Sigma,min = kappa*(A2² - A1²)/W0, N/m.

    bulk_modulus kappa, Pa; seat_area A1 and sleeve_seat_area A2, m²; volume W0, m³, above 0.
    """
    return bulk_modulus * (sleeve_seat_area ** 2 - seat_area ** 2) / volume


def relative_stiffness_span(seat_area, sleeve_seat_area, line_area):
    """
    (39) delta_kSigma = (k_Sigma,max - k_Sigma,min)/k0r = (A2² - A1²)/A0², 1.

    seat_area A1, sleeve_seat_area A2 and line_area A0, m², A0 above 0. Relative to the stiffness
    k0r of the oil column, not to k_Sigma: so geometry alone fixes it.
    """
    return (sleeve_seat_area ** 2 - seat_area ** 2) / line_area ** 2
