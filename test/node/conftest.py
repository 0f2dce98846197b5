"""Real twins in processes of their own, and an ear on their topics; all on this machine alone."""
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

# Before rclpy is imported: a domain of our own, nothing on the network.
os.environ['ROS_DOMAIN_ID'] = str(random.Random(os.getpid()).randint(1, 100))
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'

import pytest

DEADLINE = 30.0
ROOT = Path(__file__).parents[2]


class TwinProcess:
    """`hpv-twin twin` in a process group of its own, with what it says in a file."""

    def __init__(self, folder, *parameters, command=('twin',), ros=()):
        self.folder = Path(folder)
        self.log_path = self.folder / 'twin.log'
        arguments = ['-p', f'record_directory:={self.folder / "bags"}']
        for parameter in parameters:
            arguments += ['-p', parameter]
        environment = dict(os.environ, PYTHONUNBUFFERED='1')
        with open(self.log_path, 'w') as log:
            self.process = subprocess.Popen(
                [sys.executable, '-m', 'hpv_twin', *command, '--ros-args', *arguments, *ros],
                stdout=log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
                start_new_session=True, env=environment, cwd=self.folder)

    @property
    def log(self):
        return self.log_path.read_text()

    @property
    def recordings(self):
        return sorted((self.folder / 'bags').glob('*.mcap'))

    def signal(self, number):
        os.killpg(self.process.pid, number)

    def wait(self, timeout=DEADLINE):
        return self.process.wait(timeout)

    def stop(self):
        """End the twin as Ctrl-C does; its exit code."""
        if self.process.poll() is None:
            self.signal(signal.SIGINT)
        try:
            return self.wait(10)
        finally:
            if self.process.poll() is None:
                self.signal(signal.SIGKILL)
                self.process.wait(10)


@pytest.fixture
def start_twin(tmp_path):
    """Start twins; those left running at the end of the test are ended."""
    started = []

    def start(*parameters, **more):
        folder = tmp_path / f'twin_{len(started)}'
        folder.mkdir()
        started.append(TwinProcess(folder, *parameters, **more))
        return started[-1]
    yield start
    for twin in started:
        twin.stop()


class Ear:
    """A node that listens, speaks and waits for conditions."""

    def __init__(self, context):
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        self.node = rclpy.create_node('ear', context=context)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.heard = {}

    def listen(self, kind, topic, latched=False):
        """Keep every message of a topic, in the list returned."""
        from rclpy.qos import DurabilityPolicy, QoSProfile
        qos = QoSProfile(depth=2000)
        if latched:
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
        messages = self.heard.setdefault(topic, [])
        self.node.create_subscription(kind, topic, messages.append, qos)
        return messages

    def until(self, condition, what, deadline=DEADLINE):
        """Spin until `condition()`; fail after the deadline, saying what was waited for."""
        end = time.monotonic() + deadline
        while not condition():
            assert time.monotonic() < end, f'waited {deadline} s for {what}'
            self.executor.spin_once(timeout_sec=0.02)

    def spin(self, seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)

    def say(self, topic, value):
        """Publish a Float64 once somebody listens."""
        from std_msgs.msg import Float64
        publisher = self.node.create_publisher(Float64, topic, 10)
        self.until(lambda: publisher.get_subscription_count() > 0, f'a listener on {topic}')
        publisher.publish(Float64(data=value))

    def call(self, kind, name, request=None):
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready, f'service {name}')
        future = client.call_async(request or kind.Request())
        self.until(future.done, f'an answer of {name}')
        return future.result()


@pytest.fixture
def ear():
    rclpy = pytest.importorskip('rclpy')
    context = rclpy.Context()
    rclpy.init(context=context)
    ear = Ear(context)
    yield ear
    ear.executor.shutdown()
    ear.node.destroy_node()
    context.try_shutdown()
