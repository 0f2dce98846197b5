"""What a channel says of itself: schema text, type hash, QoS."""

from pathlib import Path

import pytest
import yaml

from hpv_twin.recording.schemas import SchemaError, channel_for, qos_text, schema_text

RULE = '\n' + '=' * 80 + '\nMSG: '


@pytest.fixture
def prefix(tmp_path, monkeypatch):
    """A made-up installation: package `a` in one prefix, `b` that it needs in another."""
    for package, name, text in (
            ('a', 'Top',
             'Own[] mine\nb/Far far # b/Not this\nuint8 K=1\nstring<=5 s\nb/Far[<=3] g'),
            ('a', 'Own', '# nothing/Here\nfloat64[3] x\n'),
            ('b', 'Far', 'int32 y')):
        folder = tmp_path / f'prefix_{package}' / 'share' / package / 'msg'
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f'{name}.msg').write_text(text)
        (folder / f'{name}.json').write_text(
            f'{{"type_hashes": [{{"type_name": "b/msg/Far", "hash_string": "RIHS01_b"}}, '
            f'{{"type_name": "{package}/msg/{name}", "hash_string": "RIHS01_{name}"}}]}}')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path / 'prefix_b'))
    return tmp_path / 'prefix_a'


def test_a_schema_is_followed_by_all_it_refers_to_once_each(prefix):
    channel = channel_for('/t', 'a/msg/Top', prefix / 'lib' / 'python3' / 'a' / '__init__.py')
    top = (prefix / 'share/a/msg/Top.msg').read_text()
    assert channel.schema == (
        f'{top}{RULE}a/Own\n# nothing/Here\nfloat64[3] x\n{RULE}b/Far\nint32 y')
    assert channel.type_hash == 'RIHS01_Top'


def test_a_missing_definition_is_named_with_the_places_sought(prefix, monkeypatch):
    monkeypatch.delenv('AMENT_PREFIX_PATH')
    with pytest.raises(SchemaError, match=r'share/b/msg/Far\.msg under .*prefix_a'):
        channel_for('/t', 'a/msg/Top', prefix / 'lib' / 'a' / '__init__.py')


@pytest.mark.parametrize('text, said', [('{}', 'no type hash of a/msg/Own'),
                                        ('not json', 'no type hash of a/msg/Own')])
def test_a_bad_hash_file_is_named(prefix, text, said):
    path = prefix / 'share/a/msg/Own.json'
    path.write_text(text)
    with pytest.raises(SchemaError, match=f'{path}: {said}'):
        channel_for('/t', 'a/msg/Own', prefix / 'lib' / 'a')


def test_a_type_name_is_checked():
    with pytest.raises(SchemaError, match="'../etc' is no message type"):
        schema_text('../etc', [Path('/')])


def test_qos_is_the_text_of_rosbag2():
    assert qos_text('reliable', 'transient_local', 1) == """\
- history: keep_last
  depth: 1
  reliability: reliable
  durability: transient_local
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: automatic
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false"""
    assert yaml.safe_load(qos_text('best_effort'))[0]['reliability'] == 'best_effort'


@pytest.mark.parametrize('settings', [{'reliability': 'sure'}, {'durability': 'x'}, {'depth': 0}])
def test_unknown_qos_is_refused(settings):
    with pytest.raises(ValueError, match=str(next(iter(settings.values())))):
        qos_text(**settings)


def test_installed_definitions_agree_with_rosbags():
    """An independent parser finds the same types and computes the same hashes."""
    pytest.importorskip('rclpy')
    typesys = pytest.importorskip('rosbags.typesys')
    import recording_tools as tools
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    for channel in tools.channels():
        found = typesys.get_types_from_msg(channel.schema, channel.type_name)
        for name, fields in found.items():
            assert store.fielddefs[name] == fields
        assert channel.type_hash == store.hash_rihs01(channel.type_name)
