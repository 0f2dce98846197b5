"""The designs of an optimisation: from free fields to figures, objectives and constraints."""
from __future__ import annotations

import numpy as np
from pymoo.core.problem import Problem

from hpv_twin.model import Vibrator
from hpv_twin.model.batch import BATCH_REGIMES
from hpv_twin.model.designs import Designs
from hpv_twin.model.equations import seat_contact_pressure, slotted_spring_mass
from hpv_twin.model.regimes import HELD_OPEN, HOVERING, OFF_SEAT, PARTIAL, SEAT_REBOUND, SEATED
from hpv_twin.model.spring_strength import (
    buckling_room,
    greatest_stress,
    jumper_edge,
    slot_room,
)

from .front import minimised
from .goals import Goals, bound_of_28

HOPELESS = 1e30  # objective of a design that has no such figure; its constraints tell it apart
# How far from seated motion a regime is: the search goes down this slope.
DISTANCE = np.array([{SEATED: 0.0, PARTIAL: 0.4, SEAT_REBOUND: 0.5, OFF_SEAT: 1.0, HOVERING: 1.5,
                      HELD_OPEN: 1.5}.get(name, 2.0) for name in BATCH_REGIMES])
ROUNDING = 1e-9
DERIVED = ('jumper_edge', 'spring_stress', 'spring_slots', 'spring_buckling', 'seat_pressure',
           'flow_bound', 'band_miss')


class DesignProblem(Problem):
    """pymoo's view of the designs: minimise the objectives with all constraints at most 0."""

    def __init__(self, base: Vibrator, goals: Goals, farm):
        self.base, self.goals, self.farm = base, goals, farm
        self.names = tuple(goals.bounds)
        self.latest: dict = {}  # the columns of the designs evaluated last
        low, high = np.array(list(goals.bounds.values())).T
        super().__init__(n_var=len(self.names), n_obj=len(goals.objectives),
                         n_ieq_constr=len(goals.constraints), xl=low, xu=high)
        spring = goals.spring
        edge = jumper_edge(base.slotted_spring_stiffness, spring.rings, spring.mean_radius,
                           spring.youngs_modulus)
        # Of the plunger's mass this much is not its spring.
        self.alone = base.plunger_mass - slotted_spring_mass(edge, spring.rings,
                                                             spring.mean_radius, spring.density)
        self.mass_follows = ('slotted_spring_stiffness' in self.names
                             and 'plunger_mass' not in self.names and self.alone > 0.0)
        self.columns = (*self.names, *(('plunger_mass',) if self.mass_follows else ()))

    def designs(self, x: np.ndarray) -> Designs:
        """Return the designs of rows of free fields, shape (n, fields); m1 follows k1 by (4)."""
        fields = dict(zip(self.names, np.atleast_2d(x).T, strict=True))
        if self.mass_follows:
            spring = self.goals.spring
            edge = jumper_edge(fields['slotted_spring_stiffness'], spring.rings,
                               spring.mean_radius, spring.youngs_modulus)
            fields['plunger_mass'] = self.alone + slotted_spring_mass(
                edge, spring.rings, spring.mean_radius, spring.density)
        return Designs(self.base, **fields)

    def measure(self, x: np.ndarray) -> dict:
        """Return all columns of the designs: fields, figures of the batch, what limits are on."""
        designs = self.designs(x)
        count = len(designs)
        fields = {name: np.broadcast_to(getattr(designs, name), count) for name in self.columns}
        figures = self.farm.run(designs)
        spring = self.goals.spring
        edge = jumper_edge(designs.slotted_spring_stiffness, spring.rings, spring.mean_radius,
                           spring.youngs_modulus)
        deflection = designs.preload + designs.stroke
        force = designs.slotted_spring_stiffness * deflection
        derived = (
            edge, greatest_stress(force, edge, spring.mean_radius),
            slot_room(deflection, edge, spring.rings),
            buckling_room(deflection, edge, spring.rings, spring.mean_radius),
            seat_contact_pressure(designs.twisted_spring_stiffness,
                                  designs.twisted_spring_preload, designs.sleeve_seat_diameter),
            bound_of_28(designs), band_miss(figures['frequency'], self.goals.band))
        return fields | figures | {
            name: np.broadcast_to(values, count)
            for name, values in zip(DERIVED, derived, strict=True)} | {
            'full_stroke': figures['stroke'] / designs.stroke,
            'geometry': designs.plunger_seat_diameter / designs.sleeve_seat_diameter}

    def objectives(self, columns: dict) -> np.ndarray:
        """Return what is minimised, shape (n, objectives)."""
        return np.nan_to_num(minimised(columns, self.goals.objectives), nan=HOPELESS,
                             posinf=HOPELESS)

    def constraints(self, columns: dict) -> np.ndarray:
        """Return how far each constraint is missed, at most 0 where it is kept."""
        limits = self.goals.limits
        missed = {
            'geometry': np.where(columns['geometry'] < 1.0, 0.0, columns['geometry']),
            'seated': DISTANCE[columns['regime_code']],
            'period_1': np.nan_to_num(columns['period_spread'], nan=1.0) - limits.period_spread,
            'full_stroke': 1.0 - ROUNDING - columns['full_stroke'],
            'spring_stress': columns['spring_stress'] / limits.spring_stress - 1.0,
            'spring_slots': 1.0 - columns['spring_slots'] / limits.spring_slots,
            'spring_buckling': np.maximum(
                1.0 - columns['spring_buckling'] / limits.spring_buckling, -1.0),
            'seat_pressure': 1.0 - columns['seat_pressure'] / limits.seat_pressure,
            'flow_capacity': columns['flow_bound'] / limits.flow_capacity - 1.0,
            'peak_pressure': np.nan_to_num(columns['peak_pressure'] / limits.peak_pressure - 1.0,
                                           nan=1.0)}
        return np.stack([missed[name] for name in self.goals.constraints], axis=1)

    def _evaluate(self, x, out, *_args, **_kwargs):
        self.latest = self.measure(x)
        out['F'], out['G'] = self.objectives(self.latest), self.constraints(self.latest)


def band_miss(frequency, band: tuple[float, float]) -> np.ndarray:
    """By how many Hz frequencies lie outside a band."""
    low, high = band
    return np.maximum(np.maximum(low - frequency, frequency - high), 0.0)
