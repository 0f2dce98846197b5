"""The frequency hold in a real twin: commands, limits, handing back."""
import pytest

pytest.importorskip('rclpy')
from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Float64

from hpv_twin.node.setpoint import main as setpoint


def hold_of(messages):
    """Level and words of the newest hold status."""
    for message in reversed(messages):
        for status in message.status:
            if status.name.endswith(': hold'):
                return status.level, status.message
    return None, ''


def test_a_frequency_is_held_through_a_change_of_preload_and_handed_back(start_twin, ear):
    twin = start_twin()
    frequency = ear.listen(Float64, '/hpv_twin/frequency')
    flow = ear.listen(Float64, '/hpv_twin/pump_flow', latched=True)
    diagnostics = ear.listen(DiagnosticArray, '/diagnostics')
    ear.until(lambda: len(frequency) > 20 and flow, 'cycles')

    def held(target):
        return lambda: (len(frequency) > 10 and all(
            abs(m.data / target - 1.0) < 2e-3 for m in frequency[-10:]))
    ear.say('/hpv_twin/frequency_setpoint', 70.0)
    ear.until(held(70.0), '70 Hz')
    at_70 = flow[-1].data
    assert 9e-4 < at_70 < 1.1e-3
    ear.say('/hpv_twin/preload_setpoint', 6e-3)
    ear.until(lambda: flow[-1].data > 1.05 * at_70, 'more flow for more preload')
    ear.until(held(70.0), '70 Hz again')
    ear.until(lambda: hold_of(diagnostics)[1] == 'holding 70.00 Hz', 'the diagnostics')

    ear.say('/hpv_twin/frequency_setpoint', 500.0)
    ear.until(lambda: hold_of(diagnostics)[0] == b'\x01', 'a warning')
    assert '500.0 Hz is out of reach' in hold_of(diagnostics)[1]
    assert 'out of reach' in twin.log
    ear.say('/hpv_twin/frequency_setpoint', float('nan'))
    ear.say('/hpv_twin/pump_flow_setpoint', 7.3e-4)
    ear.until(lambda: hold_of(diagnostics)[1].startswith('off'), 'the hold to be off')
    assert flow[-1].data == 7.3e-4
    assert 'frequency setpoint nan refused' in twin.log
    assert twin.stop() == 0


def test_the_command_waits_for_the_frequency(start_twin, capsys):
    start_twin('record:=false')
    for _ in range(5):  # the twin takes a moment to start
        if setpoint(['--frequency', '40']) == 0:
            break
    assert capsys.readouterr().out.startswith(('frequency: 40.0', 'frequency: 39.9'))
    assert setpoint(['--frequency', '0']) == 0
