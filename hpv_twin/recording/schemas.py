"""What a channel of a recording needs to explain itself: type, schema text, type hash, QoS.

The forms are those of rosbag2 in ROS 2 Jazzy, so that `ros2 bag`, Foxglove, PlotJuggler and rerun
read a recording without any message package installed.
"""

import json
import os
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from .layout import Layout

TYPE_NAME = re.compile(r'([a-zA-Z0-9_]+)/(?:msg/)?([a-zA-Z0-9_]+)')
FIELD_TYPE = re.compile(r'^[ \t]*([a-zA-Z0-9_/]+)(?:<=\d+)?(?:\[[^\]]*\])?[ \t]+', re.MULTILINE)
PRIMITIVES = frozenset((
    'bool', 'byte', 'char', 'float32', 'float64', 'int8', 'uint8', 'int16', 'uint16', 'int32',
    'uint32', 'int64', 'uint64', 'string', 'wstring'))
RULE = '=' * 80
RELIABILITIES = ('reliable', 'best_effort')
DURABILITIES = ('volatile', 'transient_local')
INFINITE = 'sec: 9223372036\n    nsec: 854775807'


class SchemaError(LookupError):
    """A message definition that cannot be found or understood; the text names the file."""


@dataclass(frozen=True)
class Channel:
    """One topic of a recording.

    `schema` is the message definition with everything it refers to, as rosbag2 concatenates it;
    `type_hash` the REP-2011 hash; `qos` what `qos_text` gives. The latest message of a `latched`
    channel is repeated at the start of every further file of a recording. With a `layout`, many
    messages can be recorded at once, from arrays.
    """

    topic: str
    type_name: str
    schema: str
    type_hash: str
    qos: str
    latched: bool = False
    layout: Layout | None = None


def channel_for(topic: str, type_name: str, module: str | os.PathLike, *,
                reliability: str = 'reliable', durability: str = 'volatile', depth: int = 1000,
                latched: bool = False, layout: Layout | None = None) -> Channel:
    """Describe a topic from the message packages installed on this machine.

    `type_name` is `sensor_msgs/msg/FluidPressure`; `module` the path of the imported Python
    package, `sensor_msgs.__file__`: its definitions lie under the same prefix. The packages it
    refers to are sought there, then in AMENT_PREFIX_PATH, then in `sys.prefix`.
    Raises SchemaError, ValueError (QoS).
    """
    prefixes = list(_prefixes(type_name, Path(module)))
    return Channel(topic, type_name, schema_text(type_name, prefixes),
                   type_hash(type_name, prefixes), qos_text(reliability, durability, depth),
                   latched, layout)


def qos_text(reliability: str = 'reliable', durability: str = 'volatile',
             depth: int = 1000) -> str:
    """One publisher's QoS as rosbag2's `offered_qos_profiles` has it (bag metadata version 9)."""
    if reliability not in RELIABILITIES:
        raise ValueError(f'reliability {reliability!r} is none of {", ".join(RELIABILITIES)}')
    if durability not in DURABILITIES:
        raise ValueError(f'durability {durability!r} is none of {", ".join(DURABILITIES)}')
    if depth < 1:
        raise ValueError(f'depth {depth} is below 1')
    return (f'- history: keep_last\n  depth: {depth}\n  reliability: {reliability}\n'
            f'  durability: {durability}\n  deadline:\n    {INFINITE}\n'
            f'  lifespan:\n    {INFINITE}\n  liveliness: automatic\n'
            f'  liveliness_lease_duration:\n    {INFINITE}\n'
            '  avoid_ros_namespace_conventions: false')


def schema_text(type_name: str, prefixes: Iterable[Path]) -> str:
    """The definition of `type_name` followed by those it refers to, as rosbag2 writes `ros2msg`.

    Raises SchemaError naming the file that is missing and where it was sought.
    """
    prefixes, seen = list(prefixes), set()

    def full(name: str) -> str:
        text = _read(name, '.msg', prefixes)
        for needed in _references(text, name.split('/')[0]):
            if needed not in seen:
                seen.add(needed)
                text += f'\n{RULE}\nMSG: {needed}\n{full(needed)}'
        return text

    return full(type_name)


def type_hash(type_name: str, prefixes: Iterable[Path]) -> str:
    """The REP-2011 hash (`RIHS01_…`) that the message package ships. Raises SchemaError."""
    prefixes = list(prefixes)
    try:
        hashes = json.loads(_read(type_name, '.json', prefixes))['type_hashes']
        return next(h['hash_string'] for h in hashes if h['type_name'] == type_name)
    except (ValueError, KeyError, TypeError, StopIteration) as error:
        where = _locate(type_name, '.json', prefixes)
        raise SchemaError(f'{where}: no type hash of {type_name}: {error!r}') from None


def _prefixes(type_name: str, module: Path) -> Iterator[Path]:
    """Where definitions may lie: the prefix of the module first."""
    relative = _relative(type_name, '').parent
    yield from (p for p in module.absolute().parents if (p / relative).is_dir())
    yield from (Path(p) for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p)
    yield Path(sys.prefix)


def _relative(type_name: str, suffix: str) -> Path:
    match = TYPE_NAME.fullmatch(type_name)
    if not match:
        raise SchemaError(f'{type_name!r} is no message type such as std_msgs/msg/Float64')
    package, name = match.groups()
    return Path('share', package, 'msg', name + suffix)


def _locate(type_name: str, suffix: str, prefixes: list[Path]) -> Path:
    relative = _relative(type_name, suffix)
    for prefix in prefixes:
        if (prefix / relative).is_file():
            return prefix / relative
    sought = ', '.join(dict.fromkeys(map(str, prefixes))) or 'nowhere'
    raise SchemaError(f'{type_name}: no file {relative} under {sought}')


def _read(type_name: str, suffix: str, prefixes: list[Path]) -> str:
    path = _locate(type_name, suffix, prefixes)
    try:
        return path.read_text(encoding='utf-8')
    except (OSError, UnicodeError) as error:
        raise SchemaError(f'{path}: {error}') from error


def _references(text: str, package: str) -> list[str]:
    """Names of the messages a definition refers to, sorted, as `package/Name`."""
    names = (match[1] for match in FIELD_TYPE.finditer(text))
    return sorted({name if '/' in name else f'{package}/{name}'
                   for name in names if name not in PRIMITIVES})
