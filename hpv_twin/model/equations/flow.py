"""Flow through the slot of the valve: the law that is simulated, and the bounds (26)-(28)."""
import math

import numpy as np


def slot_flow(flow_coefficient, sleeve_seat_diameter, opening, pressure_drop, density):
    """
    Orifice law of (26), (27): Q_slot = xi_H*pi*d2*s*sqrt(2*dp/rho), m³/s, 0 for s or dp below 0.

    flow_coefficient xi_H, 1; sleeve_seat_diameter d2, m; opening s, m; pressure_drop dp across the
    slot, Pa; density rho, kg/m³, above 0.

    Valid for turbulent flow through a short slot, xi_H constant (textbooks: sharp edge, about
    0.6 to 0.65). The simulation takes dp = p - p_dp at every moment.
    """
    width = math.pi * sleeve_seat_diameter * np.maximum(opening, 0.0)
    return flow_coefficient * width * np.sqrt(2.0 * np.maximum(pressure_drop, 0.0) / density)


def forward_flow(flow_coefficient, sleeve_seat_diameter, sleeve_position, gap, opening_pressure,
                 density):
    """
    (26), first part: flow on the forward stroke from h_s on, the pressure held at p1, m³/s.

    flow_coefficient xi_H, 1; sleeve_seat_diameter d2, m; sleeve_position y2 and gap h_s (0.4*h_b
    in print), m; opening_pressure p1 = k0r*x01/A0 above the drain, Pa; density rho, kg/m³.

    Valid as an estimate for design; 0 up to h_s, which the paper writes (u + |u|)/2.
    """
    return slot_flow(flow_coefficient, sleeve_seat_diameter, sleeve_position - gap,
                     opening_pressure, density)


def dwell_flow(flow_coefficient, sleeve_seat_diameter, stroke, opening_pressure, seat_area,
               sleeve_seat_area, spring_stiffness, density):
    """
    (26), second part: xi_H*pi*d2*h_b*sqrt(2*(p1*(1 - A1/A2) + k1*h_b/A2)/rho), m³/s.

    Flow through the fully open slot at the drop p1 - p2. flow_coefficient xi_H, 1;
    sleeve_seat_diameter d2 and stroke h_b, m; opening_pressure p1 above the drain, Pa; seat_area
    A1 and sleeve_seat_area A2, m²; spring_stiffness k1, N/m; density rho, kg/m³.

    Valid as an upper bound for design: by (3) the drop is p1*(1 - A1/A2) - k1*h_b/A2.
    Print: a product of two roots, in the units of no flow; it is the root of the product.
    """
    drop = (opening_pressure * (1.0 - seat_area / sleeve_seat_area)
            + spring_stiffness * stroke / sleeve_seat_area)
    return slot_flow(flow_coefficient, sleeve_seat_diameter, stroke, drop, density)


def return_flow(flow_coefficient, sleeve_seat_diameter, stroke, return_position, opening_pressure,
                seat_area, sleeve_seat_area, spring_stiffness, density):
    """
    (27) Q_Hrev = xi_H*pi*d2*(h_b - y_rev)*sqrt(2*p2/rho), p2 = p1*A1/A2 + k1*h_b/A2, m³/s.

    Flow on the return stroke, the pressure held at p2 of (3) with k2 = 0 and a constant load.
    flow_coefficient xi_H, 1; sleeve_seat_diameter d2, stroke h_b and return_position y_rev, counted
    down from full stroke, m; opening_pressure p1 above the drain, Pa; seat_area A1 and
    sleeve_seat_area A2, m²; spring_stiffness k1, N/m; density rho, kg/m³.

    Valid as an upper bound for design: the pressure goes on falling, to a few per cent of p2.
    """
    level = (opening_pressure * seat_area + spring_stiffness * stroke) / sleeve_seat_area
    return slot_flow(flow_coefficient, sleeve_seat_diameter, stroke - return_position, level,
                     density)


def flow_bound(flow_coefficient, sleeve_seat_diameter, stroke, opening_pressure,
               sleeve_seat_area, spring_stiffness, density, gap_ratio=0.4):
    """
    (28) (2 + sqrt(2)*(1 - h_s/h_b))*xi_H*pi*d2*h_b*sqrt((p1 + 2*k1*h_b/A2)/rho), m³/s.

    Bound on the sum of (26) and (27), for sizing the passages; 2 + 0.6*sqrt(2) = 2.849 at 0.4.
    flow_coefficient xi_H, 1; sleeve_seat_diameter d2 and stroke h_b, m; opening_pressure p1 above
    the drain, Pa; sleeve_seat_area A2, m²; spring_stiffness k1, N/m; density rho, kg/m³; gap_ratio
    h_s/h_b, 1, 0.2 to 0.5.

    Valid where (26), (27) are. From sqrt(a) + sqrt(b) <= sqrt(2*(a + b)) on their full openings.
    Print: 2.404 = sqrt(2)*(0.3 + 1.4) halves the 0.6 of the stroke and rounds a root of 2; and
    sqrt(U02) stands as a factor of k1*h_b where it divides.
    """
    push = opening_pressure + 2.0 * spring_stiffness * stroke / sleeve_seat_area
    share = 2.0 + math.sqrt(2.0) * (1.0 - gap_ratio)
    return (share * flow_coefficient * math.pi * sleeve_seat_diameter * stroke
            * np.sqrt(push / density))
