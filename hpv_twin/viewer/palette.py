"""How each quantity is shown: its name, a person's unit and one colour, the same everywhere."""
from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Quantity:
    """A quantity recorded in SI: `factor` turns it into `unit`; `colour` is 0xRRGGBB."""

    label: str
    unit: str
    factor: float
    colour: int
    digits: int

    @property
    def title(self) -> str:
        """The name with its unit, as legends and views have it."""
        return f'{self.label} [{self.unit}]' if self.unit else self.label

    def rgba(self, brightness: float = 1.0) -> int:
        """Return the opaque colour as rerun takes it, darkened by `brightness` below 1."""
        red, green, blue = (round(part * brightness) for part in self.colour.to_bytes(3, 'big'))
        return int.from_bytes((red, green, blue, 0xFF), 'big')

    def show(self, values):
        """Return SI values in the unit shown."""
        return np.asarray(values, dtype=np.float64) * self.factor

    def text(self, value: float) -> str:
        """Return one SI value with the unit, for sentences and tables."""
        return f'{self.show(value):.{self.digits}f} {self.unit}'.rstrip()


PRESSURE = Quantity('pressure, gauge', 'MPa', 1e-6, 0xFFA94D, 2)
PLUNGER = Quantity('plunger', 'mm', 1e3, 0x4DABF7, 3)
VALVE_SLEEVE = Quantity('valve sleeve', 'mm', 1e3, 0xF06595, 3)
PUMP_FLOW = Quantity('pump flow', 'L/min', 6e4, 0x69DB7C, 1)
PRELOAD = Quantity('preload', 'mm', 1e3, 0xB197FC, 2)
LOAD = Quantity('load', 'N', 1.0, 0xC0EB75, 0)
OPENING = Quantity('opening (green)', 'MPa', 1e-6, 0x12B886, 2)
RETURN = Quantity('return (red)', 'MPa', 1e-6, 0xFF6B6B, 2)
FREQUENCY = Quantity('frequency', 'Hz', 1.0, 0xFFE066, 2)
STROKE = Quantity('stroke', 'mm', 1e3, 0x66D9E8, 2)

NUMBERS = {'frequency': FREQUENCY, 'stroke': STROKE, 'pump_flow': PUMP_FLOW, 'preload': PRELOAD,
           'load': LOAD}
CYCLE_FIGURES = ('frequency', 'stroke')
JOINTS = {'plunger': PLUNGER, 'valve_sleeve': VALVE_SLEEVE}
# Of the cyclogram: build-up, forward, dwell, return.
PHASES = (0x5C677DFF, 0x3B8FD6FF, 0xC98A1BFF, 0xD95757FF)
MEASURED = 0xADB5BD  # a machine's waveform beside the model's
OTHERS = (0xE599F7, 0xA5D8FF, 0xFFD8A8, 0xB2F2BB, 0xFCC2D7)


# What is estimated of a measured machine: unit, factor, digits. Others are shown as recorded.
ESTIMATES = {'cavity_stiffness': ('MPa/mL', 1e-12, 3), 'pump_flow': ('L/min', 6e4, 2),
             'opening_force': ('N', 1.0, 0), 'base_pressure': ('MPa gauge', 1e-6, 3),
             'flow_coefficient': ('', 1.0, 3), 'viscous_friction': ('N·s/m', 1.0, 1),
             'residual': ('MPa', 1e-6, 3)}
ESTIMATE_COLOURS = (0xE599F7, 0x69DB7C, 0xFF922B, 0xA5D8FF, 0xFFD8A8, 0xFCC2D7, 0xFF6B6B)


def is_estimate(label: str) -> bool:
    """Whether a number belongs to the machine that a twin follows."""
    return label == 'residual' or label.startswith('estimate/')


def estimate(label: str, index: int) -> Quantity:
    """Return how an estimate, or the residual, is shown."""
    name = label.removeprefix('estimate/')
    unit, factor, digits = ESTIMATES.get(name, ('', 1.0, 3))
    return Quantity(name.replace('_', ' ') + (', estimated' if name != label else ''), unit,
                    factor, ESTIMATE_COLOURS[index % len(ESTIMATE_COLOURS)], digits)


def pressure(label: str, index: int) -> Quantity:
    """Return how the pressure topic `label` is shown; `index` counts the machine's pressures."""
    if label == 'pressure':
        return PRESSURE
    if label == 'measured/pressure':
        return replace(PRESSURE, label='measured, gauge', colour=MEASURED)
    return Quantity(f'{label}, gauge', 'MPa', 1e-6,
                    OTHERS[index % len(OTHERS)] if index else PRESSURE.colour, 2)


def joint(label: str, index: int) -> Quantity:
    """Return how a joint is shown; of a stranger it is unknown whether it slides or turns."""
    if label.startswith('measured/') and label.rsplit('/')[-1] in JOINTS:
        part = JOINTS[label.rsplit('/')[-1]]
        return replace(part, label=f'measured {part.label}', colour=MEASURED)
    return JOINTS.get(label) or Quantity(label, 'm or rad', 1.0, OTHERS[index % len(OTHERS)], 4)
