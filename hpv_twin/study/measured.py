"""What sensors of a machine showed: pressure, and position where there is one, from recordings."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hpv_twin.recording.cdr import JointSignal, PressureSignal
from hpv_twin.recording.reader import RecordingError, describe, read_signals

AMBIENT = 101_325.0  # Pa, where a recording does not tell
SLOWEST = 900.0  # samples per second; a cycle's discharge takes a millisecond
SHORTEST = 0.5  # s
PLUNGER = 'plunger'


class CalibrationError(ValueError):
    """A recording that cannot be calibrated from; the message says why."""


@dataclass(frozen=True)
class Measured:
    """
    One recording: `time` s from its first sample, `pressure` Pa gauge, both of shape (samples,).

    `position_time` and `position` (s, m) are empty where there is no displacement sensor.
    """

    name: str
    time: np.ndarray
    pressure: np.ndarray
    position_time: np.ndarray
    position: np.ndarray

    @property
    def rate(self) -> float:
        """Samples of pressure per second, by the median spacing."""
        return 1.0 / float(np.median(np.diff(self.time)))


def read_measured(path, gauge: bool = False, ambient: float | None = None,
                  pressure_topic: str | None = None, position_topic: str | None = None,
                  span: tuple[float | None, float | None] = (None, None),
                  progress=None) -> Measured:
    """
    Read the sensors of a recording; CalibrationError or RecordingError says why it cannot be used.

    With `gauge` the pressure is taken for gauge pressure; else `ambient` (Pa; by default what the
    recording tells) is subtracted. `span`: s from the beginning.
    """
    about = describe(path)
    types = {topic: told.type_name for topic, told in about.topics.items()}
    pressure_topic = choose(path, types, 'sensor_msgs/msg/FluidPressure', pressure_topic,
                            '--pressure-topic')
    if pressure_topic is None:
        raise CalibrationError(f'{path}: there is no FluidPressure topic in it; the topics are: '
                               f'{", ".join(sorted(types)) or "none"}')
    position_topic = choose(path, types, 'sensor_msgs/msg/JointState', position_topic,
                            '--position-topic')
    begin = about.start or 0
    start, end = (None if second is None else begin + round(second * 1e9) for second in span)
    signals = read_signals(path, [topic for topic in (pressure_topic, position_topic) if topic],
                           start, end, progress)
    pressure: PressureSignal = signals[pressure_topic]
    if not len(pressure.time):
        raise CalibrationError(f'{path}: {pressure_topic} has no samples in this span')
    zero = pressure.time[0]
    if ambient is None:
        ambient = float(about.metadata.get('ambient_pressure', AMBIENT))
    time, values = cleaned(pressure.time, pressure.pressure, zero)
    position_time = position = np.empty(0)
    if position_topic:
        position_time, position = plunger_of(signals[position_topic], zero)
    measured = Measured(Path(path).name, time, values - (0.0 if gauge else ambient),
                        position_time, position)
    refuse_scant(path, measured, len(pressure.time))
    return measured


def choose(path, types: dict, kind: str, wanted: str | None, option: str) -> str | None:
    """Return the topic of a type: the one wanted, a measured one, or the only one there is."""
    there = [topic for topic, type_name in types.items() if type_name == kind]
    if wanted is not None:
        if wanted not in there:
            raise CalibrationError(f'{path}: {option} {wanted}: the topics of {kind} are: '
                                   f'{", ".join(there) or "none"}')
        return wanted
    measured = [topic for topic in there if '/measured/' in topic] or [
        topic for topic in there if not topic.endswith('_fine')]
    if len(measured) > 1:
        raise CalibrationError(f'{path}: several topics of {kind}: {", ".join(measured)}; name one '
                               f'with {option}')
    return measured[0] if measured else None


def cleaned(stamps: np.ndarray, values: np.ndarray, zero: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the finite values with their times, s; of equal stamps the first."""
    kept = np.isfinite(values)
    kept[1:] &= np.diff(stamps) > 0
    return (stamps[kept] - zero) * 1e-9, values[kept]


def plunger_of(signal: JointSignal, zero: int) -> tuple[np.ndarray, np.ndarray]:
    """Return time and position of the joint called plunger, or of the only one."""
    if not signal.names:
        return np.empty(0), np.empty(0)
    column = signal.names.index(PLUNGER) if PLUNGER in signal.names else 0
    return cleaned(signal.time, signal.position[:, column], zero)


def refuse_scant(path, measured: Measured, received: int) -> None:
    """Raise CalibrationError where there is too little to go by."""
    if len(measured.time) < 0.8 * received:
        raise CalibrationError(f'{path}: {received - len(measured.time)} of {received} samples of '
                               'pressure are no numbers or have no time of their own')
    if len(measured.time) < 2 or measured.time[-1] < SHORTEST:
        raise CalibrationError(f'{path}: less than {SHORTEST:g} s of pressure')
    if measured.rate < SLOWEST:
        raise CalibrationError(f'{path}: {measured.rate:.0f} samples of pressure per second; '
                               'calibration needs 1000 or more')


__all__ = ['CalibrationError', 'Measured', 'RecordingError', 'read_measured']
