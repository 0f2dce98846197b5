"""A machine to measure: a design with faults, told what to do from outside."""
from __future__ import annotations

from collections.abc import Mapping

from .faults import FAULTS, apply_faults
from .simulation import SETPOINTS, Simulation
from .vibrator import Vibrator

# Fields that a fault can change beside the setpoints.
INNER = tuple(dict.fromkeys(fault.field for fault in FAULTS.values()
                            if fault.field not in SETPOINTS))


class Machine:
    """
    A `design` with the faults `severities` (by name, from 0 to 1), from rest.

    Setpoints are what it is told; what arrives, in `simulation`, is less where the pump leaks or
    the spring has set. One thread uses it.
    """

    def __init__(self, design: Vibrator, severities: Mapping[str, float] | None = None):
        self.told = design
        self.severities = dict(severities or {})
        self.simulation = Simulation(apply_faults(design, self.severities))

    def set(self, field: str, value: float) -> None:
        """Tell it another pump_flow, preload or load, SI; VibratorError leaves it as it was."""
        self._become(self.told.replace(**{field: value}), self.severities)

    def set_fault(self, name: str, severity: float) -> None:
        """Let a fault be so severe from now on; VibratorError leaves it as it was."""
        self._become(self.told, {**self.severities, name: severity})

    def tick(self, duration: float):
        """Run for `duration` s; the rows of the switches, as Simulation.tick returns them."""
        return self.simulation.tick(duration)

    def _become(self, told, severities):
        design = apply_faults(told, severities)
        self.simulation.redesign(**{field: getattr(design, field) for field in INNER})
        for field in SETPOINTS:
            setattr(self.simulation, field, getattr(design, field))
        self.told, self.severities = told, severities
