"""What a study of designs is after: its free fields, objectives, limits, from YAML and defaults."""
from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import yaml

from hpv_twin.model import Vibrator, VibratorError
from hpv_twin.model.designs import FIELDS
from hpv_twin.model.equations import flow_bound
from hpv_twin.model.quantity import check_quantity

# The paper's five: k1, k2, d1, d2, h_s.
FREE = ('slotted_spring_stiffness', 'twisted_spring_stiffness', 'plunger_seat_diameter',
        'sleeve_seat_diameter', 'gap_ratio')
# Figure of each objective, and whether more of it is better.
OBJECTIVES = {'impact_energy': ('impact_energy', True), 'mean_power': ('impact_power', True),
              'efficiency': ('efficiency', True), 'frequency_band': ('band_miss', False),
              'peak_pressure': ('peak_pressure', False),
              'pressure_rate': ('pressure_rate', False)}
DEFAULT_OBJECTIVES = ('impact_energy', 'efficiency', 'pressure_rate')
CONSTRAINTS = ('geometry', 'seated', 'period_1', 'full_stroke', 'spring_stress', 'spring_slots',
               'spring_buckling', 'seat_pressure', 'flow_capacity', 'peak_pressure')
DEFAULT_SPAN = (0.5, 2.0)  # bounds of a free field where none are given, times the base design's
KEYS = {'free', 'spring', 'limits', 'frequency_band'}


@dataclass(frozen=True)
class Spring:
    """Geometry of the slotted spring but for the edge a, which follows from k1 by (21)."""

    rings: float = 14.0
    mean_radius: float = 0.022
    youngs_modulus: float = 2.15e11
    density: float = 7850.0


@dataclass(frozen=True)
class Limits:
    """What a design must keep to; SI, pressures gauge."""

    spring_stress: float = 1.1e9  # Pa, equivalent; spring steel yields at about 1.35e9
    spring_slots: float = 1.2  # room of the slots over the greatest deflection, at least
    spring_buckling: float = 1.5  # critical over greatest deflection, at least
    seat_pressure: float = 5e4  # Pa, (2): what the sleeve seals with, at least
    flow_capacity: float = math.nan  # m³/s, (28): what the passages let through
    peak_pressure: float = 40e6  # Pa
    period_spread: float = 1e-6  # 1


@dataclass(frozen=True)
class Goals:
    """Bounds of the free fields, objectives, constraints in force, limits, frequency band (Hz)."""

    bounds: dict[str, tuple[float, float]]
    objectives: tuple[str, ...] = DEFAULT_OBJECTIVES
    constraints: tuple[str, ...] = CONSTRAINTS
    band: tuple[float, float] = (50.0, 60.0)
    spring: Spring = field(default_factory=Spring)
    limits: Limits = field(default_factory=Limits)


def read_numbers(data, kind, source: str):
    """Make a `kind` of the numbers under one key of the file."""
    names = kind.__dataclass_fields__
    if not isinstance(data, dict) or set(data) - set(names):
        raise VibratorError(f'{source}: expected some of {", ".join(names)}, found '
                            f'{str(data)[:80]}')
    return kind(**{name: read_number(value, f'{source}: {name}') for name, value in data.items()})


def read_number(value, what: str) -> float:
    """Read a number above 0; YAML takes 1e9 for text."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise VibratorError(f'{what} = {value!r} is not a number') from None
    if not (number > 0.0 and math.isfinite(number)):
        raise VibratorError(f'{what} = {number:g} must be above 0')
    return number


def read_bounds(name: str, pair, source: str) -> tuple[float, float]:
    """Check the bounds of one free field."""
    if name not in FIELDS:
        raise VibratorError(f'{source}: no field "{name}"; there are {", ".join(FIELDS)}')
    if not isinstance(pair, list | tuple) or len(pair) != 2:
        raise VibratorError(f'{source}: {name}: expected [low, high], found {pair}')
    try:
        low, high = (check_quantity(FIELDS[name], value) for value in pair)
    except VibratorError as error:
        raise VibratorError(f'{source}: {error}') from None
    if not low < high:
        raise VibratorError(f'{source}: {name}: {low:g} is not below {high:g}')
    return low, high


def default_bounds(name: str, base: Vibrator) -> tuple[float, float]:
    """Half to twice the base design's value, within the bounds of the field."""
    value = getattr(base, name)
    if value is None or value == 0.0:
        raise VibratorError(f'{name} is {value} in the base design: give its bounds in a YAML')
    meta = FIELDS[name].metadata
    low, high = sorted(factor * value for factor in DEFAULT_SPAN)
    return max(low, meta['low']), min(high, meta['high'])


def read_goals(base: Vibrator, path=None, free=None, objectives=DEFAULT_OBJECTIVES,
               without=()) -> Goals:
    """
    Put together what a study is after; VibratorError names file, key and what is wrong.

    `free`: names, by default those of the file, or the paper's five. `without`: constraints left
    out.
    """
    data = read_file(path)
    given = data.get('free') or {}
    if not isinstance(given, dict):
        raise VibratorError(f'{path}: free: expected "field: [low, high]" lines')
    given = {name: read_bounds(name, pair, str(path)) for name, pair in given.items()}
    names = free or tuple(given) or FREE
    for name in names:
        if name not in FIELDS:
            raise VibratorError(f'no field "{name}"; there are {", ".join(FIELDS)}')
    bounds = {name: given[name] if name in given else default_bounds(name, base) for name in names}
    check_names(objectives, OBJECTIVES, 'objective')
    check_names(without, CONSTRAINTS, 'constraint')
    limits = read_numbers(data.get('limits', {}), Limits, f'{path}: limits')
    if math.isnan(limits.flow_capacity):
        # Passages a little larger than (28) asks for at the base design.
        limits = Limits(**{**vars(limits), 'flow_capacity': 1.25 * float(bound_of_28(base))})
    band = data.get('frequency_band', (50.0, 60.0))
    if not isinstance(band, list | tuple) or len(band) != 2:
        raise VibratorError(f'{path}: frequency_band: expected [low, high] in Hz, found {band}')
    band = tuple(read_number(value, f'{path}: frequency_band') for value in band)
    return Goals(bounds, tuple(objectives), tuple(c for c in CONSTRAINTS if c not in without), band,
                 read_numbers(data.get('spring', {}), Spring, f'{path}: spring'), limits)


def check_names(names, known, what: str) -> None:
    """Raise VibratorError for a name that is not among those known, or comes twice."""
    for name in names:
        if name not in known:
            raise VibratorError(f'no {what} "{name}"; there are {", ".join(known)}')
    if len(set(names)) != len(names):
        raise VibratorError(f'{what}s named twice: {", ".join(names)}')


def read_file(path) -> dict:
    """Read the YAML of a study; without one it says nothing."""
    if path is None:
        return {}
    try:
        with open(path, encoding='utf-8') as file:
            data = yaml.safe_load(file)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise VibratorError(f'{path}: {getattr(error, "strerror", None) or error}') from None
    if not isinstance(data, dict) or set(data) - KEYS:
        raise VibratorError(f'{path}: expected the keys {", ".join(sorted(KEYS))}, found '
                            f'{str(data)[:80]}')
    return data


def bound_of_28(designs) -> np.ndarray:
    """Bound (28) on the flow through the valve, m³/s, of a design or of many."""
    above = np.maximum(designs.opening_pressure - designs.drain_pressure, 0.0)
    return flow_bound(designs.flow_coefficient, designs.sleeve_seat_diameter, designs.stroke, above,
                      designs.sleeve_seat_area, designs.slotted_spring_stiffness, designs.density,
                      designs.gap_ratio)
