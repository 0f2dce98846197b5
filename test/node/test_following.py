"""A real twin beside the stand-in machine: followed, in step, faults named, the sensor judged."""
import pytest

pytest.importorskip('rclpy')
from diagnostic_msgs.msg import DiagnosticArray
from mcap.reader import make_reader
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from std_msgs.msg import Float64

BESIDE = ('-r', '~/pressure:=/hpv_twin/measured/pressure',
          '-r', '~/plunger_position:=/hpv_twin/measured/plunger_position',
          '-r', '~/pump_flow_setpoint:=/hpv_twin/pump_flow')


class Status:
    """What /diagnostics says of a part."""

    def __init__(self, ear):
        self._messages = ear.listen(DiagnosticArray, '/diagnostics')

    def of(self, part):
        for message in reversed(self._messages):
            for status in message.status:
                if status.name.endswith(f': {part}'):
                    return status
        return None

    def says(self, part, words):
        status = self.of(part)
        return status is not None and words in status.message


def set_on_machine(ear, name, value):
    kind = ({'type': ParameterType.PARAMETER_BOOL, 'bool_value': value}
            if isinstance(value, bool)
            else {'type': ParameterType.PARAMETER_DOUBLE, 'double_value': value})
    request = SetParameters.Request(parameters=[
        Parameter(name=name, value=ParameterValue(**kind))])
    answer = ear.call(SetParameters, '/machine/set_parameters', request)
    assert answer.results[0].successful, answer.results[0].reason


def test_a_machine_is_followed_its_fault_named_its_sensor_judged(start_twin, ear):
    twin = start_twin()
    start_twin('pump_flow:=7.3e-4', command=('machine',), ros=BESIDE)
    status = Status(ear)
    stiffness = ear.listen(Float64, '/hpv_twin/estimate/cavity_stiffness')
    residual = ear.listen(Float64, '/hpv_twin/residual')
    ear.until(lambda: status.says('tracking', 'following'), 'the machine to be followed')
    ear.until(lambda: status.says('condition', 'no fault'), 'a healthy machine')
    ear.until(lambda: len(residual) > 200, 'estimates')
    healthy = 1.4e9 / 1.0342933e-3
    assert stiffness[-1].data == pytest.approx(healthy, rel=0.05)
    assert residual[-1].data < 2e5

    set_on_machine(ear, 'air_in_oil', 0.4)
    ear.until(lambda: status.says('condition', 'air in the oil'), 'the fault by its name')
    assert stiffness[-1].data == pytest.approx(0.8 * healthy, rel=0.05)
    values = {pair.key: pair.value for pair in status.of('tracking').values}
    ear.until(lambda: abs(float({pair.key: pair.value for pair in status.of('tracking').values}
                                .get('phase error [%]', 'nan'))) < 2.0, 'the cycles in step')
    assert float(values['rate of model time']) > 0.8

    set_on_machine(ear, 'pressure_noise', 0.8)
    set_on_machine(ear, 'pressure_gain', 1e-5)
    ear.until(lambda: status.says('tracking', 'in bar?'), 'the unit to be doubted')
    set_on_machine(ear, 'pressure_gain', 1.0)
    ear.until(lambda: status.says('tracking', 'following'), 'the machine to be followed again')
    set_on_machine(ear, 'stuck', True)
    ear.until(lambda: status.says('tracking', 'stuck'), 'the stuck sensor to be named')
    assert twin.stop() == 0
    with open(twin.recordings[0], 'rb') as file:
        summary = make_reader(file).get_summary()
    counts = {summary.channels[k].topic: n
              for k, n in summary.statistics.channel_message_counts.items()}
    assert counts['/hpv_twin/measured/pressure'] > 3000
    assert counts['/hpv_twin/measured/plunger_position'] > 3000
    assert counts['/hpv_twin/estimate/pump_flow'] > 200
    assert 'air in the oil' in twin.log and 'goes on alone' in twin.log
