"""The model as the node runs it: ticks, setpoints, the figures of the last cycle. No ROS."""
from __future__ import annotations

from hpv_twin.model import Cycle, CycleFinder, Simulation, Vibrator, kernel
from hpv_twin.model.regimes import OSCILLATING, name_regime


class Plant:
    """A simulation that finds its cycles as it goes, for one thread."""

    def __init__(self, vibrator: Vibrator, ambient_pressure: float, sample_rate: float = 0.0):
        """With `sample_rate`, Hz of model time, each tick leaves the kernel's `samples`."""
        self.simulation = Simulation(vibrator)
        self.ambient_pressure = ambient_pressure
        self.sample_rate = sample_rate
        self.samples = None
        self.sleeve_ratio = float(kernel.parameters(vibrator)[kernel.SLEEVE_RATIO])
        self.reset()

    def reset(self) -> None:
        """Back to rest; setpoints stay."""
        self.simulation.reset()
        self._finder = CycleFinder(self.simulation.vibrator.stroke)
        self.cycle: Cycle | None = None

    def set(self, field: str, value: float) -> None:
        """Put a setpoint in force from the present instant on."""
        setattr(self.simulation, field, value)

    def tick(self, duration: float) -> list[Cycle]:
        """Run for `duration` s of model time; return the cycles completed."""
        if self.sample_rate:
            rows, self.samples = self.simulation.sampled_tick(duration, self.sample_rate)
        else:
            rows = self.simulation.tick(duration)
        cycles = self._finder.feed(rows) if len(rows) else []
        if cycles:
            self.cycle = cycles[-1]
        return cycles

    def stopped(self) -> bool:
        """True once when the oscillation that was going on has ended."""
        if self.cycle is None or self.regime in OSCILLATING:
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
        """What the machine is doing, by the names of hpv_twin.model.regimes."""
        return name_regime(self.simulation, self.cycle)
