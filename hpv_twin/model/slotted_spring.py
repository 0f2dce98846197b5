"""The slotted spring by its geometry: another way to give a design its k1 and m1."""
from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from .equations import slotted_spring_mass, slotted_spring_stiffness
from .quantity import VibratorError, check_fields, check_quantity, quantity

# The key of a design file under which the slotted spring stands, and what stands there beside the
# fields of SlottedSpring.
SPRING = 'slotted_spring'
PLUNGER_ALONE = quantity(dataclasses.MISSING, 'kg', 'm8', 'plunger without the slotted spring, (4)',
                         'to be given', high=1e3, above=0.0)
PLUNGER_ALONE.name = 'plunger_mass_without_spring'


@dataclass(frozen=True)
class SlottedSpring:
    """
    The slotted spring by its geometry, SI units: rings of square section between n + 1 slots.

    `mass` and `stiffness` are those of (4) and (21), valid for an edge well below the radius.
    """

    jumper_edge: float = quantity(
        dataclasses.MISSING, 'm', 'a', 'edge of the jumpers and of the section of the rings',
        'to be given', low=1e-4, high=0.1)
    rings: int = quantity(
        dataclasses.MISSING, '1', 'n', 'working rings; the paper calls them jumpers',
        'to be given', low=1, high=1000)
    mean_radius: float = quantity(
        dataclasses.MISSING, 'm', 'R', 'mean radius of the rings', 'to be given',
        high=1.0, above=0.0)
    youngs_modulus: float = quantity(
        2.15e11, 'Pa', 'E', "Young's modulus of its material", 'paper: under (21)',
        high=1e13, above=0.0)
    density: float = quantity(
        7850.0, 'kg/m^3', 'rho', 'density of its material', 'chosen: steel', high=1e5, above=0.0)

    def __post_init__(self):
        check_fields(self)
        if self.rings != int(self.rings):
            raise VibratorError(f'rings (n) = {self.rings:g} is not a whole number')
        object.__setattr__(self, 'rings', int(self.rings))
        if self.mean_radius <= self.jumper_edge:
            raise VibratorError(f'mean_radius (R) = {self.mean_radius:g} m must exceed '
                                f'jumper_edge (a) = {self.jumper_edge:g} m')

    @property
    def mass(self) -> float:
        """m13, kg, (4)."""
        return slotted_spring_mass(self.jumper_edge, self.rings, self.mean_radius, self.density)

    @property
    def stiffness(self) -> float:
        """k1, N/m, (21)."""
        return slotted_spring_stiffness(self.jumper_edge, self.rings, self.mean_radius,
                                        self.youngs_modulus)


def read_spring(data) -> dict:
    """Check what stands under `slotted_spring`; return arguments of from_spring_geometry."""
    geometry = dataclasses.fields(SlottedSpring)
    fields = (*geometry, PLUNGER_ALONE)
    needed = [field for field in fields if field.default is dataclasses.MISSING]
    names = ', '.join(f'{field.name} ({field.metadata["symbol"]})' for field in fields)
    if not isinstance(data, dict):
        raise VibratorError(f'{SPRING} = {str(data)[:60]!r}: expected the fields {names}')
    for key in data:
        if key not in [field.name for field in fields]:
            raise VibratorError(f'{SPRING}: unknown field "{key}"; there are {names}')
    for field in needed:
        if field.name not in data:
            raise VibratorError(f'{SPRING}: {field.name} ({field.metadata["symbol"]}) is missing: '
                                f'{field.metadata["text"]}, {field.metadata["unit"]}')
    try:
        alone = check_quantity(PLUNGER_ALONE, data[PLUNGER_ALONE.name])
        spring = SlottedSpring(**{field.name: data[field.name] for field in geometry
                                  if field.name in data})
    except VibratorError as error:
        raise VibratorError(f'{SPRING}: {error}') from None
    return {'spring': spring, PLUNGER_ALONE.name: alone}
