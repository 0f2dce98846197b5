"""`hpv-twin demo`: a machine, a twin beside it, a fault, the alarm, and the replay of it."""
from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from hpv_twin.model.faults import FAULTS

PATIENCE = 60.0  # s for the twin to follow, and for the alarm to come
LEAST = 0.02  # severity below which a fault is none
BESIDE = {'pressure': 'measured/pressure', 'plunger_position': 'measured/plunger_position',
          'pump_flow_setpoint': 'pump_flow', 'preload_setpoint': 'preload',
          'load_setpoint': 'load'}
EXAMPLES = """\
examples:
  hpv-twin demo
  hpv-twin demo --fault worn_slot --severity 0.6 --after 10
  hpv-twin demo --no-replay --directory /tmp/demo
"""


def main(argv: list[str] | None = None) -> int:
    """Run the demonstration; 0 when the fault was found, 1 when not."""
    parser = argparse.ArgumentParser(
        prog='hpv-twin demo', epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Start the stand-in machine and a twin beside it, switch a fault on, wait for '
        'the alarm, and open the replay.')
    parser.add_argument('--fault', choices=FAULTS, default='air_in_oil',
                        help='fault of the machine (%(default)s)')
    parser.add_argument('--severity', type=severity, default=0.4, help='up to 1 (%(default)s)')
    parser.add_argument('--after', type=float, default=20.0, metavar='S',
                        help='s of healthy running before the fault (%(default)s)')
    parser.add_argument('--directory', default='bags', help='of the recording (%(default)s)')
    parser.add_argument('--no-replay', action='store_true', help='leave the replay out')
    arguments = parser.parse_args(argv)
    import rclpy  # noqa: F401  (said to be missing before anything is started)
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    directory = Path(arguments.directory).expanduser()
    before = set(directory.glob('*.mcap'))
    remaps = [word for own, twins in BESIDE.items()
              for word in ('-r', f'~/{own}:=/hpv_twin/{twins}')]
    processes = [
        start('twin', '--ros-args', '-p', f'record_directory:={directory}'),
        start('machine', '--ros-args', '-p', 'pump_flow:=7.3e-4', *remaps)]
    found = False
    try:
        found = watch(arguments, processes)
    except KeyboardInterrupt:
        print('demo: ended early; the recording is kept')
    finally:
        end(processes)
    written = sorted(set(directory.glob('*.mcap')) - before)
    if not written:
        print(f'hpv-twin demo: nothing was recorded in {directory}', file=sys.stderr)
        return 1
    print(f'demo: hpv-twin replay {written[0]}')
    if not arguments.no_replay:
        command('replay', written[0]).wait()
    return 0 if found else 1


def severity(text: str) -> float:
    """Return a severity that can be seen."""
    value = float(text)
    if not LEAST <= value <= 1.0:
        raise argparse.ArgumentTypeError(f'{text} is outside [{LEAST:g}, 1]')
    return value


def command(name, *arguments, **options):
    """Start a command of this package."""
    return subprocess.Popen([sys.executable, '-m', 'hpv_twin', name, *map(str, arguments)],
                            **options)


def start(name, *arguments):
    """Start a node in a process group of its own: Ctrl-C is passed on by `end`."""
    return command(name, *arguments, stdin=subprocess.DEVNULL, start_new_session=True)


def end(processes):
    """End nodes as Ctrl-C does, and wait for their last words."""
    for process in processes:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
    for process in processes:
        try:
            process.wait(15.0)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def watch(arguments, processes) -> bool:
    """Switch the fault on when its time has come; whether the alarm names it."""
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
    from rcl_interfaces.srv import SetParameters

    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node('demo', context=context, enable_rosout=False)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    said = {}

    def hear(message):
        for status in message.status:
            part = status.name.removeprefix('/hpv_twin: ')
            if part in ('tracking', 'condition'):
                said[part] = status.message
    node.create_subscription(DiagnosticArray, '/diagnostics', hear, 10)
    client = node.create_client(SetParameters, '/machine/set_parameters')

    def until(done, patience):
        """Listen until `done()`; False when time is up or a node has ended."""
        over = time.monotonic() + patience
        while not done():
            if time.monotonic() > over or any(p.poll() is not None for p in processes):
                return False
            executor.spin_once(timeout_sec=0.1)
        return True
    try:
        if not until(lambda: 'following' in said.get('tracking', ''), PATIENCE):
            print(f'hpv-twin demo: the machine is not followed: {said}', file=sys.stderr)
            return False
        print(f'demo: {said["tracking"]}; {arguments.fault} in {arguments.after:g} s')
        until(lambda: False, arguments.after)
        print(f'demo: {said["tracking"]}; {said["condition"]}')
        client.call_async(SetParameters.Request(parameters=[Parameter(
            name=arguments.fault, value=ParameterValue(
                type=ParameterType.PARAMETER_DOUBLE, double_value=arguments.severity))]))
        began = time.monotonic()
        print(f'demo: now {FAULTS[arguments.fault].text} (severity {arguments.severity:g})')
        alarm = until(lambda: 'from the design' in said.get('condition', ''), PATIENCE)
        if alarm:
            print(f'demo: alarm after {time.monotonic() - began:.1f} s (/diagnostics comes once a '
                  f'second): {said["condition"]}')
            until(lambda: False, 5.0)
        else:
            print(f'hpv-twin demo: no alarm: {said}', file=sys.stderr)
        return alarm
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


if __name__ == '__main__':
    sys.exit(main())
