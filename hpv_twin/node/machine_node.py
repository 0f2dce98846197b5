"""The stand-in machine as a node: topics of its sensors, setpoints in, faults by parameter."""
from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64, Header

from hpv_twin.model import Vibrator, VibratorError
from hpv_twin.model.faults import FAULTS, apply_faults
from hpv_twin.model.machine import Machine
from hpv_twin.model.sensors import Dropouts, Sensor

from .inputs import Inputs, Limits
from .interface import PARAMETERS as TWIN_PARAMETERS
from .interface import SETPOINTS, Parameter
from .loop import Loop
from .messages import Template, float_value
from .parameters import as_declared, declare
from .units import both

NODE_NAME = 'machine'
PRESSURE, POSITION = '~/pressure', '~/plunger_position'
TAKEN_OVER = ('vibrator', 'pump_flow', 'preload', 'load', 'publish_rate', 'ambient_pressure',
              'pump_flow_max', 'preload_max', 'load_min', 'load_max')
SENSORS = ('pressure', 'position')

PARAMETERS = {name: TWIN_PARAMETERS[name] for name in TAKEN_OVER} | {
    parameter.name: parameter for parameter in (
        Parameter('seed', 0.0, 'of the noise and the dropouts', 0.0, 2.0 ** 32),
        Parameter('pressure_gain', 1.0, 'sensor shows this many times the pressure; 1e-5: bar',
                  -1e6, 1e6, live=True),
        Parameter('pressure_offset', 0.0, 'Pa too much', -1e9, 1e9, live=True),
        Parameter('pressure_noise', 8e4, 'Pa, standard deviation', 0.0, 1e9, live=True),
        Parameter('pressure_quantum', 0.0, 'Pa, step of the converter', 0.0, 1e9, live=True),
        Parameter('position_gain', 1.0, 'sensor shows this many times the position; 1000: mm',
                  -1e6, 1e6, live=True),
        Parameter('position_offset', 0.0, 'm too much', -1.0, 1.0, live=True),
        Parameter('position_noise', 1e-5, 'm, standard deviation', 0.0, 1.0, live=True),
        Parameter('position_quantum', 0.0, 'm, step of the converter', 0.0, 1.0, live=True),
        Parameter('position_sensor', True, 'whether there is a displacement sensor'),
        Parameter('dropouts', 0.0, 'share of the samples that go missing, in gaps', 0.0, 0.9,
                  live=True),
        Parameter('stuck', False, 'sensors go on showing what they show now', live=True),
    )} | {fault.name: Parameter(fault.name, 0.0, f'{fault.text}; 1: {fault.at_full}', 0.0, 1.0,
                                live=True) for fault in FAULTS.values()}


def position_template() -> Template:
    """JointState of a displacement sensor: position of the plunger, m, and nothing else."""
    def build(seconds, nanoseconds, values):
        header = Header(stamp=Time(sec=seconds, nanosec=nanoseconds))
        return JointState(header=header, name=['plunger'], position=values)
    return Template(build, 1)


class MachineLoop(Loop):
    """The pacing thread of a machine: it publishes what the sensors show."""

    def __init__(self, node, machine, rate):
        super().__init__(machine, rate, 1.0, node.send, None)
        self._node = node
        self._position = position_template()
        self._random = np.random.default_rng(int(node.settings['seed']))
        self._dropouts = Dropouts(self._random)
        self._shown = None

    def _publish(self, stamp, _cycles):
        self._until_publication -= 1
        if self._until_publication:
            return
        self._until_publication = self._ticks_per_publication
        settings = self._node.settings
        if not settings['stuck'] or self._shown is None:
            simulation, sensors = self.plant.simulation, self._node.sensors
            self._shown = (sensors['pressure'].read(
                simulation.pressure + settings['ambient_pressure'], self._random),
                sensors['position'].read(simulation.plunger_position, self._random))
        if not self._dropouts.lost(settings['dropouts']):
            self._outlet(PRESSURE, stamp, self._pressure.message(stamp, self._shown[0]))
            self._outlet(POSITION, stamp, self._position.message(stamp, self._shown[1]))
            self.published += 1

    def latch(self, field, stamp):
        """Say nothing of setpoints: a machine has sensors alone."""


class MachineNode(Node):
    """The stand-in machine. `start()` lets it run; `close()` ends it."""

    def __init__(self, origins: dict[str, str] | None = None):
        """Build the node; `origins` names the files that parameters come from, for complaints."""
        super().__init__(NODE_NAME, automatically_declare_parameters_from_overrides=True)
        self.before_speaking = lambda: None
        self.settings = declare(self, PARAMETERS, lambda text: self.say('warning', text),
                                origins or {})
        self.inputs = Inputs(lambda text: self.say('warning', text))
        machine = Machine(self._design(), {name: self.settings[name] for name in FAULTS})
        self.sensors = read_sensors(self.settings)
        rate = self.settings['publish_rate']
        qos = QoSProfile(depth=max(10, round(rate)), reliability=ReliabilityPolicy.RELIABLE)
        self._out = {PRESSURE: self.create_publisher(FluidPressure, PRESSURE, qos)}
        if self.settings['position_sensor']:
            self._out[POSITION] = self.create_publisher(JointState, POSITION, qos)
        self.loop = MachineLoop(self, machine, rate)
        for name, setpoint in SETPOINTS.items():
            self.create_subscription(Float64, setpoint.topic,
                                     lambda payload, name=name: self._obey(name, payload),
                                     QoSProfile(depth=1), raw=True)
        self.add_pre_set_parameters_callback(as_declared(PARAMETERS))
        self.add_on_set_parameters_callback(self._check)
        self.add_post_set_parameters_callback(self._change)

    def _design(self):
        """The machine as it was built, told what the parameters say."""
        path = self.settings['vibrator']
        told = {name: self.settings[name] for name in SETPOINTS if self.settings[name] is not None}
        return (Vibrator.load(path) if path else Vibrator()).replace(**told)

    def _obey(self, name, payload):
        """Take a setpoint: what it brings about is told by the sensors alone."""
        setpoint, value = SETPOINTS[name], float_value(payload)
        limits = Limits(self.settings[setpoint.low] if setpoint.low else 0.0,
                        self.settings[setpoint.high], setpoint.low or 'the lowest', setpoint.high)
        if self.inputs.check(name, value, limits, getattr(self.loop.plant.told, setpoint.field)):
            self.loop.set(setpoint.field, value)

    def _check(self, parameters):
        """Refuse faults that would make a machine that cannot be."""
        faults = {p.name: p.value for p in parameters if p.name in FAULTS}
        try:
            apply_faults(self.loop.plant.told, {**self.loop.plant.severities, **faults})
        except VibratorError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _change(self, parameters):
        """Put live parameters in force; faults between two ticks."""
        self.settings |= {p.name: p.value for p in parameters if p.name in self.settings}
        self.sensors = read_sensors(self.settings)
        for parameter in parameters:
            if parameter.name in FAULTS:
                self._switch(parameter.name, parameter.value)

    def _switch(self, name, severity):
        self.loop.post(lambda _stamp: self.loop.plant.set_fault(name, severity))
        self.say('info', f'{name} {severity:g}: {FAULTS[name].text}' if severity
                 else f'{name} mended')

    def send(self, name, _stamp, payload):
        """Publish a message; called by the loop's thread."""
        if name in self._out:
            self._out[name].publish(payload)

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
        """Have everything compiled before the clock starts."""
        Machine(self.loop.plant.told).tick(0.05)

    def start(self) -> None:
        """Let the machine run."""
        told = self.loop.plant.told
        self.say('info', f'running: {both("pump_flow", told.pump_flow)}, '
                 f'preload {both("preload", told.preload)}')
        self.loop.start()

    def last_words(self) -> None:
        """Nothing to add to what the log says: a machine has no report on itself."""

    def close(self) -> None:
        """Stop the loop. Can be called twice."""
        self.loop.stop()


def read_sensors(settings) -> dict[str, Sensor]:
    """Return the sensors that the parameters describe."""
    return {sensor: Sensor(*(settings[f'{sensor}_{part}']
                             for part in ('gain', 'offset', 'noise', 'quantum')))
            for sensor in SENSORS}
