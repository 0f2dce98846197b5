"""The machine to look at: the parts of the paper's Figure 1 with the measures of one design.

Seat diameters, stroke and gap are the design's. Wall thicknesses, lengths and the number of coils
are not in it: they are drawn in plausible proportion to the larger seat. What moves is drawn with
its motion magnified, and so is every gap along the axis. Millimetres, from the plunger's seat.
"""
from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hpv_twin.model.vibrator import Vibrator
from hpv_twin.viewer import palette, solids
from hpv_twin.viewer.solids import Profile, Solid

STROKE_SHARE = 0.5  # of the larger seat's diameter: how long a stroke is drawn
COILS, RINGS = 4, 6  # of the twisted and of the slotted spring
FIELD_OF_VIEW = 0.535  # tangent of half of what the viewer shows of the height
BEHIND = 0.3  # mm; oil lies behind the cut faces of the metal
STEEL, DARK_STEEL, BRIGHT_STEEL = 0x868E96FF, 0x5C636AFF, 0xDEE2E6FF


@dataclass(frozen=True)
class Part:
    """A solid of one colour (0xRRGGBBAA) that moves with `entity`."""

    entity: str
    solid: Solid
    colour: int


@dataclass(frozen=True)
class Label:
    """Text at `place` (x, y), with a line to what it names, at `target`; without one if None."""

    text: str
    place: tuple[float, float]
    target: tuple[float, float] | None = None


class Drawing:
    """A design as solids and labels. `magnification`: how many times motion is drawn."""

    def __init__(self, vibrator: Vibrator):
        d1, d2 = 1e3 * vibrator.plunger_seat_diameter, 1e3 * vibrator.sleeve_seat_diameter
        self.magnification = _round_number(STROKE_SHARE * d2 / (1e3 * vibrator.stroke))
        self.stroke = 1e3 * vibrator.stroke * self.magnification
        self.gap = 1e3 * vibrator.gap * self.magnification
        self.seat, self.ring = d1 / 2.0, d2 / 2.0
        unit = self.unit = self.ring
        self.stem = self.seat + 0.3 * (self.ring - self.seat)
        self.guide, self.rod = 1.25 * unit, 0.75 * unit
        self.drain, self.outer = 1.8 * unit, 2.4 * unit
        self.left = -2.2 * unit
        self.ring_seat = 0.75 * unit
        self.collar = self.ring_seat + 0.6 * unit  # where the stepped sleeve sits
        self.twisted_length = self.stroke + 0.7 * unit
        self.cylinder = self.collar + 0.2 * unit + self.twisted_length
        self.guide_left = max(self.cylinder, self.collar + self.gap) + 0.4 * unit
        self.guide_right = self.guide_left + 0.9 * unit
        self.slotted_length = self.stroke + 2.2 * unit
        self.slotted_right = self.guide_right + self.slotted_length
        self.nut_right = self.slotted_right + 1.5 * unit
        self.right = self.nut_right + 1.0 * unit + self.stroke

    @property
    def bore(self) -> float:
        """Radius of cavity A."""
        return 1.3 * self.seat

    def eye(self) -> tuple[float, float]:
        """Return where on the axis to look, and from how far, to see all in a view 5 : 3."""
        return ((self.left + self.right) / 2.0,
                (self.right - self.left + 1.2 * self.unit) / 2.0 / (5.0 / 3.0) / FIELD_OF_VIEW)

    def parts(self) -> list[Part]:
        """Return what is made of metal."""
        plunger = int(palette.PLUNGER.rgba())
        sleeve = int(palette.VALVE_SLEEVE.rgba())
        return [
            Part('fixed/body', solids.turned(self._body()), STEEL),
            Part('fixed/cylinder', solids.turned(self._cylinder()), STEEL),
            Part('fixed/cap_nut', solids.turned(self._cap_nut()), DARK_STEEL),
            Part('fixed/cylindrical_sleeve', solids.turned(self._support()), BRIGHT_STEEL),
            Part('plunger/solid', solids.turned(self._plunger(), solids.WHOLE), plunger),
            Part('valve_sleeve/solid', solids.turned(self._sleeve()), sleeve),
            Part('slotted_spring/coils', self._slotted_spring(), BRIGHT_STEEL),
            Part('twisted_spring/coils', self._twisted_spring(), BRIGHT_STEEL)]

    def oil(self) -> dict[str, Solid]:
        """Return the oil in the chambers A, B and C, behind the metal."""
        a, b, unit = self.seat, self.ring, self.unit
        end = self.guide_left + self.stroke
        nipple = self._nipple
        pipe = solids.flat([(nipple - 0.25 * unit, -self.outer - 0.5 * unit),
                            (nipple + 0.25 * unit, -self.outer - 0.5 * unit),
                            (nipple + 0.25 * unit, -self.drain),
                            (nipple - 0.25 * unit, -self.drain)], -BEHIND)
        return {
            'A': solids.section([(self.left, 0.0, self.bore), (-0.5 * unit, 0.0, self.bore),
                                 (0.0, 0.0, a)], BEHIND),
            'B': solids.section([(0.0, 0.0, a), (0.15 * unit, 0.0, b),
                                 (self.ring_seat, 0.0, b)], BEHIND),
            'C': solids.join([solids.section([
                (self.ring_seat, 0.0, self.drain), (self.cylinder, 0.0, self.drain),
                (self.cylinder, 0.0, self.guide), (end, 0.0, self.guide)], BEHIND), pipe])}

    @property
    def _nipple(self) -> float:
        """Where hole b with the nipple is."""
        return (self.collar + self.cylinder) / 2.0

    def labels(self) -> list[Label]:
        """Return the names of parts and chambers, as the paper numbers them."""
        unit, above, below = self.unit, 1.3 * self.outer, -1.3 * self.outer
        middle = (self.guide_right + self.slotted_right) / 2.0
        spring = (self.collar + self.cylinder) / 2.0
        return [
            Label('1 body', (-1.5 * unit, above), (-1.2 * unit, 0.8 * self.outer)),
            Label('9 valve sleeve', (1.0 * unit, above), (self.ring_seat + 0.3 * unit, self.ring)),
            Label('10 twisted spring', (spring + 0.9 * unit, 1.12 * above),
                  (spring, 1.5 * unit)),
            Label('2 cylinder', (self.guide_right + 0.6 * unit, above),
                  (self.guide_right + 0.4 * unit, 0.8 * self.outer)),
            Label('13 slotted spring', (middle + 0.7 * unit, 1.12 * above),
                  (middle + 0.3 * unit, 1.1 * unit)),
            Label('14 cap nut', (self.nut_right, above), (self.nut_right - 0.3 * unit, 1.7 * unit)),
            Label('A pressure', (-1.6 * unit, below), (-1.4 * unit, 0.0)),
            Label('B', (0.2 * unit, below), (0.5 * unit, -0.75 * unit)),
            Label('C drain', (self._nipple, below)),
            Label('8 plunger', (self.guide_left + 0.9 * unit, below),
                  (self.guide_left + 0.5 * unit, -0.4 * unit)),
            Label('D', (middle, below), (middle, -1.0 * unit)),
            Label('18 rod', (self.nut_right + 0.7 * unit, below),
                  (self.nut_right + 0.6 * unit, -0.4 * unit))]

    def _body(self) -> Profile:
        """Part 1, with both seats."""
        unit, outer = self.unit, self.outer
        return [(self.left, self.bore, outer), (-0.5 * unit, self.bore, outer),
                (0.0, self.seat, outer), (0.15 * unit, self.ring, outer),
                (self.ring_seat, self.ring, outer), (self.ring_seat, self.drain, outer),
                (self.cylinder, self.drain, outer)]

    def _cylinder(self) -> Profile:
        """Part 2, with the bore for the plunger's guide."""
        flange = self.cylinder + 0.5 * self.unit
        return [(self.cylinder, self.guide, self.outer), (flange, self.guide, self.outer),
                (flange, self.guide, 0.88 * self.outer),
                (self.slotted_right + 0.6 * self.unit, self.guide, 0.88 * self.outer)]

    def _support(self) -> Profile:
        """Part 15, which the spring rests on."""
        return [(self.slotted_right, self.rod, self.guide),
                (self.slotted_right + 0.9 * self.unit, self.rod, self.guide)]

    def _cap_nut(self) -> Profile:
        """Part 14."""
        begin = self.slotted_right + 0.6 * self.unit
        inside = self.slotted_right + 0.9 * self.unit
        return [(begin, self.guide, 0.78 * self.outer), (inside, self.guide, 0.78 * self.outer),
                (inside, 1.05 * self.rod, 0.78 * self.outer),
                (self.nut_right, 1.05 * self.rod, 0.78 * self.outer)]

    def _plunger(self) -> Profile:
        """Parts 8 and 18: the cone on the small seat, the guide and the rod."""
        tip = 0.25 * self.unit
        steepness = (self.stem - self.seat) / tip
        return [(-tip, 0.0, max(self.seat - steepness * tip, 0.3 * self.seat)),
                (tip, 0.0, self.stem), (self.guide_left, 0.0, self.stem),
                (self.guide_left, 0.0, self.guide), (self.guide_right, 0.0, self.guide),
                (self.guide_right, 0.0, self.rod), (self.right - self.stroke, 0.0, self.rod)]

    def _sleeve(self) -> Profile:
        """Parts 9 and 11: the cone on the larger seat, and the step that the spring pushes."""
        unit, x = self.unit, self.ring_seat
        bore, waist = self.stem, 0.9 * unit
        return [(x - 0.15 * unit, bore, 0.85 * unit), (x + 0.2 * unit, bore, 1.2 * unit),
                (x + 0.35 * unit, bore, 1.2 * unit), (x + 0.35 * unit, bore, waist),
                (self.collar, bore, waist), (self.collar, bore, 1.65 * unit),
                (self.collar + 0.2 * unit, bore, 1.65 * unit),
                (self.collar + 0.2 * unit, bore, waist), (self.guide_left - self.gap, bore, waist)]

    def _slotted_spring(self) -> Solid:
        """Part 13, its right end at x = 0: rings between slots, jumpers in turn at 0 and 90 deg."""
        inner, outer = self.rod + 0.08 * self.unit, self.guide - 0.08 * self.unit
        pitch = self.slotted_length / (RINGS + 0.6)
        rings, jumpers = [], []
        for k in range(RINGS + 1):
            begin = -self.slotted_length + k * pitch
            left, right = begin + 0.6 * pitch, begin + pitch
            rings.append(solids.turned([(begin, inner, outer), (left, inner, outer)]))
            if k == RINGS:
                break
            if k % 2:  # above and below, in the plane of the cut
                jumpers.append(solids.section([(left, inner, outer), (right, inner, outer)], 0.1))
            else:
                depth, half = inner, 0.35 * self.unit
                jumpers.append(solids.flat([(left, -half), (right, -half), (right, half),
                                            (left, half)], depth))
        return solids.join(rings + jumpers)

    def _twisted_spring(self) -> Solid:
        """Part 10, its right end at x = 0: the half turns behind the cut."""
        wire = 0.13 * self.unit
        pitch = (self.twisted_length - 2.0 * wire) / COILS
        around = np.linspace(0.0, math.pi, 25)
        turns = []
        for k in range(COILS):
            x = -self.twisted_length + wire + pitch * (k + 0.25 + 0.5 * around / math.pi)
            turns.append(solids.tube(np.stack([x, 1.5 * self.unit * np.cos(around),
                                               -1.5 * self.unit * np.sin(around)], axis=1), wire))
        return solids.join(turns)


def _round_number(value: float) -> float:
    """Return the largest of 1, 2, 3, 4, 5, 6, 8, 10, 20 … that is not above `value`, at least 1."""
    decade = 10.0 ** math.floor(math.log10(max(value, 1.0)))
    return max(step * decade for step in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
               if step * decade <= max(value, 1.0))
