"""The node's recorder: its channels, and what makes a file explain itself."""
from __future__ import annotations

import importlib
from pathlib import Path

from rclpy.qos import DurabilityPolicy

from hpv_twin import __version__
from hpv_twin.recording.recorder import Recorder
from hpv_twin.recording.schemas import SchemaError, channel_for

from .fine import layouts
from .interface import FINE_OUTPUTS, MEASURED, OUTPUTS, PARAMETERS
from .params_files import ParameterError


def make_recorder(node, vibrator, fine: bool) -> Recorder | None:
    """
    Build the recorder of a node; None, with a warning, where it cannot record.

    With `fine` it has channels for what is sampled within a tick, behind all others.
    """
    settings = node.settings
    try:
        channels = [channel(output, node.resolve_topic_name(name), settings['publish_rate'])
                    for name, output in (OUTPUTS | MEASURED).items()]
        if fine:
            channels += [channel(output, node.resolve_topic_name(name), settings['record_rate'],
                                 layout)
                         for (name, output), layout in zip(FINE_OUTPUTS.items(), layouts(),
                                                           strict=True)]
    except SchemaError as error:
        node.say('warning', f'the twin runs unrecorded: {error}')
        return None
    full_name = node.get_fully_qualified_name()

    def metadata():
        """What explains a file, as it is when the file begins."""
        return {'package_version': __version__, 'node': full_name,
                'ambient_pressure': repr(settings['ambient_pressure']),
                'publish_rate': repr(settings['publish_rate']),
                'speed': repr(settings['speed']),
                **{f'parameter.{name}': str(node.get_parameter(name).value)
                   for name in PARAMETERS}}
    try:
        return Recorder(
            Path(settings['record_directory']).expanduser(), channels,
            name=full_name.strip('/').replace('/', '_'),
            max_total_size=settings['record_max_size'], max_age=settings['record_max_age'],
            split_size=settings['record_split_size'], split_time=settings['record_split_time'],
            reserve=settings['record_reserve'], fsync=settings['fsync'], metadata=metadata,
            attachments={'vibrator.yaml': vibrator.to_yaml().encode()},
            log=node.say)
    except ValueError as error:  # it begins with the name of a setting
        raise ParameterError(f'parameter record_{error}') from None


def fine_channels() -> tuple[int, int]:
    """Channels of what is sampled within a tick, behind all others."""
    first = len(OUTPUTS) + len(MEASURED)
    return first, first + 1


def channel(output, topic, publish_rate, layout=None):
    """The channel of one output, with the QoS it is published with."""
    package = output.type.__module__.split('.')[0]
    qos = output.qos(publish_rate)
    durable = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
    return channel_for(topic, f'{package}/msg/{output.type.__name__}',
                       importlib.import_module(package).__file__, reliability='reliable',
                       durability='transient_local' if durable else 'volatile', depth=qos.depth,
                       latched=output.latched, layout=layout)
