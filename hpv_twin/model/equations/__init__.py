"""
The paper's equations as they are meant, one small pure function for each law.

Source, unless a docstring names another: R. Obertyukh et al., Mathematical modeling of a
small-dimension hydropulse vibrator with a valve-driven pressure pulse generator, J. Eng. Sci.
13(1), F1-F16 (2026), whose equation numbers stand in parentheses.

- SI units; pressures are gauge. Arguments are floats or NumPy arrays and broadcast against each
  other; the result has their common shape. A docstring speaks of shapes where that is not all.
- "Print:" says where the printed equation is wrong; docs/model.md has the proofs and the tests.
- The equations of motion (22)-(25) that the simulation integrates are in kernel_machine.py.
"""
from .cycle import build_up_time, cycle_period, sleeve_rest_time
from .flow import dwell_flow, flow_bound, forward_flow, return_flow, slot_flow
from .line import (
    compressed_volume,
    compression_pressure,
    hydraulic_diameter,
    line_area,
    line_damping,
    line_deformation,
    line_drag,
    line_length,
    line_pressure,
    line_stiffness,
    reduced_deformation,
    reduced_deformation_rate,
    reduced_drag,
    reduced_stiffness,
    transfer_ratio,
    volumetric_strain,
)
from .motion import (
    damping_coefficient,
    dynamic_displacement,
    eigenfrequency,
    excitation,
    forward_acceleration,
    forward_free_term,
    forward_free_vibration,
    partial_frequency,
    return_acceleration,
    return_free_term,
    return_free_vibration,
    sleeve_partial_frequency,
)
from .stiffness import (
    greatest_total_stiffness,
    least_total_stiffness,
    relative_stiffness_span,
    stiffness_ratio,
    stiffness_span,
    total_stiffness,
)
from .valve import (
    opening_pressure,
    plunger_mass,
    return_pressure,
    seat_contact_pressure,
    sleeve_mass,
    slotted_spring_mass,
    slotted_spring_stiffness,
)

__all__ = [
    'build_up_time', 'compressed_volume', 'compression_pressure', 'cycle_period',
    'damping_coefficient', 'dwell_flow', 'dynamic_displacement', 'eigenfrequency', 'excitation',
    'flow_bound', 'forward_acceleration', 'forward_flow', 'forward_free_term',
    'forward_free_vibration', 'greatest_total_stiffness', 'hydraulic_diameter',
    'least_total_stiffness', 'line_area', 'line_damping', 'line_deformation', 'line_drag',
    'line_length', 'line_pressure', 'line_stiffness', 'opening_pressure', 'partial_frequency',
    'plunger_mass', 'reduced_deformation', 'reduced_deformation_rate', 'reduced_drag',
    'reduced_stiffness', 'relative_stiffness_span', 'return_acceleration', 'return_flow',
    'return_free_term', 'return_free_vibration', 'return_pressure', 'seat_contact_pressure',
    'sleeve_mass', 'sleeve_partial_frequency', 'sleeve_rest_time', 'slot_flow',
    'slotted_spring_mass', 'slotted_spring_stiffness', 'stiffness_ratio', 'stiffness_span',
    'total_stiffness', 'transfer_ratio', 'volumetric_strain',
]
