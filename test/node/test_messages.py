"""Templates: patched bytes are the message that they stand for."""
import pytest

pytest.importorskip('rclpy')
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

from hpv_twin.node.messages import float_value, position_template, pressure_template


@pytest.mark.parametrize('stamp', [0, 1, 1_795_394_621_369_271_598, 2**31 * 10**9 - 1])
def test_patched_bytes_read_as_the_serializers_do(stamp):
    pressure, position = pressure_template(), position_template()
    assert pressure.exact and position.exact
    values = (1e-3, -2e-3, 3.5, float('inf'), -0.0, 5e-324)
    for template, kind, fields in ((pressure, FluidPressure, (1.6e7,)),
                                   (position, JointState, values)):
        patched, serialized = template.patched(stamp, *fields), template.serialized(stamp, *fields)
        assert len(patched) == len(serialized)
        assert deserialize_message(patched, kind) == deserialize_message(serialized, kind)


def test_pressure_message_as_a_subscriber_sees_it():
    data = pressure_template().message(12_000_000_345, 101_325.0)
    message = deserialize_message(data, FluidPressure)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 345)
    assert message.header.frame_id == 'cavity_a'
    assert (message.fluid_pressure, message.variance) == (101_325.0, 0.0)


def test_position_message_as_a_subscriber_sees_it():
    data = position_template().message(1, 1e-3, 2e-3, 3.0, 4.0, 5.0, 6.0)
    message = deserialize_message(data, JointState)
    assert list(message.name) == ['plunger', 'valve_sleeve']
    assert list(message.position) == [1e-3, 2e-3]
    assert list(message.velocity) == [3.0, 4.0]
    assert list(message.effort) == [5.0, 6.0]


def test_a_layout_that_differs_falls_back_to_the_serializer():
    template = pressure_template()
    template.exact = False
    template.patched = None
    assert deserialize_message(template.message(7, 1.0), FluidPressure).fluid_pressure == 1.0


def test_a_float64_is_read_as_it_was_sent_or_not_at_all():
    payload = serialize_message(Float64(data=7.3e-4))
    assert float_value(payload) == 7.3e-4
    assert float_value(b'\0\0\0\0' + payload[:3:-1]) == 7.3e-4  # the other byte order
    for bad in (b'', payload[:4], payload[:11], payload + b'\0', b'\0\x09' + payload[2:],
                b'\1' + payload[1:]):
        assert float_value(bad) is None
