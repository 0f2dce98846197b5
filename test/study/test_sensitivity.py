"""`sensitivity`: the derivatives are those of the oracle, and what a person would expect."""
import json
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('tqdm')

from hpv_twin.model import Vibrator
from hpv_twin.model.designs import FIELDS
from hpv_twin.study import sensitivity
from hpv_twin.study.farm import Farm
from hpv_twin.study.sensitivity import sensitivities

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'model'))
from oracle import Oracle

FIGURES = ('frequency', 'peak_pressure', 'impact_energy')


@pytest.fixture(scope='module')
def table():
    with Farm() as farm:
        return sensitivities(Vibrator(), FIGURES, farm)


def row(table, name):
    return table.value[table.fields.index(name)]


def by_oracle(design):
    """The three figures of the settled motion, by the oracle alone."""
    oracle = Oracle(design)
    record = oracle.run(0.075)
    cycle = record.cycles()[-1]
    arrival = [s for s in record.switches if s.named == 'open'][-1]
    both = design.plunger_mass + design.sleeve_mass
    return np.array([1.0 / cycle.period, cycle.peak_pressure,
                     0.5 * both * arrival.plunger_velocity ** 2])


@pytest.mark.parametrize('name', [
    'plunger_seat_diameter', 'sleeve_seat_diameter', 'preload', 'slotted_spring_stiffness',
    'stroke', 'bulk_modulus', 'pump_flow', 'gap_ratio', 'plunger_mass', 'flow_coefficient',
    'viscous_friction', 'sleeve_mass', 'twisted_spring_stiffness'])
def test_derivatives_are_those_of_the_oracle(table, name):
    base = Vibrator()
    value, step = getattr(base, name), 2e-3 * getattr(base, name)
    up, down = (by_oracle(base.replace(**{name: value + way * step})) for way in (1.0, -1.0))
    expected = (up - down) / (2.0 * step) * value / by_oracle(base)
    assert row(table, name) == pytest.approx(expected, rel=1e-3, abs=2e-4)


def test_what_stands_in_the_equations_as_a_quotient_has_opposite_derivatives(table):
    assert row(table, 'bulk_modulus') == pytest.approx(-row(table, 'cavity_volume'), rel=1e-5)
    # The flow through the slot goes with xi/sqrt(rho).
    assert row(table, 'density') == pytest.approx(-0.5 * row(table, 'flow_coefficient'), rel=1e-4,
                                                  abs=1e-6)
    assert table.smooth.all()


def test_every_field_has_a_row_and_those_at_0_are_per_unit(table):
    assert table.fields == tuple(FIELDS)
    assert table.per_unit == {name for name in FIELDS if getattr(Vibrator(), name) == 0.0}
    assert np.isfinite(table.value).all()


def test_a_corner_is_marked(monkeypatch):
    class Corner(Farm):
        def run(self, designs):
            count = len(designs)
            flow = np.broadcast_to(designs.pump_flow, count)
            bent = 1.0 + np.abs(flow / 7.3e-4 - 1.0001)
            return {'frequency': bent, 'regime': np.full(count, 'seated oscillation')}
    table = sensitivities(Vibrator(), ('frequency',), Corner())
    assert not table.smooth[table.fields.index('pump_flow'), 0]
    assert table.smooth[table.fields.index('preload'), 0]


def test_the_command_prints_table_json_csv_and_picture(tmp_path, capsys):
    csv, png = tmp_path / 's.csv', tmp_path / 't.png'
    assert sensitivity.main(['-o', str(csv), '--plot', str(png)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert 'frequency' in lines[0] and '55 Hz' in lines[1]
    assert len(csv.read_text().splitlines()) == 1 + len(FIELDS)
    assert png.stat().st_size > 20_000
    assert sensitivity.main(['--json', '--figures', 'efficiency']) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told['fields']) == set(FIELDS) and 'efficiency' in told['figures']


def test_what_makes_no_table_is_told(tmp_path, capsys):
    assert sensitivity.main(['--figures', 'speed']) == 2
    assert 'no figure "speed"' in capsys.readouterr().err
    still = tmp_path / 'still.yaml'
    still.write_text('pump_flow: 0.0\n')
    assert sensitivity.main(['--vibrator', str(still)]) == 1
    assert 'does not oscillate' in capsys.readouterr().err
