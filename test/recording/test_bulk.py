"""Rows written at once are the bytes that the library writes message by message."""

import io

import numpy as np
import pytest

pytest.importorskip('rclpy')

import recording_tools as tools
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from hpv_twin.recording.bulk import BulkWriter
from hpv_twin.recording.layout import Layout, Rows

NAMES = ('plunger', 'valve_sleeve')


def layout():
    """Layout of a JointState with two joints, found by marks."""
    marks = [-1.25e100 * (k + 1) for k in range(2)]
    payload = tools.position(0, 0.0)
    for place, mark in enumerate(marks):
        old = np.array([float(place)]).tobytes()
        payload = payload.replace(old, np.array([mark]).tobytes(), 1) if place else payload
    template = tools.position(0, 0.0)
    at = template.index(np.array([1.0]).tobytes())
    return Layout(template, 4, (at - 8, at))


def write(writer_class, add):
    file = io.BytesIO()
    writer = writer_class(file, chunk_size=3000, compression=CompressionType.ZSTD)
    writer.start('ros2', 'test')
    schema = writer.register_schema('sensor_msgs/msg/JointState', 'ros2msg', b'')
    channel = writer.register_channel('/p', 'cdr', schema)
    add(writer, channel)
    writer.finish()
    return file.getvalue()


def test_the_bytes_are_those_of_the_library():
    stamps = tools.START + 50_000 * np.arange(200)
    values = np.random.default_rng(1).normal(size=(200, 2))
    shape = layout()

    def in_rows(writer, channel):
        rows = Rows(channel, shape)
        for k in range(0, 200, 40):
            writer.add_rows(channel, stamps[k:k + 40],
                            rows.lay_out(stamps[k:k + 40], values[k:k + 40], k + 1))

    def one_by_one(writer, channel):
        for k, (stamp, row) in enumerate(zip(stamps.tolist(), values, strict=True)):
            payload = bytearray(shape.template)
            payload[4:12] = np.array(divmod(stamp, 10**9), '<u4').tobytes()
            for place, value in zip(shape.fields, row, strict=True):
                payload[place:place + 8] = np.array([value]).tobytes()
            writer.add_message(channel, stamp, bytes(payload), stamp, k + 1)
    bulk = write(BulkWriter, in_rows)
    with_library = write(Writer, one_by_one)
    # Chunks may end elsewhere: what a reader finds is the same, message by message.
    found = [[(m.sequence, m.log_time, m.publish_time, m.data)
              for _, _, m in make_reader(io.BytesIO(data)).iter_messages()]
             for data in (bulk, with_library)]
    assert found[0] == found[1] and len(found[0]) == 200


def test_in_one_chunk_the_whole_file_is_the_same():
    stamps = tools.START + 50_000 * np.arange(10)
    shape = layout()

    def in_rows(writer, channel):
        writer.add_rows(channel, stamps, Rows(channel, shape).lay_out(
            stamps, np.full((10, 2), 1.5), 1))

    def one_by_one(writer, channel):
        payload = bytearray(shape.template)
        for place in shape.fields:
            payload[place:place + 8] = np.array([1.5]).tobytes()
        for k, stamp in enumerate(stamps.tolist()):
            payload[4:12] = np.array(divmod(stamp, 10**9), '<u4').tobytes()
            writer.add_message(channel, stamp, bytes(payload), stamp, k + 1)
    assert write(BulkWriter, in_rows) == write(Writer, one_by_one)


def test_values_that_do_not_fit_are_refused():
    rows = Rows(1, layout())
    with pytest.raises(ValueError, match='values of shape'):
        rows.lay_out(np.arange(3), np.zeros((3, 5)), 1)
