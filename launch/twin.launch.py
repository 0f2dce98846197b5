"""Start a twin: `ros2 launch hpv_twin twin.launch.py --show-args` lists what can be said."""
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

PARAMS_FILE = Path(__file__).parents[1] / 'config' / 'twin.yaml'

SETTINGS = {
    'namespace': ('', 'namespace of the twin, for example left: /left/hpv_twin'),
    'params_file': (str(PARAMS_FILE), 'YAML file with parameters of the twin'),
    'log_level': ('info', 'debug, info, warn, error or fatal; or LOGGER:=LEVEL'),
    'enclave': ('', 'security enclave, for example /hpv_twin'),
    'sigterm_timeout': ('5', 's from SIGINT, which a twin obeys within 2 s, to SIGTERM'),
    'sigkill_timeout': ('5', 's from SIGTERM to SIGKILL, which leaves the recording unfinished'),
}

# Parameters that can be given here, too. One that is given beats the params file.
PARAMETERS = {
    'vibrator': (str, 'YAML file of the design'),
    'speed': (float, 'model seconds per second of wall time'),
    'record': (bool, 'true or false: write a recording from the start'),
    'record_directory': (str, 'folder of the recordings, relative to where launch was started'),
}

# Each has an argument <topic>_topic: the name of this topic on your machine.
TOPICS = {
    '~/pump_flow_setpoint': 'in: pump flow, m³/s',
    '~/preload_setpoint': 'in: preload of the slotted spring, m',
    '~/load_setpoint': 'in: technological load, N',
    '~/frequency_setpoint': 'in: frequency to be held by the pump flow, Hz; 0: off',
    '~/measured/pressure': 'in: pressure of the machine, Pa absolute',
    '~/measured/plunger_position': 'in: position of the machine, m',
    '~/pressure': 'out: pressure in cavity A, Pa absolute',
    '~/plunger_position': 'out: plunger and valve sleeve, m, m/s, N',
    '~/pump_flow': 'out: pump flow in force, m³/s',
    '~/preload': 'out: preload in force, m',
    '~/load': 'out: load in force, N',
    '~/frequency': 'out: of each cycle, Hz',
    '~/stroke': 'out: of each cycle, m',
    '~/estimate/cavity_stiffness': 'out: of the measured machine, each cycle',
    '~/estimate/pump_flow': 'out: of the measured machine, each cycle',
    '~/estimate/opening_force': 'out: of the measured machine, each cycle',
    '~/estimate/flow_coefficient': 'out: of the measured machine, each cycle',
    '~/estimate/base_pressure': 'out: of the measured machine, each cycle',
    '~/estimate/viscous_friction': 'out: of the measured machine, each cycle',
    '~/residual': 'out: RMS of measured minus model, Pa, each cycle',
    '/diagnostics': 'out: health, once a second',
    '/clock': 'out: model time, with publish_clock',
}


def topic_argument(topic):
    """Name of the launch argument for a topic: ~/pressure has pressure_topic."""
    return topic.removeprefix('~').strip('/').replace('/', '_') + '_topic'


def generate_launch_description():
    """Return the arguments and the twin."""
    arguments = [DeclareLaunchArgument(name, default_value=default, description=text)
                 for name, (default, text) in SETTINGS.items()]
    arguments += [DeclareLaunchArgument(name, default_value='',
                                        description=f"{text}; empty: the params file's")
                  for name, (_, text) in PARAMETERS.items()]
    arguments += [DeclareLaunchArgument(topic_argument(topic), default_value=topic,
                                        description=text) for topic, text in TOPICS.items()]
    return LaunchDescription([*arguments, OpaqueFunction(function=twin)])


def twin(context):
    """Return the node with the arguments that were given."""
    value = context.launch_configurations
    parameters = {name: ParameterValue(LaunchConfiguration(name), value_type=kind)
                  for name, (kind, _) in PARAMETERS.items() if value[name]}
    ros_arguments = ['--log-level', value['log_level']]
    if value['enclave']:
        ros_arguments += ['--enclave', value['enclave']]
    return [Node(
        package='hpv_twin', executable='twin', name='hpv_twin', namespace=value['namespace'],
        parameters=[value['params_file'], *([parameters] if parameters else [])],
        remappings=[(topic, value[topic_argument(topic)]) for topic in TOPICS
                    if value[topic_argument(topic)] != topic],
        ros_arguments=ros_arguments,
        # At a pseudo-terminal the twin rewrites a status line, which launch would store to the end.
        output='screen', emulate_tty=False,
        sigterm_timeout=value['sigterm_timeout'], sigkill_timeout=value['sigkill_timeout'])]
