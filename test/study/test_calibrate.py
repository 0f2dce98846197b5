"""Calibration: what is found, what cannot be, what is refused, what is written."""

import json
import struct

import numpy as np
import pytest

from hpv_twin.model import Simulation, Vibrator
from hpv_twin.recording.measurements import MeasurementFile
from hpv_twin.study import calibrate as command
from hpv_twin.study.calibrate import calibrate
from hpv_twin.study.measured import CalibrationError, Measured

AMBIENT = 101_325.0
MACHINE = Vibrator(pump_flow=7.6e-4, bulk_modulus=1.3e9, preload=5.5e-3, flow_coefficient=0.65)


def motion(design, seconds=2.0, rate=4000.0, settled=0.3):
    """Time from 0, gauge pressure and position of a settled machine, with noise."""
    simulation = Simulation(design)
    simulation.tick(settled)
    trace = simulation.advance(seconds, rate)
    random = np.random.default_rng(3)
    return (trace.time - settled, trace.pressure + 8e4 * random.standard_normal(len(trace.time)),
            trace.plunger_position + 1e-5 * random.standard_normal(len(trace.time)))


def measured(design=MACHINE, position=True, name='machine.mcap', **options):
    """What the sensors of a machine showed."""
    time, pressure, moved = motion(design, **options)
    if not position:
        return Measured(name, time, pressure, np.empty(0), np.empty(0))
    return Measured(name, time, pressure, time, moved)


def written(path, time, pressure, position=None, ambient=AMBIENT):
    """Write a recording of sensors."""
    with MeasurementFile(path, metadata={'ambient_pressure': repr(AMBIENT)}) as file:
        file.write(np.round(1e9 * time).astype(np.int64) + 10 ** 18, pressure + ambient, position)
    return path


@pytest.fixture(scope='module')
def with_position():
    """Return the calibration of a machine from the base design, with a displacement sensor."""
    return calibrate([measured()], Vibrator())


def test_finds_the_machine_and_its_intervals_hold_it(with_position):
    verdicts = {verdict.name: verdict for verdict in with_position.verdicts}
    for name in ('bulk_modulus', 'pump_flow', 'preload', 'flow_coefficient'):
        found, truth = verdicts[name], getattr(MACHINE, name)
        assert found.identified
        assert found.value == pytest.approx(truth, rel=0.02)
        assert abs(found.value - truth) < 2.0 * found.half
    assert verdicts['preload'].half < 0.003 * MACHINE.preload
    force = {v.name: v for v in with_position.quantities}['opening_force']
    assert force.value == pytest.approx(2.5e5 * 5.5e-3 - 40.0, rel=3e-3)


def test_the_result_is_a_design_with_origins(with_position, tmp_path):
    path = tmp_path / 'found.yaml'
    path.write_text(with_position.to_yaml(), encoding='utf-8')
    assert Vibrator.load(path).preload == pytest.approx(with_position.design.preload, rel=1e-9)
    assert 'calibrated from machine.mcap' in path.read_text(encoding='utf-8')


def test_json_tells_intervals_correlations_and_residuals(with_position):
    told = json.loads(json.dumps(with_position.as_json()))
    preload = told['parameters']['preload']
    assert preload['low'] < preload['value'] < preload['high']
    assert abs(told['correlations']['bulk_modulus']['pump_flow']) <= 1.0
    assert told['residual']['pressure_rms'] == pytest.approx(8e4, rel=0.2)
    assert 'only the ratio kappa/W0' in with_position.as_text()


def test_preload_and_stiffness_are_one_product_by_pressure_alone():
    found = calibrate([measured(position=False, seconds=1.0)], Vibrator(),
                      ('bulk_modulus', 'preload', 'slotted_spring_stiffness', 'line_damping'))
    lost = {verdict.name: verdict for verdict in found.verdicts if not verdict.identified}
    assert set(lost) & {'preload', 'slotted_spring_stiffness'} or all(
        verdict.half > 0.0 for verdict in found.verdicts)
    assert '3e-3 N·s/m' in lost['line_damping'].why


def still(path):
    time = np.arange(0.0, 2.0, 1e-3)
    return written(path, time, 5e6 + 1e4 * np.sin(time))


def in_bar(path):
    time, pressure, _ = motion(MACHINE, 1.0)
    return written(path, time, 1e-5 * pressure, ambient=1.0)


def gauge(path):
    time, pressure, _ = motion(MACHINE, 1.0)
    return written(path, time, pressure - 1e5, ambient=0.0)


def two_machines(path):
    time, pressure, _ = motion(MACHINE, 1.0)
    _, other, _ = motion(MACHINE.replace(pump_flow=6e-4), 1.0)
    return written(path, np.concatenate([time, 1.0 + time]), np.concatenate([pressure, other]))


def too_slow(path):
    time, pressure, _ = motion(MACHINE, 2.0, 500.0)
    return written(path, time, pressure)


def nothing(path):
    return written(path, np.empty(0), np.empty(0))


@pytest.mark.parametrize(('make', 'reason'), [
    (still, 'does not oscillate'), (in_bar, 'in bar'), (gauge, '--gauge'),
    (two_machines, 'two machines'), (too_slow, '1000 or more'), (nothing, 'samples'),
])
def test_what_is_not_this_machine_is_refused_with_the_reason(make, reason, tmp_path, capsys):
    assert command.main([str(make(tmp_path / 'odd.mcap'))]) == 1
    said = capsys.readouterr().err
    assert 'refused' in said and 'odd.mcap' in said and reason in said


def test_recordings_of_two_machines_are_refused():
    one = measured(seconds=0.6)
    other = measured(MACHINE.replace(pump_flow=6e-4), seconds=0.6, name='other.mcap')
    with pytest.raises(CalibrationError, match=r'machine\.mcap has .* Hz and other\.mcap'):
        calibrate([one, other], Vibrator())


def test_the_command_reads_a_file_writes_a_design_and_draws(tmp_path, capsys):
    path = written(tmp_path / 'm.mcap', *motion(MACHINE, 1.0))
    design, picture = tmp_path / 'found.yaml', tmp_path / 'fit.png'
    assert command.main([str(path), '--free', 'bulk_modulus,preload,pressure_offset', '-o',
                         str(design), '--plot', str(picture), '--json']) == 0
    assert json.loads(capsys.readouterr().out)['parameters']['preload']['identifiable']
    assert 'calibrated from m.mcap' in design.read_text(encoding='utf-8')
    width, height = struct.unpack('>II', picture.read_bytes()[16:24])
    assert width > 800 and height > 600


def test_an_unknown_parameter_is_refused_by_name(tmp_path, capsys):
    assert command.main([str(tmp_path / 'm.mcap'), '--free', 'kappa']) == 2
    assert 'kappa' in capsys.readouterr().err
