"""Equations of motion (29)-(33): by hand, and against the motion of (22)-(25) that is simulated."""
import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

from hpv_twin.model import Simulation, Vibrator, equations, kernel


def close(value, expected, rel=1e-12):
    return value == pytest.approx(expected, rel=rel, abs=0.0)


# (29)-(33): motion as a driven oscillator ---------------------------------------------------------


def test_frequencies_by_hand():
    assert close(equations.partial_frequency(2e5, 0.5), 632.4555320336759)
    assert close(equations.sleeve_partial_frequency(100.0, 0.04), 20.0)
    assert close(equations.eigenfrequency(0.09, 100.0, 50.0, 0.04), math.sqrt(3500.0))
    assert close(equations.eigenfrequency(0.09, 100.0, 0.0), 30.0)
    assert close(equations.eigenfrequency(0.0, 100.0, 50.0), 50.0)


def test_partial_frequency_of_the_sleeve_spring_is_that_of_k2():
    delta = equations.stiffness_ratio(1e4, 2.5e5)
    assert close(delta, 0.04)
    w_01 = equations.partial_frequency(2.5e5, 0.6)
    w_02 = equations.sleeve_partial_frequency(w_01, delta)
    assert close(w_02, equations.partial_frequency(1e4, 0.6))
    assert w_02 > 600.0 * math.sqrt(delta)  # print: omega_02 = sqrt(delta)


def test_damping_coefficient_by_hand_stays_finite_on_the_seat():
    assert close(equations.damping_coefficient(60.0, 16.0, 0.0625, 2.0), 17.0)
    with np.errstate(divide='ignore'):
        printed = np.float64(60.0) + 16.0 * math.sqrt(0.0625) * (np.float64(1e-3) / 0.0 - 1.0)
    assert np.isinf(printed)


def test_terms_of_29_to_33_by_hand():
    assert close(equations.excitation(0.01, 0.5, 0.0625, 100.0, 0.5, 16.0), 25.0 + 32.0)
    assert close(equations.excitation(0.01, 0.5, 0.0625, 100.0, 0.5), 25.0)
    assert close(equations.forward_free_term(100.0, 5e-3, 0.5), 50.0)
    assert close(equations.return_free_term(100.0, 5e-3, 2e-3, 0.5, 0.0625, 200.0), -75.0)
    assert close(equations.forward_free_term(100.0, 5e-3, 0.5, 50.0, 0.04, 5e-3), 48.0 + 100.0)
    assert close(equations.return_free_term(100.0, 5e-3, 2e-3, 0.5, 0.0625, 200.0, 50.0),
                 -(70.0 + 100.0 + 5.0))
    assert close(equations.return_free_term(100.0, 5e-3, 2e-3, 0.5, 0.0625, 200.0, 50.0, 0.5, 4e-3),
                 -(60.0 + 100.0 + 5.0))
    assert close(equations.forward_acceleration(1e-3, 0.2, 5.0, 100.0, 40.0, 60.0), 8.0)
    assert close(equations.return_acceleration(1e-3, 0.2, 5.0, 100.0, -140.0, 60.0), 68.0)
    assert close(equations.dynamic_displacement(1e-3, 100.0, 40.0), 5e-3)
    assert close(equations.forward_free_vibration(5e-3, 0.2, 5.0, 100.0, 60.0), 8.0)
    assert close(equations.return_free_vibration(-13e-3, 0.2, 5.0, 100.0, 60.0), 68.0)


# One design in which no term is too small to be missed.
FELT = Vibrator(line_damping=30.0, load=150.0, drain_pressure=2e5, viscous_friction=90.0,
                twisted_spring_stiffness=3e4)
#         stage: section, both masses move, twisted spring acts
STRETCHES = {'lift': (kernel.LIFT, 1, False, True),
             'catch-up': (kernel.CATCH_UP, 1, False, True),
             'slot': (kernel.SLOT, 2, True, False),
             'return high': (kernel.RETURN_HIGH, 2, True, False),
             'return low': (kernel.RETURN_LOW, 1, False, False)}


@pytest.fixture(scope='module')
def dense():
    return Simulation(FELT).advance(0.05, sample_rate=2e6)


def stretch(trace, name):
    """Samples of the last whole passage through a stage, and the constants of (29)-(33) there."""
    stage, section, both, twisted = STRETCHES[name]
    d, rows = trace.vibrator, trace.switches
    first = np.flatnonzero(rows['stage_after'][:-1] == stage)[-1]
    inside = ((trace.time > rows['time'][first] + 1e-8)
              & (trace.time < rows['time'][first + 1] - 1e-8))
    area = (d.plunger_seat_area, d.sleeve_seat_area)[section - 1]
    k0r = equations.line_stiffness(d.bulk_modulus, d.line_area, d.cavity_volume)
    delta = equations.stiffness_ratio(d.twisted_spring_stiffness, d.slotted_spring_stiffness)
    c = SimpleNamespace(d=d, delta=delta if twisted else 0.0,
                        mass=d.plunger_mass + (d.sleeve_mass if both else 0.0),
                        u=equations.transfer_ratio(area, d.line_area),
                        time=trace.time[inside], y=trace.plunger_position[inside],
                        v=trace.plunger_velocity[inside], pressure=trace.pressure[inside])
    c.net = equations.line_deformation(c.pressure, d.line_area, k0r, d.drain_pressure)
    c.w_p = equations.partial_frequency(k0r, c.mass)
    c.w_01 = equations.partial_frequency(d.slotted_spring_stiffness, c.mass)
    c.w = equations.eigenfrequency(c.u, c.w_p, c.w_01, c.delta)
    c.beta = equations.damping_coefficient(d.viscous_friction, d.line_damping, c.u, c.mass)
    c.returns = name.startswith('return')
    if c.returns:
        c.free = equations.return_free_term(c.w_01, d.preload, d.stroke, c.mass, c.u, c.w_p,
                                            d.load)
    else:
        c.free = equations.forward_free_term(c.w_01, d.preload, c.mass, d.load, c.delta,
                                             d.twisted_spring_preload)
    return c


def integrate(c, deformation, acceleration, start):
    """Solve q'' = acceleration(q, q', drive) from `start` on, driven by the deformation; q(t)."""
    spline = make_interp_spline(c.time, deformation, k=5)
    slope = spline.derivative()

    def rates(t, state):
        drive = equations.excitation(spline(t), slope(t), c.u, c.w_p, c.mass, c.d.line_damping)
        return state[1], acceleration(*state, drive)
    solution = solve_ivp(rates, (c.time[0], c.time[-1]), start, method='DOP853', t_eval=c.time,
                         rtol=1e-11, atol=1e-13)
    return solution.y[0]


def motion(c, deformation):
    """Integrate (29) or (30); returns y(t) counted from the seat."""
    if c.returns:
        q = integrate(c, deformation, lambda q, s, drive: equations.return_acceleration(
            q, s, c.beta, c.w, c.free, drive), (c.d.stroke - c.y[0], -c.v[0]))
        return c.d.stroke - q
    return integrate(c, deformation, lambda q, s, drive: equations.forward_acceleration(
        q, s, c.beta, c.w, c.free, drive), (c.y[0], c.v[0]))


def free_vibration(c, deformation):
    """Integrate (32) or (33) in z of (31); returns y(t) counted from the seat."""
    place, speed, law = c.y[0], c.v[0], equations.forward_free_vibration
    if c.returns:
        place, speed, law = c.d.stroke - c.y[0], -c.v[0], equations.return_free_vibration
    z = integrate(c, deformation, lambda q, s, drive: law(q, s, c.beta, c.w, drive),
                  (equations.dynamic_displacement(place, c.w, c.free), speed))
    # (31) is a shift: taken back by the shift of zero.
    q = z - equations.dynamic_displacement(0.0, c.w, c.free)
    return c.d.stroke - q if c.returns else q


@pytest.mark.parametrize('name', STRETCHES)
def test_29_and_30_give_the_motion_of_22_and_23(dense, name):
    c = stretch(dense, name)
    assert len(c.time) > 300 and np.ptp(c.y) > 0.09 * c.d.stroke
    assert np.abs(motion(c, c.net + np.sqrt(c.u) * c.y) - c.y).max() < 1e-9 * c.d.stroke


@pytest.mark.parametrize('name', STRETCHES)
def test_32_and_33_give_the_motion_of_22_and_23(dense, name):
    c = stretch(dense, name)
    assert np.abs(free_vibration(c, c.net + np.sqrt(c.u) * c.y) - c.y).max() < 1e-9 * c.d.stroke


@pytest.mark.parametrize('name', STRETCHES)
def test_29_and_30_with_the_net_deformation_count_the_displacement_twice(dense, name):
    c = stretch(dense, name)
    assert np.abs(motion(c, c.net) - c.y).max() > 1e-3 * c.d.stroke


def test_29_with_the_printed_sign_pulls_the_plunger_into_its_seat(dense):
    c = stretch(dense, 'lift')
    assert motion(c, -(c.net + np.sqrt(c.u) * c.y))[-1] < -c.d.stroke


def test_30_with_the_printed_signs_leaves_the_stop_upwards(dense):
    c = stretch(dense, 'return high')
    c.free = -c.free - c.u * c.w_p ** 2 * c.d.stroke
    assert motion(c, c.net + np.sqrt(c.u) * c.y)[-1] > 1.1 * c.d.stroke


def test_31_as_printed_is_no_displacement(dense):
    c = stretch(dense, 'lift')
    printed = c.y[0] + c.w ** 2 * c.free
    assert printed > 1e6  # metres, and more
    assert abs(equations.dynamic_displacement(c.y[0], c.w, c.free)) < 0.01


@pytest.mark.parametrize('name', STRETCHES)
def test_deformation_follows_24_and_25_with_the_slot_law_of_the_moment(dense, name):
    c = stretch(dense, name)
    d = c.d
    displaced = {'lift': d.plunger_seat_area,
                 'catch-up': d.plunger_seat_area + (d.sleeve_seat_area - d.plunger_seat_area)
                 * 0.4 / 0.3}.get(name, d.sleeve_seat_area)
    opening = {'slot': c.y - d.gap, 'return high': c.y, 'return low': c.y}.get(name, 0.0)
    through = equations.slot_flow(d.flow_coefficient, d.sleeve_seat_diameter, opening,
                                  c.pressure - d.drain_pressure, d.density)
    rate = make_interp_spline(c.time, c.net, k=5).derivative()(c.time)
    expected = (d.pump_flow - through - displaced * c.v) / d.line_area
    # Away from the ends, where the spline's slope is poor.
    assert np.allclose(rate[10:-10], expected[10:-10], rtol=1e-5, atol=1e-5 * np.ptp(rate))
