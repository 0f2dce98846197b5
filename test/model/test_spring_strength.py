"""What the slotted spring bears, held against its own energy, by numbers."""
import math

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.optimize import minimize_scalar

from hpv_twin.model import equations
from hpv_twin.model.spring_strength import (
    POISSON,
    TORSION,
    TORSION_STRESS,
    buckling_room,
    greatest_stress,
    jumper_edge,
    slot_room,
)

EDGE, RINGS, RADIUS = 3.0e-3, 14.0, 0.022


def test_the_edge_gives_the_stiffness_back():
    stiffness = equations.slotted_spring_stiffness(EDGE, RINGS, RADIUS, 2.15e11)
    assert jumper_edge(stiffness, RINGS, RADIUS) == pytest.approx(EDGE, rel=1e-12)


def test_stress_is_that_of_the_ring_of_least_energy():
    """The redundant moment by minimising the energy numerically, not by the formula."""
    force, youngs = 1300.0, 2.15e11
    shear = youngs / (2.0 * (1.0 + POISSON))
    bending_stiffness, twist_stiffness = youngs * EDGE ** 4 / 12.0, shear * TORSION * EDGE ** 4
    phi = np.linspace(0.0, math.pi / 2.0, 4001)

    def energy(x):
        moment = x * (np.cos(phi) - np.sin(phi))
        torque = x * (np.sin(phi) + np.cos(phi)) - force * RADIUS / 4.0
        return trapezoid(moment ** 2 / bending_stiffness + torque ** 2 / twist_stiffness, phi)
    quarter = force * RADIUS / 4.0
    best = minimize_scalar(lambda k: energy(k * quarter), bounds=(0.0, 2.0), method='bounded',
                           options={'xatol': 1e-10}).x * quarter
    bending = 6.0 * best / EDGE ** 3
    torsion = (best - quarter) / (TORSION_STRESS * EDGE ** 3)
    assert greatest_stress(force, EDGE, RADIUS) == pytest.approx(
        math.hypot(bending, math.sqrt(3.0) * torsion), rel=1e-5)
    assert greatest_stress(2.0 * force, EDGE, RADIUS) == pytest.approx(
        2.0 * greatest_stress(force, EDGE, RADIUS))


def test_room_in_the_slots_is_their_height_over_the_deflection():
    assert slot_room(9e-3, EDGE, RINGS) == pytest.approx(15.0 * EDGE / 9e-3)


def test_buckling_grows_near_with_length_and_never_comes_for_a_short_spring():
    rooms = [float(buckling_room(5e-3, EDGE, rings, 0.01)) for rings in (4.0, 20.0, 40.0, 80.0)]
    assert rooms[0] == math.inf
    assert rooms[1] >= rooms[2] > rooms[3] or rooms[1] == math.inf
