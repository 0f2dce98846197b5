"""
The twin at its defaults for a minute: rate, lateness, processor share, and its recording.

    python bench/node_rate.py [--seconds 60] [--rate 1000]

Three processes run side by side: the twin (1 kHz, recording), one subscriber to both waveforms,
and a bare sleep loop at the same rate, whose lateness is that of the machine itself. Afterwards the
recording is read with three libraries and compared with what was published.
"""
import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('ROS_DOMAIN_ID', '91')

import numpy as np
import psutil

START_UP = 60.0  # s for the twin to compile and start


def bare_loop(seconds: float, rate: float) -> None:
    """Sleep to absolute deadlines and print p50, p99 and max lateness, ms."""
    period = 1.0 / rate
    due = time.monotonic() + period
    late = []
    while len(late) < seconds * rate:
        delay = due - time.monotonic()
        if delay > 0:
            time.sleep(delay)
            continue
        late.append(time.monotonic() - due)
        due += period
    print(*np.percentile(np.array(late) * 1e3, (50, 99, 100)))


def subscriber(seconds: float) -> None:
    """Receive both waveforms, and print counts and gaps of the stamps per topic."""
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.executors import SingleThreadedExecutor
    from sensor_msgs.msg import FluidPressure, JointState

    rclpy.init()
    node = rclpy.create_node('bench_subscriber')
    stamps, reports, pressure, position = ([], []), [], [], []

    def note(index, values, value):
        def receive(message):
            stamp = message.header.stamp
            stamps[index].append(stamp.sec * 1_000_000_000 + stamp.nanosec)
            values.append(value(message))
        return receive
    node.create_subscription(FluidPressure, '/hpv_twin/pressure',
                             note(0, pressure, lambda m: m.fluid_pressure), 2000)
    node.create_subscription(JointState, '/hpv_twin/plunger_position',
                             note(1, position, lambda m: m.position[0]), 2000)
    node.create_subscription(DiagnosticArray, '/diagnostics', reports.append, 10)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    for name, times in zip(('pressure', 'plunger_position'), stamps, strict=True):
        steps = np.diff(times)
        rate = (len(times) - 1) / (times[-1] - times[0]) * 1e9
        print(f'received {name}: {len(times)}, {rate:.2f} Hz by stamp; steps 1 ms +- 1 us: '
              f'{np.mean(abs(steps - 1e6) <= 1000):.6f}, longest {steps.max() / 1e6:.3f} ms')
    gauge = np.array(pressure[-5000:]) - 101_325.0
    times = np.array(stamps[0][-5000:]) * 1e-9 - stamps[0][-5000] * 1e-9
    k = np.nonzero((gauge[1:] >= 8e6) & (gauge[:-1] < 8e6))[0]
    rises = times[k] + (8e6 - gauge[k]) / (gauge[k + 1] - gauge[k]) * (times[k + 1] - times[k])
    print(f'last 5 s as received: {1 / np.diff(rises).mean():.3f} Hz, highest '
          f'{gauge.max() * 1e-6:.3f} MPa gauge, stroke {max(position[-5000:]) * 1e3:.3f} mm')
    for status in reports[-1].status:
        if status.name.endswith('timing'):
            for pair in status.values:
                print(f'twin, {pair.key}: {pair.value}')


def read_back(path: Path) -> None:
    """Read a recording with every library at hand and compare the counts."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory
    from rosbags.highlevel import AnyReader

    with open(path, 'rb') as file:
        counts, stamps = {}, {}
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            stamps.setdefault(channel.topic, []).append(message.log_time)
    with open(path, 'rb') as file:
        decoded = sum(1 for _ in make_reader(
            file, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
    with AnyReader([path]) as reader:
        bags = 0
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            bags += 1
    print(f'recording: {path.stat().st_size / 1e6:.2f} MB; messages read: mcap '
          f'{sum(counts.values())}, mcap-ros2-support decodes {decoded}, rosbags decodes {bags}')
    for topic in ('/hpv_twin/pressure', '/hpv_twin/plunger_position'):
        missing = np.round(np.diff(stamps[topic]) / 1e6).astype(int) - 1
        print(f'recorded {topic}: {counts[topic]}, missing by stamp: {missing.sum()}')
    try:
        from rerun.chunk import McapReader
    except ImportError:
        return
    rows = sum(chunk.num_rows for chunk in McapReader(str(path)).stream().to_chunks()
               if str(chunk.entity_path) == '/hpv_twin/pressure')
    print(f'rerun reads {rows} rows of /hpv_twin/pressure')


def main() -> None:
    """Run the three processes and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--seconds', type=float, default=60.0)
    parser.add_argument('--rate', type=float, default=1000.0)
    parser.add_argument('--part', choices=('bare', 'subscriber'), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.part == 'bare':
        return bare_loop(arguments.seconds, arguments.rate)
    if arguments.part == 'subscriber':
        return subscriber(arguments.seconds)
    with tempfile.TemporaryDirectory() as folder:
        measure(arguments.seconds, arguments.rate, Path(folder))


def measure(seconds: float, rate: float, folder: Path) -> None:
    """Start everything, wait, and report."""
    twin = subprocess.Popen(
        [sys.executable, '-m', 'hpv_twin', 'twin', '--ros-args', '-p',
         f'record_directory:={folder}', '-p', f'publish_rate:={rate}'], start_new_session=True)
    end = time.monotonic() + START_UP
    while not list(folder.glob('*.mcap')) and time.monotonic() < end:
        time.sleep(0.1)
    time.sleep(2.0)
    this = [sys.executable, __file__, '--seconds', str(seconds), '--rate', str(rate), '--part']
    process = psutil.Process(twin.pid)
    before, began = process.cpu_times(), time.monotonic()
    parts = [subprocess.Popen([*this, part], stdout=subprocess.PIPE, text=True)
             for part in ('bare', 'subscriber')]
    bare, heard = (part.communicate()[0] for part in parts)
    after, took = process.cpu_times(), time.monotonic() - began
    os.killpg(twin.pid, signal.SIGINT)
    print(f'twin ended with {twin.wait(20)}')
    share = (after.user + after.system - before.user - before.system) / took
    p50, p99, most = map(float, bare.split())
    print(heard, end='')
    print(f'bare sleep loop, lateness p50 {p50:.3f}, p99 {p99:.3f}, max {most:.3f} ms')
    print(f'twin, processor: {100 * share:.1f} % of a core')
    for path in sorted(folder.glob('*.mcap')):
        read_back(path)


if __name__ == '__main__':
    main()
