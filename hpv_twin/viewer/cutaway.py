"""The cutaway of the machine as rerun's columns: what stands, what moves, and the oil's colour."""
from __future__ import annotations

import numpy as np
import rerun as rr

from hpv_twin.model.vibrator import Vibrator
from hpv_twin.viewer import palette
from hpv_twin.viewer.drawing import Drawing, Label
from hpv_twin.viewer.signals import Machine, Signal

RESOLUTION = 1e-6  # m; what moves less is not sent anew
SHADES = 64  # of the oil
ANNOTATION = 0xCED4DAFF
OIL_LOW = 0x2B2A33  # colour of oil without pressure; under pressure it is the pressure's own


def has_cutaway(machine: Machine) -> bool:
    """Whether both moving parts are recorded, by the names the twin gives them."""
    return {'plunger', 'valve_sleeve'} <= machine.joints.keys()


class Cutaway:
    """One machine's cutaway, drawn from `vibrator`; `ambient` in Pa, `full` gauge Pa."""

    def __init__(self, machine: Machine, vibrator: Vibrator, ambient: float):
        self._machine, self._ambient = machine, ambient
        self.root = f'{machine.name}/cutaway'  # the entity below which it stands
        self.drawing = Drawing(vibrator)
        self._drain = vibrator.drain_pressure
        pressure = machine.pressures.get('pressure')
        self.full = 1e6 * np.ceil(np.nanmax(pressure.values - ambient) * 1e-6) if pressure else 1e6

    def title(self) -> str:
        """Return what a person has to know to read the drawing."""
        return (f'Cutaway: motion ×{self.drawing.magnification:g}; oil dark 0, '
                f'bright {self.full * 1e-6:g} MPa gauge')

    def send(self, stream: rr.RecordingStream, indexes) -> None:
        """Send everything; `indexes(time)` returns rerun's time columns."""
        for part in self.drawing.parts():
            _mesh(stream, f'{self.root}/{part.entity}', part.solid, part.colour)
        for name, solid in self.drawing.oil().items():
            _mesh(stream, f'{self.root}/oil/{name}', solid, None)
        _annotate(stream, self.root, self.drawing.labels())
        drained = self.colours(np.array([self._drain]))
        for name in self.drawing.oil():
            if name == 'C' or 'pressure' not in self._machine.pressures:
                stream.log(f'{self.root}/oil/{name}',
                           rr.Mesh3D.from_fields(albedo_factor=drained), static=True)
        for spring, seat in (('slotted_spring', self.drawing.slotted_right),
                             ('twisted_spring', self.drawing.cylinder)):
            stream.log(f'{self.root}/{spring}', rr.Transform3D(translation=[seat, 0.0, 0.0]),
                       static=True)
        self.send_motion(stream, indexes, self._machine)

    def send_motion(self, stream, indexes, machine: Machine) -> None:
        """Move what moves, and colour the oil, by what was recorded of `machine`."""
        self._move(stream, indexes, machine)
        if 'pressure' in machine.pressures:
            self._colour(stream, indexes, machine)

    def _move(self, stream, indexes, machine: Machine) -> None:
        """Move plunger and valve sleeve, and press their springs together."""
        drawing = self.drawing
        for name, spring, length in (('plunger', 'slotted_spring', drawing.slotted_length),
                                     ('valve_sleeve', 'twisted_spring', drawing.twisted_length)):
            signal = changes(machine.joints[name], RESOLUTION)
            moved = 1e3 * drawing.magnification * signal.values
            stream.send_columns(f'{self.root}/{name}', indexes(signal.time),
                                rr.Transform3D.columns(translation=_along(moved, 0.0)))
            scale = np.maximum(1.0 - moved / length, 0.05)
            stream.send_columns(f'{self.root}/{spring}/coils', indexes(signal.time),
                                rr.Transform3D.columns(scale=_along(scale, 1.0)))
            stream.flush()

    def _colour(self, stream, indexes, machine: Machine) -> None:
        """Colour the oil: B has the pressure of A while the plunger is off its seat."""
        pressure, plunger = machine.pressures['pressure'], machine.joints['plunger']
        lifted = np.interp(pressure.time, plunger.time, plunger.values) > RESOLUTION
        gauge = pressure.values - self._ambient
        for name, values in (('A', gauge), ('B', np.where(lifted, gauge, self._drain))):
            shown = changes(Signal(pressure.time, values), self.full / SHADES)
            stream.send_columns(
                f'{self.root}/oil/{name}', indexes(shown.time),
                rr.Mesh3D.columns(albedo_factor=self.colours(shown.values)))

    def colours(self, gauge: np.ndarray) -> np.ndarray:
        """Return 0xRRGGBBAA (uint32) of gauge pressures (Pa)."""
        share = np.clip(gauge / self.full, 0.0, 1.0)[:, None]
        low, high = (np.array(list(colour.to_bytes(3, 'big')), dtype=float)
                     for colour in (OIL_LOW, palette.PRESSURE.colour))
        parts = np.rint(low + share * (high - low)).astype(np.uint32)
        return (parts << np.array([24, 16, 8], dtype=np.uint32)).sum(axis=1, dtype=np.uint32) | 0xFF


def changes(signal: Signal, resolution: float) -> Signal:
    """Return the samples at which a value differs from the one before by about `resolution`."""
    steps = np.rint(np.nan_to_num(signal.values) / resolution)
    kept = np.diff(steps, prepend=steps[:1] - 1.0) != 0.0
    return Signal(signal.time[kept], signal.values[kept])


def _along(values: np.ndarray, others: float) -> np.ndarray:
    """Return vectors with `values` along the axis."""
    vectors = np.full((len(values), 3), others, dtype=np.float32)
    vectors[:, 0] = values
    return vectors


def _mesh(stream: rr.RecordingStream, entity: str, solid, colour: int | None) -> None:
    """Send a solid that stays as it is; its colour too, unless that changes."""
    extra = {} if colour is None else {'albedo_factor': colour}
    stream.log(entity, rr.Mesh3D(vertex_positions=solid.points, vertex_normals=solid.normals,
                                 triangle_indices=solid.triangles, **extra), static=True)


def _annotate(stream: rr.RecordingStream, entity: str, labels: list[Label]) -> None:
    """Write the labels before the drawing, each with its line."""
    front = 5.0
    stream.log(f'{entity}/labels', rr.Points3D(
        [(*label.place, front) for label in labels], labels=[label.text for label in labels],
        radii=0.01, colors=ANNOTATION, show_labels=True), static=True)
    stream.log(f'{entity}/lines', rr.LineStrips3D(
        [[(x, y - 8.0 if y > 0.0 else y, front), (*label.target, front)]  # below the text
         for label in labels if label.target for x, y in [label.place]],
        radii=rr.components.Radius.ui_points(0.7), colors=ANNOTATION), static=True)
