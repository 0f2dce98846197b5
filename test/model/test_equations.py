"""Equations of valve, masses and times, (1)-(7), (21); and what holds for all the equations."""
import inspect
import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from hpv_twin.model import Simulation, Vibrator, equations, kernel

PAGE = Path(__file__).parents[2] / 'docs' / 'model.md'


def close(value, expected, rel=1e-12):
    return value == pytest.approx(expected, rel=rel, abs=0.0)


@pytest.fixture(scope='module')
def base():
    """Return design and switches of the base design, settled."""
    return Vibrator(), Simulation().advance(0.2, sample_rate=1000).switches


# (1)-(5), (21): pressures of the valve, masses, slotted spring ------------------------------------


def test_opening_pressure_by_hand():
    # 2e5 N/m * 5 mm = 1000 N, a load of 200 N, a seat of 1 cm².
    assert close(equations.opening_pressure(2e5, 5e-3, 200.0, 1e-4), 12e6)
    # The twisted spring takes 40 N off, the drain adds its pressure.
    assert close(equations.opening_pressure(2e5, 5e-3, 200.0, 1e-4, 1e4, 4e-3, 1e5), 11.7e6)


def test_opening_pressure_is_that_of_the_design_and_of_the_located_switch(base):
    design, switches = base
    expected = equations.opening_pressure(
        design.slotted_spring_stiffness, design.preload, design.load, design.plunger_seat_area,
        design.twisted_spring_stiffness, design.twisted_spring_preload, design.drain_pressure)
    assert close(expected, design.opening_pressure)
    opened = switches[(switches['before'] == kernel.PHASE_CLOSED)]
    assert len(opened) > 5
    assert np.allclose(opened['pressure'], expected, rtol=1e-7, atol=0.0)
    # What is missing is the push of the line's dashpot, (18)-(20).
    transfer = equations.transfer_ratio(design.plunger_seat_area, design.line_area)
    rate = equations.reduced_deformation_rate(design.pump_flow / design.line_area, transfer)
    push = equations.reduced_drag(design.line_damping_in_force, transfer, rate, 0.0)
    assert np.allclose(opened['pressure'], expected - push / design.plunger_seat_area,
                       rtol=1e-12, atol=0.0)


def test_seat_contact_pressure_by_hand_and_the_area_lost_in_print():
    pressure = equations.seat_contact_pressure(1e4, 4e-3, 0.02)  # 40 N on 3.1416 cm²
    assert close(pressure, 127_323.95447351627)
    printed = 1.274 * 1e4 * 4e-3
    assert close(printed, 50.96)
    assert close(pressure, printed / 0.02 ** 2, rel=1e-3)


def test_return_pressure_by_hand():
    # 2e5 N/m * 7 mm + 100 N on 5 cm², over a drain at 1 bar.
    assert close(equations.return_pressure(2e5, 5e-3, 2e-3, 100.0, 5e-4), 3e6)
    assert close(equations.return_pressure(2e5, 5e-3, 2e-3, 100.0, 5e-4, 1e5), 3.1e6)


def test_return_pressure_is_that_of_the_design_and_of_the_located_switch():
    # Without the dashpot, so that nothing but (3) decides.
    design = Vibrator(line_damping=0.0, load=80.0, drain_pressure=1.5e5)
    expected = equations.return_pressure(
        design.slotted_spring_stiffness, design.preload, design.stroke, design.load,
        design.sleeve_seat_area, design.drain_pressure)
    assert close(expected, design.return_pressure)
    switches = Simulation(design).advance(0.2, sample_rate=1000).switches
    returned = switches[switches['before'] == kernel.PHASE_OPEN]
    assert len(returned) > 5
    assert np.allclose(returned['pressure'], expected, rtol=1e-12, atol=0.0)


def test_return_pressure_follows_from_the_opening_pressure_and_print_adds_too_much():
    d = Vibrator()
    ratio = (d.plunger_seat_diameter / d.sleeve_seat_diameter) ** 2
    for load in (0.0, 120.0):
        opening = equations.opening_pressure(d.slotted_spring_stiffness, d.preload, load,
                                             d.plunger_seat_area)
        meant = equations.return_pressure(d.slotted_spring_stiffness, d.preload, d.stroke, load,
                                          d.sleeve_seat_area)
        spring = d.slotted_spring_stiffness * d.stroke
        assert close(meant, opening * ratio + spring / d.sleeve_seat_area)
        twisted = d.twisted_spring_stiffness * (d.twisted_spring_preload + d.gap)
        printed = opening * ratio + (spring + load + twisted) / d.sleeve_seat_area
        # 48 N of the twisted spring, and the load a second time, on 6.0012 cm².
        assert close(printed - meant, (48.0 + load) / 6.001204874933e-4, rel=1e-9)


def test_slotted_spring_mass_by_hand_and_the_square_lost_in_print():
    # Three rings, eight jumpers and two end rings, as much as three rings more.
    mass = equations.slotted_spring_mass(0.1, 3, 1.0, 2.0)
    assert close(mass, 2.0 * (0.18849555921538758 + 0.008 + 0.18849555921538758))
    # A length and an area cannot be added: scaled by 2, a volume grows eightfold.
    assert close(equations.slotted_spring_mass(0.2, 3, 2.0, 2.0), 8.0 * mass)

    def printed(edge, radius):
        return 2 * (6 * math.pi * radius * edge ** 2 + 8 * edge ** 3 + 6 * math.pi * radius * edge)
    assert printed(0.1, 1.0) > 5 * mass
    assert not close(printed(0.2, 2.0), 8 * printed(0.1, 1.0), rel=0.1)


def test_moving_masses_are_sums():
    assert close(equations.plunger_mass(0.25, 0.15), 0.4)
    assert close(equations.sleeve_mass(0.05, 0.02, 0.02, 0.01), 0.1)


def test_slotted_spring_stiffness_by_hand():
    assert close(equations.slotted_spring_stiffness(0.01, 10, 0.05, 2e11), 1.656e6)
    assert close(equations.slotted_spring_stiffness(0.01, 10, 0.05), 1.656e6 * 2.15 / 2.0)


def ring_stiffness(poisson):
    """Stiffness k*R³/(E*a⁴) of one square ring between jumpers that keep it from twisting."""
    bending, torsion = 12.0, 2.0 * (1.0 + poisson) / 0.140577  # E*a⁴/(E*I) and E*a⁴/(G*J)

    # Over an eighth of the ring, under P/4 = R = 1: moment x*(cos - sin), torque x*(sin + cos) - 1.
    def energy(x):
        return quad(lambda t: bending * (x * (math.cos(t) - math.sin(t))) ** 2
                    + torsion * (x * (math.sin(t) + math.cos(t)) - 1.0) ** 2, 0, math.pi / 4)[0]
    at_0, at_1, at_2 = energy(0.0), energy(1.0), energy(2.0)
    curvature, slope = at_2 - 2.0 * at_1 + at_0, (4.0 * at_1 - 3.0 * at_0 - at_2) / 2.0
    return 2.0 / energy(-slope / curvature)


@pytest.mark.parametrize('poisson, factor', [(0.25, 1.0337), (0.28, 1.0291), (0.30, 1.0261)])
def test_slotted_spring_stiffness_agrees_with_curved_bar_theory(poisson, factor):
    theory = ring_stiffness(poisson)
    assert theory == pytest.approx(factor, abs=2e-4)
    assert equations.slotted_spring_stiffness(1.0, 1, 1.0, 1.0) == pytest.approx(theory, rel=0.01)


# (6), (7): times ----------------------------------------------------------------------------------


def times_of_6(design, switches):
    """Rows of (6) for the last whole cycle, from the located switches alone."""
    opened = np.flatnonzero(switches['before'] == kernel.PHASE_CLOSED)[-2:]
    rows = switches[opened[0]:opened[1] + 1]
    start, end = rows['time'][0], rows['time'][-1]
    pick_up = rows['time'][rows['stage_after'] == kernel.CATCH_UP][0]
    stop = rows['time'][rows['after'] == kernel.PHASE_OPEN][0]
    back = rows[rows['before'] == kernel.PHASE_OPEN][0]
    seat = rows[rows['after'] == kernel.PHASE_CLOSED][0]
    forward, dwell, returning, seated = (stop - start, back['time'] - stop,
                                         seat['time'] - back['time'], end - seat['time'])
    inside = rows[1:]
    top = inside['pressure_max_time'][inside['pressure_max'].argmax()]
    bottom = inside['pressure_min_time'][inside['pressure_min'].argmin()]
    rise = design.return_pressure - seat['pressure']
    again = seat['time'] + equations.build_up_time(design.cavity_volume, rise,
                                                   design.bulk_modulus, design.pump_flow)
    pressure = (top + (end - start) - again, back['time'] - top, bottom - back['time'],
                again - bottom)
    rest = equations.sleeve_rest_time(seated, forward, stop - pick_up)
    return (pressure, (forward, dwell, returning, seated),
            (stop - pick_up, dwell, returning, rest), end - start)


def test_every_row_of_6_sums_to_the_period(base):
    pressure, plunger, sleeve, period = times_of_6(*base)
    assert close(equations.cycle_period(pressure, plunger, sleeve, 1e-9), period, rel=1e-9)
    # The sleeve leaves its seat later than the plunger, by the time up to 0.1*h_b.
    assert plunger[0] - sleeve[0] == pytest.approx(1.96e-3, rel=0.01)
    assert min(pressure + plunger + sleeve) > 0.0


def test_rows_of_6_by_hand_and_for_several_cycles():
    assert close(equations.sleeve_rest_time(12e-3, 4e-3, 2e-3), 14e-3)
    row = np.array([1e-3, 2e-3, 3e-3, 4e-3])
    assert close(equations.cycle_period(row, row[::-1], row), 10e-3)
    many = np.column_stack([row, 2.0 * row])
    assert np.allclose(equations.cycle_period(many, many, many), [10e-3, 20e-3], rtol=1e-14)


def test_rows_of_6_that_disagree_are_refused():
    row = np.array([1e-3, 2e-3, 3e-3, 4e-3])
    with pytest.raises(ValueError, match=r'rows of \(6\) differ by 0.1'):
        equations.cycle_period(row, row, row + [0, 0, 0, 1e-3])
    with pytest.raises(ValueError, match='negative: -0.001 s'):
        equations.cycle_period(row, row, [-1e-3, 4e-3, 3e-3, 4e-3])
    with pytest.raises(ValueError, match='differ'):
        equations.cycle_period(row, row, [math.nan] * 4)


def test_build_up_time_by_hand():
    assert close(equations.build_up_time(1e-3, 14e6, 1.4e9, 1e-3), 10e-3)


def test_build_up_time_is_exact_with_the_pressure_really_swept(base):
    design, switches = base
    opened = np.flatnonzero(switches['before'] == kernel.PHASE_CLOSED)[1:]
    seated, lifted = switches[opened - 1], switches[opened]
    assert (seated['after'] == kernel.PHASE_CLOSED).all()
    measured = lifted['time'] - seated['time']

    def predicted(rise):
        return equations.build_up_time(design.cavity_volume, rise, design.bulk_modulus,
                                       design.pump_flow)
    assert np.allclose(measured, predicted(lifted['pressure'] - seated['pressure']),
                       rtol=1e-9, atol=0.0)
    # With dp = p1 - p2, as the paper has it, it comes out shorter.
    ratio = measured[-1] / predicted(design.opening_pressure - design.return_pressure)
    assert ratio == pytest.approx(1.19, abs=0.01)


# All of them --------------------------------------------------------------------------------------

SUMS = {'cycle_period', 'line_area', 'line_length', 'sleeve_mass'}  # of arrays: tested above


@pytest.mark.parametrize('name', sorted(set(equations.__all__) - SUMS))
def test_arrays_broadcast_to_what_numbers_give(name):
    function = getattr(equations, name)
    count = len(inspect.signature(function).parameters)
    random = np.random.default_rng(7)
    shapes = [(3, 1), (4,), ()]
    arguments = [random.uniform(0.5, 2.0, shapes[k % 3]) for k in range(count)]
    result = function(*arguments)
    expected = np.vectorize(function)(*arguments)
    assert np.shape(result) == np.shape(expected) == ((3, 4) if count > 1 else (3, 1))
    assert np.allclose(result, expected, rtol=1e-12, atol=0.0)


@pytest.mark.parametrize('name', equations.__all__)
def test_every_docstring_names_its_equation_and_explains_its_arguments(name):
    function = getattr(equations, name)
    assert re.search(r'\(\d+\)', function.__doc__)
    for parameter in inspect.signature(function).parameters:
        assert re.search(rf'\b{parameter}\b', function.__doc__), parameter


def test_the_page_lists_every_equation_function_and_test_that_there_is():
    text = PAGE.read_text(encoding='utf-8')
    for name in equations.__all__:
        assert f'`{name}`' in text, name
    for number in range(1, 40):
        assert re.search(rf'^\| [^|]*\({number}\)', text, re.MULTILINE), number
    folder = Path(__file__).parent
    named = re.findall(r'`(test_\w+\.py)::(test_\w+)`', text)
    assert len(named) > 50
    for file, test in named:
        assert f'def {test}(' in (folder / file).read_text(encoding='utf-8'), (file, test)
