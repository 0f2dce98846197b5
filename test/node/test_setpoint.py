"""The setpoint command, against a real twin."""
import subprocess
import sys

import pytest

pytest.importorskip('rclpy')


def setpoint(*arguments):
    return subprocess.run([sys.executable, '-m', 'hpv_twin', 'setpoint', *arguments],
                          capture_output=True, text=True, timeout=60)


def test_obeyed_refused_and_unheard(start_twin):
    start_twin('record:=false')
    for _ in range(5):  # the twin takes a moment to start
        obeyed = setpoint('--pump-flow', '3.65e-4', '--preload', '6e-3')
        if obeyed.returncode == 0:
            break
    assert '21.9 L/min (0.000365 m³/s) in force' in obeyed.stdout
    assert '6 mm (0.006 m) in force' in obeyed.stdout
    refused = setpoint('--pump-flow', '0.5')
    assert refused.returncode == 1 and 'not accepted, 21.9 L/min' in refused.stderr
    unheard = setpoint('--node', '/nobody', '--load', '1')
    assert unheard.returncode == 1 and '/nobody' in unheard.stderr


@pytest.mark.parametrize('arguments', [[], ['--pump-flow', 'nan'], ['--pump-flow', 'much']])
def test_nonsense_is_a_usage_error(arguments):
    assert setpoint(*arguments).returncode == 2
