"""The ROS 2 node: a declarative shell that wires topics, parameters and services to the loop."""
from __future__ import annotations

import threading
import time
from pathlib import Path

from builtin_interfaces.msg import Time
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

from hpv_twin.model import Vibrator
from hpv_twin.tracking.waveform import steady_waveform

from .fine import FineRecording
from .following import Following
from .health import HEARTBEAT_LIMIT, Health
from .inputs import Inputs, Limits
from .interface import (
    CLOCK,
    HIGHEST_FREQUENCY,
    INPUTS,
    MEASURED,
    NODE_NAME,
    OUTPUTS,
    PARAMETERS,
    SETPOINTS,
)
from .loop import Loop
from .messages import float_value
from .pacing import SECOND
from .parameters import as_declared, declare
from .params_files import ParameterError
from .plant import Plant
from .records import fine_channels, make_recorder
from .steering import Steering
from .units import both

COMPILING = 'compiling the model; this happens once and takes about ten seconds'


class TwinNode(Node):
    """The twin. `start()` lets model time run; `close()` ends the loop and the recording."""

    def __init__(self, origins: dict[str, str] | None = None):
        """Build the node; `origins` names the files that parameters come from, for complaints."""
        super().__init__(NODE_NAME, automatically_declare_parameters_from_overrides=True)
        self.before_speaking = lambda: None
        self.settings = declare(self, PARAMETERS, lambda text: self.say('warning', text),
                                origins or {})
        vibrator = self._design()
        self.inputs = Inputs(lambda text: self.say('warning', text))
        rate = self.settings['publish_rate']
        self._out = {output.name: (index, self.create_publisher(output.type, output.name,
                                                                output.qos(rate)))
                     for index, output in enumerate(OUTPUTS.values())}
        self._ticker = None
        if self.settings['publish_clock']:
            self._ticker = self.create_publisher(CLOCK.type, CLOCK.name, CLOCK.qos(rate))
        speed, recorded = self.settings['speed'], self.settings['record_rate']
        self._record_every = max(1, round(rate / recorded)) if recorded else 1
        fine = recorded > rate
        self.recorder = make_recorder(self, vibrator, fine)
        fine = fine and self.recorder is not None
        plant = Plant(vibrator, self.settings['ambient_pressure'],
                      recorded / speed if fine else 0.0)
        self._fine = FineRecording(self.recorder, fine_channels(), plant) if fine else None
        self.loop = Loop(plant, rate, speed, self._publish, float_payload,
                         self._fine.take if fine else None)
        self.steering = Steering(self.loop, lambda: self.limits('pump_flow').high)
        self.following = Following(self, self.loop, self.steering,
                                   self.settings['ambient_pressure'],
                                   self.settings['speed'] == 1.0)
        self.health = Health(self.get_fully_qualified_name(), self.loop, self.inputs,
                             self.recorder, self.say, self.steering, self.following)
        if not self.loop.exact_templates:
            self.say('warning', 'serialized messages differ from the templates: publishing the '
                     'slow way')
        if self.get_parameter('use_sim_time').value:
            self.say('warning', 'use_sim_time has no effect here: the twin makes time, its stamps '
                     'are wall time; with speed and publish_clock others can follow it')
        self._listen()
        self._serve()
        self.add_pre_set_parameters_callback(as_declared(PARAMETERS))
        self.add_on_set_parameters_callback(self._check_live)
        self.add_post_set_parameters_callback(self._follow_live)
        self.create_timer(1.0, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))

    # Parameters --------------------------------------------------------------------------------

    def _design(self) -> Vibrator:
        """The vibrator file with the initial setpoints that parameters give."""
        path = self.settings['vibrator']
        vibrator = Vibrator.load(path) if path else Vibrator()
        for name, setpoint in SETPOINTS.items():
            if self.settings[name] is not None:
                vibrator = vibrator.replace(**{name: self.settings[name]})
            else:
                self.settings[name] = getattr(vibrator, name)
                self.declare_parameter(name, self.settings[name], PARAMETERS[name].descriptor(),
                                       ignore_override=True)
            limits = self.limits(name)
            value = getattr(vibrator, setpoint.field)
            if not limits.low <= value <= limits.high:
                bounds = f'[{both(name, limits.low)}, {both(name, limits.high)}]'
                raise ParameterError(f'initial {name} {both(name, value)} is outside {bounds} of '
                                     f'{limits.low_name} and {limits.high_name}')
        return vibrator

    def limits(self, name: str) -> Limits:
        """Bounds of a setpoint as the parameters have them now."""
        if name not in SETPOINTS:
            return Limits(0.0, HIGHEST_FREQUENCY, 'the lowest', 'the highest')
        setpoint = SETPOINTS[name]
        low = self.get_parameter(setpoint.low).value if setpoint.low else 0.0
        return Limits(low, self.get_parameter(setpoint.high).value,
                      setpoint.low or 'the lowest', setpoint.high)

    def _check_live(self, parameters):
        """Refuse live changes that would leave a limit without meaning."""
        values = {name: self.get_parameter(name).value for name in ('load_min', 'load_max')}
        values |= {p.name: p.value for p in parameters if p.name in values}
        if values['load_min'] > values['load_max']:
            return SetParametersResult(successful=False, reason=(
                f'load_min {values["load_min"]:g} N is above load_max {values["load_max"]:g} N'))
        return SetParametersResult(successful=True)

    def _follow_live(self, parameters):
        """A hold steers within the new limits at once."""
        if self.steering.hold.active and any(p.name == 'pump_flow_max' for p in parameters):
            self.steering.renew()

    # In and out --------------------------------------------------------------------------------

    def _listen(self):
        newest_only = QoSProfile(depth=1)
        for name, setpoint in INPUTS.items():
            def receive(payload, name=name, setpoint=setpoint):
                value = float_value(payload)
                in_force = (getattr(self.loop.plant.simulation, setpoint.field) if setpoint.field
                            else self.steering.hold.target)
                if self.inputs.check(name, value, self.limits(name), in_force):
                    if setpoint.field:
                        self.steering.setpoint(setpoint.field, value)
                    else:
                        self.steering.want(value)
            strangers = SubscriptionEventCallbacks(
                incompatible_qos=lambda _, name=name: self.inputs.stranger(name, 'QoS'),
                incompatible_type=lambda _, name=name: self.inputs.stranger(name, 'type'))
            self.create_subscription(Float64, setpoint.topic, receive, newest_only,
                                     event_callbacks=strangers, raw=True)

    def _publish(self, name, stamp, payload):
        """Called by the loop's thread for every message."""
        index, publisher = self._out[name]
        publisher.publish(payload)
        if self._ticker is not None and name == '~/pressure':
            now = round(self.loop.plant.simulation.time * SECOND)
            self._ticker.publish(ClockMessage(clock=Time(sec=now // SECOND, nanosec=now % SECOND)))
        if self.recorder is not None and not (
                OUTPUTS[name].steady and self.loop.published % self._record_every):
            self.recorder.write(index, stamp, payload)

    def keep(self, name, stamp, payload):
        """Record a measured message as it came, by its own stamp."""
        if self.recorder is not None:
            self.recorder.write(len(OUTPUTS) + list(MEASURED).index(name), stamp, payload)

    def _report(self):
        me = self.get_name(), self.get_namespace()
        self.inputs.namesake(self.get_fully_qualified_name(),
                             self.get_node_names_and_namespaces().count(me) - 1)
        report = self.health.report()

        def send(stamp):
            report.header.stamp = Time(sec=stamp // SECOND, nanosec=stamp % SECOND)
            self._publish('/diagnostics', stamp, serialize_message(report))
        if self.loop.silence() < HEARTBEAT_LIMIT:
            self.loop.post(send)
        else:
            now = time.time_ns()
            report.header.stamp = Time(sec=now // SECOND, nanosec=now % SECOND)
            self._out['/diagnostics'][1].publish(report)

    # Services ----------------------------------------------------------------------------------

    def _serve(self):
        self.create_service(Trigger, '~/reset', self._reset)
        self.create_service(SetBool, '~/pause', self._pause)
        self.create_service(SetBool, '~/record', self._record)

    def _reset(self, _request, response):
        response.success = self.loop.call(self.loop.plant.reset)
        response.message = 'at rest' if response.success else 'the pacing thread does not answer'
        return response

    def _pause(self, request, response):
        self.loop.pause(request.data)
        response.success = True
        response.message = 'paused' if request.data else 'running'
        return response

    def _record(self, request, response):
        if self.recorder is None:
            response.success, response.message = False, 'recordings cannot be written here'
            return response
        finished = self.recorder.stop()
        started = self.start_recording() if request.data else None
        response.success = not request.data or started is not None
        parts = [f'finished {finished}' if finished else '',
                 f'recording to {started}' if started else '',
                 '' if response.success else f'not recording: {self.recorder.status.error}']
        response.message = '; '.join(filter(None, parts)) or 'not recording'
        return response

    # Life --------------------------------------------------------------------------------------

    def start_recording(self) -> Path | None:
        """Open a new file that begins with the setpoints in force."""
        stamp = self.loop.last_stamp
        simulation = self.loop.plant.simulation
        opening = [(self._out[f'~/{name}'][0], stamp,
                    float_payload(getattr(simulation, setpoint.field)))
                   for name, setpoint in SETPOINTS.items()]
        return self.recorder.start(opening)

    def say(self, level: str, text: str) -> None:
        """Log a line; each level has a call of its own, as rclpy demands."""
        self.before_speaking()
        log = self.get_logger()
        if level == 'error':
            log.error(text)
        elif level == 'warning':
            log.warning(text)
        else:
            log.info(text)

    def warm_up(self) -> None:
        """Have everything compiled before the clock starts, and say so if it takes its time."""
        notice = threading.Timer(1.5, self.say, ('info', COMPILING))
        notice.start()
        spare = Plant(self.loop.plant.simulation.vibrator, 0.0)
        spare.tick(0.05)
        spare.position_values()
        self.steering.map()
        steady_waveform(self.loop.plant.simulation.design)
        notice.cancel()

    def start(self) -> None:
        """Publish the setpoints in force, open the recording, let model time run."""
        if self.recorder is not None and self.settings['record']:
            self.start_recording()
        for setpoint in SETPOINTS.values():
            _, publisher = self._out[f'~/{setpoint.name}']
            publisher.publish(float_payload(getattr(self.loop.plant.simulation, setpoint.field)))
        self.loop.start()
        self.following.start()

    def last_words(self) -> None:
        """Report once more, from the thread that ends the node, that the loop has died."""
        self._report()
        self._out['/diagnostics'][1].wait_for_all_acked(Duration(seconds=0.5))

    def close(self) -> None:
        """Stop the loop, finish the recording. Can be called twice."""
        self.following.stop()
        self.loop.stop()
        if self.recorder is not None:
            self.recorder.close()


def float_payload(value: float) -> bytes:
    """A serialized std_msgs/Float64."""
    return serialize_message(Float64(data=float(value)))
