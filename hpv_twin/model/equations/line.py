"""The hydraulic link: a column of oil as a Kelvin-Voigt body, (8)-(20)."""
import math

import numpy as np


def line_length(lengths):
    """
    (9) L0 = sum(l_i): length of the averaged hydraulic line, m.

    lengths l_i of the line's parts, m, shape (parts,) or (parts, designs); result () or (designs,).

    Valid for lines short against a wave: L0 well below sqrt(kappa/rho)/f, 8.5 m at 150 Hz.
    """
    return np.sum(lengths, axis=0)


def line_area(areas, lengths):
    """
    (8) A0 = sum(A_i*l_i)/L0: section of the averaged hydraulic line, m².

    areas A_i, m², and lengths l_i, m, of the line's parts, shape (parts,) or (parts, designs);
    result () or (designs,). With W0 for the sum it is A0 = W0/L0.
    """
    return np.sum(np.multiply(areas, lengths), axis=0) / line_length(lengths)


def compression_pressure(bulk_modulus, strain):
    """
    (10) p - p_dp = kappa*eps_W: pressure of the compressed oil above the drain's, Pa.

    bulk_modulus kappa, Pa; strain eps_W, 1, see volumetric_strain.

    Valid for small strains of oil with an effective, constant bulk modulus (1 % at 14 MPa).
    """
    return bulk_modulus * strain


def compressed_volume(line_area, deformation):
    """(11) dW = A0*x0r: volume gained by compression, m³; line_area A0, m²; deformation x0r, m."""
    return line_area * deformation


def volumetric_strain(line_area, deformation, volume):
    """
    (12) eps_W = A0*x0r/W0: relative compression of the oil, 1.

    line_area A0, m²; deformation x0r, m; volume W0, m³, above 0. With W0 = A0*L0 it is x0r/L0.
    """
    return line_area * deformation / volume


def line_stiffness(bulk_modulus, line_area, volume):
    """
    (13) k0r = kappa*A0²/W0: stiffness of the oil column, N/m.

    bulk_modulus kappa, Pa; line_area A0, m²; volume W0, m³, above 0. With W0 = A0*L0 it is
    kappa*A0/L0.

    Valid while the volumes that the moving links sweep are small against W0.
    """
    return bulk_modulus * line_area ** 2 / volume


def line_pressure(line_stiffness, deformation, line_area, drain_pressure=0.0):
    """
    (14) p = p_dp + k0r*x0r/A0: pressure of the cavity, Pa gauge.

    line_stiffness k0r, N/m; deformation x0r, m; line_area A0, m², above 0; drain_pressure p_dp, Pa
    gauge, which (14) neglects and (10) has. x0r is what is left after the moving links have taken
    their share (net): see excitation for the other way of counting.
    """
    return drain_pressure + line_stiffness * deformation / line_area


def line_deformation(pressure, line_area, line_stiffness, drain_pressure=0.0):
    """
    (14) solved for x0r = (p - p_dp)*A0/k0r, m; so x01 and x02 under (23) from p1 and p2.

    pressure p and drain_pressure p_dp, Pa gauge; line_area A0, m²; line_stiffness k0r, N/m, not 0.

    Print: x02 = x01*sqrt(U21)/k0r under (23) is no length; without the k0r it is p2 = p1*(d1/d2)²,
    which leaves out the k1*h_b/A2 of (3).
    """
    return (pressure - drain_pressure) * line_area / line_stiffness


def transfer_ratio(area, line_area):
    """
    (15) U0i = (A_i/A0)²: transfer ratio from the hydraulic line to a moving link, 1.

    area A_i of the link and line_area A0, m², above 0. Between the sealing stages (under (23)):
    U21 = transfer_ratio(A1, A2) = (d1/d2)⁴.
    """
    return (area / line_area) ** 2


def reduced_stiffness(transfer, line_stiffness):
    """
    (16) k0i = U0i*k0r: stiffness of the oil felt by a moving link, N/m; kappa*A_i²/W0.

    transfer U0i, 1; line_stiffness k0r, N/m.
    """
    return transfer * line_stiffness


def reduced_deformation(deformation, transfer):
    """
    (17) x_Ai = x0r/sqrt(U0i): deformation of the oil at a moving link, m.

    deformation x0r, m; transfer U0i, 1, above 0. The volume is the same: A_i*x_Ai = A0*x0r.
    """
    return deformation / np.sqrt(transfer)


def reduced_deformation_rate(deformation_rate, transfer):
    """
    (18) dx_Ai/dt = (dx0r/dt)/sqrt(U0i): rate of deformation at a moving link, m/s.

    deformation_rate dx0r/dt, m/s; transfer U0i, 1, above 0 and constant in time.
    """
    return reduced_deformation(deformation_rate, transfer)


def hydraulic_diameter(line_area):
    """Under (19), d0 = 2*sqrt(A0/pi): diameter of the averaged line, m; line_area A0, m²."""
    return 2.0 * np.sqrt(line_area / math.pi)


def line_damping(dynamic_viscosity, line_area, line_length):
    """
    (19) c0 = mu*A0/L0 = pi*mu*d0²/(4*L0): dashpot of the oil column, N s/m.

    dynamic_viscosity mu, Pa s; line_area A0, m²; line_length L0, m, above 0.

    Valid as an order of magnitude: the viscous twin of k0r = kappa*A0/L0. It is about 1e-5 N s/m,
    without effect; a real c0 has to be identified from measurements.
    Print: pi*mu*d0²/4, in N s: the length is missing.
    """
    return dynamic_viscosity * line_area / line_length


def line_drag(line_damping, deformation_rate):
    """
    (19) F_A0 = c0*dx0r/dt: drag of the oil column, N.

    line_damping c0, N s/m; deformation_rate dx0r/dt, m/s.
    """
    return line_damping * deformation_rate


def reduced_drag(line_damping, transfer, reduced_rate, velocity):
    """
    (20) F_Ai = U0i^(1/4)*c0*(dx_Ai/dt - dy/dt): force of the line's dashpot on a moving link, N.

    line_damping c0, N s/m; transfer U0i, 1; reduced_rate dx_Ai/dt by (18), of the deformation
    before displacement, m/s; velocity dy/dt of the link, m/s, positive where it relieves the oil.
    It pushes the link as the pressure does: beside k0i*(x_Ai - y) with the same sign.

    Print: (22) subtracts it, which would drive the motion instead of damping it.
    The fourth root, d_i/d0, is kept as printed; see docs/model.md for what power would ask for.
    """
    return transfer ** 0.25 * line_damping * (reduced_rate - velocity)
