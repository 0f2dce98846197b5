"""`hpv-twin replay` makes a scene of a recording: right values, readable layout, clear errors."""
import os
import signal
import subprocess
import sys
import textwrap
import time
from itertools import pairwise

import numpy as np
import pytest

pytest.importorskip('rerun')
pytest.importorskip('rclpy')

import rerun
import viewer_recordings as made
from rerun.chunk import RrdReader
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

from hpv_twin.viewer import diagnostics, plots, replay
from hpv_twin.viewer.palette import LOAD
from hpv_twin.viewer.scene import Curve
from hpv_twin.viewer.signals import Signal

PRESSURE, PLUNGER = '/hpv_twin/pressure', '/hpv_twin/plunger'


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    """2 s of a twin, with a gap from 0.4 to 0.6 s and less flow after 1 s."""
    return made.write_twin(tmp_path_factory.mktemp('bags') / 'run.mcap', seconds=2.0,
                           gap=(0.4, 0.6))


@pytest.fixture(scope='module')
def scene(recording):
    return save(recording)


class Scene:
    """What stands in a saved scene."""

    def __init__(self, path):
        self.path = path
        reader = RrdReader(path)
        self.chunks = reader.stream().to_chunks()
        (blueprint,) = reader.blueprints()
        self.blueprint = [chunk.to_record_batch()
                          for chunk in reader.stream(store=blueprint).to_chunks()]

    def entities(self):
        return {chunk.entity_path for chunk in self.chunks}

    def values(self, entity, column='Scalars:scalars'):
        """Times (s since the start) and values of an entity."""
        tables = [chunk.to_record_batch() for chunk in self.chunks
                  if chunk.entity_path == entity and not chunk.is_static]
        times = [table.column('time').cast('int64').to_numpy() for table in tables]
        values = [value for table in tables for value in table.column(column).flatten().to_pylist()]
        return np.concatenate(times) * 1e-9, np.array(values)

    def wall_clock(self, entity):
        tables = [chunk.to_record_batch() for chunk in self.chunks
                  if chunk.entity_path == entity and not chunk.is_static]
        return np.concatenate([t.column('wall_clock').cast('int64').to_numpy() for t in tables])

    def static(self, entity, column):
        """The one static value of a component."""
        found = [table.column(column).to_pylist()[0][0]
                 for table in (chunk.to_record_batch() for chunk in self.chunks
                               if chunk.entity_path == entity and chunk.is_static)
                 if column in table.schema.names]
        return found[0]

    def laid_out(self, ending):
        """Every value in the blueprint of the components called so."""
        return [value for table in self.blueprint for name in table.schema.names
                if name.endswith(ending) for row in table.column(name).to_pylist() if row
                for value in row]


def save(path, *arguments):
    out = path.with_suffix('.rrd')
    assert replay.main([str(path), '--save', str(out), *arguments]) == 0
    return Scene(out)


def test_pressure_is_gauge_in_megapascal(scene):
    time, shown = scene.values(PRESSURE)
    there = ~np.isnan(shown)
    before = there & (time < 1.0)
    expected = made.waveform(time[before])[0] * 1e-6
    assert np.allclose(shown[before], expected, atol=1e-9)
    assert np.count_nonzero(there) == 1800


def test_positions_are_in_millimetres(scene):
    time, shown = scene.values(PLUNGER)
    before = ~np.isnan(shown) & (time < 1.0)
    assert np.allclose(shown[before], made.waveform(time[before])[1] * 1e3, atol=1e-9)
    assert np.nanmax(scene.values('/hpv_twin/valve_sleeve')[1]) == pytest.approx(2.0)


@pytest.mark.parametrize(('entity', 'name'), [
    ('pressure', 'pressure, gauge [MPa]'), ('plunger', 'plunger [mm]'),
    ('valve_sleeve', 'valve sleeve [mm]'), ('pump_flow', 'pump flow [L/min]'),
    ('preload', 'preload [mm]'), ('frequency', 'frequency [Hz]'),
    ('stroke', 'stroke [mm]')])
def test_names_carry_units(scene, entity, name):
    assert scene.static(f'/hpv_twin/{entity}', 'SeriesLines:names') == name


def test_each_quantity_has_a_colour_of_its_own(scene):
    quantities = ('pressure', 'plunger', 'valve_sleeve', 'pump_flow', 'preload', 'frequency',
                  'stroke')
    colours = {scene.static(f'/hpv_twin/{name}', 'SeriesLines:colors') for name in quantities}
    assert len(colours) == len(quantities)


def test_every_line_and_every_plot_keeps_extremes(scene):
    min_max = rerun.components.AggregationPolicy.MinMax.value
    lines = [f'/hpv_twin/{name}' for name in (
        'pressure', 'pressure/whole_run', 'plunger', 'valve_sleeve', 'pump_flow', 'preload',
        'frequency', 'stroke')]
    for entity in lines:
        assert scene.static(entity, 'SeriesLines:aggregation_policy') == min_max
    laid_out = scene.laid_out('aggregation_policy')
    assert len(laid_out) == 7
    assert set(laid_out) == {min_max}


def test_plots_name_quantity_unit_and_range(scene):
    names = scene.laid_out('display_name')
    for name in ('Cycles, pressure, gauge [MPa]; dots: opening (green), return (red)',
                 'Cycles, position [mm]', 'Phases of the cyclogram',
                 'Frequency [Hz]: 38.50 to 55.00', 'Stroke [mm]: 2.00',
                 'Pump flow [L/min]: 30.0 to 43.8', 'Preload [mm]: 5.20',
                 'Velocity [m/s] over position [mm]', 'Plunger [mm] over frequency [Hz]',
                 'Cutaway: motion ×6; oil dark 0, bright 16 MPa gauge'):
        assert name in names


def test_a_load_has_a_strip_as_soon_as_there_is_one(tmp_path):
    scene = save(made.write_twin(tmp_path / 'pull.mcap', seconds=0.3, load=-250.0))
    assert scene.values('/hpv_twin/load')[1] == pytest.approx([-250.0, -250.0])
    assert scene.static('/hpv_twin/load', 'SeriesLines:names') == 'load [N]'
    assert 'Load [N]: -250' in scene.laid_out('display_name')


def test_opening_and_return_are_marked_on_the_pressure(scene):
    time, shown = scene.values('/hpv_twin/pressure/opening')
    assert len(time) in (81, 82, 83)  # 0.8 s at 55 Hz and 1 s at 38.5 Hz
    assert np.median(shown) == pytest.approx(13.3, abs=1.0)
    time, shown = scene.values('/hpv_twin/pressure/return')
    assert len(time) in (81, 82, 83)
    assert np.median(shown) == pytest.approx(1.5, abs=0.7)


def test_the_cutaway_moves_with_plunger_and_sleeve(scene):
    plunger, position = scene.values('/hpv_twin/plunger')
    for name, most in (('plunger', 12.0), ('valve_sleeve', 12.0)):
        time, moved = scene.values(f'/hpv_twin/cutaway/{name}', 'Transform3D:translation')
        along = moved.reshape(-1, 3)[:, 0]
        assert along.min() == 0.0
        assert along.max() == pytest.approx(most)  # mm: 2.00 mm six times
    time, moved = scene.values('/hpv_twin/cutaway/plunger', 'Transform3D:translation')
    there = np.isin(time, plunger)
    assert there.all()
    shown = dict(zip(plunger, position, strict=True))
    assert moved.reshape(-1, 3)[:, 0] == pytest.approx([6.0 * shown[t] for t in time], abs=1e-3)


def test_oil_is_coloured_by_pressure(scene):
    _, pressed = scene.values('/hpv_twin/cutaway/oil/A', 'Mesh3D:albedo_factor')
    red = pressed >> 24
    assert red.min() < 60
    assert red.max() > 240
    assert scene.static('/hpv_twin/cutaway/oil/C', 'Mesh3D:albedo_factor') >> 24 < 60


def test_phases_follow_each_other(scene):
    _, names = scene.values('/hpv_twin/phases', 'StateChange:state')
    assert set(names) == {'t_kh build-up', 't_kn forward', 't_kb dwell', 't_RS return', ''}
    order = ['t_kh build-up', 't_kn forward', 't_kb dwell', 't_RS return']
    following = {a: b for a, b in zip(order, order[1:] + order[:1], strict=True)}
    wrong = sum(b != following[a] for a, b in pairwise(names) if a and b)
    assert wrong == 0


def test_spectrum_shows_the_frequency(scene):
    chunks = [table for table in (chunk.to_record_batch() for chunk in scene.chunks
                                  if chunk.entity_path == '/hpv_twin/spectrum')]
    rows = [row[0] for table in chunks if 'BarChart:values' in table.schema.names
            for row in table.column('BarChart:values').to_pylist()]
    frequency = next(row[0] for table in chunks if 'BarChart:abscissa' in table.schema.names
                     for row in table.column('BarChart:abscissa').to_pylist() if row)
    first = np.array(rows[-1]['buffer'])
    assert np.array(frequency['buffer'])[first.argmax()] == pytest.approx(38.5, abs=1.5)


def test_plays_slowly_on_seconds_since_the_start(scene):
    assert scene.laid_out('playback_speed') == [0.02]
    assert scene.laid_out('TimePanelBlueprint:timeline') == ['time']
    time, _ = scene.values(PRESSURE)
    assert time[0] == 0.0
    assert np.array_equal(scene.wall_clock(PRESSURE) - made.START, np.rint(time * 1e9))


def test_a_gap_breaks_the_lines(scene):
    for entity in (PRESSURE, PLUNGER):
        time, shown = scene.values(entity)
        (at,) = np.flatnonzero(np.isnan(shown))
        assert time[at - 1] == pytest.approx(0.399)
        assert time[at + 1] == pytest.approx(0.6)
    time, shown = scene.values('/hpv_twin/frequency')
    (at,) = np.flatnonzero(np.isnan(shown))
    assert 0.39 < time[at] < 0.41


def test_setpoints_are_steps_that_reach_to_the_end(scene):
    time, shown = scene.values('/hpv_twin/pump_flow')
    assert time == pytest.approx([0.0, 1.0, 1.999])
    assert shown == pytest.approx([43.8, 30.0, 30.0])
    step = rerun.components.InterpolationMode.StepAfter.value
    assert scene.static('/hpv_twin/pump_flow', 'SeriesLines:interpolation_mode') == step


def test_events_tell_setpoints_gaps_and_health(scene):
    _, lines = scene.values('/events', 'TextLog:text')
    _, levels = scene.values('/events', 'TextLog:level')
    assert lines.tolist() == [
        '0.000 s: pump flow 43.8 L/min', '0.000 s: preload 5.20 mm', '0.000 s: load 0 N',
        '0.100 s: /hpv_twin: timing OK: on time',
        '0.399 s: gap of 201 ms: 200 samples missing',
        '1.000 s: pump flow 30.0 L/min (was 43.8 L/min)',
        '1.100 s: /hpv_twin: timing WARN: 3 ticks late (was OK)',
        '1.999 s: /hpv_twin: timing OK: on time (was WARN)']
    assert [line for line, level in zip(lines, levels, strict=True) if level == 'WARN'] == [
        lines[4], lines[6]]


def test_card_tells_file_figures_and_design(scene):
    card = scene.static('/card', 'TextDocument:text')
    for line in ('run.mcap', '| node | /hpv_twin (hpv_twin 0.1.0) |', '101.325 kPa |',
                 '| samples | 1,800 at 1000 Hz |', '| gaps | 1, longest 201 ms |',
                 '| stroke | 2.00 mm |', '| opening pressure (median) | 1',
                 '| build-up, t_kh (median) | 12.', '| dwell, t_kb (median) | 0.'):
        assert line in card
    design = scene.static('/design', 'TextDocument:text')
    for line in ('| plunger seat diameter, d1 | 11 mm | chosen |', '| stroke, h_b | 2 mm | paper |',
                 '| preload, y01 | 5.2014 mm | derived |',
                 '| pump flow, Q_H | 43.8 L/min | paper |'):
        assert line in design
    assert scene.static('/card', 'TextDocument:media_type') == 'text/markdown'


def test_a_part_keeps_its_seconds_and_the_setpoint_in_force(recording, tmp_path):
    part = tmp_path / 'part.mcap'
    part.write_bytes(recording.read_bytes())
    scene = save(part, '--from', '1.2', '--to', '1.5')
    time, _ = scene.values(PRESSURE)
    assert (time[0], time[-1]) == (pytest.approx(1.2), pytest.approx(1.499))
    time, shown = scene.values('/hpv_twin/pump_flow')
    assert time == pytest.approx([1.2, 1.499])
    assert shown == pytest.approx([30.0, 30.0])
    assert scene.values('/hpv_twin/frequency')[0][0] >= 1.2


def test_ambient_and_design_can_be_given(tmp_path, capsys):
    path = made.write_twin(tmp_path / 'run.mcap', seconds=0.2, with_metadata=False)
    design = tmp_path / 'mine.yaml'
    design.write_text('stroke: 2.5e-3\n')
    absolute = save(path, '--ambient', '0', '--vibrator', str(design))
    gauge = save(path)
    assert absolute.values(PRESSURE)[1] - gauge.values(PRESSURE)[1] == pytest.approx(0.101325)
    assert '| stroke, h_b | 2.5 mm | user |' in absolute.static('/design', 'TextDocument:text')
    assert '/design' not in gauge.entities()
    assert '101325 Pa ambient' in capsys.readouterr().out


def test_several_twins_stand_in_tabs(tmp_path):
    nodes = ['/left/hpv_twin', '/right/hpv_twin']
    scene = save(made.write_twin(tmp_path / 'two.mcap', seconds=0.3, nodes=nodes))
    for node in nodes:
        assert len(scene.values(f'{node}/pressure')[0]) == 300
        assert node in scene.laid_out('display_name')


def test_recordings_of_others(tmp_path):
    path = tmp_path / 'rig.mcap'
    with made.Recording(path) as recording:
        for i in range(200):
            now = made.START + i * 1_000_000
            recording.write('/odd', now, Float64(data=1.0))
            for topic, pressure in (('/rig/pump', 3e6), ('/rig/tank', 2e5)):
                message = FluidPressure(fluid_pressure=pressure + made.AMBIENT)
                message.header.stamp = made.stamp(now)
                recording.write(topic, now, message)
            message = JointState(name=['lever'], position=[0.25])
            message.header.stamp = made.stamp(now)
            recording.write('/joint_states', now, message)
    scene = save(path)
    assert scene.values('/rig/pump')[1] == pytest.approx(np.full(200, 3.0))
    assert scene.values('/rig/tank')[1] == pytest.approx(np.full(200, 0.2))
    assert scene.values('/joint_states/lever')[1] == pytest.approx(np.full(200, 0.25))
    assert scene.static('/joint_states/lever', 'SeriesLines:names').endswith('[m or rad]')


def test_a_measured_machine_stands_beside_its_twin(tmp_path):
    path = tmp_path / 'tracked.mcap'
    times = made.START + np.arange(500, dtype=np.int64) * 1_000_000
    with made.Recording(path, metadata=made.metadata()) as recording:
        for now in times:
            message = FluidPressure(fluid_pressure=7e6 + made.AMBIENT)
            message.header.stamp = made.stamp(now)
            recording.write('/hpv_twin/measured/pressure', now, message)
            message = JointState(name=['plunger'], position=[1e-3])
            message.header.stamp = made.stamp(now)
            recording.write('/hpv_twin/measured/plunger_position', now, message)
        made.write_waveforms(recording, '/hpv_twin', times)
        for now in times[::18]:
            recording.write('/hpv_twin/estimate/pump_flow', now, Float64(data=7.0e-4))
            recording.write('/hpv_twin/estimate/wear', now, Float64(data=0.25))
            recording.write('/hpv_twin/residual', now, Float64(data=2.0e5))
    scene = save(path)
    assert scene.values('/hpv_twin/measured/pressure')[1] == pytest.approx(np.full(500, 7.0))
    assert scene.static('/hpv_twin/measured/pressure', 'SeriesLines:names') == (
        'measured, gauge [MPa]')
    joint = '/hpv_twin/measured/plunger_position/plunger'
    assert scene.values(joint)[1] == pytest.approx(np.full(500, 1.0))
    assert scene.static(joint, 'SeriesLines:names') == 'measured plunger [mm]'
    for entity, value, name in (('estimate/pump_flow', 42.0, 'pump flow, estimated [L/min]'),
                                ('estimate/wear', 0.25, 'wear, estimated'),
                                ('residual', 0.2, 'residual [MPa]')):
        assert np.median(scene.values(f'/hpv_twin/{entity}')[1]) == pytest.approx(value)
        assert scene.static(f'/hpv_twin/{entity}', 'SeriesLines:names') == name
    names = scene.laid_out('display_name')
    assert 'Residual [MPa]: 0.200' in names
    assert '| samples | 500 at 1000 Hz |' in scene.static('/card', 'TextDocument:text')


def test_long_runs_are_shown_by_their_envelope(tmp_path):
    path = tmp_path / 'long.mcap'
    with made.Recording(path) as recording:
        for i in range(20_000):
            value = 5e6 if i == 12_345 else 1e6
            now = made.START + i * 1_000_000 + (10**9 if i >= 15_000 else 0)
            message = FluidPressure(fluid_pressure=value + made.AMBIENT)
            message.header.stamp = made.stamp(now)
            recording.write('/pressure', now, message)
    time, shown = save(path).values('/pressure/whole_run')
    assert len(shown) < 10_000
    assert np.nanmax(shown) == pytest.approx(5.0)
    assert np.nanmin(shown) == pytest.approx(1.0)
    assert time[np.nanargmax(shown)] == pytest.approx(12.345, abs=0.01)
    assert 14.9 < time[np.isnan(shown)].min() < 15.1


def test_a_cut_file_is_shown_as_far_as_it_goes(tmp_path, capsys):
    path = made.write_twin(tmp_path / 'cut.mcap', seconds=2.0, chunk_size=32 * 1024)
    path.write_bytes(path.read_bytes()[:path.stat().st_size // 2])
    time, _ = save(path).values(PRESSURE)
    assert 0.4 < time[-1] < 1.9
    (line,) = capsys.readouterr().err.splitlines()
    assert str(path) in line
    assert 'not finished' in line


def test_a_damaged_chunk_leaves_a_gap(tmp_path, capsys):
    path = made.write_twin(tmp_path / 'flip.mcap', seconds=2.0, chunk_size=32 * 1024)
    data = bytearray(path.read_bytes())
    data[len(data) // 2:len(data) // 2 + 64] = bytes(64)
    path.write_bytes(data)
    time, shown = save(path).values(PRESSURE)
    assert time[-1] == pytest.approx(1.999)
    assert np.isnan(shown).any()
    (line,) = capsys.readouterr().err.splitlines()
    assert 'damaged and left out' in line


def refuse(capsys, *arguments):
    """The one line of an error with exit status 1."""
    assert replay.main([str(argument) for argument in arguments]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_a_missing_file(tmp_path, capsys):
    line = refuse(capsys, tmp_path / 'nowhere.mcap', '--save', tmp_path / 'out.rrd')
    assert 'nowhere.mcap' in line
    assert 'No such file' in line
    assert not (tmp_path / 'out.rrd').exists()


def test_not_a_recording(tmp_path, capsys):
    path = tmp_path / 'notes.mcap'
    path.write_text('these are notes, not a recording')
    assert f'{path}: is not an MCAP file' in refuse(capsys, path, '--save', tmp_path / 'out.rrd')


def test_nothing_to_show(tmp_path, capsys):
    path = tmp_path / 'odd.mcap'
    with made.Recording(path) as recording:
        recording.write('/odd', made.START, Float64(data=1.0))
    line = refuse(capsys, path, '--save', tmp_path / 'out.rrd')
    assert 'no sensor_msgs/FluidPressure' in line
    assert '/odd (std_msgs/msg/Float64)' in line


def test_an_empty_time_range(recording, tmp_path, capsys):
    line = refuse(capsys, recording, '--from', '7', '--save', tmp_path / 'out.rrd')
    assert str(recording) in line
    assert 'from 7 s to the end' in line
    assert 'lasts 2.' in line


def test_an_unwritable_place(recording, tmp_path, capsys):
    line = refuse(capsys, recording, '--save', tmp_path / 'no' / 'out.rrd')
    assert 'out.rrd: No such file or directory' in line


def test_a_name_that_is_no_scene_is_refused(recording, capsys):
    size = recording.stat().st_size
    with pytest.raises(SystemExit) as stop:
        replay.main([str(recording), '--save', str(recording)])
    assert stop.value.code == 2
    assert 'ends in .rrd' in capsys.readouterr().err
    assert recording.stat().st_size == size


@pytest.mark.skipif(sys.platform == 'win32', reason='POSIX limits')
def test_a_full_disk_leaves_the_old_scene(recording, tmp_path):
    out = tmp_path / 'out.rrd'
    out.write_bytes(b'the old one')
    script = ('import resource, sys; from hpv_twin.viewer.replay import main; '
              'resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000)); '
              'sys.exit(main(sys.argv[1:]))')
    result = subprocess.run([sys.executable, '-c', script, str(recording), '--save', str(out)],
                            stderr=subprocess.PIPE, text=True, check=False, timeout=60)
    assert result.returncode == 1
    assert result.stderr == f'hpv-twin replay: {out}: File too large\n'
    assert out.read_bytes() == b'the old one'
    assert list(tmp_path.iterdir()) == [out]


def test_a_bad_design(recording, tmp_path, capsys):
    design = tmp_path / 'bad.yaml'
    design.write_text('stroke: -1\n')
    line = refuse(capsys, recording, '--vibrator', design, '--save', tmp_path / 'out.rrd')
    assert 'bad.yaml' in line
    assert 'stroke' in line


@pytest.mark.parametrize('arguments', [
    ['--from', '3', '--to', '2'], ['--from', 'x'], ['--bogus'], ['a.mcap', 'b.mcap'],
    ['--from', 'nan'], ['--to', 'inf'], ['--from', '-1'], ['--ambient', 'nan']])
def test_misuse_is_status_2(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        replay.main(arguments)
    assert stop.value.code == 2
    assert 'usage: hpv-twin replay' in capsys.readouterr().err


def test_help_teaches(capsys):
    with pytest.raises(SystemExit) as stop:
        replay.main(['--help'])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    for part in ('examples:', '--save', '--from', '--to', '--ambient', '--vibrator'):
        assert part in text


def test_without_a_file_the_newest(recording, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert 'no recording in' in refuse(capsys, '--save', 'out.rrd')
    bags = tmp_path / 'bags'
    bags.mkdir()
    for name, age in (('old.mcap', 100), ('new.mcap', 10)):
        (bags / name).write_bytes(recording.read_bytes())
        os.utime(bags / name, (time.time() - age,) * 2)
    assert replay.main(['--save', 'out.rrd']) == 0
    assert 'new.mcap' in capsys.readouterr().out


def test_without_a_display_it_suggests_to_save(recording, monkeypatch, capsys):
    monkeypatch.setattr(sys, 'platform', 'linux')
    for name in ('DISPLAY', 'WAYLAND_DISPLAY'):
        monkeypatch.delenv(name, raising=False)
    line = refuse(capsys, recording)
    assert 'no display' in line
    assert '--save' in line


def test_without_rerun_it_says_how_to_get_it(recording, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'rerun', None)
    assert "pip install 'hpv_twin[viewer]'" in refuse(capsys, recording)


@pytest.mark.skipif(sys.platform == 'win32', reason='POSIX signals')
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_viewer_too(recording, tmp_path, number):
    """A stand-in for the viewer notes its arguments and would stay for a minute."""
    viewer, notes = tmp_path / 'viewer', tmp_path / 'notes'
    viewer.write_text(textwrap.dedent(f"""\
        #!{sys.executable}
        import os, pathlib, sys, time
        part = pathlib.Path({str(notes)!r} + '.part')
        part.write_text(chr(10).join([str(os.getpid()), *sys.argv[1:]]))
        part.rename({str(notes)!r})
        time.sleep(60)
        """))
    viewer.chmod(0o755)
    command = 'import sys; from hpv_twin.viewer.replay import main; sys.exit(main(sys.argv[1:]))'
    process = subprocess.Popen(
        [sys.executable, '-c', command, str(recording)],
        env=dict(os.environ, RERUN_CLI_PATH=str(viewer), DISPLAY=':0'),
        stdout=subprocess.DEVNULL, start_new_session=True)
    try:
        wait_for(notes.exists)
        pid, *arguments = notes.read_text().splitlines()
        shown = arguments[-1]
        assert arguments[:4] == ['--bind', '127.0.0.1', '--port', 'auto']
        assert os.path.exists(shown)
        process.send_signal(number)
        assert process.wait(15) == 0
        with pytest.raises(ProcessLookupError):
            os.kill(int(pid), 0)
        assert not os.path.exists(shown)
    finally:
        process.kill()
        process.wait()


def wait_for(condition, seconds=30.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.parametrize(('low', 'high'), [
    (55.0, 55.0), (38.5, 55.0), (27.2, 67.8), (0.0, 55.0), (0.0, 0.0), (2.0, 2.0), (5.2, 6.0),
    (-500.0, 8000.0), (0.1, 0.1001)])
def test_a_strip_has_room_for_two_numbers_at_least(low, high):
    curve = Curve('/x', LOAD, Signal(np.arange(2), np.array([low, high])))
    bottom, top = plots.ticked_axis(curve).range.as_arrow_array().to_pylist()[0]
    assert bottom < low
    assert high < top
    step = 10.0 ** np.ceil(np.log10((top - bottom) / 5.0))  # what the viewer has room for
    assert np.floor(top / step) - np.ceil(bottom / step) >= 1


def test_every_cut_diagnostic_message_is_survived():
    payload = made.serialize_message(made.diagnostics('/hpv_twin', 2, 'late'))
    assert diagnostics.statuses(7, payload) == [
        diagnostics.Status(7, '/hpv_twin: timing', 2, 'late')]
    for size in range(len(payload)):
        for status in diagnostics.statuses(7, payload[:size]):
            assert status.name in '/hpv_twin: timing'
