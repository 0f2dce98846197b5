"""The design: defaults with origins, YAML in and out, and errors that name what is wrong."""
import dataclasses
import math
from pathlib import Path

import pytest
import yaml

from hpv_twin.model import Vibrator, VibratorError

CONFIG = Path(__file__).parents[2] / 'config' / 'vibrator.yaml'


def test_shipped_file_is_the_built_in_design_to_the_letter():
    assert CONFIG.read_text() == Vibrator().to_yaml()
    assert Vibrator.load(CONFIG) == Vibrator()


def test_shipped_numbers_are_numbers_to_every_yaml_reader():
    values = yaml.safe_load(CONFIG.read_text())
    assert all(isinstance(v, (int, float)) or k == 'line_damping' for k, v in values.items())


def test_every_field_has_unit_symbol_and_an_origin_of_the_three_kinds():
    for field in dataclasses.fields(Vibrator):
        assert field.metadata['unit'] and field.metadata['symbol'] and field.metadata['text']
        assert field.metadata['origin'].split(':')[0].split(' ')[0] in ('paper', 'derived',
                                                                        'chosen')


def test_yaml_round_trip_keeps_every_bit():
    design = Vibrator(bulk_modulus=1.1e9 / 3.0, line_damping=1e-300, load=-12.5)
    assert Vibrator.load_yaml(design.to_yaml()) == design


def test_numbers_that_yaml_reads_as_text_are_accepted():
    assert Vibrator.load_yaml('bulk_modulus: 1.3e9\npump_flow: 7e-4').bulk_modulus == 1.3e9


def test_load_is_the_reader_on_the_class_and_the_force_on_a_design(tmp_path):
    path = tmp_path / 'one.yaml'
    path.write_text('load: 250')
    assert Vibrator.load(path).load == 250.0
    assert Vibrator().replace(load=3).load == 3.0


@pytest.mark.parametrize('text, words', [
    ('bulk_modulos: 1', ['bulk_modulos', 'bulk_modulus']),
    ('stroke: -1', ['stroke', 'h_b', '-1', 'above 0 m']),
    ('gap_ratio: 0.6', ['gap_ratio', '0.6', '[0.2, 0.5]']),
    ('preload: soft', ['preload', 'soft']),
    ('preload: .nan', ['preload', 'nan']),
    ('preload: true', ['preload', 'True']),
    ('preload: [1, 2]', ['preload', '[1, 2]']),
    ('preload: null', ['preload', 'None']),
    ('sleeve_seat_diameter: 0.010', ['sleeve_seat_diameter', 'plunger_seat_diameter', '0.01']),
    ('- 1', ['list']),
    ('', ['empty']),
    ('stroke: {', ['line 1', 'not YAML']),
    ('2001-99-99: 2001-99-99', ['not YAML']),
])
def test_a_bad_file_is_refused_in_one_line_that_names_it(tmp_path, text, words):
    path = tmp_path / 'bad.yaml'
    path.write_text(text)
    with pytest.raises(VibratorError) as caught:
        Vibrator.load(path)
    message = str(caught.value)
    assert str(path) in message and '\n' not in message
    for word in words:
        assert word in message


def test_binary_and_missing_files_are_refused_by_name(tmp_path):
    path = tmp_path / 'binary.yaml'
    path.write_bytes(bytes(range(256)))
    with pytest.raises(VibratorError, match='not a text file'):
        Vibrator.load(path)
    with pytest.raises(VibratorError, match='absent.yaml: No such file'):
        Vibrator.load(tmp_path / 'absent.yaml')


def test_line_damping_defaults_to_equation_19():
    design = Vibrator()
    assert design.line_damping_in_force == 0.026 * design.line_area / 1.5
    assert design.replace(line_damping=2.0).line_damping_in_force == 2.0


def test_closed_form_pressures_of_the_base_design():
    design = Vibrator()
    assert math.isclose(design.return_pressure, 3e6, rel_tol=1e-6)
    assert math.isclose(design.opening_pressure, 13.26e6, rel_tol=1e-3)
