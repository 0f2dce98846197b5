"""What the tests of recordings share: channels and messages as the twin has them."""

import struct
import time
import warnings

import diagnostic_msgs
import sensor_msgs
import std_msgs
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import serialize_message
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

from hpv_twin.recording.recorder import Recorder
from hpv_twin.recording.schemas import channel_for

with warnings.catch_warnings():  # the wheels' first serialisation imports deprecated modules
    warnings.simplefilter('ignore')
    serialize_message(Float64())

PRESSURE, POSITION, FLOW, DIAGNOSTICS = range(4)
TOPICS = ('/hpv_twin/pressure', '/hpv_twin/plunger_position', '/hpv_twin/pump_flow',
          '/diagnostics')
START = 1_700_000_000_123_456_789  # ns
MILLISECOND = 1_000_000  # ns


def channels():
    return (
        channel_for(TOPICS[0], 'sensor_msgs/msg/FluidPressure', sensor_msgs.__file__),
        channel_for(TOPICS[1], 'sensor_msgs/msg/JointState', sensor_msgs.__file__),
        channel_for(TOPICS[2], 'std_msgs/msg/Float64', std_msgs.__file__,
                    durability='transient_local', depth=1, latched=True),
        channel_for(TOPICS[3], 'diagnostic_msgs/msg/DiagnosticArray', diagnostic_msgs.__file__))


def stamped(message, stamp, frame_id='cavity_a'):
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    message.header.frame_id = frame_id
    return message


def pressure(stamp, value, frame_id='cavity_a'):
    return serialize_message(stamped(FluidPressure(fluid_pressure=value), stamp, frame_id))


def position(stamp, value, names=('plunger', 'valve_sleeve')):
    count = len(names)
    return serialize_message(stamped(JointState(
        name=list(names), position=[value + i for i in range(count)],
        velocity=[10 * value + i for i in range(count)],
        effort=[100 * value + i for i in range(count)]), stamp))


def scalar(value):
    return serialize_message(Float64(data=value))


def diagnostics(stamp):
    return serialize_message(stamped(DiagnosticArray(status=[
        DiagnosticStatus(name='/hpv_twin: recorder', message='recording')]), stamp))


def ticks(count, first=0):
    """What the twin hands over in `count` ms: (channel, stamp, payload), 2 a millisecond."""
    for i in range(first, first + count):
        stamp = START + i * MILLISECOND
        yield PRESSURE, stamp, pressure(stamp, 101325.0 + i)
        yield POSITION, stamp, position(stamp, 1e-3 * i)


class Log(list):
    """Keeps what a recorder says."""

    def __call__(self, level, text):
        self.append((level, text))

    def of(self, level):
        return [text for found, text in self if found == level]


def recorder(directory, **settings):
    settings.setdefault('name', 'hpv_twin')
    settings.setdefault('log', Log())
    settings.setdefault('reserve', 0)
    return Recorder(directory, channels(), **settings)


def record(directory, messages, opening=(), **settings):
    """Record `messages` and return the path of the file."""
    recording = recorder(directory, **settings)
    assert recording.start(opening)
    for message in messages:
        while not recording.write(*message):
            time.sleep(1e-3)
    return recording.stop()


def wait_until(condition, timeout=20.0):
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, 'waited in vain'
        time.sleep(1e-3)


def big_endian_pressure(stamp, value):
    """FluidPressure as a big-endian machine lays it out, with an empty frame_id."""
    return struct.pack('>HHiII', 0, 0, *divmod(stamp, 1_000_000_000), 1) + b'\0' * 4 + struct.pack(
        '>dd', value, 0.0)
