"""Equations of the hydraulic link: line (8)-(20), slot (26)-(28), total stiffness (34)-(39)."""
import math

import numpy as np
import pytest

from hpv_twin.model import Simulation, Vibrator, equations, kernel


def close(value, expected, rel=1e-12):
    return value == pytest.approx(expected, rel=rel, abs=0.0)


# (8)-(20): hydraulic link -------------------------------------------------------------------------


def test_averaged_line_by_hand_with_one_design_and_with_three():
    areas, lengths = np.array([1e-4, 3e-4]), np.array([1.0, 0.5])
    assert close(equations.line_length(lengths), 1.5)
    assert close(equations.line_area(areas, lengths), 2.5e-4 / 1.5)
    several = equations.line_area(np.outer(areas, [1, 2, 4]), lengths[:, np.newaxis])
    assert np.allclose(several, 2.5e-4 / 1.5 * np.array([1, 2, 4]), rtol=1e-14)


def test_line_area_is_that_of_the_design():
    d = Vibrator()
    hose = 0.8 * d.line_length
    areas = [d.line_area, d.line_area]
    assert close(equations.line_area(areas, [hose, d.line_length - hose]), d.line_area)


def test_compression_of_the_oil_by_hand():
    assert close(equations.compressed_volume(7e-4, 0.01), 7e-6)
    assert close(equations.volumetric_strain(7e-4, 0.01, 1e-3), 0.007)
    assert close(equations.compression_pressure(1.4e9, 0.01), 14e6)
    assert close(equations.line_stiffness(1.4e9, 1e-3, 1e-3), 1.4e6)
    assert close(equations.line_pressure(1.4e6, 0.01, 1e-3), 14e6)
    assert close(equations.line_pressure(1.4e6, 0.01, 1e-3, 2e5), 14.2e6)
    assert close(equations.line_deformation(14.2e6, 1e-3, 1.4e6, 2e5), 0.01)


def test_10_to_14_are_one_law():
    d = Vibrator()
    x = np.linspace(0.0, 0.02, 5)
    stiffness = equations.line_stiffness(d.bulk_modulus, d.line_area, d.cavity_volume)
    strain = equations.volumetric_strain(d.line_area, x, d.cavity_volume)
    volume = equations.compressed_volume(d.line_area, x)
    assert np.allclose(strain, volume / d.cavity_volume, rtol=1e-14)
    assert np.allclose(strain, x / d.line_length, rtol=1e-12)
    assert np.allclose(equations.line_pressure(stiffness, x, d.line_area),
                       equations.compression_pressure(d.bulk_modulus, strain), rtol=1e-12)
    assert close(stiffness, d.bulk_modulus * d.line_area / d.line_length)


def test_boundary_deformations_have_the_ratio_of_the_areas_not_that_over_k0r():
    u_21 = equations.transfer_ratio(1e-4, 5e-4)
    assert close(u_21, 0.04)
    x_01 = equations.line_deformation(10e6, 1e-3, 1.4e6)
    x_02 = equations.line_deformation(10e6 * 1e-4 / 5e-4, 1e-3, 1.4e6)
    assert close(x_02, x_01 * math.sqrt(u_21))
    assert x_02 > 1e6 * x_01 * math.sqrt(u_21) / 1.4e6


def test_reduction_to_a_moving_link_by_hand():
    u = equations.transfer_ratio(3e-4, 1e-3)
    assert close(u, 0.09)
    assert close(equations.reduced_stiffness(u, 1.4e6), 126e3)
    assert close(equations.reduced_deformation(0.01, u), 0.1 / 3.0)
    assert close(equations.reduced_deformation_rate(0.6, u), 2.0)


def test_reduction_keeps_volume_force_and_energy():
    u = equations.transfer_ratio(3e-4, 1e-3)
    line, link = 1.4e6, equations.reduced_stiffness(u, 1.4e6)
    x = 0.012
    reduced = equations.reduced_deformation(x, u)
    assert close(3e-4 * reduced, equations.compressed_volume(1e-3, x))
    assert close(link * reduced, 3e-4 * equations.line_pressure(line, x, 1e-3))
    assert close(link * reduced ** 2, line * x ** 2)
    assert close(link, 1.4e9 * 3e-4 ** 2 / 1e-3)  # kappa*A²/W0 with kappa = 1.4e9 Pa, W0 = 1 l


def test_line_damping_by_hand_and_the_length_lost_in_print():
    assert close(equations.line_damping(0.026, 7.5e-4, 1.5), 1.3e-5)
    d = Vibrator()
    assert close(equations.line_damping(d.dynamic_viscosity, d.line_area, d.line_length),
                 d.line_damping_in_force)
    diameter = equations.hydraulic_diameter(7.5e-4)
    assert close(diameter, 1.13 * math.sqrt(7.5e-4), rel=2e-3)
    printed = math.pi * 0.026 * diameter ** 2 / 4.0
    assert close(printed, 1.95e-5)  # N s, whatever the length
    # The viscous twin of the stiffness: both fall alike as the line grows longer.
    for length in (0.5, 1.0, 1.5):
        stiffness = equations.line_stiffness(1.4e9, 7.5e-4, 7.5e-4 * length)
        damping = equations.line_damping(0.026, 7.5e-4, length)
        assert close(damping / stiffness, 0.026 / 1.4e9)


def test_drag_by_hand():
    assert close(equations.line_drag(12.0, 0.5), 6.0)
    assert close(equations.reduced_drag(10.0, 0.0016, 3.0, 1.0), 4.0)


def test_drag_damps_the_motion_as_printed_it_would_drive_it():
    # Standing oil: the force is against the velocity, and takes power from it.
    assert equations.reduced_drag(10.0, 0.0016, 0.0, 1.0) < 0.0
    assert -equations.reduced_drag(10.0, 0.0016, 0.0, 1.0) * 1.0 > 0.0
    # It is the dashpot of kernel.net_force, for a velocity, a flow and an open slot.
    design = Vibrator(line_damping=25.0)
    p, y, v = 5e6, 1.5e-3, 0.7
    area = design.sleeve_seat_area
    u = equations.transfer_ratio(area, design.line_area)
    through = equations.slot_flow(design.flow_coefficient, design.sleeve_seat_diameter,
                                  y - design.gap, p, design.density)
    before_displacement = (design.pump_flow - through) / design.line_area
    rate = equations.reduced_deformation_rate(before_displacement, u)
    drag = equations.reduced_drag(25.0, u, rate, v)
    forces = [force_on_plunger(d, p, y, v) for d in (design, design.replace(line_damping=0.0))]
    assert close(drag, forces[0] - forces[1], rel=1e-9)


def force_on_plunger(design, p, y, v):
    table = kernel.stage_table(design, design.preload, design.load)
    return kernel.force_at(p, y, v, kernel.SLOT, table, kernel.parameters(design))


# (26)-(28): flow through the slot -----------------------------------------------------------------

SLOT = {'flow_coefficient': 0.6, 'sleeve_seat_diameter': 0.02 / math.pi, 'density': 800.0}
# With these, xi_H*pi*d2 is 0.012 m, and 4 MPa give a jet of 100 m/s.
VALVE = {'opening_pressure': 10e6, 'sleeve_seat_area': 5e-4, 'spring_stiffness': 2e5,
         'stroke': 2e-3}


def test_slot_flow_by_hand():
    assert close(equations.slot_flow(opening=1e-3, pressure_drop=4e6, **SLOT), 1.2e-3)
    assert equations.slot_flow(opening=-1e-3, pressure_drop=4e6, **SLOT) == 0.0
    assert equations.slot_flow(opening=1e-3, pressure_drop=-4e6, **SLOT) == 0.0


def test_forward_flow_by_hand_starts_at_the_gap():
    flow = equations.forward_flow(sleeve_position=np.array([0.0, 0.8e-3, 2e-3]), gap=0.8e-3,
                                  opening_pressure=4e6, **SLOT)
    assert np.allclose(flow, [0.0, 0.0, 1.44e-3], rtol=1e-12, atol=0.0)


def test_dwell_flow_by_hand_and_as_an_upper_bound():
    flow = equations.dwell_flow(seat_area=1e-4, **VALVE, **SLOT)
    # 8 MPa + 0.8 MPa over the slot: 22 000 m²/s².
    assert close(flow, 0.012 * 2e-3 * math.sqrt(22_000.0))
    # By (3) the pressure falls from 10 MPa to 2.8 MPa while the plunger dwells.
    assert flow > equations.slot_flow(opening=2e-3, pressure_drop=7.2e6, **SLOT)


def test_dwell_flow_is_the_papers_in_deformations_with_one_root_of_the_product():
    k0r, a0, a1, a2, h_b, k1 = 6e5, 7e-4, 1e-4, 5e-4, 2e-3, 2e5
    x_01 = equations.line_deformation(10e6, a0, k0r)
    u_21, u_02 = equations.transfer_ratio(a1, a2), equations.transfer_ratio(a2, a0)
    bracket = x_01 * (1.0 - math.sqrt(u_21)) + k1 * h_b / (k0r * math.sqrt(u_02))
    meant = 0.012 * h_b * math.sqrt(2.0 * k0r / (800.0 * a0) * bracket)
    assert close(equations.dwell_flow(seat_area=a1, **VALVE, **SLOT), meant)
    printed = 0.012 * h_b * math.sqrt(2.0 * k0r * x_01 / (800.0 * a0)) * math.sqrt(bracket)
    # A factor sqrt(x01), in the root of a metre.
    assert close(printed / meant, math.sqrt(x_01))


def test_return_flow_by_hand():
    flow = equations.return_flow(seat_area=1e-4, return_position=np.array([0.0, 1e-3, 2e-3]),
                                 **VALVE, **SLOT)
    # 2.8 MPa over the slot: 7000 m²/s².
    full = 0.012 * 2e-3 * math.sqrt(7000.0)
    assert np.allclose(flow, [full, full / 2.0, 0.0], rtol=1e-12, atol=0.0)


def test_return_flow_is_driven_by_equation_3():
    p1 = equations.opening_pressure(2e5, 5e-3, 0.0, 1e-4)
    p2 = equations.return_pressure(2e5, 5e-3, 2e-3, 0.0, 5e-4)
    flow = equations.return_flow(seat_area=1e-4, return_position=0.0,
                                 **(VALVE | {'opening_pressure': p1}), **SLOT)
    assert close(flow, equations.slot_flow(opening=2e-3, pressure_drop=p2, **SLOT))


def full_flows(seat_area, gap_ratio=0.4, valve=VALVE):
    """Sum of (26) and (27) with the slot as far open as it goes."""
    stroke = valve['stroke']
    return (equations.forward_flow(sleeve_position=stroke, gap=gap_ratio * stroke,
                                   opening_pressure=valve['opening_pressure'], **SLOT)
            + equations.dwell_flow(seat_area=seat_area, **valve, **SLOT)
            + equations.return_flow(seat_area=seat_area, return_position=0.0, **valve, **SLOT))


def test_flow_bound_by_hand_and_as_a_bound_which_the_printed_factor_is_not():
    bound = equations.flow_bound(**VALVE, **SLOT)
    # 10 MPa + 1.6 MPa over 800 kg/m³: 14 500 m²/s².
    unit = 0.012 * 2e-3 * math.sqrt(14_500.0)
    assert close(bound, (2.0 + 0.6 * math.sqrt(2.0)) * unit)
    assert close(bound, 2.849 * unit, rel=2e-4)
    assert 2.404 * unit < full_flows(1e-4) < bound


def test_flow_bound_holds_for_every_valve_and_is_reached():
    for seat_area in (1e-5, 5e-5, 1e-4, 2.5e-4, 4.9e-4):
        for gap_ratio in (0.2, 0.4, 0.5):
            bound = equations.flow_bound(gap_ratio=gap_ratio, **VALVE, **SLOT)
            assert full_flows(seat_area, gap_ratio) <= bound
    # Where both roots are equal and no spring pushes, nothing is given away.
    weak = VALVE | {'spring_stiffness': 0.0}
    assert close(full_flows(2.5e-4, valve=weak), equations.flow_bound(**weak, **SLOT))


def test_flow_bound_holds_for_the_simulated_machine():
    d, switches = Vibrator(), Simulation().advance(0.1, sample_rate=1000).switches
    arrival = switches[switches['after'] == kernel.PHASE_OPEN][-1]
    greatest = equations.slot_flow(d.flow_coefficient, d.sleeve_seat_diameter, d.stroke,
                                   arrival['pressure'], d.density)
    bound = equations.flow_bound(d.flow_coefficient, d.sleeve_seat_diameter, d.stroke,
                                 d.opening_pressure, d.sleeve_seat_area,
                                 d.slotted_spring_stiffness, d.density)
    assert greatest == pytest.approx(18.7e-3, rel=0.01)
    assert bound == pytest.approx(40.2e-3, rel=0.01)


# (34)-(39): total stiffness -----------------------------------------------------------------------


def test_total_stiffness_by_hand():
    assert close(equations.total_stiffness(0.09, 1.4e6, 2e5, 0.04), 334e3)
    assert close(equations.total_stiffness(0.09, 1.4e6, 2e5), 326e3)
    assert close(equations.least_total_stiffness(0.01, 0.02, 1.6e6, 2e5), 300e3)
    assert close(equations.greatest_total_stiffness(0.02, 0.02, 1.6e6, 2e5), 1.8e6)
    assert close(equations.stiffness_span(1.4e9, 1e-4, 5e-4, 1e-3), 336e3)
    assert close(equations.relative_stiffness_span(1e-4, 5e-4, 1e-3), 0.24)


def stiffness_of(d):
    """Return k0r, d0, least and greatest total stiffness of a design."""
    k0r = equations.line_stiffness(d.bulk_modulus, d.line_area, d.cavity_volume)
    d_0 = equations.hydraulic_diameter(d.line_area)
    k1 = d.slotted_spring_stiffness
    return (k0r, d_0, equations.least_total_stiffness(d.plunger_seat_diameter, d_0, k0r, k1),
            equations.greatest_total_stiffness(d.sleeve_seat_diameter, d_0, k0r, k1))


def test_34_to_38_say_the_same():
    d = Vibrator()
    k0r, _, least, greatest = stiffness_of(d)
    for area, mass, expected in ((d.plunger_seat_area, 0.5, least),
                                 (d.sleeve_seat_area, 0.6, greatest)):
        u = equations.transfer_ratio(area, d.line_area)
        assert close(equations.total_stiffness(u, k0r, d.slotted_spring_stiffness), expected)
        frequency = equations.eigenfrequency(
            u, equations.partial_frequency(k0r, mass),
            equations.partial_frequency(d.slotted_spring_stiffness, mass))
        assert close(mass * frequency ** 2, expected)
    assert close(greatest - least, equations.stiffness_span(
        d.bulk_modulus, d.plunger_seat_area, d.sleeve_seat_area, d.cavity_volume))


def test_37_as_printed_leaves_38_without_a_difference():
    d = Vibrator()
    k0r, d_0, least, greatest = stiffness_of(d)
    printed = (d.plunger_seat_diameter / d_0) ** 4 * k0r + d.slotted_spring_stiffness
    assert close(printed, least)
    assert greatest > 2.8 * printed


@pytest.mark.parametrize('changes', [
    {}, {'bulk_modulus': 0.9e9}, {'slotted_spring_stiffness': 4e5}, {'plunger_seat_diameter': 0.02},
    {'cavity_volume': 3e-4, 'line_length': 0.7}])
def test_relative_stiffness_span_is_an_identity(changes):
    d = Vibrator(**changes)
    k0r, d_0, least, greatest = stiffness_of(d)
    span = equations.relative_stiffness_span(d.plunger_seat_area, d.sleeve_seat_area, d.line_area)
    assert close((greatest - least) / k0r, span)
    assert close((d.sleeve_seat_diameter ** 4 - d.plunger_seat_diameter ** 4) / d_0 ** 4, span)


def test_relative_stiffness_span_knows_geometry_alone():
    spans = [equations.relative_stiffness_span(d.plunger_seat_area, d.sleeve_seat_area, d.line_area)
             for d in (Vibrator(), Vibrator(bulk_modulus=1e9, slotted_spring_stiffness=1e5))]
    assert spans[0] == spans[1] == pytest.approx(0.7385, abs=1e-4)
