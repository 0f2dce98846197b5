"""Parameter files: what is wrong with one is said in one line, before ROS sees it."""
import random
import string

import pytest

pytest.importorskip('rclpy')
from hpv_twin.model import Vibrator, VibratorError
from hpv_twin.node.params_files import ParameterError, names, origins

GOOD = '/**:\n  ros__parameters:\n    pump_flow: 3.65e-4\n    record: false\n'
DESIGN = 'stroke: 2e-3\npump_flow: 7.3e-4  # m^3/s\nslotted_spring_stiffness: 2.5e5\nload: -10\n'
PIECES = ['/**:', 'hpv_twin:', 'ros__parameters:', 'pump_flow:', 'record:', '  ', '\n', '\n    ',
          ': ', '- ', '[', ']', '{', '}', '&a', '*a', '!!python/object:os.system', '!!int', '1e-3',
          'true', '2026-13-45', '"', "'", '|', '>', '%', '\t', '\x00', '💧', '---', '...',
          '<<: *a', '?']


def test_every_name_is_found_and_knows_its_file(tmp_path):
    path, other = tmp_path / 'a.yaml', tmp_path / 'b.yaml'
    path.write_text(GOOD)
    other.write_text('left:\n  hpv_twin:\n    ros__parameters:\n      load: 1\n'
                     '      more: {a: 1}\n')
    assert names(str(path)) == ['pump_flow', 'record']
    assert names(str(other)) == ['load', 'more.a']
    line = ['--ros-args', '--params-file', str(path), '-p', 'record:=true', '--params-file',
            str(other)]
    assert origins(line) == {'pump_flow': str(path), 'load': str(other), 'more.a': str(other)}


@pytest.mark.parametrize('content, words', [
    (b'', 'empty'),
    (b'\x00\x01\xff\xfe', 'not a text file'),
    (b'/**:\n  ros__parameters:\n    pump_flow: [1, 2', 'line 3, column 21'),
    (b'/**:\n  ros__parameters:\n    pump_flow: 1\n   record: 2\n', 'line 4'),
    (b'hello: 3\n', 'hello: 3 stands where'),
    (b'- 1\n- 2\n', 'stands where node names'),
    (b'/**:\n  ros__parameters: 3\n', 'ros__parameters: 3 stands where'),
    (b'/**:\n  ros__parameters:\n    a: \x07\n', 'not YAML'),
    (b'a: ' + b'[' * 5000, 'not YAML'),
    (b'a: 2026-13-45\n', 'not YAML'),
])
def test_a_bad_file_is_named_with_place_and_reason(tmp_path, content, words):
    path = tmp_path / 'bad.yaml'
    path.write_bytes(content)
    with pytest.raises(ParameterError, match='^[^\n]*$') as caught:
        names(str(path))
    assert str(caught.value).startswith(f'{path}: ') and words in str(caught.value)


def test_an_absent_file_and_a_folder_are_named(tmp_path):
    for path, words in ((tmp_path / 'absent.yaml', 'No such file'), (tmp_path, 'directory')):
        with pytest.raises(ParameterError, match=words):
            names(str(path))


def damaged(rng, good):
    """A file as a crash, an editor or a wrong file name leave it behind."""
    kind = rng.randrange(4)
    if kind == 0:
        return rng.randbytes(rng.randrange(200))
    if kind == 1:
        return good[:rng.randrange(len(good))]
    if kind == 2:
        text = bytearray(good)
        for _ in range(rng.randrange(1, 6)):
            text[rng.randrange(len(text))] = rng.randrange(256)
        return bytes(text)
    return ''.join(rng.choice([*PIECES, rng.choice(string.printable)])
                   for _ in range(rng.randrange(60))).encode()


@pytest.mark.parametrize(('read', 'good', 'error'), [
    (names, GOOD, ParameterError), (Vibrator.load, DESIGN, VibratorError)],
    ids=['params', 'design'])
def test_a_thousand_random_files_are_read_or_refused_in_one_line(tmp_path, read, good, error):
    rng = random.Random(4)
    path = tmp_path / 'random.yaml'
    complaints = []
    for _ in range(1000):
        path.write_bytes(damaged(rng, good.encode()))
        try:
            read(str(path))
        except error as complaint:
            complaints.append(str(complaint))
    assert 500 < len(complaints) < 1000
    assert all(text.startswith(f'{path}: ') and '\n' not in text for text in complaints)
