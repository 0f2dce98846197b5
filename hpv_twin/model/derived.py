"""What follows from the fields of a design, for one design and for arrays of them alike."""
import math

import numpy as np


class Derived:
    """Areas, pressures and flows that follow from the fields of a design; SI, pressures gauge."""

    @property
    def plunger_seat_area(self):
        """A1, m²: what the pressure acts on before the sleeve is reached."""
        return math.pi / 4.0 * self.plunger_seat_diameter ** 2

    @property
    def sleeve_seat_area(self):
        """A2, m²: what the pressure acts on once plunger and sleeve move together."""
        return math.pi / 4.0 * self.sleeve_seat_diameter ** 2

    @property
    def line_area(self):
        """A0 = W0/L0, m²: section of the averaged hydraulic line, (8)."""
        return self.cavity_volume / self.line_length

    @property
    def gap(self):
        """h_s, m: the plunger takes the sleeve along from here."""
        return self.gap_ratio * self.stroke

    @property
    def line_damping_by_geometry(self):
        """c0, N·s/m, by (19) with the length it lacks in print."""
        return self.dynamic_viscosity * self.line_area / self.line_length

    @property
    def return_pressure(self):
        """p2, Pa gauge: balance at full stroke, (3) corrected; the return stroke starts here."""
        spring = self.slotted_spring_stiffness * (self.preload + self.stroke)
        return self.drain_pressure + (spring + self.load) / self.sleeve_seat_area

    @property
    def opening_pressure(self):
        """p1, Pa gauge: balance on the seat, (1) with the twisted spring's help."""
        spring = (self.slotted_spring_stiffness * self.preload
                  - self.twisted_spring_stiffness * self.twisted_spring_preload)
        return self.drain_pressure + (spring + self.load) / self.plunger_seat_area

    @property
    def critical_flow(self):
        """Q_crit, m³/s: at this pump flow and above, the open valve never empties the cavity."""
        drop = np.maximum(self.return_pressure - self.drain_pressure, 0.0)
        slot = self.flow_coefficient * math.pi * self.sleeve_seat_diameter * self.stroke
        return slot * (2.0 * drop / self.density) ** 0.5
