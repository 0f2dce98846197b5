"""The dispatcher `hpv-twin`: what it says, how it exits, and that it stays light."""

import os
import subprocess
import sys

import pytest

from hpv_twin import __version__, cli

LIMIT = 60  # s; a command's --help may compile nothing, but a loaded machine is slow


def hpv_twin(*argv, before='pass', **options):
    """Run `hpv-twin` in a process of its own, after the statements in `before`."""
    code = f'import sys; {before}; from hpv_twin.cli import main; sys.exit(main())'
    return subprocess.run([sys.executable, '-c', code, *argv], capture_output=True, text=True,
                          timeout=LIMIT, check=False, **options)


@pytest.mark.parametrize('option', ['-h', '--help'])
def test_help_names_every_command_and_shows_examples(option, capsys):
    assert cli.main([option]) == 0
    out = capsys.readouterr().out
    for name, command in cli.COMMANDS.items():
        assert f'  {name} ' in out
        assert command.summary in out
        assert f'hpv-twin {name}' in out.partition('examples:')[2]


def test_version(capsys):
    assert cli.main(['--version']) == 0
    assert capsys.readouterr().out == f'hpv_twin {__version__}\n'


def test_no_command_is_a_usage_error_that_teaches(capsys):
    assert cli.main([]) == 2
    captured = capsys.readouterr()
    assert captured.out == ''
    assert 'commands:' in captured.err


@pytest.mark.parametrize(('wrong', 'right'), [
    ('twim', 'twin'), ('set-point', 'setpoint'), ('reply', 'replay'), ('recovr', 'recover'),
])
def test_unknown_command_suggests_the_nearest(wrong, right, capsys):
    assert cli.main([wrong]) == 2
    assert f"'{wrong}'. Did you mean '{right}'?" in capsys.readouterr().err


def test_unknown_command_near_nothing_lists_them_all(capsys):
    assert cli.main(['xyzzy']) == 2
    err = capsys.readouterr().err
    assert 'Did you mean' not in err
    assert all(name in err for name in cli.COMMANDS)


def test_unknown_option_is_called_an_option(capsys):
    assert cli.main(['--foo']) == 2
    assert "no option '--foo'" in capsys.readouterr().err


@pytest.mark.parametrize('name', cli.COMMANDS)
def test_every_command_has_help_of_its_own(name):
    done = hpv_twin(name, '--help')
    assert (done.returncode, done.stderr) == (0, '')
    assert f'usage: hpv-twin {name}' in done.stdout


def test_python_m_is_the_same():
    done = subprocess.run([sys.executable, '-m', 'hpv_twin', '--version'], capture_output=True,
                          text=True, timeout=LIMIT, check=True)
    assert done.stdout == f'hpv_twin {__version__}\n'


def test_the_dispatcher_imports_nothing_heavy():
    heavy = {'numpy', 'numba', 'scipy', 'yaml', 'mcap', 'rclpy', 'rerun', 'argparse'}
    code = f'import sys, hpv_twin.cli; print(*({heavy} & set(sys.modules)))'
    # -S: a site package may load what it likes at start-up.
    done = subprocess.run([sys.executable, '-S', '-c', code], capture_output=True, text=True,
                          timeout=LIMIT, check=True, cwd=os.path.dirname(cli.__file__) + '/..')
    assert done.stdout.split() == []


@pytest.mark.parametrize(('argv', 'package', 'advice'), [
    (['twin'], 'rclpy', '/opt/ros/jazzy/setup.bash'),
    (['twin'], 'std_msgs', "pip install 'hpv_twin[ros]'"),
    (['setpoint', '--pump-flow', '3.65e-4'], 'rclpy', "pip install 'hpv_twin[ros]'"),
    (['replay'], 'rerun', "pip install 'hpv_twin[viewer]'"),
])
def test_missing_package_is_one_line_that_says_how_to_get_it(argv, package, advice, tmp_path):
    done = hpv_twin(*argv, before=f'sys.modules[{package!r}] = None',
                    env={**os.environ, 'PYTHONPATH': source_path()}, cwd=tmp_path)
    assert done.returncode in (1, 2)
    assert done.stdout == ''
    assert done.stderr.count('\n') == 1, done.stderr
    assert package in done.stderr
    assert advice in done.stderr


def source_path():
    """Return a PYTHONPATH under which a process elsewhere finds the package under test."""
    ours = os.path.dirname(os.path.dirname(os.path.abspath(cli.__file__)))
    return os.pathsep.join(filter(None, [ours, os.environ.get('PYTHONPATH')]))


@pytest.fixture
def command(tmp_path, monkeypatch):
    """Return a function that makes a command `probe` out of the body of its main."""
    monkeypatch.syspath_prepend(tmp_path)

    def make(body):
        (tmp_path / 'probe_command.py').write_text(f'def main(argv):\n    {body}\n')
        monkeypatch.delitem(sys.modules, 'probe_command', raising=False)
        monkeypatch.setitem(cli.COMMANDS, 'probe', cli.Command('probe_command', 'a probe'))

    return make


def test_arguments_and_status_pass_through(command, capsys):
    command('print(argv); return 3')
    assert cli.main(['probe', '--help', 'a b']) == 3
    assert capsys.readouterr().out == "['--help', 'a b']\n"


def test_interrupt_exits_130_in_silence(command, capsys):
    command('raise KeyboardInterrupt')
    assert cli.main(['probe']) == 130
    assert capsys.readouterr() == ('', '')


def test_an_import_error_of_our_own_is_not_hidden(command):
    command('import hpv_twin.no_such_room')
    with pytest.raises(ModuleNotFoundError, match='no_such_room'):
        cli.main(['probe'])


def test_a_closed_pipe_ends_it_in_silence():
    read, write = os.pipe()
    os.close(read)
    try:
        done = subprocess.run([sys.executable, '-m', 'hpv_twin', '--help'], stdout=write,
                              stderr=subprocess.PIPE, timeout=LIMIT, check=False)
    finally:
        os.close(write)
    assert (done.returncode, done.stderr) == (141, b'')
