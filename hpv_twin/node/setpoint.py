"""`hpv-twin setpoint`: give a running twin new setpoints, where there is no `ros2 topic pub`."""
from __future__ import annotations

import argparse
import math
import sys
import time

DEADLINE = 5.0  # s, for finding the twin and for hearing that it obeys
NAMES = ('pump_flow', 'preload', 'load', 'frequency')
HELD = 2e-3  # relative error at which a frequency counts as held

EXAMPLES = """\
examples:
  hpv-twin setpoint --pump-flow 3.65e-4            half the base flow, 21.9 L/min
  hpv-twin setpoint --preload 6e-3 --load 500      more preload, and a load of 500 N
  hpv-twin setpoint --frequency 70                 hold 70 Hz by the pump flow; 0 hands it back
  hpv-twin setpoint --node /left/hpv_twin --pump-flow 0
"""


def main(argv: list[str] | None = None) -> int:
    """Publish setpoints until the twin says they are in force; 1 if it does not in 5 s."""
    parser = argparse.ArgumentParser(
        prog='hpv-twin setpoint', epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Give a running twin new setpoints and wait until they are in force.')
    parser.add_argument('--pump-flow', type=number, metavar='M3/S', help='pump flow Q_H, m³/s')
    parser.add_argument('--preload', type=number, metavar='M', help='preload y01, m')
    parser.add_argument('--load', type=number, metavar='N',
                        help='technological load F_T, N; a pull is negative')
    parser.add_argument('--frequency', type=number, metavar='HZ',
                        help='frequency to be held by the pump flow, Hz; 0: no longer')
    parser.add_argument('--node', default='/hpv_twin', help='full name of the twin (%(default)s)')
    arguments = parser.parse_args(argv)
    wanted = {name: getattr(arguments, name) for name in NAMES
              if getattr(arguments, name) is not None}
    if not wanted:
        parser.error('name at least one of --pump-flow, --preload, --load, --frequency')
    return send(arguments.node.rstrip('/'), wanted)


def number(text: str) -> float:
    """A finite number."""
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'{text} is not a finite number')
    return value


def send(twin: str, wanted: dict[str, float]) -> int:
    """Publish `wanted` to the twin of this full name and report what it has put in force."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from std_msgs.msg import Float64

    from .units import both

    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node('setpoint', context=context, enable_rosout=False,
                             start_parameter_services=False)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    in_force = {}
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publishers = {}
    for name in wanted:
        # A frequency is not put in force but reached: it is measured, and not latched.
        node.create_subscription(Float64, f'{twin}/{name}',
                                 lambda m, name=name: in_force.update({name: m.data}),
                                 10 if name == 'frequency' else latched)
        publishers[name] = node.create_publisher(Float64, f'{twin}/{name}_setpoint', 1)
    try:
        end = time.monotonic() + DEADLINE
        sent = {}

        def done(name):
            # The frequency may be right by chance, before anybody was asked to hold it.
            old = name != 'frequency' or time.monotonic() - sent.get(name, math.inf) > 0.2
            return old and met(name, wanted[name], in_force.get(name))
        while time.monotonic() < end and not all(map(done, wanted)):
            for name, publisher in publishers.items():
                # Again now and then: the first may pass before both ends have found each other.
                if (not done(name) and publisher.get_subscription_count()
                        and time.monotonic() - sent.get(name, -math.inf) > 0.5):
                    publisher.publish(Float64(data=wanted[name]))
                    sent[name] = time.monotonic()
            executor.spin_once(timeout_sec=0.02)
        return report(twin, wanted, in_force, both)
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


def met(name: str, wanted: float, heard: float | None) -> bool:
    """Whether what the twin says is what was wanted; any frequency will do once none is held."""
    if heard is None or name != 'frequency':
        return heard == wanted
    return wanted == 0.0 or abs(heard / wanted - 1.0) < HELD


def report(twin, wanted, in_force, both) -> int:
    """Say what is in force; 0 if it is all that was wanted."""
    if not in_force:
        print(f'hpv-twin setpoint: no twin called {twin} answers within {DEADLINE:g} s. Is it '
              'running, with the same ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE? '
              '--node names another', file=sys.stderr)
        return 1
    for name, value in wanted.items():
        if name == 'frequency' and name in in_force:
            held = met(name, value, in_force[name])
            print(f'frequency: {in_force[name]:.2f} Hz'
                  + ('' if held else f', {value:g} Hz is not reached: /diagnostics says why'),
                  file=sys.stdout if held else sys.stderr)
        elif in_force.get(name) == value:
            print(f'{name}: {both(name, value)} in force')
        else:
            stays = both(name, in_force[name]) if name in in_force else 'unknown'
            print(f'{name}: {both(name, value)} was not accepted, {stays} is in force; the '
                  "twin's log says why", file=sys.stderr)
    return 0 if all(met(n, v, in_force.get(n)) for n, v in wanted.items()) else 1


if __name__ == '__main__':
    sys.exit(main())
