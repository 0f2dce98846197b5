"""Recordings for the viewer's tests: a drawn cycle in real ROS messages, no model is needed."""
from importlib import import_module
from pathlib import Path

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from mcap.writer import CompressionType, Writer
from rclpy.serialization import serialize_message
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

START = 1_760_000_000_000_000_000  # ns since 1970
AMBIENT = 101_325.0  # Pa
FREQUENCY = 55.0  # Hz

# One cycle as corner points: share of the period, gauge pressure in Pa, plunger and sleeve in m.
PHASE = np.array([0.0, 0.66, 0.70, 0.73, 0.78, 0.84, 0.985, 1.0])
PRESSURE = np.array([0.3, 13.3, 16.0, 11.0, 4.0, 1.0, 0.1, 0.3]) * 1e6
PLUNGER = np.array([0.0, 0.0, 0.5, 1.2, 2.0, 2.0, 0.0, 0.0]) * 1e-3
SLEEVE = np.array([0.0, 0.0, 0.2, 1.2, 2.0, 2.0, 0.0, 0.0]) * 1e-3


def schema_text(name):
    """Return the definition of `name` (pkg/msg/Type) with all it is made of, as rosbag2 does."""
    texts, todo, seen = [], [name], set()
    while todo:
        current = todo.pop(0)
        if current in seen:
            continue
        seen.add(current)
        package, _, kind = current.split('/')
        module = import_module(f'{package}.msg')
        found = (parent / 'share' / package / 'msg' / f'{kind}.msg'
                 for parent in Path(module.__file__).parents)
        text = next(f for f in found if f.is_file()).read_text()
        head = '' if not texts else f'{"=" * 80}\nMSG: {package}/{kind}\n'
        texts.append(head + text)
        for field in getattr(module, kind).get_fields_and_field_types().values():
            inner = field.removeprefix('sequence<').rstrip('>').split('[')[0]
            if '/' in inner:
                other, part = inner.split('/')
                todo.append(f'{other}/msg/{part}')
    return '\n'.join(texts)


def stamp(time_ns):
    """Return a builtin_interfaces Time for `time_ns` (ns since 1970)."""
    return Time(sec=int(time_ns // 10**9), nanosec=int(time_ns % 10**9))


class Recording:
    """Write messages into one MCAP file of profile ros2; a context manager."""

    def __init__(self, path, *, chunk_size=256 * 1024, metadata=None, design=None):
        self._file = open(path, 'wb')  # noqa: SIM115
        self._writer = Writer(self._file, chunk_size=chunk_size, compression=CompressionType.ZSTD)
        self._writer.start(profile='ros2', library='test')
        self._schemas, self._channels = {}, {}
        if metadata is not None:
            self._writer.add_metadata('hpv_twin', metadata)
        if design is not None:
            self._writer.add_attachment(START, START, 'vibrator.yaml', 'application/yaml',
                                        design.encode())

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._writer.finish()
        self._file.close()

    def write(self, topic, time_ns, message):
        """Append `message` on `topic`, stamped `time_ns`."""
        if topic not in self._channels:
            package = type(message).__module__.split('.')[0]
            name = f'{package}/msg/{type(message).__name__}'
            if name not in self._schemas:
                text = schema_text(name).encode()
                self._schemas[name] = self._writer.register_schema(name, 'ros2msg', text)
            self._channels[topic] = self._writer.register_channel(topic, 'cdr', self._schemas[name])
        self._writer.add_message(self._channels[topic], int(time_ns), serialize_message(message),
                                 int(time_ns))


def waveform(seconds, frequency=FREQUENCY):
    """Return gauge pressure (Pa), plunger and sleeve position (m) at `seconds`."""
    phase = np.mod(seconds * frequency, 1.0)
    return tuple(np.interp(phase, PHASE, curve) for curve in (PRESSURE, PLUNGER, SLEEVE))


def write_waveforms(recording, node, times_ns, frequency=FREQUENCY):
    """Write pressure (absolute) and both joints at `times_ns`, cycle figures once per cycle."""
    seconds = (times_ns - START) * 1e-9
    pressure, plunger, sleeve = waveform(seconds, frequency)
    velocity = np.gradient(plunger, seconds)
    cycle = -1
    for i, now in enumerate(times_ns):
        at = stamp(now)
        message = FluidPressure(fluid_pressure=pressure[i] + AMBIENT)
        message.header.stamp = at
        recording.write(f'{node}/pressure', now, message)
        joints = JointState(name=['plunger', 'valve_sleeve'], position=[plunger[i], sleeve[i]],
                            velocity=[velocity[i], velocity[i]], effort=[1e3, 5e2])
        joints.header.stamp = at
        recording.write(f'{node}/plunger_position', now, joints)
        if int(seconds[i] * frequency) != cycle:
            cycle = int(seconds[i] * frequency)
            recording.write(f'{node}/frequency', now, Float64(data=frequency))
            recording.write(f'{node}/stroke', now, Float64(data=2.0e-3))


def diagnostics(node, level, message):
    """Return a DiagnosticArray with one status, `<node>: timing`."""
    status = DiagnosticStatus(level=bytes([level]), name=f'{node}: timing', message=message,
                              values=[KeyValue(key='late ticks', value='3')])
    return DiagnosticArray(status=[status])


def metadata(node='/hpv_twin', ambient=AMBIENT):
    """Return the metadata a twin's own recording carries."""
    return {'package_version': '0.1.0', 'node': node, 'ambient_pressure': str(ambient)}


DESIGN = """\
plunger_seat_diameter: 0.011
sleeve_seat_diameter: 0.027642307
stroke: 0.002
preload: 0.0052014456
pump_flow: 7.3e-4
bulk_modulus: 1.4e9
"""


def write_twin(path, *, seconds=1.0, gap=None, nodes=('/hpv_twin',), with_metadata=True,
               chunk_size=256 * 1024, load=0.0):
    """Write a whole twin's recording; `gap` = (from, to) in s is left out.

    After half of the time the pump flow falls from 43.8 to 30 L/min, and the frequency with it.
    """
    times = START + np.arange(round(seconds * 1000), dtype=np.int64) * 1_000_000
    if gap:
        since = (times - START) * 1e-9
        times = times[(since < gap[0]) | (since >= gap[1])]
    middle = START + round(seconds * 500) * 1_000_000
    extra = {'metadata': metadata(','.join(nodes)), 'design': DESIGN} if with_metadata else {}
    with Recording(path, chunk_size=chunk_size, **extra) as recording:
        for name in nodes:
            for topic, value in (('pump_flow', 7.3e-4), ('preload', 5.2e-3), ('load', load)):
                recording.write(f'{name}/{topic}', START, Float64(data=value))
            write_waveforms(recording, name, times[times < middle])
            recording.write(f'{name}/pump_flow', middle, Float64(data=5.0e-4))
            write_waveforms(recording, name, times[times >= middle], FREQUENCY * 0.7)
            for k in range(int(seconds) + 1):
                level, text = (1, '3 ticks late') if k == 1 else (0, 'on time')
                recording.write('/diagnostics', START + k * 10**9 + 100_000_000,
                                diagnostics(name, level, text))
    return path
