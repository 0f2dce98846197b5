"""Waveforms sampled within a tick: recorded at `record_rate`, not published."""
from __future__ import annotations

import numpy as np

from hpv_twin.model import kernel

from .messages import fine_position_template, pressure_template
from .pacing import SECOND


class FineRecording:
    """
    Hands what the plant has sampled at each tick to the recorder, which lays it out.

    `channels` are those of ~/pressure_fine and ~/plunger_position_fine in the recorder.
    """

    def __init__(self, recorder, channels: tuple[int, int], plant):
        self.channels = channels
        self._recorder, self._plant = recorder, plant

    def take(self, stamp: int, samples: np.ndarray, pace: float) -> None:
        """
        Queue the samples of a tick that ends at `stamp`, ns. For the pacing thread.

        `pace`: model seconds per second, in which the samples' times are.
        """
        count = samples.shape[1]
        if count:
            item = stamp, self._plant.simulation.time, samples, pace
            self._recorder.write_rows(self, item, count)

    def rows(self, items: list) -> list[tuple[int, np.ndarray, np.ndarray]]:
        """Channel, stamps, ns, and values of the messages in `items`; in the recorder's thread."""
        stamps = np.concatenate([stamp - np.rint((end - samples[kernel.SAMPLE_TIME])
                                                 * (SECOND / pace)).astype(np.int64)
                                 for stamp, end, samples, pace in items])
        samples = np.concatenate([samples for _, _, samples, _ in items], axis=1)
        pressure = samples[kernel.SAMPLE_P] + self._plant.ambient_pressure
        y, v = samples[kernel.SAMPLE_Y], samples[kernel.SAMPLE_V]
        sleeve = samples[kernel.SAMPLE_SLEEVE]
        ratio = self._plant.sleeve_ratio
        # The sleeve rests, catches up, or moves with the plunger.
        sleeve_velocity = v * np.where(sleeve == y, 1.0, np.where(sleeve > 0.0, ratio, 0.0))
        return [(self.channels[0], stamps, pressure[:, None]),
                (self.channels[1], stamps, np.stack([y, sleeve, v, sleeve_velocity], axis=1))]


def layouts():
    """Layouts of the two messages; None where patched bytes do not read as they should."""
    templates = pressure_template(), fine_position_template()
    return tuple(template.layout if template.exact else None for template in templates)
