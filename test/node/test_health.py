"""The report on itself: what it says of a loop that stalls or dies, and of a node of its name."""
import threading

import pytest

pytest.importorskip('rclpy')
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import Float64

from hpv_twin.node.console import Console
from hpv_twin.node.node import TwinNode
from hpv_twin.node.process import StopSignal, serve

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class TwinHere:
    """A real twin that is served by a thread of this process."""

    def __init__(self):
        rclpy.init(args=['--ros-args', '-p', 'record:=false'])
        self.node, self.stop_signal, self.code = TwinNode(), StopSignal(), None
        self.thread = threading.Thread(target=self._serve)
        self.thread.start()

    def _serve(self):
        self.code = serve(self.node, self.stop_signal, Console(on=False))

    def hinder(self, function):
        """Have every tick of the plant begin with `function()`."""
        tick = self.node.loop.plant.tick

        def hindered(duration):
            function()
            return tick(duration)
        self.node.loop.plant.tick = hindered

    def stop(self):
        self.stop_signal.wish()
        self.thread.join(10)
        self.node.close()
        self.node.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def twin():
    twin = TwinHere()
    yield twin
    twin.stop()


def newest(messages, part):
    """The newest status of a part, or None."""
    for message in reversed(messages):
        for status in message.status:
            if status.name == f'/hpv_twin: {part}':
                return status
    return None


def level(messages, part):
    status = newest(messages, part)
    return None if status is None else status.level


def test_a_twin_in_health_says_ok_four_times(twin, ear):
    report = ear.listen(DiagnosticArray, '/diagnostics')
    ear.until(lambda: len(report) > 2, 'three reports')
    assert [level(report, part) for part in ('model', 'inputs', 'recorder')] == [OK] * 3
    # A busy machine may have dropped a tick; that is a warning, and said.
    assert level(report, 'timing') == OK or 'dropped' in newest(report, 'timing').message


def test_a_stalled_pacing_thread_is_an_error_until_it_goes_on(twin, ear):
    report = ear.listen(DiagnosticArray, '/diagnostics')
    ear.until(lambda: level(report, 'timing') is not None, 'a report')
    stalled, go_on = threading.Event(), threading.Event()

    def stall():
        if not stalled.is_set():
            stalled.set()
            go_on.wait(30)
    twin.hinder(stall)
    ear.until(lambda: level(report, 'timing') == ERROR, 'the error')
    assert 'the pacing thread has been silent for' in newest(report, 'timing').message
    go_on.set()
    ear.until(lambda: level(report, 'timing') == WARN, 'the report of what was dropped')
    assert 'ticks dropped' in newest(report, 'timing').message
    assert float(twin.node.loop.pacer.dropped_time) > 0.4e9


def test_a_dead_pacing_thread_is_an_error_and_ends_the_twin(twin, ear):
    report = ear.listen(DiagnosticArray, '/diagnostics')
    frequency = ear.listen(Float64, '/hpv_twin/frequency')
    ear.until(lambda: report and frequency, 'a report')

    def die():
        raise RuntimeError('no oil')
    twin.hinder(die)
    ear.until(lambda: level(report, 'timing') == ERROR, 'the error')
    assert 'has died' in newest(report, 'timing').message
    assert 'no oil' in newest(report, 'timing').message
    twin.thread.join(10)
    assert twin.code == 1


def test_a_node_of_the_same_name_is_warned_of_while_it_is_there(twin, ear):
    report = ear.listen(DiagnosticArray, '/diagnostics')
    ear.until(lambda: level(report, 'inputs') == OK, 'a report')
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    namesake = rclpy.create_node('hpv_twin', context=context, enable_rosout=False)
    ear.until(lambda: level(report, 'inputs') == WARN, 'the warning')
    assert newest(report, 'inputs').message == 'another node is called /hpv_twin too'
    namesake.destroy_node()
    context.try_shutdown()
    ear.until(lambda: level(report, 'inputs') == OK, 'the end of the warning')


def test_a_failing_callback_is_an_error_and_not_the_last(twin, ear):
    report = ear.listen(DiagnosticArray, '/diagnostics')
    in_force = ear.listen(Float64, '/hpv_twin/load', latched=True)
    ear.until(lambda: level(report, 'inputs') == OK and in_force, 'a report')
    check = twin.node.inputs.check

    def fail(*_):
        raise RuntimeError('no oil')
    twin.node.inputs.check = fail
    ear.say('/hpv_twin/load_setpoint', 10.0)
    ear.until(lambda: level(report, 'inputs') == ERROR, 'the error')
    twin.node.inputs.check = check
    ear.say('/hpv_twin/load_setpoint', 20.0)
    ear.until(lambda: in_force[-1].data == 20.0, 'the next setpoint in force')
    ear.until(lambda: level(report, 'inputs') == OK, 'the end of the error')


def test_no_attribute_of_the_twin_hides_one_of_its_node(twin):
    plain = rclpy.create_node('plain')
    hidden = {name for name, value in vars(plain).items()
              if type(vars(twin.node)[name]) is not type(value)}
    assert not hidden
    own = {name for name in vars(TwinNode) if not name.startswith('__')}
    assert not own & set(dir(plain))
    plain.destroy_node()
