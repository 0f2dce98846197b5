"""The model as the node runs it: ticks, setpoints, the figures of the last cycle. No ROS."""
from __future__ import annotations

from hpv_twin.model import Cycle, CycleFinder, Simulation, Vibrator

# Oscillation has stopped when no cycle was completed for so many periods of the last one,
REMEMBERED_PERIODS = 3.0
# but a machine this slow is still oscillating, s of model time.
SLOWEST_PERIOD = 1.0


class Plant:
    """A simulation that finds its cycles as it goes, for one thread."""

    def __init__(self, vibrator: Vibrator, ambient_pressure: float):
        self.simulation = Simulation(vibrator)
        self.ambient_pressure = ambient_pressure
        self.reset()

    def reset(self) -> None:
        """Back to rest; setpoints stay."""
        self.simulation.reset()
        self._finder = CycleFinder(self.simulation.vibrator.stroke)
        self._last_end = 0.0
        self.cycle: Cycle | None = None

    def set(self, field: str, value: float) -> None:
        """Put a setpoint in force from the present instant on."""
        setattr(self.simulation, field, value)

    def tick(self, duration: float) -> list[Cycle]:
        """Run for `duration` s of model time; return the cycles completed."""
        rows = self.simulation.tick(duration)
        cycles = self._finder.feed(rows) if len(rows) else []
        if cycles:
            self.cycle = cycles[-1]
            self._last_end = self.cycle.start + self.cycle.period
        return cycles

    def stopped(self) -> bool:
        """True once when the oscillation that was going on has ended."""
        if self.cycle is None:
            return False
        patience = max(REMEMBERED_PERIODS * self.cycle.period, SLOWEST_PERIOD)
        if self.simulation.time - self._last_end < patience:
            return False
        self.cycle = None
        return True

    def pressure_values(self) -> tuple[float]:
        """Value of the pressure message: absolute, Pa."""
        return (self.simulation.pressure + self.ambient_pressure,)

    def position_values(self) -> tuple[float, ...]:
        """Values of the position message: positions m, velocities m/s, efforts N."""
        simulation = self.simulation
        return (simulation.plunger_position, simulation.sleeve_position,
                simulation.plunger_velocity, simulation.sleeve_velocity,
                simulation.plunger_force, simulation.sleeve_force)

    @property
    def regime(self) -> str:
        """What the machine is doing, in the words of the last cycle."""
        if self.cycle is not None:
            return self.cycle.regime
        return 'starting' if self._last_end == 0.0 else 'not oscillating'
