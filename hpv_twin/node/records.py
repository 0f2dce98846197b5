"""The node's recorder: its channels, and what makes a file explain itself."""
from __future__ import annotations

import importlib
from pathlib import Path

from rclpy.qos import DurabilityPolicy

from hpv_twin import __version__
from hpv_twin.recording.recorder import Recorder
from hpv_twin.recording.schemas import SchemaError, channel_for

from .interface import OUTPUTS


def make_recorder(node, vibrator, publishers) -> Recorder | None:
    """Build the recorder of a node; None, with a warning, where message definitions are missing."""
    settings = node.settings
    try:
        channels = [channel(output, publishers[name][1], settings['publish_rate'])
                    for name, output in OUTPUTS.items()]
    except SchemaError as error:
        node.say('warning', f'the twin runs unrecorded: {error}')
        return None
    full_name = node.get_fully_qualified_name()
    return Recorder(
        Path(settings['record_directory']).expanduser(), channels,
        name=full_name.strip('/').replace('/', '_'),
        max_total_size=settings['record_max_size'], fsync=settings['fsync'],
        metadata={'package_version': __version__, 'node': full_name,
                  'ambient_pressure': repr(settings['ambient_pressure']),
                  'publish_rate': repr(settings['publish_rate']),
                  'speed': repr(settings['speed'])},
        attachments={'vibrator.yaml': vibrator.to_yaml().encode()},
        log=node.say)


def channel(output, publisher, publish_rate):
    """The channel of one output, with the QoS it is published with."""
    package = output.type.__module__.split('.')[0]
    qos = output.qos(publish_rate)
    durable = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
    return channel_for(publisher.topic_name, f'{package}/msg/{output.type.__name__}',
                       importlib.import_module(package).__file__, reliability='reliable',
                       durability='transient_local' if durable else 'volatile', depth=qos.depth,
                       latched=output.latched)
