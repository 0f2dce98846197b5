"""Named faults of a machine: what each one, at a severity from 0 to 1, does to its design."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from .vibrator import Vibrator, VibratorError


@dataclass(frozen=True)
class Fault:
    """
    A fault by name: the field of the design that it changes, and how.

    `changed(value, severity)` is the field's value with the fault, SI; `at_full` says in words
    what severity 1 is. Between 0, healthy, and 1 the field follows in proportion.
    """

    name: str
    field: str
    text: str
    at_full: str
    changed: Callable[[float, float], float]


def scaled(share: float) -> Callable[[float, float], float]:
    """Return a change by this share of the value at severity 1."""
    return lambda value, severity: value * (1.0 + share * severity)


def added(amount: float) -> Callable[[float, float], float]:
    """Return a change by this amount, SI, at severity 1."""
    return lambda value, severity: value + amount * severity


FAULTS = {fault.name: fault for fault in (
    # Undissolved air softens the oil: the cycle's mean of kappa falls (some 3 % of air by volume).
    Fault('air_in_oil', 'bulk_modulus', 'air in the oil: it is softer',
          'effective bulk modulus halved', scaled(-0.5)),
    Fault('pump_leakage', 'pump_flow', 'a worn pump leaks: less flow arrives',
          '40 % of the flow lost', scaled(-0.4)),
    Fault('preload_loss', 'preload', 'the spring has set, or the cap nut is loose',
          '40 % of the preload lost', scaled(-0.4)),
    Fault('worn_slot', 'flow_coefficient', 'seat and slot are washed out: they drain more',
          'flow coefficient half as large again', scaled(0.5)),
    # Added, not scaled: a design without friction can stick as well.
    Fault('sticking_plunger', 'viscous_friction', 'the plunger sticks: more friction',
          '1000 N·s/m more', added(1000.0)),
    Fault('blocked_drain', 'drain_pressure', 'the drain is blocked: oil leaves against pressure',
          '2 MPa more behind the slot', added(2e6)),
)}


def apply_faults(design: Vibrator, severities: Mapping[str, float]) -> Vibrator:
    """
    Return the design with these faults, by name and severity from 0 (healthy) to 1.

    Pump flow and preload are those that arrive at the machine when it is told those of `design`.
    Raises VibratorError for an unknown fault, a severity outside [0, 1], or a design that the
    faults make impossible.
    """
    changes = {}
    for name, severity in severities.items():
        if name not in FAULTS:
            raise VibratorError(f'no fault "{name}"; there are: {", ".join(FAULTS)}')
        if not 0.0 <= severity <= 1.0:
            raise VibratorError(f'severity of {name} = {severity:g} is outside [0, 1]')
        fault = FAULTS[name]
        if severity > 0.0:
            value = changes.get(fault.field, getattr(design, fault.field))
            changes[fault.field] = fault.changed(value, severity)
    return design.replace(**changes)
