"""The node's interface as tables: topics, services, parameters. Everything else reads them here."""
from __future__ import annotations

from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

from hpv_twin.tracking.estimator import ESTIMATES

NODE_NAME = 'hpv_twin'
JOINTS = ('plunger', 'valve_sleeve')
PRESSURE_FRAME = 'cavity_a'


@dataclass(frozen=True)
class Output:
    """A topic the twin publishes. `latched`: late subscribers get the last value."""

    name: str
    type: type
    unit: str
    text: str
    latched: bool = False
    steady: bool = False  # published at publish_rate

    def qos(self, publish_rate: float) -> QoSProfile:
        """Reliable, so that every subscriber matches; deep enough for a second of data."""
        depth = max(10, round(publish_rate)) if self.steady else 1 if self.latched else 200
        durability = (DurabilityPolicy.TRANSIENT_LOCAL if self.latched
                      else DurabilityPolicy.VOLATILE)
        return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE,
                          durability=durability)


@dataclass(frozen=True)
class Setpoint:
    """An input with the parameters that bound it, the field it sets and its unit for a person."""

    name: str
    field: str
    unit: str
    low: str | None
    high: str
    text: str

    @property
    def topic(self) -> str:
        """Name of the topic in the node's private namespace."""
        return f'~/{self.name}_setpoint'


OUTPUTS = {output.name: output for output in (
    Output('~/pressure', FluidPressure, 'Pa', 'cavity A, absolute (gauge + ambient)',
           steady=True),
    Output('~/plunger_position', JointState, 'm, m/s, N',
           'joints plunger and valve_sleeve; effort: net force on the plunger, pressure force on '
           'the sleeve', steady=True),
    Output('~/pump_flow', Float64, 'm³/s', 'pump flow Q_H in force', latched=True),
    Output('~/preload', Float64, 'm', 'preload y01 in force', latched=True),
    Output('~/load', Float64, 'N', 'technological load F_T in force, a pull is negative',
           latched=True),
    Output('~/frequency', Float64, 'Hz', 'of each cycle; 0 once when oscillation has stopped'),
    Output('~/stroke', Float64, 'm', 'of each cycle; 0 once when oscillation has stopped'),
    *(Output(f'~/estimate/{name}', Float64, unit, f'of the measured machine, each cycle: {text}')
      for name, (unit, text) in ESTIMATES.items()),
    Output('~/residual', Float64, 'Pa', 'RMS of measured minus model, each cycle'),
    Output('/diagnostics', DiagnosticArray, '', 'model, timing, inputs, recorder, hold, '
           'tracking, condition; once a second'),
)}
# Recorded at record_rate where that is above publish_rate; not published.
FINE_OUTPUTS = {output.name: output for output in (
    Output('~/pressure_fine', FluidPressure, 'Pa', 'as ~/pressure, at record_rate', steady=True),
    Output('~/plunger_position_fine', JointState, 'm, m/s',
           'as ~/plunger_position without efforts, at record_rate', steady=True),
)}
CLOCK = Output('/clock', Clock, 's', 'model time since rest, with publish_clock')

SETPOINTS = {setpoint.name: setpoint for setpoint in (
    Setpoint('pump_flow', 'pump_flow', 'm³/s', None, 'pump_flow_max', 'pump flow Q_H'),
    Setpoint('preload', 'preload', 'm', None, 'preload_max', 'preload y01 of the slotted spring'),
    Setpoint('load', 'load', 'N', 'load_min', 'load_max', 'technological load F_T, signed'),
)}
# What sensors of a running machine say; recorded with what the twin says.
MEASURED = {output.name: output for output in (
    Output('~/measured/pressure', FluidPressure, 'Pa', 'of the machine, absolute', steady=True),
    Output('~/measured/plunger_position', JointState, 'm', 'of the machine', steady=True),
)}

# Steers the pump flow; it is no state of the model.
FREQUENCY_SETPOINT = Setpoint('frequency', '', 'Hz', None, '', 'frequency to be held by the pump '
                              'flow; 0, or a pump-flow setpoint, hands it back')
HIGHEST_FREQUENCY = 1e4  # Hz; what is out of reach below it ends at a limit, and that is said
INPUTS = {**SETPOINTS, FREQUENCY_SETPOINT.name: FREQUENCY_SETPOINT}


@dataclass(frozen=True)
class Parameter:
    """A parameter with its default (None: the design's own value), bounds and meaning."""

    name: str
    default: float | bool | str | None
    text: str
    low: float | None = None
    high: float | None = None
    live: bool = False  # may change while the twin runs

    @property
    def kind(self) -> type:
        """Type of the value: float, bool or str."""
        return float if self.default is None else type(self.default)

    def descriptor(self) -> ParameterDescriptor:
        """What `ros2 param describe` shows."""
        ranges = []
        if self.low is not None:
            ranges = [FloatingPointRange(from_value=self.low, to_value=self.high)]
        return ParameterDescriptor(name=self.name, description=self.text,
                                   read_only=not self.live, floating_point_range=ranges)


PARAMETERS = {parameter.name: parameter for parameter in (
    Parameter('vibrator', '', 'YAML file of the design; "" is the built-in base design'),
    Parameter('pump_flow', None, "pump flow at the start, m³/s; default: the design's",
              0.0, 1.0),
    Parameter('preload', None, "preload at the start, m; default: the design's", 0.0, 1.0),
    Parameter('load', None, "load at the start, N; default: the design's", -1e9, 1e9),
    Parameter('publish_rate', 1000.0, 'Hz of wall time for pressure and position', 1.0, 10_000.0),
    Parameter('speed', 1.0, 'model seconds per second of wall time', 0.001, 10_000.0),
    Parameter('publish_clock', False, 'publish model time as /clock at publish_rate, for nodes '
              'with use_sim_time'),
    Parameter('ambient_pressure', 101_325.0, 'Pa, added to the gauge pressure for publishing',
              0.0, 1e6),
    Parameter('pump_flow_max', 4e-3, 'm³/s, highest pump-flow setpoint accepted', 0.0, 1.0,
              live=True),
    Parameter('preload_max', 15e-3, 'm, highest preload setpoint accepted', 0.0, 1.0, live=True),
    Parameter('load_min', -2e3, 'N, lowest load setpoint accepted', -1e9, 1e9, live=True),
    Parameter('load_max', 1e4, 'N, highest load setpoint accepted', -1e9, 1e9, live=True),
    Parameter('record', True, 'write a recording from the start'),
    Parameter('record_directory', 'bags', 'folder of the recordings, relative to where it runs'),
    Parameter('record_max_size', 1e9, 'bytes kept in all; the oldest own recordings go first',
              2e6, 1e15),
    Parameter('record_max_age', 0.0, 's; own recordings that ended longer ago are removed; 0: '
              'never for their age', 0.0, 1e9),
    Parameter('record_split_size', 0.0, 'bytes after which a recording goes on in a further file; '
              '0: a tenth of record_max_size, 1 MB to 1 GB', 0.0, 1e12),
    Parameter('record_split_time', 0.0, 's after which a recording goes on in a further file; 0: '
              'never for its length', 0.0, 1e7),
    Parameter('record_reserve', 100e6, 'bytes of the disk left to others: below, recording waits',
              0.0, 1e15),
    Parameter('record_rate', 0.0, 'Hz at which pressure and position are recorded; above '
              'publish_rate as ~/pressure_fine and ~/plunger_position_fine, beside what is '
              'published; 0: publish_rate', 0.0, 20_000.0),
    Parameter('fsync', False, 'wait for the disk at each flush, so that a power cut loses little'),
)}

SERVICES = {
    '~/reset': 'back to rest (p = y = v = 0); setpoints stay',
    '~/pause': 'model time stands still; outputs stop, diagnostics go on',
    '~/record': 'stop, or start a new file',
}
