"""
How soon a setpoint acts: until it is in force, and until the frequency is what the model says.

    python bench/setpoint_response.py [--times 20]

A twin runs in another process. Setpoints go out at random moments; the latched topics tell when
they are in force (two ways through DDS included), the frequency topic when the machine follows.
"""
import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('ROS_DOMAIN_ID', '92')

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Float64

from hpv_twin.model import Simulation, find_cycles

DEADLINE = 60.0  # s
SAME = 1e-3  # relative difference of frequencies that counts as equal


class Client:
    """Publishes setpoints and remembers when what was heard."""

    def __init__(self):
        self.node = rclpy.create_node('setpoint_response')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.heard = {}
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        for name, qos in (('pump_flow', latched), ('preload', latched), ('frequency', 100)):
            self.node.create_subscription(
                Float64, f'/hpv_twin/{name}',
                lambda m, name=name: self.heard.update({name: (m.data, time.monotonic())}), qos)
        self.node.create_subscription(DiagnosticArray, '/diagnostics',
                                      lambda m: self.heard.update(diagnostics=m), 10)
        self.out = {name: self.node.create_publisher(Float64, f'/hpv_twin/{name}_setpoint', 1)
                    for name in ('pump_flow', 'preload')}

    def until(self, condition):
        """Spin until the condition holds; the time it took to, s."""
        began = time.monotonic()
        while not condition():
            if time.monotonic() - began > DEADLINE:
                raise TimeoutError(f'the twin does not answer; heard {self.heard}')
            self.executor.spin_once(timeout_sec=0.01)
        return time.monotonic() - began

    def value(self, name):
        """What was last heard on a topic."""
        return self.heard.get(name, (np.nan, 0.0))[0]


def expected(flow, preload):
    """Settled frequency of the model, Hz."""
    simulation = Simulation()
    simulation.pump_flow, simulation.preload = flow, preload
    return find_cycles(simulation.advance(1.0, sample_rate=10)).frequency[-1]


def measure(client, times):
    """Send `times` setpoints of each kind and print what they took."""
    client.until(lambda: len(client.heard) == 4)
    state = {'pump_flow': client.value('pump_flow'), 'preload': client.value('preload')}
    took = {'pump_flow': [], 'preload': []}
    followed = {'pump_flow': [], 'preload': []}
    for k in range(2 * times):
        name = ('pump_flow', 'preload')[k % 2]
        state[name] = {'pump_flow': (3.65e-4, 7.3e-4), 'preload': (4e-3, 5.2e-3)}[name][k // 2 % 2]
        wanted = expected(**{'flow': state['pump_flow'], 'preload': state['preload']})
        end = time.monotonic() + random.uniform(0.3, 0.5)
        client.until(lambda end=end: time.monotonic() > end)
        client.out[name].publish(Float64(data=state[name]))
        sent = time.monotonic()
        client.until(lambda name=name: client.value(name) == state[name])
        took[name].append(time.monotonic() - sent)
        client.until(lambda wanted=wanted: abs(client.value('frequency') / wanted - 1.0) < SAME)
        followed[name].append(time.monotonic() - sent)
    for name in took:
        ms = 1e3 * np.array(took[name])
        print(f'{name}: in force and heard of after {np.median(ms):.2f} ms (median), '
              f'{ms.max():.2f} ms (longest of {len(ms)}); frequency as the model says after '
              f'{1e3 * np.median(followed[name]):.0f} ms, longest '
              f'{1e3 * max(followed[name]):.0f} ms')


def refuse(client):
    """Send nonsense and print that nothing changes."""
    before = {name: client.value(name) for name in ('pump_flow', 'preload')}
    frequency = client.value('frequency')
    for value in (np.nan, np.inf, -1.0, 1.0):
        for publisher in client.out.values():
            publisher.publish(Float64(data=value))
        end = time.monotonic() + 0.3
        client.until(lambda end=end: time.monotonic() > end)
    same = all(client.value(name) == before[name] for name in before)
    print(f'NaN, infinity, -1 and 1 refused: setpoints unchanged {same}, frequency '
          f'{frequency:.4f} and {client.value("frequency"):.4f} Hz')
    end = time.monotonic() + 1.2
    client.until(lambda: time.monotonic() > end)
    for status in client.heard['diagnostics'].status:
        if status.name.endswith('inputs'):
            for pair in status.values:
                print(f'  {pair.key}: {pair.value}')


def main():
    """Start a twin, measure, end it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--times', type=int, default=20)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        twin = subprocess.Popen(
            [sys.executable, '-m', 'hpv_twin', 'twin', '--ros-args', '-p',
             f'record_directory:={folder}'], start_new_session=True)
        rclpy.init()
        try:
            client = Client()
            measure(client, arguments.times)
            refuse(client)
        finally:
            os.killpg(twin.pid, signal.SIGINT)
            print(f'twin ended with {twin.wait(20)}')


if __name__ == '__main__':
    main()
