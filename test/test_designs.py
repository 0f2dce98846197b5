"""A design comes from a YAML file or from a recording, by the same option."""

from pathlib import Path

import pytest

from hpv_twin.designs import load_design
from hpv_twin.model import Vibrator, VibratorError

EXAMPLE = Path(__file__).parents[1] / 'bags' / 'example.mcap'


def test_a_recording_gives_the_design_it_carries():
    design = load_design(EXAMPLE)
    assert isinstance(design, Vibrator)
    assert design.stroke == 0.002


def test_a_yaml_file_and_nothing_at_all(tmp_path):
    path = tmp_path / 'design.yaml'
    path.write_text('stroke: 0.0015\n')
    assert load_design(path).stroke == 0.0015
    assert load_design(None) == load_design('') == Vibrator()


def test_what_carries_no_design_is_told_in_a_line(tmp_path):
    path = tmp_path / 'broken.mcap'
    path.write_bytes(b'nothing')
    with pytest.raises(VibratorError, match=f'{path}: is not an MCAP file'):
        load_design(path)
    with pytest.raises(VibratorError, match='no recording in this folder'):
        load_design(_empty(tmp_path))


def _empty(tmp_path):
    folder = tmp_path / 'empty'
    folder.mkdir()
    return folder


def test_validate_takes_a_recording(capsys, tmp_path):
    from hpv_twin.study.validate import main
    assert main(['--vibrator', str(tmp_path / 'gone.mcap')]) == 2
    assert 'gone.mcap: No such file' in capsys.readouterr().err
