"""What an operator is given: params file, launch file, security policy, systemd unit."""
import ast
import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import yaml
from conftest import DEADLINE, ROOT

from hpv_twin.model import Vibrator

pytest.importorskip('rclpy')

from hpv_twin.node.interface import CLOCK, INPUTS, MEASURED, OUTPUTS, PARAMETERS, SERVICES

PARAMS_FILE = ROOT / 'config/twin.yaml'
LAUNCH_FILE = ROOT / 'launch/twin.launch.py'
POLICY = ROOT / 'config/sros2/hpv_twin.policy.xml'
UNIT = ROOT / 'deploy/hpv-twin.service'
DOCUMENT = ROOT / 'docs/deployment.md'

TOPICS = {*OUTPUTS, CLOCK.name, *MEASURED,
          *(setpoint.topic for setpoint in INPUTS.values())}


# --- Params file ------------------------------------------------------------------------------

def test_params_file_has_every_parameter_with_its_default():
    written = yaml.safe_load(PARAMS_FILE.read_text())['/**']['ros__parameters']
    assert written == {name: parameter.default for name, parameter in PARAMETERS.items()
                       if parameter.default is not None}
    assert {name: type(value) for name, value in written.items()} == {
        name: PARAMETERS[name].kind for name in written}


def test_params_file_tells_the_setpoints_of_the_base_design_without_setting_them():
    told = dict(re.findall(r'^ +# (\w+): (\S+)$', PARAMS_FILE.read_text(), re.MULTILINE))
    base = Vibrator()
    assert {name: float(value) for name, value in told.items()} == {
        name: getattr(base, name) for name, parameter in PARAMETERS.items()
        if parameter.default is None}


def comment_above(name):
    """Return the paragraph of comments over a parameter, which neighbours may share."""
    before = re.split(rf'^ +(?:# )?{name}: .*$', PARAMS_FILE.read_text(), flags=re.MULTILINE)[0]
    paragraph = re.split(r'\n *#?\n', before)[-1]
    return ' '.join(re.findall(r'^ *# (?!\w+: )(.*)$', paragraph, re.MULTILINE))


@pytest.mark.parametrize('name', PARAMETERS)
def test_params_file_tells_bounds_and_what_is_live(name):
    comment, parameter = comment_above(name), PARAMETERS[name]
    bounds = [tuple(map(float, pair)) for pair in
              re.findall(r'(-?[\d.e]+) to (-?[\d.e]+)', comment)]
    assert comment and ('live' in comment) == parameter.live, comment
    assert (parameter.low, parameter.high) in [*bounds, (None, None)], comment


def test_twin_runs_with_the_params_file(start_twin, ear):
    from std_msgs.msg import Float64
    twin = start_twin(ros=['--params-file', str(PARAMS_FILE)])
    frequencies = ear.listen(Float64, '/hpv_twin/frequency')
    ear.until(lambda: len(frequencies) > 5, 'cycles')
    assert frequencies[-1].data == pytest.approx(55, rel=0.02)
    assert twin.stop() == 0
    assert 'unknown parameter' not in twin.log


# --- Launch file ------------------------------------------------------------------------------

def launch_table(name):
    """Return a dict of the launch file, without importing it: launch is not on PyPI."""
    for node in ast.parse(LAUNCH_FILE.read_text()).body:
        if isinstance(node, ast.Assign) and node.targets[0].id == name:
            return {ast.literal_eval(key): value for key, value
                    in zip(node.value.keys, node.value.values, strict=True)}
    raise AssertionError(f'no table {name} in {LAUNCH_FILE}')


def test_launch_file_describes_a_launch():
    tree = ast.parse(LAUNCH_FILE.read_text())
    compile(tree, LAUNCH_FILE, 'exec')
    assert 'generate_launch_description' in {node.name for node in tree.body
                                             if isinstance(node, ast.FunctionDef)}
    assert {'namespace', 'params_file', 'log_level'} <= set(launch_table('SETTINGS'))


def test_launch_file_remaps_every_topic():
    assert set(launch_table('TOPICS')) == TOPICS


def test_launch_file_takes_parameters_of_the_twin():
    table = launch_table('PARAMETERS')
    assert {'vibrator', 'record', 'record_directory', 'speed'} <= set(table)
    for name, value in table.items():
        assert value.elts[0].id == PARAMETERS[name].kind.__name__, name


def test_launch_leaves_the_twin_its_two_seconds():
    settings = launch_table('SETTINGS')
    assert all(float(ast.literal_eval(settings[name])[0]) > 2
               for name in ('sigterm_timeout', 'sigkill_timeout'))


LAUNCH = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
arguments = [tuple(argument.split(':=', 1)) for argument in sys.argv[2:]]
service = LaunchService()
service.include_launch_description(LaunchDescription([IncludeLaunchDescription(
    PythonLaunchDescriptionSource(sys.argv[1]), launch_arguments=arguments)]))
sys.exit(service.run())
"""


@pytest.fixture
def prefix(tmp_path):
    """Return a prefix in which launch finds the twin of this tree."""
    prefix = tmp_path / 'prefix'
    (prefix / 'share/ament_index/resource_index/packages').mkdir(parents=True)
    (prefix / 'share/ament_index/resource_index/packages/hpv_twin').touch()
    (prefix / 'lib/hpv_twin').mkdir(parents=True)
    launcher = prefix / 'lib/hpv_twin/twin'
    launcher.write_text(f'#!/bin/sh\nexec {sys.executable} -m hpv_twin twin "$@"\n')
    launcher.chmod(0o755)
    return prefix


@pytest.fixture
def launch(prefix, tmp_path):
    """Launch the twin with arguments; what is left at the end of the test is ended."""
    pytest.importorskip('launch_ros.actions', reason='launch comes with ROS, not from PyPI')
    started = []

    def start(*arguments):
        path = [str(prefix), *filter(None, [os.environ.get('AMENT_PREFIX_PATH')])]
        with open(tmp_path / 'launch.log', 'w') as log:
            started.append(subprocess.Popen(
                [sys.executable, '-c', LAUNCH, str(LAUNCH_FILE), *arguments], cwd=tmp_path,
                stdout=log, stderr=subprocess.STDOUT, start_new_session=True,
                env=os.environ | {'AMENT_PREFIX_PATH': os.pathsep.join(path)}))
        return started[-1]
    yield start
    for process in started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)  # the group: launch passes a SIGTERM to nobody
            try:
                process.wait(DEADLINE)
            finally:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)


def test_launched_twin_speaks_on_the_topics_of_the_machine(launch, ear, tmp_path):
    from std_msgs.msg import Float64
    process = launch('namespace:=left', 'pump_flow_topic:=/plant/q', 'speed:=1', 'record:=true',
                     'pump_flow_setpoint_topic:=/plant/q_wanted', 'record_directory:=kept')
    in_force = ear.listen(Float64, '/plant/q', latched=True)
    frequencies = ear.listen(Float64, '/left/hpv_twin/frequency')
    ear.until(lambda: in_force and len(frequencies) > 5, 'the twin')
    ear.say('/plant/q_wanted', 3.65e-4)
    ear.until(lambda: in_force[-1].data == 3.65e-4, 'the setpoint in force')
    # As Ctrl-C in a terminal: to launch and to the twin.
    os.killpg(process.pid, signal.SIGINT)
    log = tmp_path / 'launch.log'
    assert process.wait(DEADLINE) == 0, log.read_text()
    assert 'process has finished cleanly' in log.read_text()
    recordings = list((tmp_path / 'kept').glob('*.mcap'))
    assert len(recordings) == 1
    assert recordings[0].read_bytes().endswith(b'\x89MCAP0\r\n')


def test_launch_arguments_beat_the_params_file(launch, ear, tmp_path):
    from rcl_interfaces.srv import GetParameters
    (tmp_path / 'mine.yaml').write_text(
        '/left/hpv_twin: {ros__parameters: {speed: 2.0, pump_flow_max: 1.0e-3, record: true}}')
    launch('namespace:=/left', 'params_file:=mine.yaml', 'speed:=0.5', 'record:=false')
    request = GetParameters.Request(names=['speed', 'pump_flow_max', 'record'])
    speed, limit, record = ear.call(GetParameters, '/left/hpv_twin/get_parameters', request).values
    assert (speed.double_value, limit.double_value, record.bool_value) == (0.5, 1e-3, False)


# --- Security policy --------------------------------------------------------------------------

RIGHTS = {'publish': 'topics', 'subscribe': 'topics', 'reply': 'services', 'request': 'services'}


def policy():
    """Return what the policy allows: full names by right. Raises where it denies or is broken."""
    root = ElementTree.parse(POLICY).getroot()
    assert (root.tag, root.get('version')) == ('policy', '0.2.0')
    enclave, = root.iterfind('enclaves/enclave')
    assert enclave.get('path') == '/hpv_twin'
    profile, = enclave.iterfind('profiles/profile')
    private = profile.get('ns').rstrip('/') + '/' + profile.get('node')
    allowed = {right: [] for right in RIGHTS}
    for rule in profile:
        for right, word in rule.attrib.items():
            assert (rule.tag, word) == (RIGHTS[right], 'ALLOW')
            allowed[right] += [name.text.replace('~', private) for name in rule]
    assert all(len(names) == len(set(names)) for names in allowed.values())
    return {right: set(names) for right, names in allowed.items()}


def graph(node, name='hpv_twin', namespace='/'):
    """Return what a running node has: full names by the right that it needs."""
    look = {'publish': node.get_publisher_names_and_types_by_node,
            'subscribe': node.get_subscriber_names_and_types_by_node,
            'reply': node.get_service_names_and_types_by_node,
            'request': node.get_client_names_and_types_by_node}
    return {right: {topic for topic, _ in names(name, namespace)}
            for right, names in look.items()}


@pytest.mark.parametrize('clock', ['true', 'false'])
def test_policy_lists_what_the_running_twin_has(start_twin, ear, clock):
    start_twin(f'publish_clock:={clock}', 'record:=false')
    expected = policy()
    if clock == 'false':
        expected['publish'] -= {CLOCK.name}
    ear.until(lambda: ('hpv_twin', '/') in ear.node.get_node_names_and_namespaces(), 'the twin')
    try:
        ear.until(lambda: graph(ear.node) == expected, 'the interfaces of the policy', 10)
    except AssertionError:
        assert graph(ear.node) == expected
        raise
    ear.spin(1.0)  # nothing more may appear
    assert graph(ear.node) == expected


def test_policy_knows_the_interface_tables():
    allowed = policy()
    here = {right: {name.replace('~', '/hpv_twin') for name in names} for right, names in {
        'publish': [*OUTPUTS, CLOCK.name], 'reply': SERVICES,
        'subscribe': [*MEASURED, *(setpoint.topic for setpoint in INPUTS.values())]}.items()}
    assert all(here[right] <= allowed[right] for right in here)


# --- systemd unit -----------------------------------------------------------------------------

def unit(path=UNIT):
    """Return what a unit file sets: key -> list of values; an empty value starts anew."""
    settings = {}
    for line in path.read_text().splitlines():
        if line and not line.startswith(('#', '[')):
            key, value = line.split('=', 1)
            settings[key] = [*settings.get(key, []), value] if value else []
    return settings


def environment():
    """Return the service's environment, with the profile of this tree."""
    lines = (ROOT / 'deploy/environment').read_text().splitlines()
    pairs = dict(line.split('=', 1) for line in lines if line and not line.startswith('#'))
    profile = ROOT / 'deploy' / Path(pairs['FASTRTPS_DEFAULT_PROFILES_FILE']).name
    return pairs | {'FASTRTPS_DEFAULT_PROFILES_FILE': str(profile)}


def ros_arguments(command, instance=''):
    """Return what ExecStart tells the twin, with the params file of this tree."""
    program, name, flag, *arguments = command.replace('%i', instance).split()
    assert (program, name, flag) == ('/opt/hpv-twin/bin/hpv-twin', 'twin', '--ros-args')
    return [str(PARAMS_FILE) if argument.startswith('/etc/hpv-twin/') else argument
            for argument in arguments]


@pytest.mark.parametrize('instance', ['', 'left'])
def test_service_runs_the_twin_and_ends_it(start_twin, ear, instance, monkeypatch):
    from std_msgs.msg import Float64
    for name, value in environment().items():
        if name != 'ROS_DOMAIN_ID':
            monkeypatch.setenv(name, value)
    command, = unit(ROOT / 'deploy/instance.conf' if instance else UNIT)['ExecStart']
    twin = start_twin(ros=ros_arguments(command, instance))
    frequencies = ear.listen(Float64, f'{"/" if instance else ""}{instance}/hpv_twin/frequency')
    ear.until(lambda: len(frequencies) > 5, 'cycles')
    # Its own profile: nothing of Fast DDS in shared memory, where other users cannot write.
    assert '/dev/shm/fastrtps_' not in Path(f'/proc/{twin.process.pid}/maps').read_text()
    twin.signal(signal.SIGTERM)  # as systemd ends it, and then it waits so long
    assert twin.wait(float(unit()['TimeoutStopSec'][0])) == 0
    assert len(twin.recordings) == 1


def test_service_is_not_started_again_after_a_bad_parameter(start_twin):
    twin = start_twin('speed:=-1')
    assert unit()['RestartPreventExitStatus'] == [str(twin.wait())]


@pytest.mark.skipif(not shutil.which('systemd-analyze'), reason='no systemd here')
@pytest.mark.parametrize('name', ['hpv-twin.service', 'hpv-twin@left.service'])
def test_systemd_takes_the_unit(tmp_path, name):
    for file in ('hpv-twin.service', 'hpv-twin@.service'):
        # The verification asks whether the command exists, too.
        (tmp_path / file).write_text(
            UNIT.read_text().replace('/opt/hpv-twin/bin/hpv-twin', sys.executable))
    (tmp_path / 'hpv-twin@.service.d').mkdir()
    (tmp_path / 'hpv-twin@.service.d/instance.conf').write_text(
        (ROOT / 'deploy/instance.conf').read_text().replace('/opt/hpv-twin/bin/hpv-twin',
                                                            sys.executable))
    done = subprocess.run(['systemd-analyze', 'verify', '--man=no', name], text=True, cwd=tmp_path,
                          env=os.environ | {'SYSTEMD_UNIT_PATH': f'{tmp_path}:'},
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    ours = [line for line in done.stdout.splitlines() if 'hpv-twin' in line]
    assert (done.returncode, ours) == (0, []), done.stdout


def test_command_of_the_service_with_ros_of_the_distribution(tmp_path):
    """It sources ROS, then the workspace, and becomes the command."""
    (tmp_path / 'setup.bash').write_text('export SAID="$SAID ros"\n')
    install = tmp_path / 'install'
    (install / 'hpv_twin/bin').mkdir(parents=True)
    (install / 'setup.bash').write_text('export SAID="$SAID workspace"\n')
    command = install / 'hpv_twin/bin/hpv-twin'
    command.write_text('#!/bin/sh\necho $$ $SAID "$@"\n')
    command.chmod(0o755)
    script = tmp_path / 'hpv-twin'
    script.write_text((ROOT / 'deploy/hpv-twin-with-ros.sh').read_text()
                      .replace('/opt/ros/jazzy', str(tmp_path))
                      .replace('/opt/hpv-twin', str(tmp_path)))
    script.chmod(0o755)
    process = subprocess.Popen([script, 'twin', '--ros-args'], stdout=subprocess.PIPE, text=True)
    said, _ = process.communicate(timeout=DEADLINE)
    assert said.split() == [str(process.pid), 'ros', 'workspace', 'twin', '--ros-args']


# --- Document ---------------------------------------------------------------------------------

def test_document_names_what_there_is():
    text = DOCUMENT.read_text()
    for path in [PARAMS_FILE, LAUNCH_FILE, POLICY, *(ROOT / 'deploy').iterdir()]:
        assert path.name in text, path
    for path in re.findall(r'(?<![\w/.-])((?:deploy|config|launch|docs|bench)/[\w./-]+\w)', text):
        assert (ROOT / path).exists(), path
