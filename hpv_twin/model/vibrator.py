"""The design of a hydropulse vibrator: every number of the model, with unit, symbol and origin."""
from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from . import yaml_text
from .derived import Derived
from .equations import plunger_mass
from .quantity import VibratorError, check_fields, check_quantity, quantity
from .slotted_spring import PLUNGER_ALONE, SPRING, SlottedSpring, read_spring

ATMOSPHERE = 101_325.0  # Pa; a gauge pressure cannot fall below its negative


@dataclass(frozen=True)
class Vibrator(Derived):
    """
    One vibrator with its oil, its pump flow and its load. SI units; all pressures are gauge.

    The defaults are the base design, which shows what the paper reports (55 Hz, 2.0 mm, 16 MPa,
    3 MPa, dwell 15 % of the forward stroke). The paper gives no masses, stiffnesses or diameters:
    `origin` in each field's metadata says whether a value is the paper's, derived or chosen.
    `python -m hpv_twin.study.base_design` finds the derived ones again.
    """

    plunger_seat_diameter: float = quantity(
        0.011, 'm', 'd1', 'mean diameter of the plunger seat, first sealing stage',
        'chosen: the smallest round size that also reaches 150 Hz', high=1.0, above=0.0)
    sleeve_seat_diameter: float = quantity(
        0.027642307, 'm', 'd2', 'mean diameter of the valve-sleeve seat, second sealing stage',
        'derived: return stroke starts at 3.0 MPa, by (3)', high=1.0, above=0.0)
    stroke: float = quantity(
        0.002, 'm', 'h_b', 'full stroke of the plunger, also the opening of the valve',
        'paper: 2.0 mm', high=0.1, above=0.0)
    gap_ratio: float = quantity(
        0.4, '1', 'h_s/h_b', 'gap between sleeve and plunger, as a share of the stroke',
        'paper: 0.2 to 0.5, 0.4 in its equations', low=0.2, high=0.5)
    plunger_mass: float = quantity(
        0.50345885, 'kg', 'm1', 'plunger with the slotted spring, (4)',
        'derived: dwell is 15 % of the forward stroke', high=1e3, above=0.0)
    sleeve_mass: float = quantity(
        0.1, 'kg', 'm2', 'valve sleeve with twisted spring, stepped sleeve and ring, (5)',
        'chosen: well below the plunger mass, as the paper says', low=0.0, high=1e3)
    slotted_spring_stiffness: float = quantity(
        2.5e5, 'N/m', 'k1', 'slotted spring, (21)',
        'chosen: with d1 it carries 150 Hz (2e5 N/m with 10 mm stops at 143 Hz)',
        high=1e10, above=0.0)
    preload: float = quantity(
        5.2014456e-3, 'm', 'y01', 'preliminary deformation of the slotted spring',
        'derived: highest pressure 16.0 MPa', low=0.0, high=1.0)
    twisted_spring_stiffness: float = quantity(
        1e4, 'N/m', 'k2', 'twisted spring of the valve sleeve', 'chosen: k2 << k1, as under (34)',
        low=0.0, high=1e10)
    twisted_spring_preload: float = quantity(
        4e-3, 'm', 'y02', 'preliminary deformation of the twisted spring',
        'chosen: the sleeve seals with 67 kPa, by (2)', low=0.0, high=1.0)
    cavity_volume: float = quantity(
        1.0342933e-3, 'm^3', 'W0', 'pressure cavity A with the hose',
        'derived: 55 Hz at the base pump flow, by (7)', high=10.0, above=0.0)
    line_length: float = quantity(
        1.5, 'm', 'L0', 'length of the averaged hydraulic line, (9); its section is A0 = W0/L0',
        'paper: hose below 1.5 m', high=1e3, above=0.0)
    bulk_modulus: float = quantity(
        1.4e9, 'Pa', 'kappa', 'effective bulk modulus of the oil with its air',
        'paper: 1.4e9 Pa, 2 to 3 % undissolved air', high=1e12, above=0.0)
    density: float = quantity(
        870.0, 'kg/m^3', 'rho_e', 'oil density', 'paper: IGP-30 at 40 degC', high=1e5, above=0.0)
    dynamic_viscosity: float = quantity(
        0.026, 'Pa s', 'mu_e', 'dynamic viscosity of the oil', 'paper: IGP-30 at 40 degC',
        low=0.0, high=1e3)
    flow_coefficient: float = quantity(
        0.62, '1', 'xi_H', 'flow coefficient of the open slot',
        'chosen: sharp edge, as textbooks have it', high=2.0, above=0.0)
    viscous_friction: float = quantity(
        60.0, 'N s/m', 'c1', 'viscous friction of plunger and sleeve in their guides',
        'chosen: light damping, below 5 % of critical', low=0.0, high=1e9)
    line_damping: float | None = quantity(
        None, 'N s/m', 'c0', 'dashpot of the hydraulic link; null: mu_e*A0/L0, (19) with its '
        'missing length', 'derived by (19), about 1e-5 N s/m; identify it from measurements',
        low=0.0, high=1e9)
    drain_pressure: float = quantity(
        0.0, 'Pa', 'p_dp', 'pressure in the drain cavity, gauge', 'paper: neglected',
        low=-ATMOSPHERE, high=1e9)
    pump_flow: float = quantity(
        7.3e-4, 'm^3/s', 'Q_H', 'flow of the pump',
        'paper: pump QH-32, 32 cm^3/rev at 1450 rpm and 94 %', low=0.0, high=1.0)
    load: float = quantity(
        0.0, 'N', 'F_T', 'technological resistance on the plunger, a pull is negative',
        'chosen: the paper states no load', low=-1e9, high=1e9)

    def __post_init__(self):
        check_fields(self)
        if self.sleeve_seat_diameter <= self.plunger_seat_diameter:
            raise VibratorError(
                f'sleeve_seat_diameter (d2) = {self.sleeve_seat_diameter:g} m must exceed '
                f'plunger_seat_diameter (d1) = {self.plunger_seat_diameter:g} m')

    def replace(self, **changes) -> Vibrator:
        """Return the design with some fields changed; the result is validated."""
        return dataclasses.replace(self, **changes)

    @property
    def line_damping_in_force(self) -> float:
        """c0, N·s/m: the field, or (19) with the length it lacks in print."""
        return self.line_damping_by_geometry if self.line_damping is None else self.line_damping

    @classmethod
    def from_spring_geometry(cls, spring: SlottedSpring, plunger_mass_without_spring: float,
                             **fields) -> Vibrator:
        """
        Return the design with k1 and m1 from its slotted spring, by (21) and (4).

        `plunger_mass_without_spring` is m8, kg; `fields` are other fields of the design. Raises
        VibratorError where `fields` give plunger_mass or slotted_spring_stiffness a second time.
        """
        alone = check_quantity(PLUNGER_ALONE, plunger_mass_without_spring)
        derived = {'plunger_mass': plunger_mass(alone, spring.mass),
                   'slotted_spring_stiffness': spring.stiffness}
        for name in derived:
            if name in fields:
                raise VibratorError(f'both {name} = {fields[name]} and {SPRING} are given, and '
                                    f'that makes it {derived[name]:g}: leave one of them out')
        return cls(**derived, **fields)

    @classmethod
    def load_yaml(cls, text: str, source: str = 'vibrator') -> Vibrator:
        """
        Read a design from YAML text; keys that are absent keep the base design's value.

        The key `slotted_spring` gives plunger_mass and slotted_spring_stiffness by geometry: the
        fields of SlottedSpring, and plunger_mass_without_spring (m8, kg).
        """
        try:
            fields = read_mapping(text)
            if SPRING in fields:
                return cls.from_spring_geometry(**read_spring(fields.pop(SPRING)), **fields)
            return cls(**fields)
        except VibratorError as error:
            raise VibratorError(f'{source}: {error}') from None

    def to_yaml(self, origins: Mapping[str, str] | None = None) -> str:
        """
        Write the design as YAML, each value with its unit, symbol, meaning and origin.

        `origins` tells where the values of some fields come from, by name.
        """
        base = Vibrator()
        lines = ['# A hydropulse vibrator. SI units; every pressure is gauge.']
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            meta = field.metadata
            origin = meta['origin'] if value == getattr(base, field.name) else 'set by the user'
            origin = (origins or {}).get(field.name, origin)
            lines += ['', f'# {meta["symbol"]} [{meta["unit"]}]: {meta["text"]}', f'# {origin}',
                      f'{field.name}: {yaml_number(value)}']
        return '\n'.join(lines) + '\n'


def _load(cls, path) -> Vibrator:
    """Read a design from a YAML file; a VibratorError names file, key, value and bound."""
    try:
        text = Path(path).read_text(encoding='utf-8')
    except UnicodeDecodeError:
        raise VibratorError(f'{path}: not a text file (UTF-8 YAML expected)') from None
    except OSError as error:
        raise VibratorError(f'{path}: {error.strerror or error}') from None
    return cls.load_yaml(text, str(path))


# `load` is both the field F_T and the reader of files: a classmethod gives way to the instance's
# own value, so Vibrator.load(path) reads a design and Vibrator().load is its load in N.
Vibrator.load = classmethod(_load)


def yaml_number(value) -> str:
    """Format a number so that every YAML reader takes it for one (1.4e9 needs its sign: 1.4e+9)."""
    if value is None:
        return 'null'
    text = repr(float(value))
    if 'e' in text:
        mantissa, exponent = text.split('e')
        mantissa += '' if '.' in mantissa else '.0'
        text = f'{mantissa}e{int(exponent):+d}'
    return text


def read_mapping(text: str) -> dict:
    """Parse YAML text into keyword arguments of Vibrator; unknown keys get the nearest name."""
    try:
        data = yaml_text.parse(text)
    except yaml_text.YamlError as error:
        raise VibratorError(str(error)) from None
    if data is None:
        raise VibratorError('empty: expected "field: value" lines')
    if not isinstance(data, dict):
        raise VibratorError(f'expected "field: value" lines, found a {type(data).__name__}')
    names = [SPRING] + [field.name for field in dataclasses.fields(Vibrator)]
    for key in data:
        if key not in names:
            near = difflib.get_close_matches(str(key), names, n=1)
            hint = f'; did you mean "{near[0]}"?' if near else ''
            raise VibratorError(f'unknown field "{key}"{hint}')
    return data
