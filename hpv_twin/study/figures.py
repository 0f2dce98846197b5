"""How fields and figures of studies are shown to people: label, unit, factor from SI."""
from __future__ import annotations

from typing import NamedTuple

from hpv_twin.model.designs import FIELDS

# A person's unit for the unit of a field.
SHOWN_UNITS = {'m': ('mm', 1e3), 'm^3/s': ('L/min', 6e4), 'm^3': ('L', 1e3), 'N/m': ('kN/m', 1e-3),
               'Pa': ('MPa', 1e-6), 'kg/m^3': ('kg/m³', 1.0), 'N s/m': ('N·s/m', 1.0),
               'Pa s': ('Pa·s', 1.0), '1': ('', 1.0)}


class Shown(NamedTuple):
    """A quantity in a person's unit: `factor` times the SI value."""

    label: str
    unit: str
    factor: float

    @property
    def title(self) -> str:
        """Label with unit, for axes."""
        return f'{self.label} [{self.unit}]' if self.unit else self.label

    def text(self, value: float, digits: int = 4) -> str:
        """One SI value with the unit."""
        return f'{value * self.factor:.{digits}g} {self.unit}'.strip()


FIGURES_SHOWN = {
    'frequency': Shown('frequency', 'Hz', 1.0),
    'stroke': Shown('stroke', 'mm', 1e3),
    'peak_pressure': Shown('peak pressure, gauge', 'MPa', 1e-6),
    'return_pressure': Shown('return pressure, gauge', 'MPa', 1e-6),
    'opening_pressure': Shown('opening pressure, gauge', 'MPa', 1e-6),
    'lowest_pressure': Shown('lowest pressure, gauge', 'MPa', 1e-6),
    'impact_energy': Shown('impact energy per cycle', 'J', 1.0),
    'seat_energy': Shown('energy lost at the seat', 'J', 1.0),
    'impact_power': Shown('impact power', 'kW', 1e-3),
    'hydraulic_energy': Shown('hydraulic energy per cycle', 'J', 1.0),
    'hydraulic_power': Shown('hydraulic power', 'kW', 1e-3),
    'load_work': Shown('work on the load', 'J', 1.0),
    'efficiency': Shown('efficiency', '%', 100.0),
    'pressure_rate': Shown('greatest |dp/dt|', 'GPa/s', 1e-9),
    'band_miss': Shown('frequency outside the band by', 'Hz', 1.0),
}


def shown_field(name: str) -> Shown:
    """Return how a field of a design is shown."""
    meta = FIELDS[name].metadata
    unit, factor = SHOWN_UNITS.get(meta['unit'], (meta['unit'], 1.0))
    return Shown(f'{name.replace("_", " ")} ({meta["symbol"]})', unit, factor)


def shown(name: str) -> Shown:
    """Return how a figure is shown."""
    return FIGURES_SHOWN[name]
