"""Many designs at once: the fields of a Vibrator as arrays."""
from __future__ import annotations

import dataclasses

import numpy as np

from .derived import Derived
from .quantity import VibratorError, check_quantity
from .vibrator import Vibrator

FIELDS = {field.name: field for field in dataclasses.fields(Vibrator)}


class Designs(Derived):
    """
    `len()` designs: those of `base` but for the fields given, each an array of shape (n,).

    Attributes are the fields and derived values of a Vibrator, of shape (n,) where they vary and
    scalars where they do not. Values are held to the bounds of the fields (VibratorError names
    field, value and bound), but d2 may come out no larger than d1: `possible` tells.
    """

    def __init__(self, base: Vibrator, **fields):
        arrays = {name: np.atleast_1d(np.asarray(values, dtype=float))
                  for name, values in fields.items()}
        for name, values in arrays.items():
            check_values(name, values)
        self.base = base
        self.varied = tuple(arrays)
        self._values = {name: getattr(base, name) for name in FIELDS} | arrays
        if self._values['line_damping'] is None:
            self._values['line_damping'] = np.nan
        shape = np.broadcast_shapes((1,), *(values.shape for values in arrays.values()))
        self._length = shape[0]

    def __len__(self):
        return self._length

    def __getattr__(self, name):
        try:
            return self.__dict__['_values'][name]
        except KeyError:
            raise AttributeError(f'a design has no "{name}"') from None

    def __getitem__(self, chosen) -> Designs:
        """Return the designs of a slice, a mask or an array of indices."""
        return Designs(self.base, **{name: np.broadcast_to(self._values[name], len(self))[chosen]
                                     for name in self.varied})

    def vibrator(self, index: int) -> Vibrator:
        """Return one of them."""
        fields = {name: float(np.broadcast_to(self._values[name], len(self))[index])
                  for name in self.varied}
        return self.base.replace(**{name: None if np.isnan(value) else value
                                    for name, value in fields.items()})

    @property
    def line_damping_in_force(self):
        """c0, N·s/m, as in Vibrator; not a number stands for (19)."""
        given = self.line_damping
        return np.where(np.isnan(given), self.line_damping_by_geometry, given)

    @property
    def possible(self) -> np.ndarray:
        """Where d2 exceeds d1, shape (n,)."""
        return np.broadcast_to(self.sleeve_seat_diameter > self.plunger_seat_diameter, len(self))


def check_values(name: str, values: np.ndarray) -> None:
    """Raise VibratorError where a value is outside the bounds of its field."""
    if name not in FIELDS:
        raise VibratorError(f'no field "{name}"; there are {", ".join(FIELDS)}')
    if FIELDS[name].default is None:
        values = values[~np.isnan(values)]  # "not given"
    # A field's bounds are an interval: where the ends are within, and all is finite, all are.
    for value in (values.min(), values.max()) if len(values) else ():
        check_quantity(FIELDS[name], float(value))
