"""The frequency hold between the node's callbacks and the loop."""
from __future__ import annotations

import time

from hpv_twin.tracking.frequency_map import FrequencyMap
from hpv_twin.tracking.hold import MEASURED, OFF, FrequencyHold

MEASURED_FOR = 0.5  # s after which the twin's own cycles count again


class Steering:
    """
    Holds a frequency by setting the loop's pump flow. No ROS.

    A measured machine's frequency counts before the twin's own.

    Maps are computed by whoever calls (some ms, without Python's lock); what has been computed
    is handed to the loop's thread, which alone touches the hold. `highest()` is the greatest pump
    flow that is accepted now, m³/s.
    """

    def __init__(self, loop, highest):
        self._loop, self._highest = loop, highest
        self.hold = FrequencyHold(FrequencyMap.none())
        self._measured_until = 0.0
        loop.after_tick.append(self._steer)

    def map(self, **setpoints: float) -> FrequencyMap:
        """Return the map at the setpoints in force, but for those given."""
        return FrequencyMap.of(self._loop.plant.simulation.design.replace(**setpoints),
                               self._highest())

    # Called by the executor's thread -------------------------------------------------------------

    def want(self, target: float) -> None:
        """Hold this frequency, Hz; 0 hands the pump flow back and leaves it as it is."""
        if target == 0.0:
            self._loop.post(lambda _stamp: self.hold.release())
            return
        frequency_map = self.map()
        self._loop.post(lambda _stamp: self._flow(
            self.hold.engage(target, self._loop.plant.simulation.pump_flow, frequency_map)))

    def setpoint(self, field: str, value: float) -> None:
        """Put a setpoint in force; a pump flow ends the hold, others change its map."""
        if not self.hold.active:
            self._loop.set(field, value)
        elif field == 'pump_flow':
            # In one call, or a command on its way could come after it.
            self._loop.post(lambda _stamp: (self.hold.release(), self._loop.set(field, value)))
        else:
            self.renew(**{field: value})

    def renew(self, **setpoints: float) -> None:
        """Put setpoints in force together with the map that goes with them."""
        frequency_map = self.map(**setpoints)

        def change(_stamp):
            for field, value in setpoints.items():
                self._loop.set(field, value)
            self._flow(self.hold.use(frequency_map, self._loop.plant.simulation.pump_flow))
        self._loop.post(change)

    # Called by the thread that follows a machine -------------------------------------------------

    def measured(self, frequency: float) -> None:
        """Take the frequency of a measured machine, Hz; for a while it counts, not the twin's."""
        self._loop.post(lambda _stamp: self._take(frequency))

    def _take(self, frequency):
        simulation = self._loop.plant.simulation
        self._measured_until = time.monotonic() + MEASURED_FOR
        self._flow(self.hold.cycle(simulation.time, frequency, simulation.pump_flow,
                                   gains=MEASURED))

    # Called by the loop's thread -----------------------------------------------------------------

    def _steer(self, cycles, stopped):
        hold, simulation = self.hold, self._loop.plant.simulation
        for cycle in cycles if time.monotonic() > self._measured_until else ():
            self._flow(hold.cycle(simulation.time, cycle.frequency, simulation.pump_flow,
                                  cycle.regime))
        if stopped:
            hold.lost(simulation.pump_flow)
            self._flow(hold.command(simulation.pump_flow))

    def _flow(self, flow):
        if self.hold.active and flow != self._loop.plant.simulation.pump_flow:
            self._loop.set('pump_flow', flow)

    # Called by the report ------------------------------------------------------------------------

    def report(self) -> tuple[bool, str, dict]:
        """Return whether all is as wanted, that in words, and the values behind it."""
        hold = self.hold
        if hold.state == OFF:
            return True, 'off: the pump flow is set from outside', {}
        values = {'target [Hz]': f'{hold.target:.3f}', 'state': hold.state,
                  'frequency [Hz]': f'{hold.frequency:.3f}',
                  'error [%]': f'{100.0 * hold.error:.3f}',
                  'flow needed / flow by the model': f'{hold.ratio:.4f}'}
        if hold.limited:
            return False, hold.limited, values
        return True, f'{hold.state} {hold.target:.2f} Hz', values
