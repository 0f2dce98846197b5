"""`calibrate`: true values within honest intervals, what cannot be told, refusals, files."""
import json

import numpy as np
import pytest

pytest.importorskip('tqdm')

from hpv_twin.model import Simulation, Vibrator
from hpv_twin.node import machine_file
from hpv_twin.study import calibrate as command
from hpv_twin.study.calibrate import calibrate
from hpv_twin.study.cycle_wave import cycle_wave
from hpv_twin.study.fit import FREE
from hpv_twin.study.folding import fold
from hpv_twin.study.measured import CalibrationError, Measured, read_measured

BASE = Vibrator()
TRUTH = BASE.replace(bulk_modulus=1.25e9, pump_flow=6.6e-4, preload=5.6e-3, flow_coefficient=0.68,
                     viscous_friction=45.0)
OFFSETS = {'pressure_offset': 3e4, 'position_offset': 2e-5}


def measured(design, seconds=4.0, rate=5000.0, noise=8e4, seed=1, position=True, **more):
    """What sensors show of a machine, by the model itself."""
    random = np.random.default_rng(seed)
    simulation = Simulation(design)
    simulation.tick(0.31)
    trace = simulation.advance(seconds, rate)
    time = trace.time - trace.time[0]
    pressure = trace.pressure + noise * random.standard_normal(len(time)) + 3e4
    moved = trace.plunger_position + 1e-5 * random.standard_normal(len(time)) + 2e-5
    return Measured(more.get('name', 'made.mcap'), time, pressure, time if position else moved[:0],
                    moved if position else moved[:0])


@pytest.fixture(scope='module')
def outcome():
    return calibrate([measured(TRUTH)], BASE)


def verdicts_of(outcome):
    return {verdict.name: verdict for verdict in outcome.verdicts}


def test_the_truth_lies_where_it_is_said_to(outcome):
    found = verdicts_of(outcome)
    assert tuple(found) == FREE
    for name, verdict in found.items():
        truth = OFFSETS.get(name) or getattr(TRUTH, name)
        assert verdict.identified
        assert abs(verdict.value - truth) < 2.0 * verdict.half, name
    for name, share in (('bulk_modulus', 0.01), ('pump_flow', 0.01), ('preload', 1e-3),
                        ('flow_coefficient', 0.01)):
        assert found[name].half < share * found[name].value
    assert outcome.fit.cost == pytest.approx(1.0, abs=0.1) and outcome.fit.order < 2.0
    by_name = {quantity.name: quantity for quantity in outcome.quantities}
    assert by_name['cavity_stiffness'].value == pytest.approx(
        TRUTH.bulk_modulus / TRUTH.cavity_volume, rel=0.01)


def test_wrong_starts_lead_to_the_same_answer(outcome):
    random = np.random.default_rng(3)
    wrong = BASE.replace(**{name: getattr(BASE, name) * random.uniform(0.8, 1.2)
                            for name in FREE if name not in OFFSETS})
    again = verdicts_of(calibrate([measured(TRUTH)], wrong))
    for name, verdict in verdicts_of(outcome).items():
        assert again[name].value == pytest.approx(verdict.value, abs=0.05 * verdict.half)


def test_noise_gaps_and_a_clock_that_jitters_do_no_harm():
    random, clean = np.random.default_rng(2), measured(TRUTH, 6.0)
    kept = np.sort(random.permutation(len(clean.time))[:20_000])
    kept = kept[(clean.time[kept] < 2.0) | (clean.time[kept] > 2.4)]
    time = clean.time + np.clip(2e-5 * random.standard_normal(len(clean.time)), -9e-5, 9e-5)
    rough = Measured('rough', time[kept], clean.pressure[kept], time[kept], clean.position[kept])
    found = verdicts_of(calibrate([rough], BASE))
    for name in ('bulk_modulus', 'pump_flow', 'preload', 'flow_coefficient'):
        assert abs(found[name].value - getattr(TRUTH, name)) < 2.0 * found[name].half, name


def test_pressure_alone_is_less_sure_and_says_so(outcome):
    alone = verdicts_of(calibrate([measured(TRUTH, position=False)], BASE))
    assert 'position_offset' not in alone
    for name in ('bulk_modulus', 'pump_flow', 'flow_coefficient'):
        assert alone[name].half > verdicts_of(outcome)[name].half
        assert abs(alone[name].value - getattr(TRUTH, name)) < 2.0 * alone[name].half


def test_what_the_data_cannot_tell_is_said_with_the_reason():
    free = ('bulk_modulus', 'pump_flow', 'preload', 'load', 'line_damping', 'flow_coefficient',
            'pressure_offset')
    outcome = calibrate([measured(TRUTH, position=False)], BASE.replace(viscous_friction=45.0),
                        free)
    found = verdicts_of(outcome)
    assert not found['line_damping'].identified and 'c0' in found['line_damping'].why
    assert not (found['preload'].identified and found['load'].identified)
    lost = next(found[name] for name in ('load', 'preload') if not found[name].identified)
    assert 'k1*y01 + F_T' in lost.why
    # It is kept where it was, and the file says so.
    assert getattr(outcome.design, lost.name) == getattr(BASE, lost.name)
    assert 'NOT identifiable from made.mcap' in outcome.to_yaml()
    # Their sum is known all the same.
    force = next(q for q in outcome.quantities if q.name == 'opening_force')
    truth = TRUTH.plunger_seat_area * TRUTH.opening_pressure
    assert force.half < 0.01 * force.value and abs(force.value - truth) < 3.0 * force.half


def test_preload_and_stiffness_are_almost_only_a_product_by_pressure_alone():
    free = ('bulk_modulus', 'pump_flow', 'preload', 'slotted_spring_stiffness')
    outcome = calibrate([measured(BASE, 2.0, position=False)], BASE, (*free, 'pressure_offset'))
    preload = verdicts_of(outcome)['preload']
    assert not preload.identified or 'only the product k1*y01' in preload.why
    force = next(q for q in outcome.quantities if q.name == 'spring_force')
    assert force.half / force.value < 0.1 * preload.half / preload.value


def test_noise_alike_from_sample_to_sample_widens_the_intervals(outcome):
    clean, random = measured(TRUTH, noise=0.0), np.random.default_rng(5)
    noise = np.convolve(random.standard_normal(len(clean.time) + 24), np.ones(25) / 5.0, 'valid')
    slow = Measured('slow', clean.time, clean.pressure + 8e4 * noise, clean.position_time,
                    clean.position)
    wide, narrow = verdicts_of(calibrate([slow], BASE)), verdicts_of(outcome)
    assert wide['preload'].half > 2.0 * narrow['preload'].half
    assert abs(wide['preload'].value - TRUTH.preload) < 2.0 * wide['preload'].half


def test_a_coarse_converter_does_no_harm():
    clean = measured(TRUTH, 2.0)
    coarse = Measured('coarse', clean.time, np.round(clean.pressure / 5e4) * 5e4, clean.time,
                      np.round(clean.position / 5e-5) * 5e-5)
    found = verdicts_of(calibrate([coarse], BASE))
    for name in ('bulk_modulus', 'pump_flow', 'preload', 'flow_coefficient'):
        assert abs(found[name].value - getattr(TRUTH, name)) < 2.0 * found[name].half, name


def test_what_is_not_noise_is_cautioned_of():
    outcome = calibrate([measured(TRUTH.replace(sleeve_seat_diameter=0.9 * TRUTH.
                                                sleeve_seat_diameter))], BASE)
    assert outcome.fit.order > 3.0 and 'CAUTION' in outcome.as_text()


def test_several_recordings_of_one_machine_say_more(outcome):
    two = calibrate([measured(TRUTH), measured(TRUTH, seed=2)], BASE)
    found = verdicts_of(two)
    assert found['preload'].half < 0.85 * verdicts_of(outcome)['preload'].half


@pytest.mark.parametrize('recordings, words', [
    ([measured(BASE.replace(pump_flow=0.0))], 'does not oscillate'),
    ([Measured('mm', m.time, m.pressure, m.time, 1e3 * m.position) for m in [measured(BASE)]],
     'in other units than m'),
    ([Measured('bar', m.time, m.pressure * 1e-5, m.time[:0], m.time[:0])
      for m in [measured(BASE)]], 'in bar'),
    ([Measured('MPa', m.time, m.pressure * 1e-6, m.time[:0], m.time[:0])
      for m in [measured(BASE)]], 'MPa'),
    ([Measured('twice', m.time, m.pressure - 4e5, m.time[:0], m.time[:0])
      for m in [measured(BASE)]], '--gauge'),
    ([measured(BASE), measured(TRUTH, name='other')], 'two machines'),
])
def test_what_is_not_this_machine_is_refused(recordings, words):
    with pytest.raises(CalibrationError, match=words):
        calibrate(recordings, BASE)


def test_a_machine_that_changes_is_refused():
    first, second = measured(BASE), measured(BASE.replace(pump_flow=7.0e-4))
    changed = Measured('changed', np.concatenate([first.time, first.time[-1] + 2e-4 + second.time]),
                       np.concatenate([first.pressure, second.pressure]), first.time[:0],
                       first.time[:0])
    with pytest.raises(CalibrationError, match='two machines'):
        calibrate([changed], BASE)


def test_another_kind_of_motion_is_refused():
    time = np.arange(20_000) / 5000.0
    sine = Measured('sine', time, 5e6 + 4e6 * np.sin(2.0 * np.pi * 55.0 * time), time[:0],
                    time[:0])
    with pytest.raises(CalibrationError, match='not this machine'):
        calibrate([sine], BASE)


def test_the_fold_finds_the_period_through_gaps():
    clean = measured(TRUTH, 3.0)
    kept = (clean.time < 1.0) | (clean.time > 1.37)
    gappy = Measured('gappy', clean.time[kept], clean.pressure[kept], clean.time[:0],
                     clean.time[:0])
    assert fold(gappy).period == pytest.approx(cycle_wave(TRUTH).period, rel=1e-5)


def test_a_file_is_calibrated_into_a_design_that_runs(tmp_path, capsys):
    mcap, yaml, png = (tmp_path / name for name in ('m.mcap', 'm.yaml', 'fit.png'))
    assert machine_file.main(['--to-file', str(mcap), '--duration', '4', '--rate', '5000',
                              '--fault', 'air_in_oil=0.3', '--dropouts', '0.02']) == 0
    capsys.readouterr()
    assert command.main([str(mcap), '-o', str(yaml), '--plot', str(png), '--json']) == 0
    told = json.loads(capsys.readouterr().out)
    kappa = told['parameters']['bulk_modulus']
    assert kappa['identifiable'] and kappa['low'] < kappa['value'] < kappa['high']
    assert kappa['value'] == pytest.approx(0.85 * BASE.bulk_modulus, rel=0.02)
    design = Vibrator.load(yaml)
    assert design.bulk_modulus == kappa['value']
    assert 'calibrated from m.mcap' in yaml.read_text()
    assert png.stat().st_size > 30_000
    assert command.main([str(mcap), '--no-position']) == 0
    assert 'pressure alone' in capsys.readouterr().out


def test_gauge_recordings_and_topics(tmp_path, capsys):
    mcap = tmp_path / 'gauge.mcap'
    machine_file.main(['--to-file', str(mcap), '--duration', '2', '--rate', '2000',
                       '--ambient-pressure', '0'])
    assert command.main([str(mcap), '--ambient', '101325']) in (0, 1)
    capsys.readouterr()
    assert command.main([str(mcap), '--gauge', '--free', 'preload,bulk_modulus']) == 0
    assert read_measured(mcap, gauge=True).rate == pytest.approx(2000.0)
    assert command.main([str(mcap), '--pressure-topic', '/nowhere']) == 1
    assert '/machine/pressure' in capsys.readouterr().err


@pytest.mark.parametrize('arguments, code, words', [
    (['absent.mcap'], 1, 'absent.mcap'),
    (['absent.mcap', '--free', 'speed'], 2, 'no free parameter "speed"'),
    (['absent.mcap', '--vibrator', 'absent.yaml'], 2, 'absent.yaml'),
])
def test_bad_arguments_are_told_in_one_line(arguments, code, words, capsys):
    assert command.main(arguments) == code
    said = capsys.readouterr().err
    assert words in said and 'Traceback' not in said


def test_too_slow_and_too_short_are_refused(tmp_path, capsys):
    slow, short = tmp_path / 'slow.mcap', tmp_path / 'short.mcap'
    machine_file.main(['--to-file', str(slow), '--duration', '2', '--rate', '500'])
    machine_file.main(['--to-file', str(short), '--duration', '0.2', '--rate', '5000'])
    assert command.main([str(slow)]) == 1 and command.main([str(short)]) == 1
    said = capsys.readouterr().err
    assert '500 samples' in said and 'less than 0.5 s' in said
