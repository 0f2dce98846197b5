"""The energy ledger: where the pump's work goes, term by term, from rest on."""
from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from . import kernel

# Stages in which plunger and sleeve move as one.
BOTH_MASSES = (kernel.SLOT, kernel.OPEN, kernel.RETURN_HIGH)


@dataclass(frozen=True)
class EnergyLedger:
    """
    Energies in J since rest.

    Two balances close, each but for its `..._residual`:

    oil: pump_work = oil_energy + slot_loss + displaced_work - clamp_work;
    plunger: pressure_work + dashpot_work + sleeve_spring_work = kinetic_energy + spring_energy +
    load_energy + friction_loss + stop_loss + seat_loss + mass_switched_out - mass_switched_in -
    setpoint_work.

    `displaced_work` - `pressure_work` (about 5 % of the pump's) drives the sleeve while it travels
    alone. The mass switches are an artefact of taking m2 along from h_s to h_b and letting it go
    at h_b - h_s on the way back: about 0.2 % of the pump's work.
    """

    pump_work: float = 0.0  # ∫p Q_H dt
    slot_loss: float = 0.0  # ∫p Q_slot dt
    displaced_work: float = 0.0  # ∫p A_v v dt
    clamp_work: float = 0.0  # ∫p Q_added dt, what holds the pressure at vacuum
    pressure_work: float = 0.0  # ∫A (p - p_dp) v dt
    dashpot_work: float = 0.0  # ∫F_HL v dt
    sleeve_spring_work: float = 0.0  # ∫F_k2 v dt
    friction_loss: float = 0.0  # ∫c1 v² dt
    stop_loss: float = 0.0  # kinetic energy lost at h_b
    seat_loss: float = 0.0  # kinetic energy lost at the seat
    mass_switched_in: float = 0.0  # ½ m2 v² where the sleeve joins
    mass_switched_out: float = 0.0  # ½ m2 v² where it is let go
    setpoint_work: float = 0.0  # work of changing preload and load
    oil_energy: float = 0.0  # W0 p²/2κ now
    kinetic_energy: float = 0.0  # ½ m v² now
    spring_energy: float = 0.0  # ½ k1 ((y + y01)² - y01²), the preload that of the start
    load_energy: float = 0.0  # F_T y now

    @property
    def oil_residual(self) -> float:
        """What the balance of the oil misses, J."""
        return (self.pump_work - self.oil_energy - self.slot_loss - self.displaced_work
                + self.clamp_work)

    @property
    def plunger_residual(self) -> float:
        """What the balance of the plunger misses, J."""
        put_in = self.pressure_work + self.dashpot_work + self.sleeve_spring_work
        held = self.kinetic_energy + self.spring_energy + self.load_energy
        lost = (self.friction_loss + self.stop_loss + self.seat_loss + self.mass_switched_out
                - self.mass_switched_in - self.setpoint_work)
        return put_in - held - lost


class Account:
    """Collects the energies of one simulation: `integrals` is filled by the kernel."""

    def __init__(self, simulation):
        self._simulation = simulation
        self.integrals = np.zeros(kernel.ACCOUNT_SIZE)
        self.reset()

    def reset(self) -> None:
        """Begin again, at rest."""
        self.integrals[:] = 0.0
        self._preload = self._simulation.preload
        self._sums = dict.fromkeys(('stop_loss', 'seat_loss', 'mass_switched_in',
                                    'mass_switched_out', 'setpoint_work'), 0.0)

    def note_rows(self, rows) -> None:
        """Take in what is lost and switched at the located switches; rows as the kernel logs."""
        vibrator = self._simulation.vibrator
        for row in rows:
            before, after = int(row[kernel.ROW_BEFORE]), int(row[kernel.ROW_AFTER])
            square = 0.5 * row[kernel.ROW_V] ** 2
            mass = vibrator.plunger_mass
            if after == kernel.OPEN:
                self._sums['stop_loss'] += (mass + vibrator.sleeve_mass) * square
            elif after == kernel.CLOSED:
                self._sums['seat_loss'] += mass * square
            elif before not in BOTH_MASSES and after in BOTH_MASSES:
                self._sums['mass_switched_in'] += vibrator.sleeve_mass * square
            elif before in BOTH_MASSES and after not in BOTH_MASSES:
                self._sums['mass_switched_out'] += vibrator.sleeve_mass * square

    def note_setpoints(self, preload, load) -> None:
        """Take in the work of setting preload (m) and load (N) to these, from those in force."""
        simulation = self._simulation
        y, k1 = simulation.plunger_position, simulation.vibrator.slotted_spring_stiffness
        if simulation.time == 0.0 and y == 0.0:
            self._preload = preload
            return
        stretch = (y + preload) ** 2 - (y + simulation.preload) ** 2
        self._sums['setpoint_work'] += 0.5 * k1 * stretch + (load - simulation.load) * y

    def ledger(self) -> EnergyLedger:
        """The ledger at the present instant."""
        simulation, vibrator = self._simulation, self._simulation.vibrator
        names = [field.name for field in dataclasses.fields(EnergyLedger)]
        integrals = dict(zip(names[:kernel.LEDGER_SIZE], self.integrals.tolist(), strict=False))
        mass = vibrator.plunger_mass
        if simulation.stage in BOTH_MASSES:
            mass += vibrator.sleeve_mass
        y, k1 = simulation.plunger_position, vibrator.slotted_spring_stiffness
        return EnergyLedger(
            **integrals, **self._sums,
            oil_energy=(vibrator.cavity_volume * simulation.pressure ** 2
                        / (2.0 * vibrator.bulk_modulus)),
            kinetic_energy=0.5 * mass * simulation.plunger_velocity ** 2,
            spring_energy=0.5 * k1 * ((y + simulation.preload) ** 2 - self._preload ** 2),
            load_energy=simulation.load * y)
