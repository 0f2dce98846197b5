"""
The twin under fire: a flood of setpoints, and a process that is stopped for seconds.

    python bench/under_fire.py

Each figure stands beside the same twin left in peace in the same run. What is not about time is in
`make test-long`: random bytes and values, bad files, many starts and stops, random scenarios.
"""
import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('ROS_DOMAIN_ID', '94')

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import serialize_message
from sensor_msgs.msg import FluidPressure
from std_msgs.msg import Float64

PERIOD = 1_000_000  # ns
LAST_FLOW = 6e-4  # m³/s, the last setpoint of a flood


class Listener:
    """Keeps the newest report and every stamp of the pressure, with the time of its receipt."""

    def __init__(self):
        self.node = rclpy.create_node('under_fire')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.reports, self.stamps, self.flows = 0, [], []
        self.report = None
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self.keep, 10)
        self.node.create_subscription(FluidPressure, '/hpv_twin/pressure', self.note, 5000)
        self.node.create_subscription(Float64, '/hpv_twin/pump_flow',
                                      lambda m: self.flows.append(m.data), 10)

    def keep(self, report):
        """Remember the newest diagnostics."""
        self.reports += 1
        self.report = {status.name.rpartition(': ')[2]: {v.key: v.value for v in status.values}
                       for status in report.status}

    def note(self, message):
        """Remember a stamp."""
        self.stamps.append(message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec)

    def spin(self, seconds):
        """Listen for so long."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)

    def fresh(self, count=2):
        """The timing of a report made from now on."""
        until = self.reports + count
        while self.reports < until:
            self.executor.spin_once(timeout_sec=0.1)
        return self.report['timing']

    def late(self, seconds):
        """Ticks, and those late by more than 1 ms, in so many seconds from now."""
        before = self.fresh(1)
        self.spin(seconds)
        after = self.fresh(1)
        return tuple(int(after[key]) - int(before[key])
                     for key in ('ticks', 'late by more than 1 ms', 'dropped ticks'))


def speak(rate, seconds):
    """Publish pump-flow setpoints at `rate` Hz, in a process of its own."""
    rclpy.init()
    node = rclpy.create_node('flood')
    publisher = node.create_publisher(Float64, '/hpv_twin/pump_flow_setpoint', 1)
    while not publisher.get_subscription_count():
        time.sleep(0.01)
    payloads = [serialize_message(Float64(data=7.3e-4 + 1e-9 * k)) for k in range(1000)]
    began, sent = time.monotonic(), 0
    while (now := time.monotonic() - began) < seconds:
        while sent < now * rate:
            publisher.publish(payloads[sent % 1000])
            sent += 1
        time.sleep(5e-4)
    publisher.publish(Float64(data=LAST_FLOW))
    print(f'  sent {sent} setpoints in {time.monotonic() - began:.2f} s', flush=True)
    time.sleep(0.5)
    node.destroy_node()
    rclpy.shutdown()


def flood(listener, rate, seconds):
    """A flood of setpoints against the same time without it."""
    quiet = listener.late(seconds)
    speaker = subprocess.Popen([sys.executable, __file__, '--speak', str(rate), str(seconds)])
    flooded = listener.late(seconds)
    speaker.wait(60)
    listener.spin(0.5)
    print(f'flood of {rate:.0f} setpoints/s for {seconds:.0f} s')
    for name, (ticks, late, dropped) in (('in peace', quiet), ('flooded', flooded)):
        print(f'  {name}: {ticks} ticks, {late} late by more than 1 ms, {dropped} dropped: '
              f'{100.0 * (1.0 - (late + dropped) / (ticks + dropped)):.2f} % in time')
    inputs = listener.report['inputs']
    print(f'  taken by the twin: {inputs["pump_flow accepted"]} (its queue holds the newest '
          f'alone); longest to force {inputs["longest from receipt to force [ms]"]} ms')
    print(f'  in force at the end: {listener.flows[-1]:g} m³/s, last one sent: {LAST_FLOW:g} m³/s')


def stand_still(listener, twin, seconds):
    """SIGSTOP, and SIGCONT after so many seconds."""
    before = listener.fresh()
    first = len(listener.stamps)
    os.killpg(twin.pid, signal.SIGSTOP)
    listener.spin(seconds)
    resumed = time.time_ns()
    os.killpg(twin.pid, signal.SIGCONT)
    listener.spin(1.0)
    after = listener.fresh()
    stamps = np.array(listener.stamps[first:])
    steps = np.diff(stamps)
    k = int(np.argmax(steps))
    reported = float(after['dropped time [s]']) - float(before['dropped time [s]'])
    print(f'SIGSTOP for {seconds:.0f} s')
    print(f'  gaps in the stamps: {int((steps > PERIOD + 1000).sum())}, the longest '
          f'{(steps[k] - PERIOD) * 1e-9:.3f} s; reported as dropped {reported:.3f} s')
    print(f'  first tick after it: stamped {(stamps[k + 1] - resumed) * 1e-6:+.1f} ms after '
          'SIGCONT (not before -21: the catch-up)')
    soon = stamps[k + 1:]
    for window in (50, 100, 1000):
        count = int(((soon >= resumed) & (soon < resumed + window * PERIOD)).sum())
        print(f'  ticks stamped in the first {window} ms: {count}')
    model = float(listener.report['model']['model time [s]'])
    print(f'  model time {model:.3f} s for {int(after["ticks"])} ticks of 1 ms: continuous')


def main():
    """Run both and print them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--speak', nargs=2, type=float, help=argparse.SUPPRESS)
    parser.add_argument('--seconds', type=float, default=10.0, help='of flood (%(default)s)')
    parser.add_argument('--rate', type=float, default=10_000.0, help='of the flood, Hz')
    arguments = parser.parse_args()
    if arguments.speak:
        speak(*arguments.speak)
        return
    with tempfile.TemporaryDirectory() as folder:
        twin = subprocess.Popen(
            [sys.executable, '-m', 'hpv_twin', 'twin', '--ros-args', '-p',
             f'record_directory:={folder}'], start_new_session=True)
        rclpy.init()
        listener = Listener()
        try:
            listener.fresh(3)
            flood(listener, arguments.rate, arguments.seconds)
            stand_still(listener, twin, 5.0)
        finally:
            os.killpg(twin.pid, signal.SIGCONT)
            os.killpg(twin.pid, signal.SIGINT)
            print(f'twin ended with {twin.wait(30)}')
            rclpy.try_shutdown()


if __name__ == '__main__':
    main()
