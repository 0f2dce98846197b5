"""Setpoints of random bytes and values: nothing that is refused changes anything."""
import math
import random
import struct
import time

import pytest

pytest.importorskip('rclpy')
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64

LIMITS = {'pump_flow': (0.0, 4e-3), 'preload': (0.0, 15e-3), 'load': (-2e3, 1e4)}
ODD = [math.nan, math.inf, -math.inf, -5e-324, 1.8e308, -1.8e308, 1e308, -1.0, 0.1, 1e5, -1e5]
HEADER = b'\x00\x01\x00\x00'  # CDR, little endian


def is_refused(payload, low, high):
    """
    Whether the twin has to refuse these bytes: they are no Float64, or one beyond the limits.

    DDS fills the last word of a message on its way: of 9 bytes it makes 12, and of them a number.
    """
    payload += bytes(-len(payload) % 4)
    if len(payload) != 12 or payload[0] or payload[1] not in (0, 1, 6, 7):
        return True
    value = deserialize_message(payload, Float64).data
    return not (math.isfinite(value) and low <= value <= high)


def random_payload(rng):
    """A setpoint of a random or an odd value, or bytes that are none; DDS sends up to 12."""
    kind = rng.randrange(4)
    if kind == 0:
        return serialize_message(Float64(data=rng.choice(ODD)))
    if kind == 1:
        return serialize_message(Float64(data=struct.unpack('<d', rng.randbytes(8))[0]))
    if kind == 2:
        return HEADER + rng.randbytes(rng.randrange(9))
    return rng.randbytes(rng.randrange(1, 13))


def fuzz(twin, ear, count, pause):
    """Send `count` setpoints that must be refused, `pause` s apart; return how many were sent."""
    in_force = {name: ear.listen(Float64, f'/hpv_twin/{name}', latched=True) for name in LIMITS}
    ear.until(lambda: all(in_force.values()), 'the setpoints in force')
    before = {name: [message.data for message in heard] for name, heard in in_force.items()}
    publishers = {name: ear.node.create_publisher(Float64, f'/hpv_twin/{name}_setpoint', 1)
                  for name in LIMITS}
    ear.until(lambda: all(p.get_subscription_count() for p in publishers.values()), 'the twin')
    rng = random.Random(9)
    sent = 0
    while sent < count:
        name, payload = rng.choice(list(LIMITS)), random_payload(rng)
        if is_refused(payload, *LIMITS[name]):
            publishers[name].publish(payload)
            sent += 1
            if pause:
                time.sleep(pause)
            if sent % 500 == 0:
                ear.spin(0.01)
                assert twin.process.poll() is None, twin.log
    ear.spin(0.5)
    assert {name: [message.data for message in heard] for name, heard in in_force.items()} == before
    return in_force


def check(twin, ear, count, pause):
    report = ear.listen(DiagnosticArray, '/diagnostics')
    in_force = fuzz(twin, ear, count, pause)
    reports = len(report)
    ear.until(lambda: len(report) > reports + 1, 'a report')
    told = {pair.key: pair.value for status in report[-1].status for pair in status.values}
    print(f'{count} sent, {told["refused"]} reached the twin and were refused')
    # Its queues hold the newest one alone; that many at least have to come through.
    assert int(told['refused']) > count / 20
    ear.say('/hpv_twin/pump_flow_setpoint', 5e-4)
    ear.until(lambda: in_force['pump_flow'][-1].data == 5e-4, 'a good setpoint in force')
    assert twin.stop() == 0
    assert 'Traceback' not in twin.log and 'refused, not finite' in twin.log


def test_random_setpoints_change_nothing(start_twin, ear):
    check(start_twin('record:=false'), ear, 3_000, 2e-4)


@pytest.mark.long
@pytest.mark.timeout(600)
def test_a_hundred_thousand_random_setpoints_change_nothing(start_twin, ear):
    check(start_twin('record:=false'), ear, 100_000, 2e-4)
