"""
What the slotted spring bears, by the geometry of (21): stress, room in its slots, buckling.

The paper has none of this. Arguments are floats or arrays, SI.
"""
import math

import numpy as np

from .equations import slotted_spring_stiffness

POISSON = 0.28  # steel
TORSION = 0.1406  # J/a⁴ of a square section
TORSION_STRESS = 0.208  # T/(tau*a³) of a square section
FIXED_ENDS = 0.5  # effective length over length: both ends are held, by housing and plunger


def jumper_edge(stiffness, rings, mean_radius, youngs_modulus=2.15e11):
    """
    Return the edge a, m, with which (21) gives this stiffness k1, N/m.

    rings n, 1; mean_radius R, m; youngs_modulus E, Pa.
    """
    unit = slotted_spring_stiffness(1.0, rings, mean_radius, youngs_modulus)
    return (stiffness / unit) ** 0.25


def greatest_stress(force, edge, mean_radius, poisson=POISSON):
    """
    Equivalent stress (von Mises) in the rings at a jumper, Pa, under the spring's `force` P, N.

    edge a and mean_radius R, m. By the ring of docs/model.md, under "n counts rings": between
    jumpers M = x*(cos phi - sin phi), T = x*(sin phi + cos phi) - P*R/4, and the energy is least
    at x = P*R/4/((pi/4 - 1/2)*G*J/(E*I) + pi/4 + 1/2). The greatest moment is M = x at the jumper,
    with T = x - P*R/4; bending stress 6*M/a³ and shear T/(0.208*a³) are taken together, though they
    peak in the middle of different sides. No notch factor: fillets decide on that.
    """
    ratio = 12.0 * TORSION / (2.0 * (1.0 + poisson))  # G*J/(E*I)
    quarter = force * mean_radius / 4.0
    moment = quarter / ((math.pi / 4.0 - 0.5) * ratio + math.pi / 4.0 + 0.5)
    bending = 6.0 * moment / edge ** 3
    shear = (moment - quarter) / (TORSION_STRESS * edge ** 3)
    return np.sqrt(bending ** 2 + 3.0 * shear ** 2)


def slot_room(deflection, edge, rings):
    """
    Room of the slots over the spring's `deflection`: below 1 they would close. 1.

    deflection y01 + h_b, m; edge a, m, is also the height of each of the n + 1 slots, by (4).
    """
    return (rings + 1.0) * edge / deflection


def buckling_room(deflection, edge, rings, mean_radius, poisson=POISSON):
    """
    Deflection at which the spring would buckle over its `deflection` y01 + h_b, 1; inf: never.

    edge a and mean_radius R, m; rings n, 1. Its free length by (4) is (2*n + 4)*a. Taken as a
    helical spring of that length and of diameter 2*R with both ends held (Haringx): an estimate,
    for a slotted spring is stiffer sideways.
    """
    shear = 1.0 / (2.0 * (1.0 + poisson))  # G/E
    length = (2.0 * rings + 4.0) * edge
    slenderness = FIXED_ENDS * length / (2.0 * mean_radius)
    inside = 1.0 - (2.0 * math.pi ** 2 * (1.0 - shear) / (2.0 * shear + 1.0)) / slenderness ** 2
    critical = length / (2.0 * (1.0 - shear)) * (1.0 - np.sqrt(np.maximum(inside, 0.0)))
    return np.where(inside < 0.0, np.inf, critical / deflection)
