"""The package as a whole: colcon and pip install it, `ros2 run` finds it, its papers agree."""

import ast
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from importlib.metadata import Distribution
from pathlib import Path

import pytest
from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.package import parse_package
from catkin_pkg.package_version import get_forthcoming_label
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from hpv_twin import __version__
from hpv_twin.cli import COMMANDS

ROOT = Path(__file__).parents[1]
LIMIT = 120  # s, for one build


def run(*command, **options):
    """Run a command; where it fails, the assertion shows all that it said."""
    done = subprocess.run(list(map(str, command)), stdout=subprocess.PIPE, timeout=LIMIT,
                          stderr=subprocess.STDOUT, text=True, check=False, **options)
    assert done.returncode == 0, f'{command}\n{done.stdout}'
    return done.stdout


def outside():
    """Return the environment without what points at this source tree or at another prefix."""
    ours = re.compile('AMENT_|COLCON_|PYTHONPATH')
    return {name: value for name, value in os.environ.items() if not ours.match(name)}


# --- Installed three ways ---------------------------------------------------------------------

@pytest.fixture(scope='session')
def source(tmp_path_factory):
    """Return a copy of the source tree as a fresh clone has it."""
    copy = tmp_path_factory.mktemp('source') / 'hpv_twin'
    away = shutil.ignore_patterns('.git', '.venv*', 'build', 'install', 'log', '*.egg-info',
                                  '__pycache__', '.*_cache', '.hypothesis')
    return shutil.copytree(ROOT, copy, symlinks=True, ignore=away)


def colcon(source, work, *options):
    """Build with colcon; return the prefix and the environment of its setup.bash."""
    run(sys.executable, '-m', 'colcon', '--log-base', work / 'log', 'build', *options,
        '--base-paths', source, '--build-base', work / 'build', '--install-base', work / 'install',
        '--event-handlers', 'console_direct+', cwd=work, env=outside())
    lines = run('bash', '-c', f'. {work}/install/setup.bash && env -0', env=outside())
    env = dict(line.split('=', 1) for line in lines.split('\0') if '=' in line)
    return work / 'install' / 'hpv_twin', env


def pip(source, work):
    """Install with pip into an empty prefix; return it and an environment that uses it."""
    run(sys.executable, '-m', 'pip', 'install', '--quiet', '--no-deps', '--no-build-isolation',
        '--ignore-installed', '--no-warn-script-location', '--prefix', work, source, env=outside())
    return work, outside() | {'PYTHONPATH': str(site(work)), 'AMENT_PREFIX_PATH': str(work)}


def site(prefix):
    """Return where Python packages lie in a prefix."""
    return Path(sysconfig.get_path('purelib', vars={'base': str(prefix)}))


WAYS = {
    'colcon': colcon,
    'colcon-symlink': lambda source, work: colcon(source, work, '--symlink-install'),
    'pip': pip,
}


@pytest.fixture(scope='session', params=WAYS)
def installed(request, source, tmp_path_factory):
    """Return the prefix and the environment of each way of installing."""
    return WAYS[request.param](source, tmp_path_factory.mktemp(request.param))


def test_colcon_sees_a_ros_package(source, tmp_path):
    out = run(sys.executable, '-m', 'colcon', '--log-base', tmp_path, 'list', '--base-paths',
              source, env=outside())
    assert out.split() == ['hpv_twin', str(source), '(ros.ament_python)']


def test_ros2_run_finds_every_command(installed, tmp_path):
    # This is how `ros2 run` looks: the prefix by the ament index, then what is executable there.
    _, env = installed
    look = ('from ament_index_python import get_package_prefix, get_package_share_directory;'
            'print(get_package_prefix("hpv_twin"), get_package_share_directory("hpv_twin"))')
    prefix, share = run(sys.executable, '-c', look, env=env, cwd=tmp_path).split()
    found = {path.name for path in Path(prefix, 'lib/hpv_twin').iterdir()
             if os.access(path, os.X_OK)}
    assert found == set(COMMANDS)
    assert (Path(share) / 'package.xml').read_text() == (ROOT / 'package.xml').read_text()


@pytest.mark.parametrize('name', COMMANDS)
def test_launcher_runs_its_command(installed, name, tmp_path):
    prefix, env = installed
    out = run(prefix / 'lib/hpv_twin' / name, '--help', env=env, cwd=tmp_path)
    assert f'usage: hpv-twin {name}' in out


def test_launcher_runs_the_installed_code(installed, source, tmp_path):
    prefix, env = installed
    out = run(sys.executable, '-c', 'import hpv_twin; print(hpv_twin.__file__)', env=env,
              cwd=tmp_path)
    # With --symlink-install it lies in the build folder, as a link to the source.
    assert Path(out.strip()).resolve().is_relative_to(prefix.parent.resolve()) or (
        Path(out.strip()).resolve().is_relative_to(source.resolve()))
    assert run(prefix / 'bin/hpv-twin', '--version', env=env) == f'hpv_twin {__version__}\n'


@pytest.mark.parametrize(('folder', 'pattern'), [
    ('config', '*.yaml'), ('config/sros2', '*.xml'), ('launch', '*.launch.py'),
])
def test_shared_files_are_installed(installed, folder, pattern):
    prefix, _ = installed
    there = {path.name for path in (prefix / 'share/hpv_twin' / folder).iterdir()
             if path.is_file()}
    assert there == {path.name for path in (ROOT / folder).glob(pattern)}


def test_no_bare_name_enters_the_path(installed):
    prefix, _ = installed
    assert [path.name for path in (prefix / 'bin').iterdir()] == ['hpv-twin']


# --- Papers that must agree -------------------------------------------------------------------

@pytest.fixture(scope='session')
def metadata(source, tmp_path_factory):
    """Return the metadata that pip writes of a fresh install."""
    prefix, _ = pip(source, tmp_path_factory.mktemp('metadata'))
    return Distribution.at(next(site(prefix).glob('hpv_twin-*.dist-info')))


@pytest.fixture(scope='session')
def manifest():
    """Return package.xml, parsed and validated (catkin_pkg validates on parsing)."""
    return parse_package(str(ROOT / 'package.xml'))


def test_one_version_everywhere(metadata, manifest):
    assert metadata.version == manifest.version == __version__
    released = [version for version, _, _ in get_changelog_from_path(str(ROOT)).foreach_version()]
    forthcoming = get_forthcoming_label((ROOT / 'CHANGELOG.rst').read_text())
    assert forthcoming or released[0] == __version__


def test_only_the_package_is_installed(metadata):
    # What lies outside, under "..", is data: the launch file.
    tops = {path.parts[0] for path in metadata.files if path.suffix == '.py'} - {'..'}
    assert tops == {'hpv_twin'}


ROSDEP_KEYS = {
    'mcap': 'mcap-ros2-support', 'numba': 'python3-numba', 'numpy': 'python3-numpy',
    'pyyaml': 'python3-yaml', 'scipy': 'python3-scipy', 'zstandard': 'mcap-ros2-support',
}
IMPORTED_AS = {'yaml': 'pyyaml', 'rerun': 'rerun-sdk', 'rerun_cli': 'rerun-sdk',
               'distributed': 'dask'}


def test_rosdep_keys_follow_the_requirements(metadata, manifest):
    always = {canonicalize_name(Requirement(line).name) for line in metadata.requires
              if 'extra ==' not in line}
    keys = {depend.name for depend in manifest.exec_depends}
    assert {key for key in keys if re.match('python3-|mcap-', key)} == {
        ROSDEP_KEYS[name] for name in always}


def test_what_is_imported_is_required(metadata, manifest):
    files = [*(ROOT / 'hpv_twin').rglob('*.py'), *(ROOT / 'launch').glob('*.py')]
    names = set().union(*map(imports, files))
    names = {name for name in names if not name.startswith('hpv_twin')} - sys.stdlib_module_names
    ros = {name for name in names
           if name in ('rclpy', 'launch', 'launch_ros')
           or name.endswith(('_msgs', '_srvs', '_interfaces'))}
    keys = {depend.name for depend in manifest.exec_depends}
    assert {key for key in keys if not re.match('python3-|mcap-', key)} == ros
    assert {IMPORTED_AS.get(name, name) for name in names - ros} <= set(requirements(metadata))


def requirements(metadata, **environment):
    """Return every requirement of the package and its extras by name, for one environment."""
    lines = [Requirement(line) for line in metadata.requires]
    extras = metadata.metadata.get_all('Provides-Extra')
    return {canonicalize_name(line.name): line for line in lines for extra in ['', *extras]
            if line.marker is None or line.marker.evaluate({'extra': extra, **environment})}


@pytest.mark.parametrize(('lock', 'python', 'absent'), [
    ('pip', '3.11', set()), ('pip', '3.12', set()), ('pip', '3.13', set()),
    ('noble', '3.12', {'rerun-sdk'}),
])
def test_lock_pins_every_requirement(metadata, lock, python, absent):
    environment = {'python_version': python, 'python_full_version': f'{python}.0',
                   'sys_platform': 'linux', 'platform_machine': 'x86_64'}
    pins = {}
    for line in (ROOT / 'requirements' / f'{lock}.txt').read_text().splitlines():
        if line.strip() and not line.lstrip().startswith('#'):
            pin = Requirement(line)  # neither an option, a path nor an index
            assert re.fullmatch(r'==[\w.+]+', str(pin.specifier)), line
            if pin.marker is None or pin.marker.evaluate(environment):
                pins[canonicalize_name(pin.name)] = str(pin.specifier).removeprefix('==')
    needed = requirements(metadata, **environment)
    assert set(needed) - set(pins) == absent, 'run `make lock`'
    for name in set(needed) - absent:
        assert needed[name].specifier.contains(pins[name]), name


# --- Rooms ------------------------------------------------------------------------------------

def imports(path):
    """Return the top-level names a file imports; of hpv_twin, the room: hpv_twin.model."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parents = path.relative_to(ROOT).parts[:-node.level] if node.level else ()
            module = '.'.join([*parents, *filter(None, [node.module])])
            names |= {f'{module}.{alias.name}' for alias in node.names}
    parts = [name.split('.') for name in names]
    return {'.'.join(part[:2] if part[0] == 'hpv_twin' else part[:1]) for part in parts}


ROOMS = {
    'model': set(),
    'recording': set(),
    'node': {'model', 'recording', 'tracking'},
    'tracking': {'model'},
    'viewer': {'model', 'recording'},
    'study': {'model', 'recording'},
}


@pytest.mark.parametrize('room', ROOMS)
def test_arrows_between_rooms_run_one_way(room):
    allowed = ROOMS[room] | {room}
    for path in (ROOT / 'hpv_twin' / room).rglob('*.py'):
        names = imports(path)
        rooms = {name.removeprefix('hpv_twin.') for name in names if name.startswith('hpv_twin.')}
        assert rooms & set(ROOMS) <= allowed, path
        assert room == 'node' or 'rclpy' not in names, path
        assert room == 'viewer' or 'rerun' not in names, path


# --- README -----------------------------------------------------------------------------------

README = (ROOT / 'README.md').read_text(encoding='utf-8')


def test_readme_tells_every_command_topic_service_and_parameter():
    from hpv_twin.node.interface import INPUTS, MEASURED, OUTPUTS, PARAMETERS, SERVICES
    topics = [*MEASURED, *(setpoint.topic for setpoint in INPUTS.values())]
    for name in [*COMMANDS, *OUTPUTS, *topics, *SERVICES, *PARAMETERS]:
        rows = [line for line in README.splitlines() if re.match(rf'\|.*`{name}[` ]', line)]
        assert rows, name


def test_readme_example_runs(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    exec(re.search(r'```python\n(.*?)```', README, re.DOTALL).group(1), {})
    frequency, peak = map(float, capsys.readouterr().out.split())
    assert 25 < frequency < 40
    assert 10e6 < peak < 16e6
