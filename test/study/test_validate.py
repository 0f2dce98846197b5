"""`validate`: the paper's rows pass on the base design and fail on a disturbed one."""
import json

import pytest

from hpv_twin.model import Vibrator
from hpv_twin.study import rows, validate


@pytest.fixture(scope='module')
def measured():
    return validate.measure(Vibrator())


def test_base_design_passes_every_row(measured, capsys):
    assert [row.result for row in measured if not row.passed] == []
    assert len(measured) == 14


def test_a_disturbed_design_fails(tmp_path, capsys):
    path = tmp_path / 'stiff.yaml'
    path.write_text('bulk_modulus: 1.54e9')
    assert validate.main(['--vibrator', str(path)]) == 1
    out = capsys.readouterr().out
    assert 'FAIL  steady frequency' in out and 'rows pass' in out


def test_json_holds_paper_twin_tolerance_and_verdict(capsys):
    assert validate.main(['--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert {'result', 'paper', 'twin', 'accepted', 'passed', 'note'} == set(found[0])
    assert found[0]['paper'] == '55 Hz' and found[0]['passed'] is True


def test_plot_is_a_picture(tmp_path, capsys):
    pyplot = pytest.importorskip('matplotlib.pyplot')
    path = tmp_path / 'out.png'
    assert validate.main(['--plot', str(path)]) == 0
    image = pyplot.imread(path)
    assert image.shape[0] > 500 and image[..., :3].std() > 0.05


def test_a_design_that_does_not_oscillate_fails_and_says_so():
    still = Vibrator(pump_flow=0.0)
    made = rows.cycle_rows(still)
    assert not made[0].passed and made[0].twin == 'no opening'
    for make in rows.ROWS[1:]:
        make(still)  # no row raises


def test_a_bad_design_file_is_one_line_and_exit_code_2(tmp_path, capsys):
    path = tmp_path / 'bad.yaml'
    path.write_text('stroke: long')
    assert validate.main(['--vibrator', str(path)]) == 2
    assert str(path) in capsys.readouterr().err


@pytest.mark.parametrize('field, factor, result', [
    ('cavity_volume', 0.9, 'steady frequency'),
    ('preload', 1.1, 'highest pressure'),
    ('sleeve_seat_diameter', 1.05, 'return stroke starts'),
    ('plunger_mass', 2.0, 'dwell'),
])
def test_each_figure_can_fail(field, factor, result):
    design = Vibrator()
    design = design.replace(**{field: factor * getattr(design, field)})
    failed = [row.result for row in rows.cycle_rows(design) if not row.passed]
    assert any(name.startswith(result) for name in failed)
