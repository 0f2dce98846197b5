"""Random interleavings of all that an operator can do, and what has to hold after each step."""
import math
import signal
import tempfile
import time
from itertools import pairwise

import pytest

pytest.importorskip('rclpy')
import rclpy
from conftest import Ear, TwinProcess
from diagnostic_msgs.msg import DiagnosticArray
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

from hpv_twin.recording.reader import describe

# Slow enough for an ear in Python that Hypothesis watches; the twin ticks at 1 kHz all the same.
PUBLISH_RATE = 100
PERIOD = 10**9 // PUBLISH_RATE
BASE = {'pump_flow': 7.3e-4, 'preload': 5.2014456e-3, 'load': 0.0}
DOUBLE, STRING = 3, 4  # rcl_interfaces/ParameterType


def stamp(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


class Operator(RuleBasedStateMachine):
    """One twin in a process of its own, and an operator with no plan."""

    @initialize()
    def start(self):
        self.folder = tempfile.TemporaryDirectory()
        self.twin = TwinProcess(self.folder.name, f'publish_rate:={PUBLISH_RATE}')
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.ear = Ear(self.context)
        self.pressure = self.ear.listen(FluidPressure, '/hpv_twin/pressure')
        self.position = self.ear.listen(JointState, '/hpv_twin/plunger_position')
        self.report = self.ear.listen(DiagnosticArray, '/diagnostics')
        self.heard = {name: self.ear.listen(Float64, f'/hpv_twin/{name}', latched=True)
                      for name in BASE}
        self.expected, self.limit = dict(BASE), 4e-3
        self.paused, self.refused, self.seen = False, 0, 0
        self.pauses = []  # indices of the first messages after a pause
        self.speakers = {name: self.ear.node.create_publisher(
            Float64, f'/hpv_twin/{name}_setpoint', 10) for name in BASE}
        self.ear.until(lambda: all(s.get_subscription_count() for s in self.speakers.values())
                       and all(self.heard.values()) and self.pressure, 'the twin')

    # What an operator does ---------------------------------------------------------------------

    def send(self, name, value):
        self.speakers[name].publish(Float64(data=value))
        self.expected[name] = value
        self.ear.until(lambda: self.heard[name][-1].data == value, f'{name} {value} in force')

    @rule(share=st.floats(0.0, 1.0))
    def set_pump_flow(self, share):
        self.send('pump_flow', share * self.limit)

    @rule(value=st.floats(0.0, 15e-3))
    def set_preload(self, value):
        self.send('preload', value)

    @rule(value=st.floats(-2e3, 1e4))
    def set_load(self, value):
        self.send('load', value)

    @rule(name=st.sampled_from(list(BASE)),
          value=st.sampled_from([math.nan, math.inf, -math.inf, -1e9, 1e9]))
    def send_nonsense(self, name, value):
        self.speakers[name].publish(Float64(data=value))
        self.refused += 1
        # The twin's queue holds one setpoint: give it the time to take this one.
        self.ear.spin(0.1)

    @rule(wish=st.booleans())
    def pause_or_resume(self, wish):
        assert self.ear.call(SetBool, '/hpv_twin/pause', SetBool.Request(data=wish)).success
        if self.paused and not wish:
            self.ear.until(lambda: len(self.pressure) > self.seen, 'pressure after a pause')
            self.pauses.append(self.seen)
        self.paused = wish
        if wish:
            self.ear.spin(0.1)  # what was on its way arrives
            self.seen = len(self.pressure)

    @rule()
    def reset(self):
        assert self.ear.call(Trigger, '/hpv_twin/reset').success

    @rule(wish=st.booleans())
    def record(self, wish):
        assert self.ear.call(SetBool, '/hpv_twin/record', SetBool.Request(data=wish)).success

    def set_parameter(self, value):
        answer = self.ear.call(SetParameters, '/hpv_twin/set_parameters', SetParameters.Request(
            parameters=[Parameter(name='pump_flow_max', value=value)]))
        return answer.results[0].successful

    @rule(value=st.floats(1e-4, 4e-3))
    def change_a_limit(self, value):
        assert self.set_parameter(ParameterValue(type=DOUBLE, double_value=value))
        self.limit = value

    @rule(value=st.sampled_from([math.nan, -1.0, 2.0, 'much']))
    def change_a_limit_to_nonsense(self, value):
        assert not self.set_parameter(
            ParameterValue(type=STRING, string_value=value) if isinstance(value, str)
            else ParameterValue(type=DOUBLE, double_value=value))

    @precondition(lambda self: not self.paused)
    @rule(duration=st.floats(0.05, 0.4))
    def stand_still(self, duration):
        self.twin.signal(signal.SIGSTOP)
        time.sleep(duration)
        self.twin.signal(signal.SIGCONT)

    # What holds after each ---------------------------------------------------------------------

    @invariant()
    def the_twin_lives_and_obeys(self):
        assert self.twin.process.poll() is None, self.twin.log
        for name, value in self.expected.items():
            assert self.heard[name][-1].data == value

    @invariant()
    def what_it_publishes_is_a_machine(self):
        if self.paused:
            self.ear.spin(0.05)
            assert len(self.pressure) == self.seen
            return
        count = len(self.pressure)
        self.ear.until(lambda: len(self.pressure) > count + 5, 'more pressure')
        for message in self.pressure[count:]:
            assert message.fluid_pressure >= 0.0 and math.isfinite(message.fluid_pressure)
        assert all(0.0 <= message.position[0] <= 2e-3 for message in self.position[-5:])

    def teardown(self):
        if not hasattr(self, 'twin'):
            return
        try:
            self.ear.until(lambda: self.refused == int(self.value('inputs', 'refused')),
                           'all refusals counted')
            self.check_gaps()
            assert self.twin.stop() == 0
            assert 'Traceback' not in self.twin.log
            assert not any(describe(path).problem for path in self.twin.recordings)
        finally:
            self.twin.stop()
            self.ear.executor.shutdown()
            self.ear.node.destroy_node()
            self.context.try_shutdown()
            self.folder.cleanup()

    def value(self, part, key):
        for message in reversed(self.report):
            for status in message.status:
                if status.name.endswith(f': {part}'):
                    return next((v.value for v in status.values if v.key == key), '0')
        return '0'

    def check_gaps(self):
        """Every gap in the stamps is a reported one, but for the pauses that were asked for."""
        def all_told():
            dropped, missing = float(self.value('timing', 'dropped time [s]')), self.missing()
            # What was dropped at the very pause is in the report and in no stamp.
            return dropped >= missing - 2e-3 if self.pauses or self.paused else (
                abs(dropped - missing) < 2e-3)
        self.ear.until(all_told, 'every gap reported, and no more')

    def missing(self):
        """Time missing in the stamps heard so far, s, but for the pauses that were asked for."""
        steps = [after - before - PERIOD for before, after in pairwise(
            stamp(message) for message in self.pressure)]
        assert min(steps) >= -PERIOD // 1000
        return 1e-9 * sum(step for k, step in enumerate(steps, start=1)
                          if k not in self.pauses and step > PERIOD // 1000)


def plan(examples, steps):
    """So many scenarios of so many steps; a failure is printed as it is, not made smaller."""
    return settings(max_examples=examples, stateful_step_count=steps, deadline=None,
                    phases=[Phase.explicit, Phase.reuse, Phase.generate],
                    suppress_health_check=list(HealthCheck))


TestScenarios = Operator.TestCase
TestScenarios.settings = plan(3, 12)


@pytest.mark.long
@pytest.mark.timeout(1800)
class TestManyScenarios(Operator.TestCase):
    settings = plan(30, 40)
